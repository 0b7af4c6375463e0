//! What a misfit costs: squares, Huber's loss, or the sum of the smallest squares.
//!
//! Place in the flow: the objective of [`super::fit_points`]. Input: squared standardised distances, s = ‖r‖²/u², of which a
//! point has three degrees of freedom. Sources: Huber & Ronchetti, Robust Statistics, ch. 3; Rousseeuw 1984, J. Am. Stat.
//! Assoc. 79 (least trimmed squares).

use crate::robust::median;

/// Distance, in robust standard deviations, from which Huber's loss grows linearly: 95 % of normal points are nearer.
const HUBER: f64 = 2.795;
/// Median length of a vector of three standard normal numbers.
const MEDIAN_LENGTH: f64 = 1.538_172;

/// The same of two: √(2 ln 2).
const MEDIAN_IN_PLANE: f64 = 1.177_410;

/// What is summed over the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// Squared distances, as in the paper: exact for normal noise, at the mercy of a single gross error.
    Squares,
    /// Squares near zero, linear beyond: convex, gives gross errors a bounded pull. Good for a few of them.
    Huber,
    /// The smallest half of the squares: gross errors in up to almost half of the points cost nothing. Many local minima.
    Trimmed,
}

impl Loss {
    /// Name on the command line and in model files.
    pub fn name(self) -> &'static str {
        match self {
            Loss::Squares => "squares",
            Loss::Huber => "huber",
            Loss::Trimmed => "trimmed",
        }
    }

    /// Value of the objective from the squared standardised distances; `scale` is that of [`scale_of`]. May reorder.
    pub(super) fn total(self, squares: &mut [f64], unknowns: usize, scale: f64) -> f64 {
        match self {
            Loss::Squares => squares.iter().sum(),
            Loss::Huber => squares.iter().map(|s| huber(*s, scale)).sum(),
            Loss::Trimmed => {
                let kept = kept_points(squares.len(), unknowns);
                let (smaller, limit, _) = squares.select_nth_unstable_by(kept - 1, f64::total_cmp);
                // Partly sorted, so that the sum does not depend on how the selection shuffled what lies below.
                smaller.sort_unstable_by(f64::total_cmp);
                smaller.iter().sum::<f64>() + *limit
            }
        }
    }

    /// Weight of each point in the least-squares problem that has the same slope here.
    pub(super) fn weights(self, squares: &[f64], unknowns: usize, scale: f64) -> Vec<f64> {
        match self {
            Loss::Squares => vec![1.0; squares.len()],
            Loss::Huber => squares.iter().map(|s| (HUBER * scale / s.sqrt()).min(1.0)).collect(),
            Loss::Trimmed => {
                let kept = kept_points(squares.len(), unknowns);
                let mut order: Vec<usize> = (0..squares.len()).collect();
                order.sort_by(|a, b| squares[*a].total_cmp(&squares[*b]).then(a.cmp(b)));
                let mut weights = vec![0.0; squares.len()];
                order[..kept].iter().for_each(|k| weights[*k] = 1.0);
                weights
            }
        }
    }
}

fn huber(square: f64, scale: f64) -> f64 {
    let knee = HUBER * scale;
    if square <= knee * knee { square } else { 2.0 * knee * square.sqrt() - knee * knee }
}

/// Points that least trimmed squares keeps: h = ⌊(n + p + 1)/2⌋ with p unknowns at three equations a point (Rousseeuw's
/// choice for the largest share of gross errors that can be borne).
pub(super) fn kept_points(points: usize, unknowns: usize) -> usize {
    (points + unknowns.div_ceil(3)).div_ceil(2).clamp(1, points)
}

/// Robust standard deviation in units of the declared one, from squared standardised distances in so many dimensions.
pub(super) fn scale_of(squares: &[f64], dimensions: usize) -> f64 {
    let usual = if dimensions == 2 { MEDIAN_IN_PLANE } else { MEDIAN_LENGTH };
    median(squares.iter().map(|s| s.sqrt()).collect()).map_or(0.0, |median| median / usual)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_losses_are_those_of_the_hand_case() {
        let mut squares = [1.0, 400.0, 4.0, 0.25, 9.0];
        assert_eq!(Loss::Squares.total(&mut squares, 3, 1.0), 414.25);
        // Five points, three unknowns: (5 + 1 + 1)/2 = 3 kept.
        assert_eq!(Loss::Trimmed.total(&mut squares, 3, 1.0), 5.25);
        let squares = [1.0, 400.0, 4.0, 0.25, 9.0];
        assert_eq!(Loss::Trimmed.weights(&squares, 3, 1.0), [1.0, 0.0, 1.0, 1.0, 0.0]);
        let weights = Loss::Huber.weights(&squares, 3, 1.0);
        assert_eq!(weights[0], 1.0);
        assert!((weights[1] - HUBER / 20.0).abs() < 1e-15);
        // Continuous at the knee, with the slope 2·knee beyond it.
        let knee = HUBER;
        assert!((huber(knee * knee, 1.0) - knee * knee).abs() < 1e-12);
        assert!((huber((knee + 1.0).powi(2), 1.0) - (knee * knee + 2.0 * knee)).abs() < 1e-12);
    }

    #[test]
    fn scale_of_unit_normal_vectors_is_one() {
        // Lengths at the quantiles 0.25, 0.5, 0.75 of the chi distribution with three degrees of freedom.
        let squares = [1.2125, 2.3660, 4.1083];
        assert!((scale_of(&squares, 3) - 1.0).abs() < 1e-4);
        assert_eq!(scale_of(&[], 3), 0.0);
    }
}
