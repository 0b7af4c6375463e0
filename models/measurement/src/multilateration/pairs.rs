//! Repeated readings of a point from a station: compared, averaged, or rejected together.
//!
//! Place in the flow: between the calibration of stations and the solution of points. A campaign measures forward and in
//! reverse; two lengths of one point that differ by more than a limit contradict each other, and nothing tells which is
//! wrong, so both go, and are reported. Source: Chen 2020 section 3.1 (5 µm).

/// Limit of the difference in Chen 2020 (m).
pub const LIMIT_M: f64 = 5e-6;

/// Readings of one point from one station that contradict each other.
#[derive(Debug, Clone, PartialEq)]
pub struct RejectedPair {
    /// Index of the station.
    pub station: usize,
    /// Index of the point.
    pub point: usize,
    /// Indices of the readings that were left out.
    pub readings: Vec<usize>,
    /// Largest less smallest length, each relative to where the machine indicated the point (m).
    pub difference_m: f64,
}

/// Difference between the largest and the smallest of the deviations, if it exceeds the limit.
pub(crate) fn contradiction(deviations_m: &[f64], limit_m: f64) -> Option<f64> {
    let (lower, upper) =
        deviations_m.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, u), d| (l.min(*d), u.max(*d)));
    let difference_m = upper - lower;
    (difference_m > limit_m).then_some(difference_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_is_rejected_beyond_the_limit_only() {
        assert_eq!(contradiction(&[1.0e-6, -3.9e-6], LIMIT_M), None);
        let beyond = contradiction(&[1.0e-6, -4.1e-6], LIMIT_M).unwrap();
        assert!((beyond - 5.1e-6).abs() < 1e-15);
        assert_eq!(contradiction(&[7.0], LIMIT_M), None);
        assert_eq!(contradiction(&[], LIMIT_M), None);
    }
}
