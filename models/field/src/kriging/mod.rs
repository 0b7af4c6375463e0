//! Kriging: interpolation by a Gaussian process whose covariance is fitted to the measured errors.
//!
//! Place in the flow: a [`MeasuredField`] in (m, machine frame), the error at any point with its standard uncertainty out; of
//! [`Samples`] of any inputs, what was fitted.
//! Each component has a process of its own: trend + signal with a covariance that has a length scale for each input + noise. Length
//! scales, signal and noise maximise the restricted marginal likelihood (the trend integrated out), by its analytic gradient.
//! Nothing is added to a covariance matrix to make it invertible: a matrix that is not positive definite is an error.
//! Source: Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, ch. 2, 4, 5; Stein 1999 for the Matérn class.

mod averaged;
mod bounded;
mod fit;
mod gross;
mod judged;
mod kernel;
mod likelihood;
mod posterior;
mod prior;
mod process;

use crate::cells::PLANE_TOLERANCE_M;
use crate::error::FieldError;
use crate::hull::{Hull, Region};
use crate::measured::MeasuredField;
use crate::samples::Samples;
use nalgebra::Vector3;
use process::Process;
use thiserror::Error;

pub use averaged::AveragedKriging;
pub use judged::{Judgement, LeftOut, judge, judge_samples};
pub use kernel::Kernel;
pub use likelihood::Trend;

/// Names of the components, for messages.
const COMPONENTS: [&str; 3] = ["x", "y", "z"];

/// How noise enters the fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Noise {
    /// One variance for all points, fitted.
    Fitted,
    /// The uncertainties of the measured field as they are.
    Declared,
    /// The uncertainties of the measured field, and a variance for all points, fitted, on top.
    DeclaredAndFitted,
    /// The uncertainties of the measured field times one factor, fitted: how much of them the errors scatter by.
    Scaled,
}

impl Noise {
    /// Whether declared uncertainties enter.
    pub(crate) fn is_declared(self) -> bool {
        self != Noise::Fitted
    }
}

/// What kind of process is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KrigingOptions {
    /// Covariance of the signal.
    pub kernel: Kernel,
    /// What is removed before.
    pub trend: Trend,
    /// How noise enters.
    pub noise: Noise,
}

impl KrigingOptions {
    /// What vectors are held against each other by, as `abbe interpolate` does it: a signal of continuous slope beside a linear trend,
    /// and noise beyond the declared uncertainties where there are any.
    pub fn usual(is_declared: bool) -> KrigingOptions {
        let noise = if is_declared { Noise::DeclaredAndFitted } else { Noise::Fitted };
        KrigingOptions { kernel: Kernel::Matern52, trend: Trend::Linear, noise }
    }
}

/// Fitted parameters of one component.
#[derive(Debug, Clone, PartialEq)]
pub struct Hyperparameters {
    /// Length scale along each input, in its unit: m along axes.
    pub length: Vec<f64>,
    /// Standard deviation of the signal (m).
    pub signal_m: f64,
    /// Standard deviation of the fitted noise (m); `None` where noise is only declared. Where declared uncertainties are scaled,
    /// that of a point whose declared variance is the mean of all.
    pub noise_m: Option<f64>,
}

/// One component of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedComponent {
    /// Its parameters.
    pub hyperparameters: Hyperparameters,
    /// Logarithm of the restricted marginal likelihood of the errors in metres.
    pub log_likelihood: f64,
    /// Parameters that ended at the edge of what is searched, by name: the data do not bound them on that side.
    pub at_bound: Vec<String>,
}

/// Error at a point, with the standard uncertainty of the field there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Error = actual − indicated (m).
    pub error_m: Vector3<f64>,
    /// Standard uncertainty of each component (m, k = 1): of the field itself, without the noise of a new measurement.
    pub u_m: Vector3<f64>,
    /// Whether the point lies among the measured ones.
    pub region: Region,
}

/// A field by kriging.
#[derive(Debug, Clone)]
pub struct Kriging {
    processes: [Process; 3],
    fitted: [FittedComponent; 3],
    hull: Hull,
}

impl Kriging {
    /// Fits covariance and noise of each component to the measured errors.
    ///
    /// Source: Rasmussen & Williams 2006 eq. 2.25-2.26 (prediction), 2.45 (trend), 5.9 (gradient).
    pub fn fit(field: &MeasuredField, options: &KrigingOptions) -> Result<Kriging, KrigingError> {
        Kriging::assemble(field, fit_each(&Samples::from(field), options)?)
    }

    /// The field with given parameters, such as those of an earlier fit.
    pub fn with_hyperparameters(
        field: &MeasuredField,
        options: &KrigingOptions,
        hyperparameters: &[Hyperparameters; 3],
    ) -> Result<Kriging, KrigingError> {
        let samples = Samples::from(field);
        check_noise(&samples, options)?;
        let [x, y, z] = hyperparameters;
        let one = |component, parameters| fit::with(&samples, component, options, parameters);
        Kriging::assemble(field, [one(0, x)?, one(1, y)?, one(2, z)?])
    }

