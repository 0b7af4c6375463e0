//! The fit itself: rows, constraint on the beam's length, covariance.
//!
//! Place in the flow: called by [`super::ProbePose::fit`] once the centres are checked. Unknowns in the order S0, R_p, T_p,
//! axis offset. Residuals of the centres of one pose share what the model lacks there, so the covariance is
//! N⁻¹·(Σ Mᵀ·V·M)·N⁻¹ with V = σ_within²·I + σ_between²·(the same in all centres of a pose), both from the data
//! (components of variance, as for a split plot: Montgomery, Design and Analysis of Experiments, chapter 14).

use super::design::{c_in_machine, centre_rows, head_in_machine};
use super::same::{at_mean_angles, poses};
use super::{BeamLength, ProbePose, ProbePoseError, ProbePoseModel, Scatter, SphereCentre, Undetermined};
use crate::claim::Claim;
use crate::least_squares::{self, Solution};
use nalgebra::{DMatrix, DVector, Matrix3x2, Vector3};

const MOST_PASSES: usize = 50;
/// Step of the direction (rad) from which the constrained fit counts as settled.
const SETTLED: f64 = 1e-14;

pub(super) fn fit(centres: &[SphereCentre], model: ProbePoseModel) -> Result<ProbePose, ProbePoseError> {
    let (matrix, right) = rows(centres, model);
    let free = least_squares::solve(&matrix, &right)
        .map_err(|deficient| Undetermined::new(centres, matrix.ncols(), deficient.rank, &deficient.free))?;
    let (unknowns, tangent) = match model.beam {
        BeamLength::Free => (free.unknowns, DMatrix::identity(matrix.ncols(), matrix.ncols())),
        BeamLength::One => of_length_one(&matrix, &right, free)?,
    };
    Ok(outcome(centres, model, &matrix, &right, unknowns, &tangent))
}

/// Whitened by the declared uncertainties where all are; otherwise in metres.
fn rows(centres: &[SphereCentre], model: ProbePoseModel) -> (DMatrix<f64>, DVector<f64>) {
    let unknowns = if model.axis_offset { 10 } else { 9 };
    let mut matrix = DMatrix::zeros(3 * centres.len(), unknowns);
    let mut right = DVector::zeros(3 * centres.len());
    let weight = weights(centres);
    for (i, centre) in centres.iter().enumerate() {
        let head = head_in_machine(centre.a_rad, centre.c_rad);
        matrix.view_mut((3 * i, 0), (3, 9)).copy_from(&(centre_rows(&head, centre.distance_m) * weight[i]));
        if model.axis_offset {
            matrix.view_mut((3 * i, 9), (3, 1)).copy_from(&(c_in_machine(centre.c_rad).column(1) * -weight[i]));
        }
        (0..3).for_each(|d| right[3 * i + d] = centre.centre_m[d] * weight[i]);
    }
    (matrix, right)
}

/// 1/u (1/m) where every centre declares u, otherwise 1.
fn weights(centres: &[SphereCentre]) -> Vec<f64> {
    let declared: Option<Vec<f64>> = centres.iter().map(|c| c.u_m.map(f64::recip)).collect();
    declared.unwrap_or_else(|| vec![1.0; centres.len()])
}

/// Gauss-Newton on the sphere of directions; the columns of the result's matrix span what may still change.
fn of_length_one(
    matrix: &DMatrix<f64>,
    right: &DVector<f64>,
    start: Solution,
) -> Result<(DVector<f64>, DMatrix<f64>), ProbePoseError> {
    let mut unknowns = start.unknowns;
    for _ in 0..MOST_PASSES {
        let direction = unknowns.fixed_rows::<3>(3).normalize();
        unknowns.fixed_rows_mut::<3>(3).copy_from(&direction);
        let tangent = tangent(&direction, matrix.ncols());
        let found = least_squares::solve(&(matrix * &tangent), &(right - matrix * &unknowns))
            .map_err(|_| ProbePoseError::NotSettled(MOST_PASSES))?;
        let step = &tangent * &found.unknowns;
        unknowns += &step;
        if step.fixed_rows::<3>(3).norm() < SETTLED {
            let direction = unknowns.fixed_rows::<3>(3).normalize();
            unknowns.fixed_rows_mut::<3>(3).copy_from(&direction);
            return Ok((unknowns, tangent));
        }
    }
    Err(ProbePoseError::NotSettled(MOST_PASSES))
}

