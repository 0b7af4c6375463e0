//! The tightest limits A + L/K that a set of observed errors supports: not one, but a frontier.
//!
//! Place in the flow: lengths (m) and magnitudes of observed errors (m) in; every limit that could not be tightened
//! without an error beyond it, out. A smaller A costs a larger 1/K. The frontier A(1/K) = max |E_i| − L_i/K (and not
//! below 0) is a convex polygon; its corners are the edges of the upper convex hull of the points (L, |E|).
//!
//! A criterion has to choose on it. Smallest area under A + L/K from zero to the longest length, that is the smallest
//! mean limit, is the default here; a given A or a given K are others. A set of errors supports a limit in the sense
//! that none of them is beyond it; it says nothing of errors that were not measured.

use crate::error::ConformityError;
use crate::limit::MaximumPermissibleError;
use crate::quantity::{ObservedError, PermissibleError};

/// One limit of the frontier.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupportedLimit {
    /// A (m).
    pub constant_m: f64,
    /// 1/K (m/m).
    pub per_metre: f64,
}

impl SupportedLimit {
    /// The limit at a length (m), m.
    pub fn at_m(&self, length_m: f64) -> f64 {
        self.constant_m + self.per_metre * length_m
    }

    /// As a specification.
    ///
    /// # Errors
    /// Where it is zero or larger than any machine's.
    pub fn specification(&self) -> Result<MaximumPermissibleError, ConformityError> {
        MaximumPermissibleError::new(self.constant_m, self.per_metre)
    }
}

/// All tightest limits of a set of errors.
#[derive(Debug, Clone, PartialEq)]
pub struct Frontier {
    points: Vec<(f64, f64)>,
    corners: Vec<SupportedLimit>,
}

impl Frontier {
    /// From lengths (m) and the errors observed there.
    ///
    /// # Errors
    /// No error at all, a length that is not above zero, or an error that is not finite.
    pub fn of(observed: impl IntoIterator<Item = (f64, ObservedError)>) -> Result<Frontier, ConformityError> {
        Frontier::above(observed.into_iter().map(|(l, e)| (l, e.magnitude_m())).collect())
    }

    /// From lengths (m) and the limits that are needed there.
    ///
    /// # Errors
    /// As [`Frontier::of`].
    pub fn of_limits(needed: impl IntoIterator<Item = (f64, PermissibleError)>) -> Result<Frontier, ConformityError> {
        Frontier::above(needed.into_iter().map(|(l, limit)| (l, limit.metres())).collect())
    }

    fn above(points: Vec<(f64, f64)>) -> Result<Frontier, ConformityError> {
        if points.is_empty() {
            return Err(ConformityError::new("limits", "there is no observed error", "give at least one"));
        }
        if points.iter().any(|(l, e)| !(l.is_finite() && *l > 0.0 && e.is_finite())) {
            let problem = "a length is not above zero, or an error is not finite";
            return Err(ConformityError::new("limits", problem, "correct or remove it"));
        }
        let corners = corners(&points);
        Ok(Frontier { points, corners })
    }

    /// Corners from the smallest 1/K (a constant limit) to A = 0.
    pub fn corners(&self) -> &[SupportedLimit] {
        &self.corners
    }

    /// Smallest A (m) for a given 1/K (m/m).
    pub fn smallest_constant_m(&self, per_metre: f64) -> f64 {
        self.points.iter().map(|(l, e)| e - per_metre * l).fold(0.0, f64::max)
    }

    /// Smallest 1/K (m/m) for a given A (m).
    pub fn smallest_per_metre(&self, constant_m: f64) -> f64 {
        self.points.iter().map(|(l, e)| (e - constant_m) / l).fold(0.0, f64::max)
    }

    /// The limit with the smallest area below it, from zero to the longest length of the data.
    pub fn smallest_area(&self) -> SupportedLimit {
        let half_m = self.longest_m() / 2.0;
        // The area is the longest length times the limit at half of it.
        let mut best = SupportedLimit { constant_m: f64::INFINITY, per_metre: 0.0 };
        for corner in &self.corners {
            if corner.at_m(half_m) < best.at_m(half_m) {
                best = *corner;
            }
        }
        best
    }

    /// Longest length of the data (m).
    pub fn longest_m(&self) -> f64 {
        self.points.iter().map(|(l, _)| *l).fold(0.0, f64::max)
    }
}

