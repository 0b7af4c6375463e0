//! The vector field of residuals from ranges of stations that measured different points.
//!
//! Place in the flow: model and campaign in, residual vectors at measured points with covariance out. A single range
//! tells the residual along its line of sight only. Neighbouring readings from other stations see other components, and
//! how far "neighbouring" reaches is what the data themselves say ([`crate::search`]): a Gaussian process for each
//! component, seen through the lines of sight, beside what the model's own parameters could still move (universal
//! kriging with the geometric model as trend). Where nothing looked, the covariance stays that of the prior, and a
//! component of which nothing is known is not claimed. Residual = actual − corrected = J_tip δ + r(p) (m, machine frame).
//! Source: as in [`crate::evidence`]; eq. 2.41-2.42 for mean and covariance.

use crate::evidence::{Factored, FieldPrior};
use crate::problem::Problem;
use crate::search::search;
use crate::{PointResidual, ResidualError};
use abbe_geometry::model::MachineModel;
use abbe_identify::in_parallel;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_measurement::subset::spread;
use faer::Mat;
use faer::linalg::solvers::Solve;
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeSet;

/// Evidence that a field needs: gain of twice the log likelihood less ln n for each of its numbers, as for an effect.
const LEAST_EVIDENCE: f64 = 10.0;
/// Numbers that a field has beyond noise: three sizes, three lengths.
const FIELD_NUMBERS: f64 = 6.0;
/// Share of the field's own standard deviation from which a component counts as not seen.
const NOT_SEEN: f64 = 0.9;
/// Points nearer than this are one place of the field (m): another reading there adds no place to estimate it at, and files
/// round to a tenth of a micrometre.
const SAME_PLACE_M: f64 = 2e-6;
/// Points solved for side by side: a fixed number, so that results do not depend on the number of threads.
const CHUNK: usize = 64;

/// How much work is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeOptions {
    /// Readings that the search for size and smoothness uses at most.
    pub search_readings: usize,
    /// Readings that the estimate uses at most: cost grows with the cube.
    pub readings: usize,
    /// Points to estimate at, at most, taken evenly from the measured ones.
    pub points: usize,
}

impl Default for RangeOptions {
    fn default() -> RangeOptions {
        RangeOptions { search_readings: 700, readings: 2400, points: 1000 }
    }
}

/// What is being done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// So many priors were tried.
    Searching(usize),
    /// The field is being factored and evaluated.
    Estimating,
}

/// Residual vectors and what they rest on.
#[derive(Debug, Clone)]
pub struct FromRanges {
    /// At measured points; those of which no component was seen are left out.
    pub points: Vec<PointResidual>,
    /// Points that were left out because no component was seen.
    pub unseen_points: usize,
    /// Components (of all three at the points given) that count as not seen: their standard uncertainty is at least nine
    /// tenths of the field's own size.
    pub unseen_components: usize,
    /// Size and smoothness that the ranges asked for.
    pub prior: FieldPrior,
    /// Gain of twice the log likelihood less what the field's numbers cost.
    pub evidence: f64,
    /// Noise over declared noise without any field.
    pub noise_without: f64,
    /// Readings used and left out as outliers.
    pub readings: (usize, usize),
}

