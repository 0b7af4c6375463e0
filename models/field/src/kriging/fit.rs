//! Fit of one component: scaling, starts, the maximum of the likelihood.
//!
//! Place in the flow: one call a component from [`super::Kriging::fit`]. Several starts on a part of the points, the best
//! of them refined on all: the likelihood may have more than one maximum, and its cost grows with the third power.

use super::bounded::{self, Minimum, Start};
use super::likelihood::{Data, Scaled};
use super::posterior;
use super::process::{Process, Scaling};
use super::{COMPONENTS, FittedComponent, Hyperparameters, KrigingError, KrigingOptions, Noise};
use crate::samples::Samples;
use nalgebra::Vector3;

/// Points on which the starts are tried.
const FIRST_POINTS: usize = 160;
/// Bounds of a length scale in extents of its input: from a fiftieth to twenty-fold.
const LENGTH: (f64, f64) = (0.02, 20.0);
/// Bounds of the signal's deviation, in deviations of the errors; the upper one is that of a field of which the volume shows
/// but a small part.
const SIGNAL: (f64, f64) = (1e-3, 3e1);
/// Bounds of the fitted noise, in deviations of the errors; the lower one, nanometres, is below what any instrument leaves, and
/// with the signal's upper one keeps the condition of a covariance within what double precision can factor.
const NOISE: (f64, f64) = (1e-3, 1e1);
/// Starts: length scale in extents, and noise in deviations of the errors.
const STARTS: [(f64, f64); 3] = [(1.0, 0.1), (0.25, 0.1), (4.0, 0.5)];
/// Length scale at the start of inputs beyond the first three, in extents; none: that of the others. One that says nothing must not hide
/// what the first three, the position, say without it.
const FURTHER: [Option<f64>; 2] = [None, Some(10.0)];
/// Gain in −2 L below which the parameters have settled: far below what a difference in likelihood means.
const GAIN: f64 = 1e-3;
/// Difference in −2 L that no conclusion would rest on.
const NO_MATTER: f64 = 0.1;
/// Steps at most.
const MOST_STEPS: usize = 200;
/// Relative deviation of the errors below which they are all the same.
const SAME: f64 = 1e-12;
/// How near to a bound is at it, in the logarithm.
const AT_BOUND: f64 = 1e-6;
/// Fractional part of the golden ratio: its multiples fill an interval evenly.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Fits one component.
pub(crate) fn fit(
    samples: &Samples,
    component: usize,
    options: &KrigingOptions,
) -> Result<(Process, FittedComponent), KrigingError> {
    let (data, scaling) = scaled(samples, component, options)?;
    let bounds = bounds(options, data.size);
    let found = likeliest(&data, &bounds, component, Weigh::Likelihood)?;
    let at_bound = at_bound(&found.at, &bounds, samples.names());
    let parameters = Scaled::from_logarithms(&found.at, data.size);
    finish(data, scaling, &parameters, at_bound, component)
}

/// What the parameters of a component are weighed by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Weigh {
    /// By what the points say alone.
    Likelihood,
    /// By that and what is assumed before.
    Posterior,
}

/// The likeliest logarithms of parameters.
pub(super) fn likeliest(
    data: &Data,
    bounds: &[(f64, f64)],
    component: usize,
    weigh: Weigh,
) -> Result<Minimum, KrigingError> {
    let mut found = first_fit(data, bounds, component, weigh)?;
    if data.values.len() > FIRST_POINTS {
        // The curvature of a likelihood grows with the points.
        let share = FIRST_POINTS as f64 / data.values.len() as f64;
        let start = Start { at: &found.at, inverse: found.inverse.map(|inverse| inverse * share) };
        found = maximum(data, start, bounds, weigh).ok_or(not_positive(component))?;
    }
    if !found.is_settled {
        return Err(KrigingError::NotConverged { component: COMPONENTS[component], steps: found.steps });
    }
    Ok(found)
}

