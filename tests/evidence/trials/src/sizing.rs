//! How large an effect must be to raise the verification error by a given factor.
//!
//! Place in the flow: [`crate::trial`] evaluates a size by simulating, identifying and scoring; the search here only
//! chooses sizes. Equation: with c the error without the effect and r(s) the error with size s, the excess is
//! √(r² − c²)/c; for a small effect it is proportional to s, which makes two or three evaluations enough.

use crate::error::TrialError;

/// Share by which the factor reached may differ from the one asked for.
pub const TOLERANCE: f64 = 0.05;
/// Share by which it may differ where the error jumps with the size, because the fit changes its mind.
const JUMPING: f64 = 0.2;
/// Excess that fixes the proportionality: well above scatter, not yet so large that readings are rejected.
const GAUGED: [f64; 2] = [0.4, 6.0];
/// Largest size tried, in units of the template's.
const LARGEST: f64 = 2000.0;
/// Steps of either search.
const GAUGE_STEPS: usize = 6;
const STEPS: usize = 5;
/// Largest change of the size in one step.
const STRIDE: f64 = 16.0;

/// A size and the verification error (m) that it leads to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sized {
    /// Size in units of the template's.
    pub size: f64,
    /// Verification error without a word for the effect (m).
    pub rms_m: f64,
}

/// Excess of an error over that without the effect, in units of the latter; 0 where it is not above.
pub fn excess(rms_m: f64, clean_m: f64) -> f64 {
    (rms_m * rms_m - clean_m * clean_m).max(0.0).sqrt() / clean_m
}

/// Excess per unit of size, from one to six evaluations.
///
/// # Errors
/// No size within reason raises the error, or an evaluation fails.
pub fn gauge(clean_m: f64, evaluate: &mut dyn FnMut(f64) -> Result<f64, TrialError>) -> Result<f64, TrialError> {
    let mut size = 1.0;
    for _ in 0..GAUGE_STEPS {
        let found = excess(evaluate(size)?, clean_m);
        if (GAUGED[0]..=GAUGED[1]).contains(&found) {
            return Ok(found / size);
        }
        size *= if found > 0.0 { (1.7 / found).clamp(1.0 / STRIDE, STRIDE) } else { STRIDE };
        if size > LARGEST {
            break;
        }
    }
    Err(TrialError::Unreachable { size })
}

/// The size at which the error is `factor` times that without the effect, within [`TOLERANCE`]; where the error jumps
/// with the size, the nearest that was found.
///
/// # Errors
/// No size within reason reaches the factor, or an evaluation fails.
pub fn find(
    factor: f64,
    clean_m: f64,
    per_size: f64,
    evaluate: &mut dyn FnMut(f64) -> Result<f64, TrialError>,
) -> Result<Sized, TrialError> {
    let wanted = (factor * factor - 1.0).sqrt();
    let miss = |sized: &Sized| (sized.rms_m / clean_m / factor - 1.0).abs();
    let mut size = wanted / per_size;
    let mut nearest: Option<Sized> = None;
    for _ in 0..STEPS {
        if size > LARGEST {
            break;
        }
        let sized = Sized { size, rms_m: evaluate(size)? };
        if nearest.is_none_or(|best| miss(&sized) < miss(&best)) {
            nearest = Some(sized);
        }
        if miss(&sized) <= TOLERANCE {
            break;
        }
        let found = excess(sized.rms_m, clean_m);
        size *= if found > 0.0 { (wanted / found).clamp(1.0 / STRIDE, STRIDE) } else { STRIDE };
    }
    nearest.filter(|best| miss(best) <= JUMPING).ok_or(TrialError::Unreachable { size })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quadrature(slope: f64) -> impl FnMut(f64) -> Result<f64, TrialError> {
        move |size| Ok(3e-7 * (1.0 + (slope * size).powi(2)).sqrt())
    }

    #[test]
    fn a_proportional_excess_is_sized_in_one_step() {
        for slope in [1e-2, 0.3, 1.0, 40.0] {
            let per_size = gauge(3e-7, &mut quadrature(slope)).unwrap();
            assert!((per_size / slope - 1.0).abs() < 1e-12);
            let mut calls = 0;
            let mut inner = quadrature(slope);
            let found = find(2.0, 3e-7, per_size, &mut |size| {
                calls += 1;
                inner(size)
            });
            let found = found.unwrap();
            assert!((found.rms_m / 3e-7 - 2.0).abs() < 1e-12 && calls == 1, "{found:?} {calls}");
        }
    }

    #[test]
    fn an_excess_that_flattens_is_followed() {
        let mut evaluate = |size: f64| Ok(3e-7 * (1.0 + 4.0 * size.powf(1.4)).sqrt());
        let per_size = gauge(3e-7, &mut evaluate).unwrap();
        let found = find(3.0, 3e-7, per_size, &mut evaluate).unwrap();
        assert!((found.rms_m / 3e-7 / 3.0 - 1.0).abs() <= TOLERANCE);
    }

    #[test]
    fn an_error_that_jumps_over_the_factor_is_taken_next_to_it() {
        let mut evaluate = |size: f64| Ok(3e-7 * if size < 2.0 { (1.0 + size * size).sqrt() } else { 3.3 });
        let found = find(3.0, 3e-7, 1.0, &mut evaluate).unwrap();
        assert_eq!(found.rms_m, 3e-7 * 3.3);
    }

    #[test]
    fn what_the_fit_swallows_is_said_to_be_out_of_reach() {
        let nothing = gauge(3e-7, &mut |_| Ok(3e-7));
        assert!(matches!(nothing, Err(TrialError::Unreachable { .. })));
        let saturated = find(5.0, 3e-7, 1.0, &mut |size: f64| Ok(3e-7 * (1.0 + size.min(1.0))));
        assert!(matches!(saturated, Err(TrialError::Unreachable { .. })));
    }
}
