//! What identification found out besides the model: order, rejected readings, rank, correlations.
//!
//! Place in the flow: filled by [`crate::solve`], shown by reports and `--json`. SI.

use crate::design::Setup;
use crate::range_correlation::RangeCorrelation;
use crate::smoothing::Solution;
use abbe_geometry::ErrorId;
use abbe_measurement::campaign::Campaign;
use faer::Mat;

/// A reading whose weight fell to zero.
#[derive(Debug, Clone, PartialEq)]
pub struct RejectedReading {
    /// Number of the reading, from 1.
    pub reading: usize,
    /// Its station.
    pub station: String,
    /// Its line.
    pub line: String,
    /// Measured minus predicted length (m).
    pub residual_m: f64,
    /// Residual in units of the robust standard deviation.
    pub standardised: f64,
}

/// How many degrees of freedom the data gave one error function.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorEvidence {
    /// ISO 230-1 name.
    pub name: String,
    /// Free coefficients.
    pub coefficients: usize,
    /// Effective degrees of freedom, at most the number of coefficients.
    pub effective: f64,
    /// Penalty λ of the curvature; `None` where the order was not chosen by a penalty.
    pub penalty: Option<f64>,
}

/// One station's share.
#[derive(Debug, Clone, PartialEq)]
pub struct StationEvidence {
    /// Name.
    pub name: String,
    /// Readings from it.
    pub readings: usize,
    /// Rms of its residuals, rejected ones left out (m).
    pub residual_rms_m: f64,
    /// Standard uncertainty of its x, y, z and dead path (m).
    pub u_m: [f64; 4],
}

/// Two quantities that the data hardly tell apart.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrelatedPair {
    /// First name.
    pub first: String,
    /// Second name.
    pub second: String,
    /// Correlation of largest magnitude between them.
    pub correlation: f64,
}

/// How the noise is correlated, where the data show that it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorrelatedNoise {
    /// Its parameters.
    pub correlation: RangeCorrelation,
    /// Correlation of readings that follow one another on a line.
    pub neighbours: f64,
    /// How many independent readings would tell as much of what neighbours have in common.
    pub effective_readings: f64,
}

impl CorrelatedNoise {
    pub(crate) fn of(correlation: &RangeCorrelation, campaign: &Campaign, weights: &[f64]) -> CorrelatedNoise {
        CorrelatedNoise {
            correlation: *correlation,
            neighbours: correlation.of_neighbours(campaign),
            effective_readings: correlation.effective_readings(campaign, weights),
        }
    }
}

/// What the fit says about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// Passes over the readings.
    pub passes: usize,
    /// Last step, in units of the parameters' uncertainty.
    pub largest_step: f64,
    /// Unknowns that were free.
    pub unknowns: usize,
    /// Effective number of parameters.
    pub effective_unknowns: f64,
    /// χ² per degree of freedom with the declared uncertainties.
    pub chi2_per_dof: f64,
    /// −2 log of the restricted marginal likelihood, up to a constant of data and weights: compares orders on the same
    /// weights ([`crate::minus_two_log_likelihood_on`]); smaller is better.
    pub minus_two_log_likelihood: f64,
    /// Robust standard deviation of the residuals in units of the declared one.
    pub robust_scale: f64,
    /// Rank of the plan for low-order errors and stations, equal to `low_order_unknowns` where the fit was accepted.
    pub rank: usize,
    /// Low-order unknowns.
    pub low_order_unknowns: usize,
    /// Condition number of the equilibrated low-order problem.
    pub condition: f64,
    /// Order of each error function.
    pub errors: Vec<ErrorEvidence>,
    /// Stations.
    pub stations: Vec<StationEvidence>,
    /// Correlations of magnitude above 0.9.
    pub correlated: Vec<CorrelatedPair>,
    /// How the noise is correlated; `None` where it is white for all that the data say.
    pub noise: Option<CorrelatedNoise>,
    /// Rejected readings.
    pub rejected: Vec<RejectedReading>,
    /// Why a fit with finer splines, which the data asked for, came to nothing; this one is the fit without them.
    pub refinement_given_up: Option<String>,
}