/// The component at given parameters.
pub(crate) fn with(
    samples: &Samples,
    component: usize,
    options: &KrigingOptions,
    parameters: &Hyperparameters,
) -> Result<(Process, FittedComponent), KrigingError> {
    let (data, scaling) = scaled(samples, component, options)?;
    let named =
        parameters.length.iter().map(|length| (*length, "a length scale")).chain([(parameters.signal_m, "the signal")]);
    let noise = parameters.noise_m.map(|noise| (noise, "the noise"));
    if let Some((_, what)) = named.chain(noise).find(|(value, _)| !(value.is_finite() && *value > 0.0)) {
        return Err(KrigingError::Parameter { component: COMPONENTS[component], what });
    }
    let parameters = Scaled {
        signal: parameters.signal_m / scaling.deviation_m,
        length: parameters.length.iter().zip(&scaling.extent).map(|(length, extent)| length / extent).collect(),
        noise: parameters.noise_m.map(|noise| noise / scaling.deviation_m),
    };
    finish(data, scaling, &parameters, Vec::new(), component)
}

fn finish(
    data: Data,
    scaling: Scaling,
    parameters: &Scaled,
    at_bound: Vec<String>,
    component: usize,
) -> Result<(Process, FittedComponent), KrigingError> {
    let factored = data.factored(parameters).map_err(|_| not_positive(component))?;
    let freedom = (data.values.len() - factored.coefficients.len()) as f64;
    let two_pi = 2.0 * std::f64::consts::PI;
    // The density of errors in metres, not in deviations.
    let log_likelihood = -0.5 * (factored.minus_two_log + freedom * (two_pi.ln() + 2.0 * scaling.deviation_m.ln()));
    let hyperparameters = Hyperparameters {
        length: parameters.length.iter().zip(&scaling.extent).map(|(length, extent)| length * extent).collect(),
        signal_m: parameters.signal * scaling.deviation_m,
        noise_m: parameters.noise.map(|noise| noise * scaling.deviation_m),
    };
    let fitted = FittedComponent { hyperparameters, log_likelihood, at_bound };
    Ok((Process::new(data, scaling, parameters.clone(), factored), fitted))
}

/// Inputs in extents about their middle, errors in deviations.
pub(super) fn scaled(
    samples: &Samples,
    component: usize,
    options: &KrigingOptions,
) -> Result<(Data, Scaling), KrigingError> {
    let (lower, upper) = samples.range();
    let values: Vec<f64> = samples.errors_m().iter().map(|e| e[component]).collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
    let largest = values.iter().fold(0.0_f64, |largest, v| largest.max(v.abs()));
    let normal = samples.normal();
    let mut extent: Vec<f64> = lower.iter().zip(&upper).map(|(lower, upper)| upper - lower).collect();
    // Across a plane nothing differs: any length will do.
    let largest_extent = extent.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    normal.into_iter().for_each(|axis| extent[axis] = largest_extent);
    let middle = lower.iter().zip(&upper).map(|(lower, upper)| (lower + upper) / 2.0).collect();
    let scaling = Scaling { middle, extent, deviation_m: square.sqrt() };
    if scaling.deviation_m <= SAME * largest {
        return Err(KrigingError::Constant { component: COMPONENTS[component] });
    }
    let variance = |u: &Vector3<f64>| (u[component] / scaling.deviation_m).powi(2);
    let declared = samples.u_m().filter(|_| options.noise != Noise::Fitted);
    let declared: Option<Vec<f64>> = declared.map(|list| list.iter().map(variance).collect());
    let scaled = options.noise == Noise::Scaled;
    let data = Data {
        size: samples.size(),
        points: samples.points().flat_map(|point| scaling.point(point)).collect(),
        values: values.iter().map(|v| v / scaling.deviation_m).collect(),
        shares: declared.as_ref().filter(|_| scaled).map(|list| over_mean(list)),
        declared: declared.filter(|_| !scaled),
        kernel: options.kernel,
        trend: options.trend,
        normal,
    };
    Ok((data, scaling))
}

