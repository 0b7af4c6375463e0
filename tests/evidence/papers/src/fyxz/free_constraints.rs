//! Is Abbe's identification the paper's problem? Unknowns, rank defect, and the solution with the paper's own constraints.
//!
//! Place in the flow: the first figures of the paper. Here the errors are free at *every* node and the stations are free, as
//! in the paper's J (eq. 6); the constraints are rows of B (eq. 7), stacked below (eq. 8). Abbe instead leaves the constrained
//! nodes out of its basis. Ranges in m, all of one weight; SI throughout.

use super::setup::{Experiment, NODES, UNSEEN, failed};
use crate::figure::PaperError;
use abbe_geometry::chain::{ErrorValues, chain_point};
use abbe_geometry::{Axis, ErrorId, Vector3};
use nalgebra::{DMatrix, DVector};

/// Eigenvalue of JᵀJ, scaled to a unit diagonal, below which a combination of unknowns moves no range: rounding leaves
/// 1e-14, what is seen at all 1e-7.
const UNSEEN_EIGENVALUE: f64 = 1e-11;
/// Gauss-Newton steps; the third already changes nothing.
const STEPS: usize = 6;

/// Unknowns without constraints, in order: nodes of each error, squareness, stations.
pub(super) struct Free<'a> {
    experiment: &'a Experiment,
    errors: Vec<ErrorId>,
}

/// What was counted and solved.
pub(super) struct Solved {
    /// Unknowns before any constraint.
    pub(super) unknowns: usize,
    /// Combinations that the ranges do not see.
    pub(super) defect: usize,
    /// Rows of B.
    pub(super) constraints: usize,
    /// Combinations not seen once the constraints are stacked below.
    pub(super) defect_with_constraints: usize,
    /// Value of every error at every node (m, rad), by error in order, origin included.
    pub(super) nodes: Vec<(ErrorId, Vec<f64>)>,
    /// C0Y, B0Z, A0Z (rad).
    pub(super) squareness: Vec<f64>,
}

