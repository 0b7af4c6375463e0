//! Kriging that does not take its parameters for known.
//!
//! Place in the flow: a [`MeasuredField`] in, the error at any point with its standard uncertainty out, as [`super::Kriging`]. With
//! few points many length scales, signals and noises explain them, and the likeliest alone says too little uncertainty: so
//! the field is averaged over a sample of them, weighed by likelihood and a wide prior, and their disagreement is part of the
//! variance: u² = Σ wₘ (uₘ² + (eₘ − e)²). What the points themselves say is the last word: where they differ from what the
//! others predict by more than that predicts, u is widened by the ratio. Where uncertainties are declared, what the points scatter beyond them is no
//! noise of theirs but a field that is finer than they are: no answer knows it, and u² holds it.
//! Source: Rasmussen & Williams 2006, ch. 5.2; Handcock & Stein 1993, Technometrics 35(4); O'Hagan 1991 for averaging.

use super::likelihood::Scaled;
use super::posterior::{Member, members};
use super::process::Process;
use super::{KrigingError, KrigingOptions, Noise, Prediction, check_noise, fit};
use crate::cells::PLANE_TOLERANCE_M;
use crate::hull::Hull;
use crate::interpolator::{Estimate, Interpolator, Unanswered, finite};
use crate::measured::MeasuredField;
use crate::samples::Samples;
use nalgebra::Vector3;

/// Points up to which parameters are averaged over; of more the likeliest say as much.
const AVERAGED_POINTS: usize = 250;
/// Share of the extent by which coordinates of one plane differ at most.
const SAME_PLANE: f64 = 0.05;
/// Planes that show a bend.
const LEAST_PLANES: usize = 3;
/// Share of the members that must show noise beyond the declared before it is said.
const SURE: f64 = 0.9;

/// A field by averaged kriging.
#[derive(Debug, Clone)]
pub struct AveragedKriging {
    averaged: Averaged,
    /// Variance of a field that is finer than the points (m²).
    finer_m2: Vector3<f64>,
    hull: Hull,
}

/// The components of errors by any inputs.
#[derive(Debug, Clone)]
pub(super) struct Averaged {
    components: [Component; 3],
}

#[derive(Debug, Clone)]
struct Component {
    members: Vec<(Process, f64)>,
    /// Fitted noise of each member (m), ascending, with its share.
    noise_m: Vec<(f64, f64)>,
    /// By how much u is widened, at least 1.
    widening: f64,
}

impl AveragedKriging {
    /// Fits covariance and noise of each component to the measured errors.
    pub fn fit(field: &MeasuredField, options: &KrigingOptions) -> Result<AveragedKriging, KrigingError> {
        check_planes(field)?;
        Ok(AveragedKriging::of(Averaged::fit(&Samples::from(field), options)?, field, options))
    }

    /// Of the components of a field.
    pub(super) fn of(averaged: Averaged, field: &MeasuredField, options: &KrigingOptions) -> AveragedKriging {
        // What scales the declared is no more than that.
        let is_beside = options.noise == Noise::DeclaredAndFitted;
        let finer_m2 = if is_beside { averaged.noise_variance_m2() } else { Vector3::zeros() };
        AveragedKriging { averaged, finer_m2, hull: Hull::new(field.points_m(), PLANE_TOLERANCE_M) }
    }

    /// Error and uncertainty at a finite point (m, machine frame).
    pub fn predict(&self, point_m: &Vector3<f64>) -> Prediction {
        let (error_m, u_m) = self.averaged.predict(point_m.as_slice());
        let u_m = (u_m.component_mul(&u_m) + self.finer_m2).map(f64::sqrt);
        Prediction { error_m, u_m, region: self.hull.region(point_m) }
    }
}

impl Averaged {
    /// Fits covariance and noise of each component.
    pub(super) fn fit(samples: &Samples, options: &KrigingOptions) -> Result<Averaged, KrigingError> {
        check_noise(samples, options)?;
        let fit = |component: usize| Component::fit(samples, component, options);
        // One thread a component: their results do not depend on each other.
        let [x, y, z] = std::thread::scope(|scope| {
            let others = [1, 2].map(|component| scope.spawn(move || fit(component)));
            let first = fit(0);
            let [y, z] = others.map(|thread| thread.join().unwrap_or(Err(KrigingError::Interrupted)));
            [first, y, z]
        });
        Ok(Averaged { components: [x?, y?, z?] })
    }

    /// Error and standard uncertainty (m) at values of the inputs.
    pub(super) fn predict(&self, at: &[f64]) -> (Vector3<f64>, Vector3<f64>) {
        let each = self.components.each_ref().map(|component| component.predict(at));
        (Vector3::from_fn(|d, _| each[d].0), Vector3::from_fn(|d, _| each[d].1))
    }