/// Identity with the three columns of R_p replaced by two across it.
fn tangent(direction: &Vector3<f64>, unknowns: usize) -> DMatrix<f64> {
    let least = direction.iamin();
    let first = direction.cross(&Vector3::ith(least, 1.0)).normalize();
    let across = Matrix3x2::from_columns(&[first, direction.cross(&first)]);
    let mut tangent = DMatrix::zeros(unknowns, unknowns - 1);
    for k in 0..3 {
        tangent[(k, k)] = 1.0;
    }
    tangent.view_mut((3, 3), (3, 2)).copy_from(&across);
    for k in 6..unknowns {
        tangent[(k, k - 1)] = 1.0;
    }
    tangent
}

fn outcome(
    centres: &[SphereCentre],
    model: ProbePoseModel,
    matrix: &DMatrix<f64>,
    right: &DVector<f64>,
    unknowns: DVector<f64>,
    tangent: &DMatrix<f64>,
) -> ProbePose {
    let weight = weights(centres);
    let whitened = right - matrix * &unknowns;
    let free = matrix * tangent;
    let of_poses = self::rows(&at_mean_angles(centres), model).0 * tangent;
    let rows = Rows { centres, matrix: &free, of_poses: &of_poses, residuals: &whitened };
    // Rank was shown before: the same design, or one with a column less.
    let (cofactor, condition) = least_squares::solve(&free, right)
        .map_or_else(|_| (None, f64::INFINITY), |found| (Some(found.cofactor), found.condition));
    let is_declared = centres.iter().all(|centre| centre.u_m.is_some());
    let components = rows.components();
    let claim = rows.claim(&components, is_declared);
    let covariance = cofactor.zip(claim).map(|(cofactor, claim)| {
        let covariance = rows.covariance(&cofactor, &components) * claim.variance();
        tangent * covariance * tangent.transpose()
    });
    let three = |k: usize| Vector3::new(unknowns[k], unknowns[k + 1], unknowns[k + 2]);
    // Components are in units of the declared uncertainties where those are declared.
    let unit_m = (weight.iter().map(|w| w * w).sum::<f64>() / weight.len() as f64).sqrt().recip();
    let dof = rows.degrees();
    ProbePose {
        model,
        centre_m: three(0),
        direction: three(3),
        zero_m: three(6),
        axis_offset_m: model.axis_offset.then(|| unknowns[9]),
        residuals_m: (0..centres.len()).map(|i| whitened.fixed_rows::<3>(3 * i) / weight[i]).collect(),
        degrees_of_freedom: dof,
        condition,
        scatter: Scatter {
            within_m: components.within.map(|v| v.sqrt() * unit_m),
            between_m: components.between.map(|v| v.sqrt() * unit_m),
            chi2_per_dof: (is_declared && dof > 0).then(|| whitened.norm_squared() / dof as f64),
            chi2_per_dof_within: components
                .within
                .filter(|_| is_declared)
                .map(|within| (within, components.degrees_within)),
        },
        covariance,
        claim,
    }
}

/// Variances of the whitened residuals.
struct Components {
    within: Option<f64>,
    between: Option<f64>,
    /// All together, where the two cannot be told apart.
    pooled: Option<f64>,
    degrees_within: usize,
    degrees_between: usize,
}