/// Numbers over their mean.
fn over_mean(list: &[f64]) -> Vec<f64> {
    let mean = list.iter().sum::<f64>() / list.len() as f64;
    list.iter().map(|value| value / mean).collect()
}

pub(super) fn bounds(options: &KrigingOptions, size: usize) -> Vec<(f64, f64)> {
    let logarithms = |(lower, upper): (f64, f64)| (lower.ln(), upper.ln());
    let noise = (options.noise != Noise::Declared).then_some(NOISE);
    std::iter::once(SIGNAL).chain(std::iter::repeat_n(LENGTH, size)).chain(noise).map(logarithms).collect()
}

/// The best of all starts on a part of the points.
fn first_fit(data: &Data, bounds: &[(f64, f64)], component: usize, weigh: Weigh) -> Result<Minimum, KrigingError> {
    let part = part(data);
    let mut best: Option<Minimum> = None;
    let further = FURTHER.into_iter().take(if data.size > 3 { FURTHER.len() } else { 1 });
    for (further, (length, noise)) in further.flat_map(|further| STARTS.map(|start| (further, start))) {
        let length_of = |d: usize| if d < 3 { length } else { further.unwrap_or(length) };
        let start = Scaled {
            signal: 1.0,
            length: (0..data.size).map(length_of).collect(),
            noise: (bounds.len() > data.size + 1).then_some(noise),
        };
        let logarithms = start.logarithms();
        let Some(found) = maximum(&part, Start { at: &logarithms, inverse: None }, bounds, weigh) else { continue };
        if best.as_ref().is_none_or(|before| is_better(&found, before)) {
            best = Some(found);
        }
    }
    best.ok_or(not_positive(component))
}

/// Whether a descent ended lower than another; one that settled may be higher by what does not matter.
fn is_better(found: &Minimum, before: &Minimum) -> bool {
    let lead = match (found.is_settled, before.is_settled) {
        (true, false) => NO_MATTER,
        (false, true) => -NO_MATTER,
        _ => 0.0,
    };
    found.value < before.value + lead
}

/// Points spread over the list, so that a lattice's order does not pick out one of its planes.
pub(super) fn part(data: &Data) -> Data {
    let count = data.values.len();
    if count <= FIRST_POINTS {
        return data.clone();
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| (*a as f64 * GOLDEN).fract().total_cmp(&(*b as f64 * GOLDEN).fract()));
    order.truncate(FIRST_POINTS);
    data.picked(&order)
}

fn maximum(data: &Data, start: Start<'_>, bounds: &[(f64, f64)], weigh: Weigh) -> Option<Minimum> {
    let evaluate = |logarithms: &[f64]| match weigh {
        Weigh::Likelihood => data.minus_two_log(logarithms).ok(),
        Weigh::Posterior => posterior::minus_two_log(data, logarithms),
    };
    bounded::minimum(evaluate, start, bounds, GAIN, MOST_STEPS)
}

fn at_bound(logarithms: &[f64], bounds: &[(f64, f64)], inputs: &[String]) -> Vec<String> {
    let lengths = inputs.iter().map(|name| format!("length {}", name.strip_suffix("_m").unwrap_or(name)));
    let names = std::iter::once("signal".to_owned()).chain(lengths).chain(["noise".to_owned()]);
    let is_at = |value: f64, (lower, upper): (f64, f64)| value - lower < AT_BOUND || upper - value < AT_BOUND;
    let all = names.zip(logarithms.iter().zip(bounds));
    all.filter(|(_, (value, bounds))| is_at(**value, **bounds)).map(|(name, _)| name).collect()
}

pub(super) fn not_positive(component: usize) -> KrigingError {
    KrigingError::NotPositiveDefinite { component: COMPONENTS[component] }
}
