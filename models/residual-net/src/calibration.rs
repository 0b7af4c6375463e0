//! From a model's own deviation to one that holds what it says.
//!
//! Place in the flow: training compares predictions of blocks that were held out with what was measured there, and keeps
//! one factor a component. Method: the factor is the 95 % quantile of |error|/deviation over 1.96, after which 95 %
//! intervals (±1.96 deviations) hold 95 % of the held-out values, whatever their distribution. (Split conformal
//! prediction; Lei et al. 2018, J. American Statistical Association 113, section 2.)

use nalgebra::Vector3;

/// Standard deviations of a normal distribution within which 95 % lie.
pub const NORMAL_95: f64 = 1.959_963_984_540_054;
/// Share of values that an interval should hold.
const COVERAGE: f64 = 0.95;

/// Factors on the standard deviation of x, y, z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// One a component, above zero.
    pub scale: Vector3<f64>,
}

impl Calibration {
    /// Deviations as the model states them.
    pub fn none() -> Calibration {
        Calibration { scale: Vector3::repeat(1.0) }
    }

    /// Factors from held-out errors (predicted − measured) with their stated deviations, both in one unit; `None` without any.
    pub fn from_held_out(held_out: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Calibration> {
        let mut scale = Vector3::zeros();
        for axis in 0..3 {
            let mut ratios: Vec<f64> = held_out.iter().map(|(e, u)| (e[axis] / u[axis]).abs()).collect();
            ratios.sort_by(f64::total_cmp);
            // The finite-sample quantile: of n values and one to come, the one to come lies below with 95 %.
            let place = ((ratios.len() + 1) as f64 * COVERAGE).ceil() as usize;
            let quantile = if place > ratios.len() { of_few(&ratios)? } else { ratios[place - 1] };
            scale[axis] = quantile / NORMAL_95;
        }
        scale.iter().all(|s| s.is_finite() && *s > 0.0).then_some(Calibration { scale })
    }
}

/// 95 % quantile where fewer than 19 values (ascending) cannot show it: that of Student's distribution about their mean square, as if
/// they were normal, but no less than the largest. `None` without any. Source: Abramowitz & Stegun 1964, 26.7.5.
fn of_few(ratios: &[f64]) -> Option<f64> {
    let n = ratios.len() as f64;
    let student = NORMAL_95 + 2.372 / n + 2.823 / (n * n);
    let root_mean_square = (ratios.iter().map(|r| r * r).sum::<f64>() / n).sqrt();
    Some(ratios.last()?.max(student * root_mean_square))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factor_makes_the_interval_hold_95_of_100() {
        let held_out: Vec<_> =
            (1..=99).map(|k| (Vector3::repeat(f64::from(k)), Vector3::new(1.0, 2.0, 10.0))).collect();
        let scale = Calibration::from_held_out(&held_out).unwrap().scale;
        assert!((scale * NORMAL_95 - Vector3::new(95.0, 47.5, 9.5)).norm() < 1e-12);
    }

    #[test]
    fn few_values_give_the_wider_interval_of_few() {
        // t of 5 degrees of freedom at 97.5 % is 2.571.
        let held_out = [1.0, -1.0, 1.0, -1.0, 1.0].map(|e| (Vector3::repeat(e), Vector3::repeat(1.0)));
        let scale = Calibration::from_held_out(&held_out).unwrap().scale;
        assert!((scale.x * NORMAL_95 / 2.571 - 1.0).abs() < 0.02, "{scale}");
        let one_wild = [0.1, 0.1, 9.0].map(|e| (Vector3::repeat(e), Vector3::repeat(1.0)));
        assert!(Calibration::from_held_out(&one_wild).unwrap().scale.x * NORMAL_95 >= 9.0);
    }

    #[test]
    fn without_held_out_values_or_with_errors_of_zero_there_is_no_factor() {
        assert_eq!(Calibration::from_held_out(&[]), None);
        assert_eq!(Calibration::from_held_out(&[(Vector3::zeros(), Vector3::repeat(1.0))]), None);
    }
}