impl<'a> Free<'a> {
    pub(super) fn new(experiment: &'a Experiment) -> Free<'a> {
        let seen = |id: &ErrorId| !UNSEEN.contains(&id.name().as_str());
        Free { experiment, errors: ErrorId::all().filter(seen).collect() }
    }

    fn unknowns(&self) -> usize {
        self.errors.len() * NODES as usize + 3 + 3 * self.experiment.stations_m.len()
    }

    fn node_value(&self, unknowns: &[f64], error: usize, reading_m: f64) -> f64 {
        let (first, share) = self.piece(error, reading_m);
        (1.0 - share) * unknowns[first] + share * unknowns[first + 1]
    }

    /// Place of the node below a reading, and how far towards the next one it lies (0 to 1).
    fn piece(&self, error: usize, reading_m: f64) -> (usize, f64) {
        let (lower_m, upper_m) = self.experiment.machine.stroke_m[self.errors[error].axis().index()];
        let at = (reading_m - lower_m) / (upper_m - lower_m) * f64::from(NODES - 1);
        let below = (at.floor() as usize).min(NODES as usize - 2);
        (error * NODES as usize + below, at - below as f64)
    }

    /// Partials of each range by every unknown (m per unit), and measured minus predicted range (m).
    fn rows(&self, unknowns: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let readings = &self.experiment.campaign.readings;
        let mut jacobian = DMatrix::zeros(readings.len(), self.unknowns());
        let mut right = DVector::zeros(readings.len());
        let squareness = self.errors.len() * NODES as usize;
        for (row, reading) in readings.iter().enumerate() {
            let mut values = ErrorValues::ZERO;
            for (k, id) in self.errors.iter().enumerate() {
                values.errors[id.index()] = self.node_value(unknowns, k, reading.reading_m[id.axis().index()]);
            }
            values.squareness.copy_from_slice(&unknowns[squareness..squareness + 3]);
            let point = chain_point(&self.experiment.machine, reading.reading_m, [0.0; 3], &values);
            let first = squareness + 3 + 3 * reading.station as usize;
            let station_m = Vector3::new(unknowns[first], unknowns[first + 1], unknowns[first + 2]);
            let line_m = point.position_m - station_m;
            let ray = line_m / line_m.norm();
            right[row] = reading.length_m - line_m.norm();
            for (k, id) in self.errors.iter().enumerate() {
                let along = ray.dot(&point.by_error[id.index()]);
                let (below, share) = self.piece(k, reading.reading_m[id.axis().index()]);
                jacobian[(row, below)] = along * (1.0 - share);
                jacobian[(row, below + 1)] = along * share;
            }
            for (k, column) in point.by_squareness.iter().enumerate() {
                jacobian[(row, squareness + k)] = ray.dot(column);
            }
            (0..3).for_each(|d| jacobian[(row, first + d)] = -ray[d]);
        }
        (jacobian, right)
    }

    /// Nodes that the constraints hold at zero: every origin, and the far end of every straightness.
    fn constrained(&self) -> Vec<usize> {
        let nodes = NODES as usize;
        let of = |(k, id): (usize, &ErrorId)| {
            let far_end = id.is_straightness().then_some(k * nodes + nodes - 1);
            std::iter::once(k * nodes).chain(far_end)
        };
        self.errors.iter().enumerate().flat_map(of).collect()
    }

    /// Least squares of J d = F and B d = 0 together (eq. 8), from the true stations and a perfect machine.
    pub(super) fn solve(&self) -> Result<Solved, PaperError> {
        let mut unknowns = vec![0.0; self.unknowns()];
        let first = unknowns.len() - 3 * self.experiment.stations_m.len();
        for (k, station_m) in self.experiment.stations_m.iter().enumerate() {
            unknowns[first + 3 * k..first + 3 * k + 3].copy_from_slice(station_m.as_slice());
        }
        let constrained = self.constrained();
        let (jacobian, _) = self.rows(&unknowns);
        let free = jacobian.tr_mul(&jacobian);
        let with_constraints = stacked(&free, &constrained);
        let (defect, defect_with_constraints) = (unseen(&free), unseen(&with_constraints));
        for _ in 0..STEPS {
            let (jacobian, right) = self.rows(&unknowns);
            let matrix = stacked(&jacobian.tr_mul(&jacobian), &constrained);
            // The rows of B ask that the sum of what is there and the step be zero.
            let mut gradient = jacobian.tr_mul(&right);
            constrained.iter().for_each(|k| gradient[*k] -= unknowns[*k]);
            let step = matrix.cholesky().ok_or_else(|| failed("eq. 8 is singular"))?.solve(&gradient);
            unknowns.iter_mut().zip(step.iter()).for_each(|(value, change)| *value += change);
        }
        let nodes = NODES as usize;
        let curve = |(k, id): (usize, &ErrorId)| (*id, unknowns[k * nodes..(k + 1) * nodes].to_vec());
        Ok(Solved {
            unknowns: unknowns.len(),
            defect,
            constraints: constrained.len(),
            defect_with_constraints,
            nodes: self.errors.iter().enumerate().map(curve).collect(),
            squareness: unknowns[self.errors.len() * nodes..first].to_vec(),
        })
    }
}

/// JᵀJ + BᵀB, where B has a one for each constrained unknown.
fn stacked(normal: &DMatrix<f64>, constrained: &[usize]) -> DMatrix<f64> {
    let mut matrix = normal.clone();
    constrained.iter().for_each(|k| matrix[(*k, *k)] += 1.0);
    matrix
}

/// Combinations that a normal matrix does not see.
fn unseen(normal: &DMatrix<f64>) -> usize {
    let scale = |k: usize| normal[(k, k)].max(f64::MIN_POSITIVE).sqrt();
    let scaled = DMatrix::from_fn(normal.nrows(), normal.ncols(), |i, j| normal[(i, j)] / (scale(i) * scale(j)));
    scaled.symmetric_eigenvalues().iter().filter(|value| **value < UNSEEN_EIGENVALUE).count()
}

/// Combinations that ranges between stations and points alone do not see: six, the motions of everything together.
pub(super) fn defect_of_the_network(experiment: &Experiment) -> usize {
    let (targets, of_readings) = experiment.targets();
    let stations = experiment.stations_m.len();
    let mut jacobian = DMatrix::zeros(of_readings.len(), 3 * (stations + targets.len()));
    for (row, (reading, target)) in experiment.campaign.readings.iter().zip(&of_readings).enumerate() {
        let line_m = Vector3::from(targets[*target]) - experiment.stations_m[reading.station as usize];
        let ray = line_m / line_m.norm();
        for axis in Axis::ALL {
            let d = axis.index();
            jacobian[(row, 3 * reading.station as usize + d)] = -ray[d];
            jacobian[(row, 3 * (stations + target) + d)] = ray[d];
        }
    }
    unseen(&jacobian.tr_mul(&jacobian))
}
