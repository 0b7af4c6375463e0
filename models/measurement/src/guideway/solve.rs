//! Least squares of one position against the lowest.
//!
//! Place in the flow: called by [`super::Guideway::new`] for each position. Rows are whitened with the covariance of the
//! difference of the two points of a target, where all are declared.

use super::check::{Run, Seen, common, spread};
use super::{Guideway, GuidewayError, GuidewayOptions, GuidewayRotation, PositionErrors};
use crate::chance::beyond;
use crate::claim::Claim;
use crate::least_squares;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Rotation3, UnitQuaternion, Vector3, Vector6};
use statrs::distribution::{ChiSquared, FisherSnedecor};

const MOST_PASSES: usize = 50;
/// Step of the rotation (rad) from which an exact solution counts as settled.
const SETTLED_RAD: f64 = 1e-14;
/// Probability below which the residual of one position is no chance, and its uncertainties are its own.
const CHANCE: f64 = 1e-3;

/// A target in the machine frame: about the reference point at the lowest position, and displaced.
pub(super) struct Arm {
    pub(super) start_m: Vector3<f64>,
    here_m: Vector3<f64>,
    /// W with WᵀW the inverse covariance of the difference (1/m); the identity where none is declared.
    whitening: Matrix3<f64>,
}

pub(super) fn all(
    runs: &[Run],
    machine_from_points: Rotation3<f64>,
    options: GuidewayOptions,
) -> Result<Guideway, GuidewayError> {
    let solver = Solver::new(runs, machine_from_points, options);
    let lowest = solver.lowest;
    let solved = runs[1..].iter().map(|run| solver.position(run)).collect::<Result<Vec<_>, _>>()?;
    let degrees: usize = solved.iter().map(|one| one.degrees).sum();
    let square_m2: f64 = solved.iter().map(|one| one.square_m2).sum();
    // Three targets leave three degrees of freedom at each position, so there always are some.
    let scatter_m = (square_m2 / degrees as f64).sqrt();
    let chi2_per_dof = solved.iter().map(|one| one.chi2).sum::<f64>() / degrees as f64;
    let worth = independent(degrees, solved.len());
    let claim = match solver.is_declared {
        true => Claim::declared(chi2_per_dof, worth),
        false => {
            Claim::estimated(worth).ok_or(GuidewayError::TooFew { position_mm: lowest.position_mm(), count: 0 })?
        }
    };
    let noise = Noise { chi2: chi2_per_dof * degrees as f64, degrees, positions: solved.len(), claim };
    let zero = PositionErrors {
        position_m: lowest.position_m,
        errors: Vector6::zeros(),
        covariance: None,
        widening: None,
        targets: lowest.targets.len(),
        residual_rms_m: 0.0,
    };
    let finish = |one: Solved| {
        let variance = noise.variance_of(&one);
        let widening = Some((variance / noise.unwidened()).sqrt());
        PositionErrors { covariance: Some(one.cofactor * variance), widening, ..one.errors }
    };
    let spreads = runs.iter().map(|run| spread(&run.targets.values().map(|s| s.point_m).collect::<Vec<_>>()).0);
    Ok(Guideway {
        options,
        machine_from_points,
        reference_m: solver.reference_m,
        spread_ratio: spreads.fold(f64::INFINITY, f64::min),
        chi2_per_dof: solver.is_declared.then_some(chi2_per_dof),
        positions: std::iter::once(zero).chain(solved.into_iter().map(finish)).collect(),
        scatter_m,
        claim,
    })
}

/// How many independent degrees of freedom tell as much of the noise. All positions are held against the lowest, so that differences
/// of two positions correlate by one half: of J positions Σλ² of their correlations is J + J·(J − 1)/4 where it would be J
/// (Satterthwaite 1946).
pub(super) fn independent(degrees: usize, positions: usize) -> usize {
    (4 * degrees / (positions + 3)).max(1)
}

/// Noise of all positions together: in units of the declared one, or in m².
struct Noise {
    chi2: f64,
    degrees: usize,
    positions: usize,
    claim: Claim,
}

impl Noise {
    /// What the covariances would be computed with if nothing were widened.
    fn unwidened(&self) -> f64 {
        if self.claim.is_declared { 1.0 } else { self.chi2 / self.degrees as f64 }
    }

