//! Kriging of all points, and of those outside a fold.
//!
//! Place in the flow: measured residuals (m) in, fitted and solved kriging out, on which networks are trained and judged. A fold's
//! kriging is fitted without it.

use crate::error::TrainingError;
use crate::views::ViewError;
use abbe_field::Samples;
use abbe_field::kriging::{FittedComponent, Kernel, KrigingOptions, Noise, Trend, fitted};
use abbe_residual_net::Kriging;
use nalgebra::Vector3;

/// Kriging with the likelier kernel, on all points.
pub(crate) fn fitted_kriging(field: &Samples) -> Result<Kriging, TrainingError> {
    let seen = seen(field)?;
    let likelihood = |fit: &[FittedComponent; 3]| fit.iter().map(|c| c.log_likelihood).sum::<f64>();
    let matern = fit(field, Kernel::Matern52)?;
    // The smoother kernel may be too smooth to be factored: then the other one is the likelier.
    let smooth = fit(field, Kernel::SquaredExponential).ok();
    let better = smooth.filter(|smooth| likelihood(smooth) > likelihood(&matern));
    let (kernel, fit) = match better {
        Some(smooth) => (Kernel::SquaredExponential, smooth),
        None => (Kernel::Matern52, matern),
    };
    Kriging::from_fit(&fit, kernel, field, &seen).ok_or(TrainingError::NotPositiveDefinite)
}

/// How much of the declared uncertainties the residuals scatter by, 0 to 1 a component. Uncertainties that neighbours have in
/// common (of the frame, of a station, of an estimate from shared readings) are declared but do not scatter. In full they weigh the
/// points against each other and against the field; but held-out errors do not contain them, and would call every deviation too
/// large.
fn seen(field: &Samples) -> Result<Vector3<f64>, TrainingError> {
    let Some(u_m) = field.u_m() else { return Ok(Vector3::repeat(1.0)) };
    let options = KrigingOptions { kernel: Kernel::Matern52, trend: Trend::Constant, noise: Noise::Scaled };
    let fit = fitted(field, &options)?;
    let share = |axis: usize| {
        let declared_m2 = u_m.iter().map(|u| u[axis] * u[axis]).sum::<f64>() / u_m.len() as f64;
        let scatter_m = fit[axis].hyperparameters.noise_m.unwrap_or(0.0);
        (scatter_m / declared_m2.sqrt()).min(1.0)
    };
    Ok(Vector3::from_fn(|axis, _| share(axis)))
}

/// Kriging of the points outside a fold, with parameters that have not seen it.
pub(crate) fn fitted_without(
    field: &Samples,
    fold: &[usize],
    held: usize,
    kriging: &Kriging,
) -> Result<Kriging, TrainingError> {
    let rest: Vec<usize> = (0..fold.len()).filter(|k| fold[*k] != held).collect();
    let part = field.part(&rest).map_err(ViewError::from)?;
    kriging_of(&part, kriging.kernel, &kriging.seen())
}

/// Kriging of a field.
pub(crate) fn kriging_of(field: &Samples, kernel: Kernel, seen: &Vector3<f64>) -> Result<Kriging, TrainingError> {
    Kriging::from_fit(&fit(field, kernel)?, kernel, field, seen).ok_or(TrainingError::NotPositiveDefinite)
}

/// Fitted by restricted likelihood, with the declared uncertainties where there are any.
fn fit(field: &Samples, kernel: Kernel) -> Result<[FittedComponent; 3], TrainingError> {
    let noise = if field.u_m().is_some() { Noise::DeclaredAndFitted } else { Noise::Fitted };
    Ok(fitted(field, &KrigingOptions { kernel, trend: Trend::Constant, noise })?)
}
