//! From a minimum to a model and what the fit says about itself.
//!
//! Place in the flow: the last step of [`super::fit_points`]; nothing is estimated here any more.

use super::PointsError;
use super::certificate::{Certificate, widening};
use super::levenberg_marquardt::Descent;
use super::problem::Problem;
use crate::observability::Observability;
use abbe_geometry::model::{FitQuality, IdentifiedVolume, MachineModel, ModelParts};
use abbe_geometry::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// A model from measured positions, and what was found out on the way.
#[derive(Debug)]
pub struct FittedPoints {
    /// The model, ready to correct; it knows no station.
    pub model: MachineModel,
    /// Where the frame of the instrument lies; of a plate, in its first pose.
    pub pose: Pose,
    /// What the points cannot tell, held at zero: only of plates, anywhere else it is refused.
    pub not_seen: Vec<NotSeen>,
    /// What the fit says about itself.
    pub evidence: PointEvidence,
    /// Measured minus predicted position of every point (m, measuring frame turned into the machine's).
    pub residuals_m: Vec<Vector3<f64>>,
    /// Weight of every point, 0 for rejected ones.
    pub weights: Vec<f64>,
}

/// Pose of the measuring frame: point in machine = turn · measured + shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation from the measuring frame to the machine frame.
    pub machine_from_measured: Matrix3<f64>,
    /// Origin of the measuring frame (m, machine frame).
    pub origin_m: Vector3<f64>,
}

/// An error that the points of a plate cannot tell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NotSeen {
    /// ISO 230-1 name.
    pub name: String,
    /// Why, in words.
    pub because: String,
}

/// A point that the fit did not use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RejectedPoint {
    /// Number of the point, from 1.
    pub point: usize,
    /// Distance between measured and predicted position (m).
    pub distance_m: f64,
}

/// What the fit says about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct PointEvidence {
    /// Unknowns: coefficients, squareness angles, three of the turn of the ram, six of the measuring frame.
    pub unknowns: usize,
    /// Unknowns that the data determine: fewer where a penalty holds functions smooth.
    pub effective: f64,
    /// Rank of the problem, equal to the unknowns where the fit was accepted.
    pub rank: usize,
    /// Condition number of the problem with columns of unit length.
    pub condition: f64,
    /// Steps or generations to the minimum.
    pub steps: usize,
    /// Evaluations of the objective, where the way counts them (JADE).
    pub evaluations: Option<usize>,
    /// Value of the objective at the minimum of the loss.
    pub objective: f64,
    /// Largest component of a Newton step from the result, in standard uncertainties: 0 at an exact minimum.
    pub largest_step: f64,
    /// χ² per degree of freedom with the declared uncertainties, over the points used.
    pub chi2_per_dof: f64,
    /// Robust standard deviation of the residuals in units of the declared one.
    pub robust_scale: f64,
    /// Bayesian information criterion of the weighted residuals; compares degrees, smaller is better.
    pub bic: f64,
    /// Largest distance between measured and predicted position of the points used (m).
    pub largest_residual_m: f64,
    /// Points not used.
    pub rejected: Vec<RejectedPoint>,
}

/// What the search handed over.
pub(super) struct Minimised {
    pub(super) descent: Descent,
    pub(super) certificate: Certificate,
    pub(super) seen: Observability,
    /// Value of the loss, steps and evaluations of the search.
    pub(super) search: (f64, usize, Option<usize>),
}

