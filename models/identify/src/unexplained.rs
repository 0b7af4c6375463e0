//! What a fit leaves unexplained, axis by axis.
//!
//! Place in the flow: the end of a fit, and whoever predicts readings that a fit did not see. A reading sees one direction: a cause that
//! moves the tip along X with a standard deviation s shows s² dx² of variance on the ranges, a third of it on the average, and taken
//! for one that acts in all directions alike it would be covered to 75 % along X. So
//!
//! mean of r² − u² = sx² dx² + sy² dy² + sz² dz²
//!
//! is solved for variances that are not below zero (least squares), which also holds what acts on the range itself: it has the same
//! variance in every direction. Readings of a block (a line) count as one where it is asked how well that is known. m.

use abbe_geometry::Matrix3;
use abbe_geometry::Vector3;
use std::collections::BTreeMap;

/// What one reading shows beyond its declared noise.
#[derive(Debug, Clone, Copy)]
pub struct Excess {
    /// Line of sight.
    pub direction: Vector3<f64>,
    /// Square of its residual less its declared variance (m²).
    pub square_m2: f64,
    /// The line that it was measured on, with all that is correlated along it.
    pub line: u32,
}

/// Standard deviation along X, Y and Z (m) of what explains a mean excess of `total_m`² over these readings. One standard deviation
/// of what the lines leave open is added to each, at most what would explain all of it alone.
pub fn by_axis(excess: &[Excess], total_m: f64) -> [f64; 3] {
    if excess.is_empty() || total_m <= 0.0 {
        return [0.0; 3];
    }
    let seen = |one: &Excess| one.direction.component_mul(&one.direction);
    let count = excess.len() as f64;
    let mean = excess.iter().map(seen).sum::<Vector3<f64>>() / count;
    let normal = excess.iter().map(|one| seen(one) * seen(one).transpose()).sum::<Matrix3<f64>>();
    let right = excess.iter().map(|one| seen(one) * one.square_m2).sum::<Vector3<f64>>();
    let Some(inverse) = normal.try_inverse() else { return [total_m; 3] };
    let found = above_zero(&normal, &right);
    let explained = found.dot(&mean);
    let total_m2 = total_m * total_m;
    let found = if explained > 0.0 { found * (total_m2 / explained) } else { Vector3::repeat(total_m2) };
    let mut scores: BTreeMap<u32, Vector3<f64>> = BTreeMap::new();
    for one in excess {
        let rest = one.square_m2 - seen(one).dot(&found);
        *scores.entry(one.line).or_insert_with(Vector3::zeros) += seen(one) * rest;
    }
    let scatter = scores.values().map(|score| score * score.transpose()).sum::<Matrix3<f64>>();
    let open = inverse * scatter * inverse;
    std::array::from_fn(|d| {
        let alone_m2 = if mean[d] > 0.0 { total_m2 / mean[d] } else { total_m2 };
        (found[d] + open[(d, d)].max(0.0).sqrt()).min(alone_m2).sqrt()
    })
}

/// The least-squares solution among those without a component below zero: the best of all choices of components that may differ from it.
fn above_zero(normal: &Matrix3<f64>, right: &Vector3<f64>) -> Vector3<f64> {
    let mut best = (0.0, Vector3::zeros());
    for choice in 1_usize..8 {
        let is_in = |d: usize| (choice >> d) & 1 == 1;
        // A component that is out has a row and column of its own.
        let of = Matrix3::from_fn(|i, j| match (is_in(i) && is_in(j), i == j) {
            (true, _) => normal[(i, j)],
            (false, true) => 1.0,
            (false, false) => 0.0,
        });
        let kept = Vector3::from_fn(|d, _| if is_in(d) { right[d] } else { 0.0 });
        let Some(found) = of.try_inverse().map(|inverse| inverse * kept) else { continue };
        // The sum of squares, but for what all have.
        let left = found.dot(&(normal * found)) - 2.0 * found.dot(right);
        if found.iter().all(|value| *value >= 0.0) && left < best.0 {
            best = (left, found);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Directions all about, ten a line, with the variance that these axes give.
    fn readings(variances: [f64; 3], noise: f64) -> Vec<Excess> {
        let one = |k: usize| {
            let (turn, height) = (2.4 * k as f64, 0.9 * (1.7 * k as f64).sin());
            let flat = (1.0 - height * height).sqrt();
            let direction = Vector3::new(flat * turn.cos(), flat * turn.sin(), height);
            let square_m2 = Vector3::from(variances).dot(&direction.component_mul(&direction));
            Excess { direction, square_m2: square_m2 + noise * (5.1 * k as f64).sin(), line: (k / 10) as u32 }
        };
        (0..600).map(one).collect()
    }

    fn total_m(excess: &[Excess]) -> f64 {
        (excess.iter().map(|one| one.square_m2).sum::<f64>() / excess.len() as f64).sqrt()
    }

    #[test]
    fn what_moves_along_one_axis_stands_on_that_axis_with_its_own_size() {
        let along_x = readings([4e-12, 0.0, 0.0], 0.0);
        let found = by_axis(&along_x, total_m(&along_x));
        assert!((found[0] - 2e-6).abs() < 1e-10 && found[1] < 1e-10 && found[2] < 1e-10, "{found:?}");
        assert!(found[0] > 1.6 * total_m(&along_x), "one figure for all directions would hide two thirds of it");
    }

    #[test]
    fn what_acts_on_the_range_is_the_same_along_all_axes() {
        let range = readings([1e-12; 3], 0.0);
        assert!(by_axis(&range, total_m(&range)).iter().all(|u_m| (u_m - 1e-6).abs() < 1e-10));
        assert_eq!(by_axis(&range, 0.0), [0.0; 3]);
        assert_eq!(by_axis(&[], 1e-6), [0.0; 3]);
    }

    #[test]
    fn what_the_lines_leave_open_is_added_and_no_axis_has_more_than_all() {
        let noisy = readings([4e-12, 0.5e-12, 0.0], 6e-12);
        let total_m = total_m(&noisy);
        let found = by_axis(&noisy, total_m);
        let plain = by_axis(&readings([4e-12, 0.5e-12, 0.0], 0.0), total_m);
        assert!(found.iter().zip(plain).all(|(open, known)| *open > known - 1e-7), "{found:?} {plain:?}");
        assert!(found[2] > 1e-7, "{found:?}");
        // One direction only: nobody knows the others.
        let blind = vec![Excess { direction: Vector3::x(), square_m2: 1e-12, line: 0 }; 20];
        assert_eq!(by_axis(&blind, 1e-6), [1e-6; 3]);
    }
}
