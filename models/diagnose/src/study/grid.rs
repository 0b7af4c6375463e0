//! Steps that targets have in common: what repeats at them is the same at all targets.
//!
//! Place in the flow: asked once for each axis of a study of runs. Targets in keys of 1 nm, steps in m.

/// Shortest distance at which a drive repeats (m).
const SHORTEST_LEAD_M: f64 = 2e-3;
/// Share of a wave by which targets may be off and still all show nearly the same of it.
const SAME_PHASE: f64 = 0.03;

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
    let steps: Vec<f64> = from_first.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let shortest_m = steps.iter().copied().reduce(f64::min)?;
    let fitted = |about_m: f64| {
        // Counted from step to step, so that little by little does not add up.
        let counts: Vec<f64> = std::iter::once(0.0)
            .chain(steps.iter().scan(0.0, |count, step_m| {
                *count += (step_m / about_m).round();
                Some(*count)
            }))
            .collect();
        let (products, squares) =
            counts.iter().zip(&from_first).fold((0.0, 0.0), |sums, (n, x_m)| (sums.0 + n * x_m, sums.1 + n * n));
        let step_m = products / squares;
        let off = |(n, x_m): (&f64, &f64)| (x_m / step_m - n).abs();
        counts.iter().zip(&from_first).all(|both| off(both) < SAME_PHASE).then_some(step_m)
    };
    let parts = (1..).map(|part| shortest_m / f64::from(part)).take_while(|step_m| *step_m >= SHORTEST_LEAD_M);
    parts.into_iter().find_map(fitted)
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