    /// Standard deviation by which the measured errors scatter beyond what is declared of them (m), by component: what is
    /// most often exceeded of those that explain the points.
    pub(super) fn noise_m(&self) -> Vector3<f64> {
        Vector3::from_fn(|d, _| self.components[d].sure_noise_m())
    }

    /// By how much the uncertainty was widened, by component: 1 where the points agree with each other as well as predicted.
    pub(super) fn widening(&self) -> Vector3<f64> {
        Vector3::from_fn(|d, _| self.components[d].widening)
    }

    /// Variance of the fitted noise (m²), by component.
    pub(super) fn noise_variance_m2(&self) -> Vector3<f64> {
        let mean = |component: &Component| component.noise_m.iter().map(|(noise, share)| noise * noise * share).sum();
        Vector3::from_fn(|d, _| mean(&self.components[d]))
    }
}

/// Refuses points of two planes across an axis: linear between them is all that they show, whatever the field does.
pub(super) fn check_planes(field: &MeasuredField) -> Result<(), KrigingError> {
    let normal = field.plane().map(|plane| plane.normal);
    for axis in (0..3).filter(|axis| Some(*axis) != normal) {
        let mut at_m: Vec<f64> = field.points_m().iter().map(|point| point[axis]).collect();
        at_m.sort_by(f64::total_cmp);
        let extent_m = at_m.last().zip(at_m.first()).map_or(0.0, |(last, first)| last - first);
        let (mut planes, mut start_m) = (0, f64::NEG_INFINITY);
        for at_m in at_m {
            if at_m - start_m > SAME_PLANE * extent_m {
                (planes, start_m) = (planes + 1, at_m);
            }
        }
        if planes < LEAST_PLANES {
            return Err(KrigingError::TwoPlanes { axis: ["X", "Y", "Z"][axis] });
        }
    }
    Ok(())
}

impl Interpolator for AveragedKriging {
    fn at(&self, point_m: &Vector3<f64>) -> Result<Estimate, Unanswered> {
        finite(point_m)?;
        let predicted = self.predict(point_m);
        Ok(Estimate { error_m: predicted.error_m, u_m: Some(predicted.u_m), region: predicted.region })
    }
}

impl Component {
    fn fit(samples: &Samples, component: usize, options: &KrigingOptions) -> Result<Component, KrigingError> {
        let (data, scaling) = fit::scaled(samples, component, options)?;
        let bounds = fit::bounds(options, data.size);
        let likeliest = fit::likeliest(&data, &bounds, component, fit::Weigh::Posterior)?;
        let parameters: Vec<Member> = if data.values.len() <= AVERAGED_POINTS {
            members(&data, &likeliest.at, &bounds)
        } else {
            vec![(Scaled::from_logarithms(&likeliest.at, data.size), 1.0)]
        };
        let mut processes = Vec::new();
        let mut noise_m = Vec::new();
        for (scaled, share) in parameters {
            let factored = data.factored(&scaled).map_err(|_| fit::not_positive(component))?;
            noise_m.push((scaled.noise.unwrap_or(0.0) * scaling.deviation_m, share));
            processes.push((Process::new(data.clone(), scaling.clone(), scaled, factored), share));
        }
        noise_m.sort_by(|a, b| a.0.total_cmp(&b.0));
        let found = Component { members: processes, noise_m, widening: 1.0 };
        let widening = found.seen_over_predicted(samples.errors_m(), component).max(1.0);
        Ok(Component { widening, ..found })
    }

    /// Expected error and standard uncertainty (m).
    fn predict(&self, at: &[f64]) -> (f64, f64) {
        let (mean, variance) = mixed(self.members.iter().map(|(process, share)| (process.predict(at), *share)));
        (mean, variance.sqrt() * self.widening)
    }

    /// Root mean square of what the points differ by from what the others predict, over its uncertainty.
    fn seen_over_predicted(&self, errors_m: &[Vector3<f64>], component: usize) -> f64 {
        let left: Vec<(Vec<(f64, f64)>, f64)> =
            self.members.iter().map(|(process, share)| (process.leave_one_out(), *share)).collect();
        let square = |(k, error): (usize, &Vector3<f64>)| {
            let (mean, variance) = mixed(left.iter().map(|(all, share)| (all[k], *share)));
            (error[component] - mean).powi(2) / variance
        };
        (errors_m.iter().enumerate().map(square).sum::<f64>() / errors_m.len() as f64).sqrt()
    }

    fn sure_noise_m(&self) -> f64 {
        let mut above = 1.0;
        for (noise, share) in &self.noise_m {
            above -= share;
            if above < SURE {
                return *noise;
            }
        }
        0.0
    }
}

/// Mean and variance of a mixture of values with deviations, each with its share.
fn mixed(members: impl Iterator<Item = ((f64, f64), f64)> + Clone) -> (f64, f64) {
    let mean: f64 = members.clone().map(|((mean, _), share)| mean * share).sum();
    (mean, members.map(|((value, deviation), share)| share * (deviation.powi(2) + (value - mean).powi(2))).sum())
}