/// Upper convex hull from the point with the largest error to the axis; each edge is a corner in (1/K, A).
fn corners(points: &[(f64, f64)]) -> Vec<SupportedLimit> {
    // From the constant limit on, the next corner is where another point becomes the binding one: at the smallest
    // larger slope at which the line of that point meets the line of this one.
    let mut at = points
        .iter()
        .copied()
        .fold((f64::INFINITY, 0.0), |best, p| if p.1 > best.1 || (p.1 == best.1 && p.0 < best.0) { p } else { best });
    let mut found = vec![SupportedLimit { constant_m: at.1, per_metre: 0.0 }];
    if at.1 == 0.0 {
        return found;
    }
    loop {
        // The origin stands for A = 0, beyond which nothing is gained.
        let shorter = points.iter().copied().filter(|p| p.0 < at.0).chain([(0.0, 0.0)]);
        let slope = |p: (f64, f64)| (at.1 - p.1) / (at.0 - p.0);
        let next = shorter.min_by(|a, b| slope(*a).total_cmp(&slope(*b)).then(a.0.total_cmp(&b.0)));
        let Some(next) = next else { return found };
        let per_metre = slope(next);
        found.push(SupportedLimit { constant_m: (at.1 - per_metre * at.0).max(0.0), per_metre });
        if next.0 == 0.0 {
            return found;
        }
        at = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frontier(points: &[(f64, f64)]) -> Frontier {
        Frontier::of(points.iter().map(|(l, e)| (*l, ObservedError::from_metres(*e)))).unwrap()
    }

    /// Points (100 mm, 1 µm), (200 mm, −1.5 µm), (400 mm, 2 µm). Hull edges by hand: constant 2; through the last two
    /// points 1/K = 0.5/200 µm/mm, A = 1; through the first two 0.5/100, A = 0.5; then A = 0 with 1/100.
    #[test]
    fn corners_are_the_edges_of_the_hull() {
        let found = frontier(&[(0.1, 1e-6), (0.2, -1.5e-6), (0.4, 2e-6), (0.3, 0.2e-6)]);
        let expected = [(2e-6, 0.0), (1e-6, 2.5e-6), (0.5e-6, 5e-6), (0.0, 10e-6)];
        assert_eq!(found.corners().len(), expected.len(), "{found:?}");
        for (corner, (constant_m, per_metre)) in found.corners().iter().zip(expected) {
            assert!((corner.constant_m - constant_m).abs() < 1e-18, "{corner:?}");
            assert!((corner.per_metre - per_metre).abs() < 1e-18, "{corner:?}");
        }
        // At half the longest length, 200 mm, the corners say 2, 1.5, 1.5 and 2 µm: the first of the two is taken.
        assert!((found.smallest_area().at_m(0.2) - 1.5e-6).abs() < 1e-18);
        assert!((found.smallest_constant_m(2.5e-6) - 1e-6).abs() < 1e-18);
        assert!((found.smallest_per_metre(1e-6) - 2.5e-6).abs() < 1e-18);
    }

    #[test]
    fn every_corner_holds_all_errors_and_no_smaller_one_does() {
        let points: Vec<(f64, f64)> = (1..60)
            .map(|k| (0.02 * f64::from(k), 1e-6 * (f64::from(k) * 1.7).sin() * (1.0 + 0.02 * f64::from(k))))
            .collect();
        let found = frontier(&points);
        assert!(found.corners().len() > 3);
        for corner in found.corners() {
            let slack = points.iter().map(|(l, e)| corner.at_m(*l) - e.abs());
            assert!(slack.fold(f64::INFINITY, f64::min) > -1e-18, "{corner:?}");
            assert!((found.smallest_constant_m(corner.per_metre) - corner.constant_m).abs() < 1e-18, "{corner:?}");
        }
        // By brute force over slopes: nothing has a smaller area.
        let half_m = found.longest_m() / 2.0;
        let least = (0..100_000).map(|k| 1e-10 * f64::from(k)).map(|b| found.smallest_constant_m(b) + b * half_m);
        assert!(found.smallest_area().at_m(half_m) <= least.fold(f64::INFINITY, f64::min) + 1e-18);
    }

    #[test]
    fn errors_of_zero_support_a_limit_of_zero_which_is_no_specification() {
        let found = frontier(&[(0.1, 0.0), (0.2, 0.0)]);
        assert_eq!(found.smallest_area(), SupportedLimit { constant_m: 0.0, per_metre: 0.0 });
        assert!(found.smallest_area().specification().is_err());
    }

    #[test]
    fn nothing_and_nonsense_are_refused() {
        let one = |l: f64, e: f64| Frontier::of([(l, ObservedError::from_metres(e))]);
        assert!(Frontier::of([]).is_err());
        assert!(one(0.0, 1e-6).is_err() && one(-0.1, 1e-6).is_err() && one(0.1, f64::NAN).is_err());
    }
}