/// Estimates residual vectors from the ranges of a campaign; `own` says that the model was identified from it.
///
/// # Errors
/// Stations or covariates that do not fit, too few readings, and ranges that show no field: nothing is made up.
pub fn from_ranges(
    model: &MachineModel,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    own: bool,
    options: &RangeOptions,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<FromRanges, ResidualError> {
    let all = Problem::new(model, instrument, campaign, own)?;
    let problem = all.thinned(options.readings.max(1));
    let few = problem.thinned(options.search_readings.max(1));
    let (prior, none) = search(&few, &mut |count| observe(Progress::Searching(count)))?;
    if !observe(Progress::Estimating) {
        return Err(ResidualError::Stopped);
    }
    let factored = Factored::new(&problem, &prior)?;
    let without = Factored::new(&problem, &none)?.minus_two_log_likelihood;
    let evidence = without - factored.minus_two_log_likelihood - FIELD_NUMBERS * (problem.len() as f64).ln();
    if evidence < LEAST_EVIDENCE {
        return Err(ResidualError::NothingThere { evidence, least: LEAST_EVIDENCE, noise: none.noise });
    }
    let field = Field { problem: &problem, prior: &prior, factored: &factored };
    let chosen = places(&problem.points_m, options.points.max(1));
    let chunks: Vec<&[usize]> = chosen.chunks(CHUNK).collect();
    let estimated = in_parallel(&chunks, |rows| field.at(rows)).concat();
    let count = estimated.len();
    let seen = |estimate: &PointResidual| unseen_components(estimate, &prior) < 3;
    let points: Vec<PointResidual> = estimated.into_iter().filter(seen).collect();
    if points.is_empty() {
        let used: BTreeSet<u32> = problem.stations.iter().copied().collect();
        return Err(ResidualError::Unseen {
            readings: problem.len(),
            stations: used.len(),
            amplitude_um: prior.amplitude_m.into_iter().fold(0.0, f64::max) * 1e6,
            noise: prior.noise,
            without: none.noise,
        });
    }
    Ok(FromRanges {
        unseen_points: count - points.len(),
        unseen_components: points.iter().map(|point| unseen_components(point, &prior)).sum(),
        points,
        prior,
        evidence,
        noise_without: none.noise,
        readings: (problem.len(), all.rejected),
    })
}

/// At most so many points, spread over all, each place once.
fn places(points_m: &[Vector3<f64>], most: usize) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    for row in spread(points_m.len(), most) {
        if chosen.iter().all(|other| (points_m[*other] - points_m[row]).norm() >= SAME_PLACE_M) {
            chosen.push(row);
        }
    }
    chosen
}

/// Components of a point of which its ranges tell next to nothing.
fn unseen_components(estimate: &PointResidual, prior: &FieldPrior) -> usize {
    let Some(covariance_m2) = estimate.covariance_m2 else { return 0 };
    (0..3).filter(|d| covariance_m2[(*d, *d)].sqrt() >= NOT_SEEN * prior.amplitude_m[*d]).count()
}

struct Field<'a> {
    problem: &'a Problem,
    prior: &'a FieldPrior,
    factored: &'a Factored,
}

impl Field<'_> {
    /// Residual vectors at the points of these rows.
    fn at(&self, rows: &[usize]) -> Vec<PointResidual> {
        let (count, problem) = (self.problem.len(), self.problem);
        let mut seen = Mat::zeros(count, 3 * rows.len());
        for (place, row) in rows.iter().enumerate() {
            for k in 0..count {
                let covariance = self.prior.seen_by(problem, k, &problem.points_m[*row]);
                (0..3).for_each(|d| seen[(k, 3 * place + d)] = covariance[d]);
            }
        }
        let solved = self.factored.rows.solve(&seen);
        // What the model's own parameters move at the points beyond what the field already follows of them.
        let followed = problem.jacobian.transpose() * &solved;
        let lever = Mat::from_fn(followed.nrows(), followed.ncols(), |parameter, column| {
            problem.tips[rows[column / 3]][(column % 3, parameter)] - followed[(parameter, column)]
        });
        let spread = self.factored.trend.solve(&lever);
        let mean = seen.transpose() * &self.factored.weights;
        rows.iter()
            .enumerate()
            .map(|(place, row)| {
                let dot = |a: &Mat<f64>, i: usize, b: &Mat<f64>, j: usize| -> f64 {
                    a.col(3 * place + i).iter().zip(b.col(3 * place + j).iter()).map(|(x, y)| x * y).sum()
                };
                let tip = &problem.tips[*row] * &self.factored.change;
                let own = |i: usize, j: usize| if i == j { self.prior.amplitude_m[i].powi(2) } else { 0.0 };
                let covariance =
                    Matrix3::from_fn(|i, j| own(i, j) - dot(&seen, i, &solved, j) + dot(&lever, i, &spread, j));
                PointResidual {
                    row: problem.readings[*row],
                    point_m: problem.points_m[*row],
                    residual_m: Vector3::from_fn(|d, _| mean[(3 * place + d, 0)] + tip[(d, 0)]),
                    covariance_m2: Some((covariance + covariance.transpose()) * 0.5),
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_that_was_measured_twice_is_one_place() {
        let at = |x_m: f64| Vector3::new(x_m, 0.3, 0.1);
        assert_eq!(places(&[at(0.1), at(0.2), at(0.1 + 1e-6), at(0.1 + 3e-6)], 4), [0, 1, 3]);
        let two = places(&[at(0.1), at(0.2), at(0.3), at(0.4)], 2);
        assert!(two.len() == 2 && two[0] < 2 && two[1] >= 2, "{two:?}");
    }
}