    /// What the covariance of a position is computed with. A gross reading that three targets cannot name shows in the residual
    /// of its own position; shared with all others it would be thinned out.
    fn variance_of(&self, one: &Solved) -> f64 {
        let all = self.unwidened() * self.claim.variance();
        match Claim::estimated(one.degrees) {
            Some(own) if self.by_chance(one) < CHANCE => all.max(one.chi2 / one.degrees as f64 * own.variance()),
            _ => all,
        }
    }

    /// Probability that the residual of a position is as large if its noise is that of the others, or the declared one where that is
    /// larger.
    fn by_chance(&self, one: &Solved) -> f64 {
        let others = self.degrees - one.degrees;
        let own = one.chi2 / one.degrees as f64;
        let floor = if self.claim.is_declared { 1.0 } else { 0.0 };
        if others == 0 {
            // Nothing to compare an undeclared noise with.
            return ChiSquared::new(one.degrees as f64)
                .map_or(1.0, |law| if floor > 0.0 { beyond(&law, one.chi2) } else { 1.0 });
        }
        let expected = ((self.chi2 - one.chi2).max(0.0) / others as f64).max(floor);
        let worth = independent(others, self.positions - 1) as f64;
        FisherSnedecor::new(one.degrees as f64, worth).map_or(1.0, |law| beyond(&law, own / expected))
    }
}

/// One position before the noise is known.
pub(super) struct Solved {
    errors: PositionErrors,
    cofactor: Matrix6<f64>,
    pub(super) degrees: usize,
    square_m2: f64,
    /// In units of the declared covariances, otherwise in m².
    pub(super) chi2: f64,
}

pub(super) struct Solver<'a> {
    lowest: &'a Run<'a>,
    machine_from_points: Rotation3<f64>,
    pub(super) reference_m: Vector3<f64>,
    options: GuidewayOptions,
    pub(super) is_declared: bool,
}

impl<'a> Solver<'a> {
    pub(super) fn new(
        runs: &'a [Run<'a>],
        machine_from_points: Rotation3<f64>,
        options: GuidewayOptions,
    ) -> Solver<'a> {
        let lowest = &runs[0];
        let centroid =
            || lowest.targets.values().map(|seen| seen.point_m).sum::<Vector3<f64>>() / lowest.targets.len() as f64;
        let reference_m = options.reference_m.unwrap_or_else(centroid);
        let is_declared = runs.iter().flat_map(|run| run.targets.values()).all(|seen| seen.covariance_m2.is_some());
        Solver { lowest, machine_from_points, reference_m, options, is_declared }
    }

    /// Targets that a run has in common with the lowest position.
    pub(super) fn arms(&self, run: &Run) -> Vec<Arm> {
        let moved_m = self.options.axis.unit() * (run.position_m - self.lowest.position_m);
        common(self.lowest, run).map(|(_, first, here)| self.arm(first, here, &moved_m)).collect()
    }

    fn position(&self, run: &Run) -> Result<Solved, GuidewayError> {
        self.solved(run, &self.arms(run).iter().collect::<Vec<_>>())
    }

    /// The errors of a run by these of its targets.
    pub(super) fn solved(&self, run: &Run, arms: &[&Arm]) -> Result<Solved, GuidewayError> {
        let position_mm = run.position_mm();
        let (translation_m, rotation, cofactor) = match self.options.rotation {
            GuidewayRotation::SmallAngle => small_angle(arms).ok_or(GuidewayError::Undetermined { position_mm })?,
            GuidewayRotation::Exact => exact(arms, position_mm)?,
        };
        let (mut square_m2, mut chi2) = (0.0, 0.0);
        for arm in arms {
            let residual_m = self.residual_m(arm, translation_m, rotation);
            square_m2 += residual_m.norm_squared();
            chi2 += (arm.whitening * residual_m).norm_squared();
        }
        let errors = PositionErrors {
            position_m: run.position_m,
            errors: Vector6::new(translation_m.x, translation_m.y, translation_m.z, rotation.x, rotation.y, rotation.z),
            covariance: None,
            widening: None,
            targets: arms.len(),
            residual_rms_m: (square_m2 / (3 * arms.len()) as f64).sqrt(),
        };
        Ok(Solved { errors, cofactor, degrees: 3 * arms.len() - 6, square_m2, chi2 })
    }

    fn residual_m(&self, arm: &Arm, translation_m: Vector3<f64>, rotation: Vector3<f64>) -> Vector3<f64> {
        match self.options.rotation {
            GuidewayRotation::SmallAngle => arm.here_m - arm.start_m - translation_m - rotation.cross(&arm.start_m),
            GuidewayRotation::Exact => arm.here_m - translation_m - Rotation3::new(rotation) * arm.start_m,
        }
    }

    /// How far a target is off where these others put it (m); `None` where they do not determine the errors.
    pub(super) fn off_m(&self, run: &Run, arms: &[&Arm], target: &Arm) -> Option<Vector3<f64>> {
        let errors = self.solved(run, arms).ok()?.errors.errors;
        let three = |k: usize| errors.fixed_rows::<3>(k).into_owned();
        Some(self.residual_m(target, three(0), three(3)))
    }

    /// `moved_m` is the indicated motion; what remains of the target's motion is error.
    fn arm(&self, first: Seen, here: Seen, moved_m: &Vector3<f64>) -> Arm {
        let turn = self.machine_from_points;
        // Each is brought from where it was read to the position of its run.
        let along = self.options.axis.unit();
        let start_m = turn * (first.point_m - self.reference_m) - along * first.beyond_m;
        let here_m = turn * (here.point_m - self.reference_m) - along * here.beyond_m - moved_m;
        let whitening = match (first.covariance_m2, here.covariance_m2) {
            (Some(first), Some(here)) if self.is_declared => whitening(&(turn * (first + here) * turn.inverse())),
            _ => Matrix3::identity(),
        };
        Arm { start_m, here_m, whitening }
    }
}

