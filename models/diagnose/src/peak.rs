//! The maximum of a function of one figure, found with few of its values.
//!
//! Place in the flow: periods, variances and figures of shapes are chosen here, each by what it explains. Brent's method (1973, Algorithms
//! for Minimization without Derivatives, chapter 5): the top of a parabola through the three best values so far, and a golden section where
//! that does not come nearer.

use std::convert::Infallible;

/// Share of the way between the ends that the larger part of a golden section leaves out.
const GOLDEN: f64 = 0.381_966_011_250_105_2;
/// Share of the way between the ends to which a smooth peak is found: none is told from its surroundings much nearer than that.
const NEAR: f64 = 5e-7;
/// Values asked for at most.
const MOST: usize = 60;

/// Maximum of a function with one peak between the ends.
pub(crate) fn peak(ends: (f64, f64), mut value: impl FnMut(f64) -> f64) -> f64 {
    let Ok(at) = peak_within(ends, NEAR, |at| Ok::<f64, Infallible>(value(at)));
    at
}

/// The same to a share of the way between the ends, of a function that may fail.
///
/// # Errors
/// The first of the function.
pub(crate) fn peak_within<E>(
    (mut low, mut high): (f64, f64),
    share: f64,
    mut value: impl FnMut(f64) -> Result<f64, E>,
) -> Result<f64, E> {
    // What has no value is no peak.
    let mut value = |at: f64| value(at).map(|of| if of.is_nan() { f64::NEG_INFINITY } else { of });
    let near = 0.5 * share * (high - low);
    let first = low + GOLDEN * (high - low);
    let of_first = value(first)?;
    // The best three so far, the best one first, and the last two steps.
    let mut best = [(first, of_first); 3];
    let (mut step, mut before): (f64, f64) = (0.0, 0.0);
    for _ in 1..MOST {
        let at = best[0].0;
        let middle = 0.5 * (low + high);
        if (at - middle).abs() <= 2.0 * near - 0.5 * (high - low) {
            break;
        }
        let to_top = top(&best).filter(|to_top| {
            let is_inside = at + to_top > low && at + to_top < high;
            is_inside && before.abs() > near && to_top.abs() < 0.5 * before.abs()
        });
        before = step;
        step = match to_top {
            // Beside an end, one step over the top brings the other end near as well.
            Some(to_top) if (at + to_top - low).min(high - at - to_top) < 2.0 * near => near.copysign(middle - at),
            Some(to_top) => to_top,
            None => {
                before = if at < middle { high - at } else { low - at };
                GOLDEN * before
            }
        };
        let next = at + if step.abs() >= near { step } else { near.copysign(step) };
        let of_next = value(next)?;
        let is_better = of_next >= best[0].1;
        match (is_better, next < at) {
            (true, true) => high = at,
            (true, false) => low = at,
            (false, true) => low = next,
            (false, false) => high = next,
        }
        keep(&mut best, (next, of_next), is_better);
    }
    Ok(best[0].0)
}

/// Way from the best of three points to the top of the parabola through them; `None` where they lie on a line.
fn top(&[(at, most), (other, of_other), (third, of_third)]: &[(f64, f64); 3]) -> Option<f64> {
    let (a, b) = ((at - other) * (of_third - most), (at - third) * (of_other - most));
    let to_top = ((at - third) * b - (at - other) * a) / (2.0 * (a - b));
    to_top.is_finite().then_some(to_top)
}

/// Puts a point among the best three.
fn keep(best: &mut [(f64, f64); 3], next: (f64, f64), is_better: bool) {
    if is_better {
        *best = [next, best[0], best[1]];
    } else if next.1 >= best[1].1 || best[1].0 == best[0].0 {
        *best = [best[0], next, best[1]];
    } else if next.1 >= best[2].1 || best[2].0 == best[0].0 || best[2].0 == best[1].0 {
        best[2] = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peak_is_found_wherever_it_lies_with_few_values() {
        let peaks: [(&dyn Fn(f64) -> f64, f64); 5] = [
            (&|at| -(at - 1.25_f64).powi(2), 1.25),
            (&|at| (-(at - 2.9_f64).powi(2) / 0.01).exp(), 2.9),
            (&|at| -(at - 0.4_f64).abs(), 0.4),
            (&|at| at, 3.0),
            (&|at| (3.0 * at).cos(), 0.0),
        ];
        for (function, expected) in peaks {
            let mut asked = 0;
            let at = peak((0.0, 3.0), |at| {
                asked += 1;
                function(at)
            });
            let expected = if expected == 0.0 { [0.0, std::f64::consts::TAU / 3.0] } else { [expected; 2] };
            assert!(expected.iter().any(|expected| (at - expected).abs() < 3e-6), "{at} {expected:?}");
            assert!(asked < 45, "{asked}");
        }
    }

    #[test]
    fn a_smooth_peak_takes_a_third_of_the_values_of_a_golden_section() {
        let mut asked = 0;
        let at = peak((0.0, 1.0), |at| {
            asked += 1;
            (-(at - 0.3_f64).powi(2)).exp() + 0.01 * at
        });
        assert!((at - 0.305_000_125).abs() < 1e-6 && asked <= 12, "{at} {asked}");
        let mut asked = 0;
        let Ok(at) = peak_within((0.0, 1.0), 0.02, |at: f64| {
            asked += 1;
            Ok::<f64, Infallible>(-(at - 0.3).powi(2))
        });
        assert!((at - 0.3).abs() < 0.01 && asked <= 6, "{at} {asked}");
    }

    #[test]
    fn functions_that_are_flat_or_have_no_value_end_it() {
        for function in [|_: f64| 1.0, |_: f64| f64::NAN, |_: f64| f64::NEG_INFINITY] {
            assert!((-1.0..=1.0).contains(&peak((-1.0, 1.0), function)));
        }
        assert_eq!(peak((2.0, 2.0), |at| at), 2.0);
        let half = |at: f64| if at < 0.5 { f64::NAN } else { -(at - 0.7).powi(2) };
        assert!((peak((0.0, 1.0), half) - 0.7).abs() < 1e-6);
    }

    #[test]
    fn an_error_of_the_function_is_let_through() {
        let found = peak_within((0.0, 3.0), 1e-3, |at| if at > 2.0 { Err(at) } else { Ok(at) });
        assert_eq!(found.map_err(|at| at > 2.0), Err(true));
    }
}
