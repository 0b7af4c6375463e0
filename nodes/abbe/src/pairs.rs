//! Length errors between pairs of points whose actual positions are known.
//!
//! Place in the flow: `abbe verify`. The distance of two points needs no alignment. Error of indication = measured −
//! actual length, as in ISO 10360-2, over all pairs at once. It is no acceptance test after that standard, which has gauges
//! on seven lines; it is what the points at hand say of lengths anywhere in the volume.

use abbe_conformity::{Frontier, ObservedError, SupportedLimit};
use abbe_geometry::Vector3;
use abbe_report::digits;
use anyhow::bail;

/// Pairs nearer than this say nothing of a length (m).
const SHORTEST_M: f64 = 0.01;

/// Length errors over all pairs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PairErrors {
    /// Number of pairs.
    pub(crate) pairs: usize,
    /// Largest magnitude (m).
    pub(crate) largest_m: f64,
    /// Tightest limit A + L/K that holds them all (smallest mean over the lengths).
    pub(crate) tightest: SupportedLimit,
}

/// Length errors between all pairs of points; corresponding lists (m).
pub(crate) fn pair_errors(measured_m: &[Vector3<f64>], actual_m: &[Vector3<f64>]) -> anyhow::Result<PairErrors> {
    let points = measured_m.iter().zip(actual_m);
    let points: Vec<_> = points.collect();
    let of = |(k, (measured, actual)): (usize, &(&Vector3<f64>, &Vector3<f64>))| {
        let rest = points[k + 1..].iter();
        let error = |(other, truth): &(&Vector3<f64>, &Vector3<f64>)| {
            let length_m = (*truth - *actual).norm();
            (length_m, ObservedError::from_metres((*other - *measured).norm() - length_m))
        };
        rest.map(error).filter(|(length_m, _)| *length_m >= SHORTEST_M).collect::<Vec<_>>()
    };
    let errors: Vec<(f64, ObservedError)> = points.iter().enumerate().flat_map(of).collect();
    if errors.is_empty() {
        let pairs = points
            .iter()
            .enumerate()
            .flat_map(|(k, (_, one))| points[..k].iter().map(move |(_, other)| (**one - **other).norm()));
        let longest_mm = pairs.fold(0.0, f64::max) * 1e3;
        bail!(
            "the actual positions are {longest_mm:.4} mm apart at the most, which says nothing of lengths: give points all over the volume; \
             if the numbers are metres, multiply readings, offsets and actual positions by 1000"
        );
    }
    let largest_m = errors.iter().map(|(_, error)| error.magnitude_m()).fold(0.0, f64::max);
    let frontier = Frontier::of(errors.iter().copied())?;
    Ok(PairErrors { pairs: errors.len(), largest_m, tightest: frontier.smallest_area() })
}

impl PairErrors {
    /// The tightest limit in words: A in µm, K in mm, as specifications are written. It has the decimals of the largest error
    /// and is rounded so that it still holds that one.
    pub(crate) fn limit(&self) -> String {
        let SupportedLimit { constant_m, per_metre } = self.tightest;
        let decimals = digits::of_result(self.largest_m * 1e6);
        let constant = digits::rounded_up(constant_m * 1e6, decimals);
        match per_metre > 0.0 {
            // µm per mm is a thousandth of m per m.
            true => format!("{constant} + L/{:.0}", (1e-3 / per_metre + 1e-6).floor()),
            false => constant,
        }
    }

    /// The same where it grows with the length; where it does not, it is the largest error again.
    pub(crate) fn growing_limit(&self) -> Option<String> {
        (self.tightest.per_metre > 0.0).then(|| self.limit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_that_is_too_long_shows_as_a_length_error_whatever_the_frame() {
        let actual: Vec<Vector3<f64>> =
            (0..20).map(|k| Vector3::new(f64::from(k) * 0.04, f64::from(k % 3) * 0.1, 0.0)).collect();
        let turn = nalgebra_turn();
        // 10 µm/m too long, in another frame.
        let measured: Vec<_> = actual.iter().map(|p| turn * (p * 1.000_010) + Vector3::new(1.0, 2.0, 3.0)).collect();
        let found = pair_errors(&measured, &actual).unwrap();
        let longest_m = (actual[19] - actual[0]).norm();
        assert_eq!(found.pairs, 190);
        assert!((found.largest_m - 10e-6 * longest_m).abs() < 1e-9, "{found:?}");
        assert!((found.tightest.per_metre - 10e-6).abs() < 1e-8 && found.tightest.constant_m < 1e-9, "{found:?}");
        assert_eq!(found.limit(), "0.00 + L/100");
    }

    #[test]
    fn regress_points_in_metres_are_told_by_how_near_they_are() {
        let near: Vec<Vector3<f64>> = (0..4).map(|k| Vector3::new(f64::from(k) * 2e-4, 0.0, 0.0)).collect();
        let told = pair_errors(&near, &near).unwrap_err().to_string();
        assert!(told.contains("0.6000 mm apart at the most") && told.contains("if the numbers are metres"), "{told}");
    }

    #[test]
    fn a_limit_is_rounded_so_that_it_holds_the_largest_error() {
        let of = |constant_m, per_metre| SupportedLimit { constant_m, per_metre };
        let limit = |largest_m, tightest| PairErrors { pairs: 1, largest_m, tightest }.limit();
        assert_eq!(limit(48.612e-6, of(48.612e-6, 0.0)), "48.7");
        assert_eq!(limit(66.473e-6, of(59.281e-6, 9.2e-6)), "59.3 + L/108");
        assert_eq!(limit(0.0, of(0.0, 0.0)), "0");
        // The largest error was said twice, once rounded and once rounded up.
        let growing =
            |per_metre| PairErrors { pairs: 1, largest_m: 1e-6, tightest: of(1e-6, per_metre) }.growing_limit();
        assert_eq!((growing(0.0), growing(1e-5).as_deref()), (None, Some("1.00 + L/100")));
    }

    fn nalgebra_turn() -> abbe_geometry::Matrix3<f64> {
        let (sin, cos) = 0.7_f64.sin_cos();
        abbe_geometry::Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
    }
}