/// L⁻¹ of C = L·Lᵀ; sums of covariances that were checked have one.
pub(super) fn whitening(covariance_m2: &Matrix3<f64>) -> Matrix3<f64> {
    covariance_m2.cholesky().and_then(|factor| factor.l().try_inverse()).unwrap_or_else(Matrix3::identity)
}

/// \[I, −\[p\]×\], whitened: how Δ depends on δ and ε (eq. 9).
pub(super) fn design<'a>(arms: impl ExactSizeIterator<Item = (&'a Vector3<f64>, &'a Matrix3<f64>)>) -> DMatrix<f64> {
    let mut matrix = DMatrix::zeros(3 * arms.len(), 6);
    for (i, (arm_m, whitening)) in arms.enumerate() {
        matrix.view_mut((3 * i, 0), (3, 3)).copy_from(whitening);
        matrix.view_mut((3 * i, 3), (3, 3)).copy_from(&(whitening * -arm_m.cross_matrix()));
    }
    matrix
}

type Six = (Vector3<f64>, Vector3<f64>, Matrix6<f64>);

fn small_angle(arms: &[&Arm]) -> Option<Six> {
    step(arms, |arm| (arm.start_m, arm.here_m - arm.start_m))
}

/// One linear solution: `of` gives the lever and the displacement of an arm.
fn step(arms: &[&Arm], of: impl Fn(&Arm) -> (Vector3<f64>, Vector3<f64>)) -> Option<Six> {
    let (levers, displacements): (Vec<_>, Vec<_>) = arms.iter().map(|arm| of(arm)).unzip();
    let matrix = design(levers.iter().zip(arms.iter().map(|arm| &arm.whitening)));
    let mut right = DVector::zeros(3 * arms.len());
    for (i, (arm, displacement)) in arms.iter().zip(&displacements).enumerate() {
        right.fixed_rows_mut::<3>(3 * i).copy_from(&(arm.whitening * displacement));
    }
    let found = least_squares::solve(&matrix, &right).ok()?;
    let three = |k: usize| found.unknowns.fixed_rows::<3>(k).into_owned();
    Some((three(0), three(3), Matrix6::from_fn(|i, j| found.cofactor[(i, j)])))
}

/// Gauss-Newton on the rotation itself; the covariance is that of small turns about the solution.
fn exact(arms: &[&Arm], position_mm: f64) -> Result<Six, GuidewayError> {
    let (mut turn, mut translation_m) = (Rotation3::identity(), Vector3::zeros());
    for _ in 0..MOST_PASSES {
        let at = |arm: &Arm| {
            let turned = turn * arm.start_m;
            (turned, arm.here_m - turned - translation_m)
        };
        let (shift_m, angles, cofactor) = step(arms, at).ok_or(GuidewayError::Undetermined { position_mm })?;
        translation_m += shift_m;
        turn = Rotation3::new(angles) * turn;
        if angles.norm() < SETTLED_RAD {
            // By way of the quaternion: the arc cosine of the trace would lose half the digits of small angles.
            let angles = UnitQuaternion::from_rotation_matrix(&turn).scaled_axis();
            return Ok((translation_m, angles, cofactor));
        }
    }
    Err(GuidewayError::NotSettled { position_mm })
}