    fn assemble(field: &MeasuredField, fits: [(Process, FittedComponent); 3]) -> Result<Kriging, KrigingError> {
        let [(x, fitted_x), (y, fitted_y), (z, fitted_z)] = fits;
        let hull = Hull::new(field.points_m(), PLANE_TOLERANCE_M);
        Ok(Kriging { processes: [x, y, z], fitted: [fitted_x, fitted_y, fitted_z], hull })
    }

    /// What was fitted, for x, y and z.
    pub fn fitted(&self) -> &[FittedComponent; 3] {
        &self.fitted
    }

    /// The error alone at a finite point (m, machine frame); cost linear in the measured points.
    pub fn error_m(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        Vector3::from_fn(|d, _| self.processes[d].mean(point_m.as_slice()))
    }

    /// Error and uncertainty at a finite point (m, machine frame); cost quadratic in the measured points.
    pub fn predict(&self, point_m: &Vector3<f64>) -> Prediction {
        let at = self.processes.each_ref().map(|process| process.predict(point_m.as_slice()));
        Prediction {
            error_m: Vector3::from_fn(|d, _| at[d].0),
            u_m: Vector3::from_fn(|d, _| at[d].1),
            region: self.hull.region(point_m),
        }
    }

    /// What the other points predict at each measured point, with the standard uncertainty of the difference to what was
    /// measured there (m): parameters stay, trend and signal are without the point. Source: Rasmussen & Williams eq. 5.12.
    pub fn leave_one_out(&self) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let left = self.processes.each_ref().map(Process::leave_one_out);
        let count = left[0].len();
        let at = |k: usize| (Vector3::from_fn(|d, _| left[d][k].0), Vector3::from_fn(|d, _| left[d][k].1));
        (0..count).map(at).collect()
    }
}

/// What [`Kriging::fit`] fits, of any inputs, for x, y and z.
///
/// # Errors
/// As there.
pub fn fitted(samples: &Samples, options: &KrigingOptions) -> Result<[FittedComponent; 3], KrigingError> {
    Ok(fit_each(samples, options)?.map(|(_, fitted)| fitted))
}

fn fit_each(samples: &Samples, options: &KrigingOptions) -> Result<[(Process, FittedComponent); 3], KrigingError> {
    check_noise(samples, options)?;
    let fit = |component: usize| fit::fit(samples, component, options);
    // One thread a component: their results do not depend on each other.
    let [x, y, z] = std::thread::scope(|scope| {
        let others = [1, 2].map(|component| scope.spawn(move || fit(component)));
        let first = fit(0);
        let [y, z] = others.map(|thread| thread.join().unwrap_or(Err(KrigingError::Interrupted)));
        [first, y, z]
    });
    Ok([x?, y?, z?])
}

fn check_noise(samples: &Samples, options: &KrigingOptions) -> Result<(), KrigingError> {
    let undeclared = options.noise != Noise::Fitted && samples.u_m().is_none();
    if undeclared { Err(KrigingError::NoiseNotDeclared) } else { Ok(()) }
}

/// Why there is no such field; the text says what to do.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum KrigingError {
    /// The points make no field.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// Declared noise was asked for.
    #[error("the measured errors have no declared uncertainty; give one for each point, or let the noise be fitted")]
    NoiseNotDeclared,
    /// Nothing varies.
    #[error("the errors in {component} are the same at all points beyond the trend; nothing is left to interpolate")]
    Constant {
        /// Component.
        component: &'static str,
    },
    /// No admissible parameters.
    #[error(
        "component {component}: the covariance of the points is not positive definite; fit the noise, or declare it larger"
    )]
    NotPositiveDefinite {
        /// Component.
        component: &'static str,
    },
    /// The likelihood has no maximum that could be found.
    #[error("component {component}: the likelihood did not settle in {steps} steps; check the errors for outliers")]
    NotConverged {
        /// Component.
        component: &'static str,
        /// Steps made.
        steps: usize,
    },
    /// A parameter that is none.
    #[error("component {component}: {what} is not above zero; give lengths and deviations in metres")]
    Parameter {
        /// Component.
        component: &'static str,
        /// Which.
        what: &'static str,
    },
    /// Vectors that contradict the others, more than accidents are.
    #[error(
        "{} of {vectors} vectors contradict all others, which is more than accidents: {}; check these, and whether all \
         vectors are of one machine in one state",
        gross.len(), judged::named(gross)
    )]
    TooManyGross {
        /// Which, the furthest first.
        gross: Vec<LeftOut>,
        /// All vectors.
        vectors: usize,
    },
    /// Vectors that are gross without each other and not with each other.
    #[error("which vectors contradict the others does not settle; check the errors for outliers")]
    Undecided,
    /// A bend between planes that nobody measured.
    #[error(
        "the points stand in only two planes across {axis}: a bend between them would not be seen, and no uncertainty would \
         be true; measure a third plane, or take a method that states no uncertainty"
    )]
    TwoPlanes {
        /// Axis across them.
        axis: &'static str,
    },
    /// A thread ended before its work.
    #[error("fitting was interrupted; run it again")]
    Interrupted,
}

#[cfg(test)]
mod tests;