/// Magnitude from which a correlation is reported.
const REPORTED_CORRELATION: f64 = 0.9;
/// Positions, as shares of the stroke, at which error functions are compared.
const LOOK_AT: [f64; 4] = [0.25, 0.5, 0.75, 1.0];

/// Pairs of errors, angles, effects and stations whose largest correlation exceeds 0.9.
pub(crate) fn correlated(
    setup: &Setup,
    solution: &Solution,
    free: &[usize],
    stations: &[String],
) -> Vec<CorrelatedPair> {
    let views = views(setup, free, stations);
    let weights = Mat::from_fn(views.len(), free.len(), |i, j| views[i].1[j]);
    let covariance = &weights * &solution.covariance * weights.transpose();
    let mut pairs: Vec<CorrelatedPair> = Vec::new();
    for i in 0..views.len() {
        for j in 0..i {
            let spread = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
            let correlation = covariance[(i, j)] / spread;
            if views[i].0 == views[j].0 || !(spread > 0.0 && correlation.abs() > REPORTED_CORRELATION) {
                continue;
            }
            match pairs.iter_mut().find(|p| p.first == views[j].0 && p.second == views[i].0) {
                Some(pair) if pair.correlation.abs() < correlation.abs() => pair.correlation = correlation,
                Some(_) => {}
                None => {
                    pairs.push(CorrelatedPair { first: views[j].0.clone(), second: views[i].0.clone(), correlation })
                }
            }
        }
    }
    pairs.sort_by(|a, b| b.correlation.abs().total_cmp(&a.correlation.abs()));
    pairs
}

/// Named linear functions of the free parameters: error values at a few positions, angles, effects, stations.
fn views(setup: &Setup, free: &[usize], stations: &[String]) -> Vec<(String, Vec<f64>)> {
    let size = setup.machine_parameters() + 4 * stations.len();
    let mut place = vec![None; size];
    free.iter().enumerate().for_each(|(k, index)| place[*index] = Some(k));
    let mut views = Vec::new();
    let mut push = |name: String, entries: &[(usize, f64)]| {
        let mut weights = vec![0.0; free.len()];
        entries.iter().for_each(|(index, value)| {
            if let Some(k) = place[*index] {
                weights[k] = *value;
            }
        });
        views.push((name, weights));
    };
    for id in ErrorId::all() {
        let Some(basis) = setup.layout.basis(id) else { continue };
        let (lower, upper) = basis.stroke_m();
        for share in LOOK_AT {
            let local = basis.at(lower + share * (upper - lower));
            let first = setup.layout.range(id).start + local.first;
            let entries: Vec<_> = local.values().iter().enumerate().map(|(k, v)| (first + k, *v)).collect();
            push(id.name(), &entries);
        }
    }
    for (entry, index) in setup.machine.squareness.iter().zip(setup.layout.squareness()) {
        push(entry.name.clone(), &[(index, 1.0)]);
    }
    for (letter, index) in ['A', 'B', 'C'].into_iter().zip(setup.layout.ram_turn()) {
        push(format!("ram turn {letter}"), &[(index, 1.0)]);
    }
    let mut index = setup.layout.len();
    for term in setup.terms {
        for parameter in term.effect.parameters() {
            push(format!("{} {}", term.effect.name(), parameter.name), &[(index, 1.0)]);
            index += 1;
        }
    }
    for (k, station) in stations.iter().enumerate() {
        for (d, what) in ["x", "y", "z", "dead path"].into_iter().enumerate() {
            push(format!("{station} {what}"), &[(setup.machine_parameters() + 4 * k + d, 1.0)]);
        }
    }
    views
}