pub(super) fn finish(problem: &Problem, found: Minimised) -> Result<FittedPoints, PointsError> {
    let Minimised { descent, certificate, seen, search: (objective, steps, evaluations) } = found;
    let unknowns = &descent.unknowns;
    let residuals_m: Vec<Vector3<f64>> = (0..problem.points.len()).map(|k| problem.residual_m(k, unknowns)).collect();
    let rejected: Vec<RejectedPoint> = (0..residuals_m.len())
        .filter(|k| descent.weights[*k] == 0.0)
        .map(|k| RejectedPoint { point: k + 1, distance_m: residuals_m[k].norm() })
        .collect();
    let used = || residuals_m.iter().zip(&descent.weights).filter(|(_, w)| **w > 0.0).map(|(r, _)| r.norm());
    let count = residuals_m.len() - rejected.len();
    let square: f64 = used().map(|d| d * d).sum();
    let equations = problem.dimensions() as f64 * descent.weights.iter().sum::<f64>();
    let free = certificate.effective;
    let degrees = (equations - free).max(1.0);
    let chi2 = certificate.chi2_per_dof * degrees;
    let evidence = PointEvidence {
        unknowns: problem.free(),
        effective: free,
        rank: seen.rank,
        condition: seen.condition,
        steps,
        evaluations,
        objective,
        largest_step: certificate.largest_step,
        chi2_per_dof: certificate.chi2_per_dof,
        robust_scale: problem.scale(unknowns),
        bic: equations * (chi2 / equations).ln() + free * equations.ln(),
        largest_residual_m: used().fold(0.0, f64::max),
        rejected,
    };
    let quality = FitQuality {
        readings: count,
        rejected: residuals_m.len() - count,
        chi2_per_dof: certificate.chi2_per_dof,
        residual_rms_m: (square / count.max(1) as f64).sqrt(),
        unexplained_m: [FitQuality::unexplained_of(certificate.chi2_per_dof, square, degrees); 3],
        wanders: None,
        unseen_expansions: Default::default(),
    };
    let geometric = problem.layout.len();
    let scale = widening(certificate.chi2_per_dof);
    let triangle = (0..geometric).flat_map(|i| (0..=i).map(move |j| (i, j)));
    // The pose of the measuring frame is marginalised: its rows are left out of the inverse, not of the normal matrix.
    let covariance: Vec<f64> = triangle.map(|(i, j)| certificate.inverse[(i, j)] * scale).collect();
    let parts = ModelParts {
        machine: problem.machine.clone(),
        coefficients: unknowns[..geometric].to_vec(),
        offset_centre_m: problem.layout.offset_centre_m(),
        effects: Vec::new(),
        stations: Vec::new(),
        chord_covariance: problem.chord_covariance(unknowns, &descent.weights, (&certificate.inverse, &covariance)),
        covariance,
        identified: volume(problem, &descent.weights),
        quality,
    };
    let pose = pose(problem, unknowns);
    let (model, not_seen) = (MachineModel::new(parts)?, Vec::new());
    Ok(FittedPoints { model, pose, not_seen, evidence, residuals_m, weights: descent.weights })
}

fn pose(problem: &Problem, unknowns: &[f64]) -> Pose {
    let (frame, aligned) = (problem.frame(unknowns, 0), &problem.alignments[0]);
    let back = frame.turn.transpose();
    let machine_from_measured = back * aligned.rotation;
    // q = middle + turnᵀ (aligned − middle − shift), aligned = to + R (P − from), to = middle.
    let origin_m = frame.middle_m - back * (frame.shift_m + aligned.rotation * aligned.from_m);
    Pose { machine_from_measured, origin_m }
}

fn volume(problem: &Problem, weights: &[f64]) -> IdentifiedVolume {
    let mut reading_m = [(f64::INFINITY, f64::NEG_INFINITY); 3];
    let mut offset_m = reading_m;
    for (point, _) in problem.points.iter().zip(weights).filter(|(_, weight)| **weight > 0.0) {
        for d in 0..3 {
            let widen = |(low, high): (f64, f64), value: f64| (low.min(value), high.max(value));
            reading_m[d] = widen(reading_m[d], point.reading_m[d]);
            offset_m[d] = widen(offset_m[d], point.offset_m[d]);
        }
    }
    IdentifiedVolume { reading_m, offset_m, covariates: BTreeMap::new(), differences: Vec::new() }
}
