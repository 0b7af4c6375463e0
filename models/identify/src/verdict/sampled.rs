//! Whether readings lie at whole multiples of one step, so that an error that repeats within it cannot show.
//!
//! Place in the flow: from the readings alone. Sampled at equal steps p, an error of period p/k is a constant, and one of a period near
//! it a slow wave (Nyquist, Shannon): no residual tells it, and no uncertainty of a fit holds it. Steps that are drawn do not have that
//! (ISO 230-2, 5.3.1 asks for targets at unequal distances for the same reason).

use super::{Cause, Finding, Grade, Subject};
use abbe_measurement::common_step::common_step_m;

/// Readings nearer than this (m) were taken at one place: machines stop that near to where they were sent.
const PLACE_M: f64 = 0.2e-3;
/// Fewest places that show a step, and readings that each place has on average where a plan goes back to its places.
const PLACES: usize = 4;
const READINGS: usize = 3;
/// Share of the places that lie on multiples of the step.
const MOST: f64 = 0.9;

/// The axes of these along which readings (m) lie at equal steps.
pub fn equal_steps(axes: [bool; 3], readings_m: impl Iterator<Item = [f64; 3]> + Clone) -> Option<Finding> {
    let steps: Vec<(char, f64)> = (0..3)
        .filter(|d| axes[*d])
        .filter_map(|d| Some((['X', 'Y', 'Z'][d], step(readings_m.clone().map(|reading_m| reading_m[d]).collect())?)))
        .collect();
    let finding =
        |steps| Finding { grade: Grade::Message, subject: Subject::Sampled { steps }, causes: vec![Cause::EqualSteps] };
    (!steps.is_empty()).then(|| finding(steps))
}

/// The step (m) at whose multiples nearly all positions lie.
fn step(mut positions_m: Vec<f64>) -> Option<f64> {
    positions_m.retain(|at| at.is_finite());
    positions_m.sort_by(f64::total_cmp);
    let places: Vec<f64> =
        positions_m.chunk_by(|a, b| b - a < PLACE_M).map(|own| own.iter().sum::<f64>() / own.len() as f64).collect();
    if places.len() < PLACES || places.len() * READINGS > positions_m.len() {
        return None;
    }
    common_step_m(&places, MOST)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along_x(positions_m: impl Iterator<Item = f64> + Clone) -> Option<Finding> {
        equal_steps([true, false, false], positions_m.map(|x| [x, 0.0, 0.0]))
    }

    #[test]
    fn equal_steps_are_named_with_their_length_and_drawn_ones_are_not() {
        // Five lines over 14 places, each stop off by up to 20 µm.
        let equal = (0..70_u32).map(|k| f64::from(k % 14) * 0.8 / 13.0 + f64::from(k * 7 % 5) * 1e-5 - 2e-5);
        let found = along_x(equal).unwrap().to_string();
        assert!(found.contains("61.54 mm along X"), "{found}");
        // Drawn multiples of 25 mm.
        let multiples =
            (0..70_u32).map(|k| 0.025 * f64::from([0, 3, 5, 8, 11, 13, 15, 16, 18, 19, 21, 24][k as usize % 12]));
        let found = along_x(multiples).unwrap().to_string();
        assert!(found.contains("25.00 mm along X") && found.contains("wave"), "{found}");
        let drawn = (0..70_u32).map(|k| 0.8 * (f64::from(k) * 0.618_034).fract());
        assert_eq!(along_x(drawn), None);
        // Drawn places that each line goes through again.
        let again =
            (0..70_u32).map(|k| 0.8 * (f64::from(k % 14) * 0.618_034 + f64::from(k % 14).powi(2) * 0.07).fract());
        assert_eq!(along_x(again), None);
    }
}
