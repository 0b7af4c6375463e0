//! Steps that places have in common: what repeats within such a step is the same at all places.
//!
//! Place in the flow: asked of the targets of runs and of the readings of campaigns, along one axis. Lengths in m.

/// Shortest distance at which a drive repeats (m).
const SHORTEST_LEAD_M: f64 = 2e-3;
/// Share of a wave by which places may be off and still all show nearly the same of it.
const SAME_PHASE: f64 = 0.03;

/// The largest distance of which the steps of neighbouring places (ascending) are whole multiples, but for a small part of it, at this share of
/// the places at least; `None` where that is shorter than any lead.
pub fn common_step_m(places_m: &[f64], share: f64) -> Option<f64> {
    let from_first: Vec<f64> = places_m.iter().map(|place_m| place_m - places_m[0]).collect();
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
        let is_on = |(n, x_m): &(&f64, &f64)| (*x_m / step_m - *n).abs() < SAME_PHASE;
        let on = counts.iter().zip(&from_first).filter(is_on).count();
        (on as f64 >= share * places_m.len() as f64).then_some(step_m)
    };
    let parts = (1..).map(|part| shortest_m / f64::from(part)).take_while(|step_m| *step_m >= SHORTEST_LEAD_M);
    parts.into_iter().find_map(fitted)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn common_mm(places_mm: &[f64], share: f64) -> Option<f64> {
        let places_m: Vec<f64> = places_mm.iter().map(|mm| mm * 1e-3).collect();
        common_step_m(&places_m, share).map(|m| (m * 1e9).round() * 1e-6)
    }

    #[test]
    fn one_place_off_the_others_is_allowed_where_not_all_need_be_on() {
        let mut places_mm: Vec<f64> =
            [0, 3, 5, 8, 11, 13, 15, 16, 18, 19, 21, 24].map(|k| 25.0 * f64::from(k)).to_vec();
        assert_eq!(common_mm(&places_mm, 1.0), Some(25.0));
        places_mm[4] += 7.0;
        assert_eq!(common_mm(&places_mm, 1.0), None);
        assert!(common_mm(&places_mm, 0.9).is_some_and(|mm| (mm - 25.0).abs() < 0.05));
        assert_eq!((common_mm(&[], 0.9), common_mm(&[1.0], 0.9)), (None, None));
    }
}
