//! Figures of predictions against what was measured.
//!
//! Place in the flow: errors = predicted − measured (m) in, figures (µm) for tables out. MSE is the mean over all components
//! of all points, as in Liang 2025 table 1, MAE likewise; the 95 % error and the worst are lengths of the error vector.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Micrometres in a metre.
const UM_PER_M: f64 = 1e6;

/// Figures of one method on one set of points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scores {
    /// Mean squared component (µm²).
    pub mse_um2: f64,
    /// Mean absolute component (µm).
    pub mae_um: f64,
    /// Length of the error vector that 95 % of the points stay below (µm).
    pub error_95_um: f64,
    /// Longest error vector (µm).
    pub worst_um: f64,
}

impl Scores {
    /// Figures of errors (m); `None` without any.
    pub fn of(errors_m: &[Vector3<f64>]) -> Option<Scores> {
        Scores::of_components(errors_m, 3)
    }

    /// The same where so many components were measured; the others are zero.
    pub fn of_components(errors_m: &[Vector3<f64>], measured: usize) -> Option<Scores> {
        let components = (measured * errors_m.len()) as f64;
        let mut lengths: Vec<f64> = errors_m.iter().map(|e| e.norm() * UM_PER_M).collect();
        lengths.sort_by(f64::total_cmp);
        let place = (lengths.len() as f64 * 0.95).ceil() as usize;
        Some(Scores {
            mse_um2: errors_m.iter().map(Vector3::norm_squared).sum::<f64>() * UM_PER_M * UM_PER_M / components,
            mae_um: errors_m.iter().map(|e| e.abs().sum()).sum::<f64>() * UM_PER_M / components,
            error_95_um: *lengths.get(place.checked_sub(1)?)?,
            worst_um: *lengths.last()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_a_hand_case() {
        // Twenty points: nineteen with an error of (3, 4, 0) µm, one with (0, 0, 12) µm.
        let mut errors = vec![Vector3::new(3e-6, -4e-6, 0.0); 19];
        errors.push(Vector3::new(0.0, 0.0, 12e-6));
        let scores = Scores::of(&errors).unwrap();
        assert!((scores.mse_um2 - (19.0 * 25.0 + 144.0) / 60.0).abs() < 1e-9);
        assert!((scores.mae_um - (19.0 * 7.0 + 12.0) / 60.0).abs() < 1e-9);
        assert!((scores.error_95_um - 5.0).abs() < 1e-9 && (scores.worst_um - 12.0).abs() < 1e-9);
        assert_eq!(Scores::of(&[]), None);
        let plane = Scores::of_components(&errors[..19], 2).unwrap();
        assert!((plane.mse_um2 - 12.5).abs() < 1e-9 && (plane.mae_um - 3.5).abs() < 1e-9);
    }
}
