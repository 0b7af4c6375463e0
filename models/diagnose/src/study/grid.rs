//! Steps that targets have in common: what repeats at them is the same at all targets.
//!
//! Place in the flow: asked once for each axis of a study of runs. Targets in keys of 1 nm, steps in m.

use abbe_measurement::common_step;

/// The distance of neighbouring targets where all are equal to a thousandth.
pub(super) fn equal_step_m(targets: &[i64]) -> Option<f64> {
    let steps: Vec<f64> = targets.windows(2).map(|pair| (pair[1] - pair[0]) as f64 * 1e-9).collect();
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    steps.iter().all(|step| (step - mean).abs() <= 1e-3 * mean).then_some(mean)
}

/// The largest distance of which all steps of neighbouring targets are whole multiples, but for a small part of it; `None` where that
/// is shorter than any lead.
pub(super) fn common_step_m(targets: &[i64]) -> Option<f64> {
    let from_first: Vec<f64> = targets.iter().map(|target| (target - targets[0]) as f64 * 1e-9).collect();
    common_step::common_step_m(&from_first, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn common_mm(targets_mm: &[f64]) -> Option<f64> {
        let keys: Vec<i64> = targets_mm.iter().map(|mm| (mm * 1e6).round() as i64).collect();
        common_step_m(&keys).map(|m| (m * 1e9).round() * 1e-6)
    }

    #[test]
    fn what_all_steps_are_multiples_of_is_found() {
        assert_eq!(common_mm(&[0.0, 50.0, 100.0, 150.0]), Some(50.0));
        assert_eq!(common_mm(&[5.0, 25.0, 35.0, 85.0]), Some(10.0), "multiples of a lead, at irregular steps");
        assert_eq!(common_mm(&[0.0, 50.02, 99.98, 200.01]).map(f64::round), Some(50.0), "but for a little");
        assert_eq!(common_mm(&[0.0, 41.3, 97.7, 131.9, 188.2]), None);
        assert_eq!(equal_step_m(&[0, 50_000_000, 150_000_000]), None);
    }
}