struct Rows<'a> {
    centres: &'a [SphereCentre],
    matrix: &'a DMatrix<f64>,
    /// The same at the mean angles of the poses: what differs within a pose by how nearly its angles were met tells nothing.
    of_poses: &'a DMatrix<f64>,
    residuals: &'a DVector<f64>,
}

impl Rows<'_> {
    fn degrees(&self) -> usize {
        self.matrix.nrows().saturating_sub(self.matrix.ncols())
    }

    /// Rows less the mean over the centres of their pose.
    fn within_poses(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let mut centred = rows.clone();
        for group in poses(self.centres) {
            let mean = self.sum(rows, &group) / group.len() as f64;
            for i in group {
                let own = rows.rows(3 * i, 3) - &mean;
                centred.rows_mut(3 * i, 3).copy_from(&own);
            }
        }
        centred
    }

    fn sum(&self, rows: &DMatrix<f64>, group: &[usize]) -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(3, rows.ncols());
        group.iter().for_each(|i| sum += rows.rows(3 * i, 3));
        sum
    }

    fn components(&self) -> Components {
        let count = poses(self.centres).len();
        let repeats = 3 * (self.centres.len() - count);
        let residuals = DMatrix::from_column_slice(self.residuals.len(), 1, self.residuals.as_slice());
        let square_within = self.within_poses(&residuals).norm_squared();
        let square = residuals.norm_squared();
        let degrees_within = repeats.saturating_sub(rank(&self.within_poses(self.of_poses), self.of_poses));
        let degrees_between = self.degrees().saturating_sub(degrees_within);
        let within = (degrees_within > 0).then(|| square_within / degrees_within as f64);
        let mean_size = self.centres.len() as f64 / count.max(1) as f64;
        let between = within.filter(|_| degrees_between > 0).map(|within| {
            // A negative estimate says that the scatter within explains everything: the component is zero.
            (((square - square_within) / degrees_between as f64 - within) / mean_size).max(0.0)
        });
        let pooled = (within.is_none() && self.degrees() > 0).then(|| square / self.degrees() as f64);
        Components { within, between, pooled, degrees_within, degrees_between }
    }

    /// What the covariance rests on; `None` where neither the scatter nor a declaration gives one.
    fn claim(&self, components: &Components, is_declared: bool) -> Option<Claim> {
        match (components.within, components.between, components.pooled) {
            // What poses have in common decides wherever there is any, and is known from fewer degrees.
            (Some(_), Some(between), _) if between > 0.0 => Claim::estimated(components.degrees_between),
            (Some(_), Some(_), _) => Claim::estimated(components.degrees_within),
            (_, _, Some(_)) => Claim::estimated(self.degrees()),
            (Some(within), None, _) if is_declared => Some(Claim::declared(within, components.degrees_within)),
            _ if is_declared => Some(Claim::declared(0.0, 0)),
            _ => None,
        }
    }

    /// Covariance of the free unknowns, not yet widened; of the declared uncertainties where the scatter gives none.
    fn covariance(&self, cofactor: &DMatrix<f64>, components: &Components) -> DMatrix<f64> {
        let (within, between) = match (components.within, components.between, components.pooled) {
            (Some(within), Some(between), _) => (within, between),
            (_, _, Some(pooled)) => (pooled, 0.0),
            _ => (1.0, 0.0),
        };
        let mut middle = self.matrix.transpose() * self.matrix * within;
        for group in poses(self.centres) {
            let sum = self.sum(self.matrix, &group);
            middle += sum.transpose() * sum * between;
        }
        cofactor * middle * cofactor
    }
}

/// Rank of `part`, a difference of rows of `whole`: what rounding leaves of a column counts as zero.
fn rank(part: &DMatrix<f64>, whole: &DMatrix<f64>) -> usize {
    let scaled = DMatrix::from_fn(part.nrows(), part.ncols(), |i, j| part[(i, j)] / whole.column(j).norm());
    scaled.singular_values().iter().filter(|value| **value > least_squares::DEPENDENT).count()
}
