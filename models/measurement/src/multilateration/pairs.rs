//! Repeated readings of a point from a station: compared, averaged, or left out.
//!
//! Place in the flow: between the start of the stations and the adjustment. A campaign measures forward and in reverse; lengths of
//! one point that differ by more than a limit contradict each other. Of three or more the most that agree stay, where they are
//! the majority; of two nothing tells which is wrong, so both go. All that goes is reported. The limit follows from what is
//! declared: six deviations of the difference of two readings, and never less than the 5 µm of Chen 2020 section 3.1.

use std::fmt;

/// Limit of the difference in Chen 2020 (m), the least that is taken.
pub const LIMIT_M: f64 = 5e-6;
/// Deviations of a difference beyond which two readings contradict each other: of normal ones 2 in 10⁹.
const DEVIATIONS: f64 = 6.0;

/// Readings of one point from one station that contradict each other.
#[derive(Debug, Clone, PartialEq)]
pub struct RejectedPair {
    /// Index of the station.
    pub station: usize,
    /// Index of the point.
    pub point: usize,
    /// Indices of the readings that were left out.
    pub readings: Vec<usize>,
    /// The fewest gross errors that explain it: of a pair one, though both were left out.
    pub gross: usize,
    /// Largest less smallest length, each relative to where the machine indicated the point (m).
    pub difference_m: f64,
    /// The limit that it exceeds (m).
    pub limit_m: f64,
}

/// What contradicting pairs cost a campaign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOut {
    /// Points and stations whose readings contradict each other.
    pub pairs: usize,
    /// Points and stations with two readings or more.
    pub repeated: usize,
    /// Median of their differences (m).
    pub difference_m: f64,
    /// Median of the limits that these exceed (m).
    pub limit_m: f64,
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let LeftOut { pairs, repeated, difference_m, limit_m } = self;
        write!(
            f,
            "at {pairs} of {repeated} points read more than once from a station, readings differ by {:.1} µm (median) where {:.1} µm is \
             let pass. Declare the instrument's range uncertainty and the machine's repeatability in the machine file as they are, or \
             give another limit with --pair-limit-um",
            difference_m * 1e6,
            limit_m * 1e6
        )
    }
}

/// The largest difference of two readings that the declared standard uncertainty (m) of one explains (m).
pub(crate) fn limit_m(u_m: f64) -> f64 {
    (DEVIATIONS * std::f64::consts::SQRT_2 * u_m).max(LIMIT_M)
}

/// Deviations that are left out, by their places, and how many gross errors that takes at least.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Contradiction {
    pub(crate) left_out: Vec<usize>,
    pub(crate) gross: usize,
    pub(crate) difference_m: f64,
}

/// What contradicts among deviations of one point from one station; `None` where all agree.
pub(crate) fn contradiction(deviations_m: &[f64], limit_m: f64) -> Option<Contradiction> {
    let mut order: Vec<usize> = (0..deviations_m.len()).collect();
    order.sort_by(|a, b| deviations_m[*a].total_cmp(&deviations_m[*b]));
    let at = |k: usize| deviations_m[order[k]];
    let difference_m = at(order.len().checked_sub(1)?) - at(0);
    if difference_m <= limit_m {
        return None;
    }
    // The most that lie within the limit of each other; the first of several.
    let agreeing = |from: usize| order[from..].iter().filter(|k| deviations_m[**k] - at(from) <= limit_m).count();
    let (from, most) = (0..order.len())
        .map(|from| (from, agreeing(from)))
        .fold((0, 0), |best, one| if one.1 > best.1 { one } else { best });
    let gross = order.len() - most;
    let is_majority = 2 * most > order.len();
    let mut left_out: Vec<usize> =
        (0..order.len()).filter(|k| !(is_majority && (from..from + most).contains(k))).map(|k| order[k]).collect();
    left_out.sort_unstable();
    Some(Contradiction { left_out, gross, difference_m })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_is_rejected_beyond_the_limit_only() {
        assert_eq!(contradiction(&[1.0e-6, -3.9e-6], LIMIT_M), None);
        let beyond = contradiction(&[1.0e-6, -4.1e-6], LIMIT_M).unwrap();
        assert!((beyond.difference_m - 5.1e-6).abs() < 1e-15);
        assert_eq!((beyond.left_out, beyond.gross), (vec![0, 1], 1));
        assert_eq!(contradiction(&[7.0], LIMIT_M), None);
        assert_eq!(contradiction(&[], LIMIT_M), None);
    }

    #[test]
    fn of_three_the_two_that_agree_stay_and_of_two_and_two_none() {
        let three = contradiction(&[1.0e-6, 90e-6, 2.0e-6], LIMIT_M).unwrap();
        assert_eq!((three.left_out, three.gross), (vec![1], 1));
        let four = contradiction(&[1.0e-6, 90e-6, 2.0e-6, 91e-6], LIMIT_M).unwrap();
        assert_eq!((four.left_out, four.gross), (vec![0, 1, 2, 3], 2));
    }

    #[test]
    fn the_limit_follows_from_what_is_declared() {
        // A tracer of 0.2 µm keeps the published limit; of 10 µm, 6 · √2 · 10 = 84.9 µm.
        assert_eq!(limit_m(0.2e-6), LIMIT_M);
        assert!((limit_m(10e-6) - 84.85e-6).abs() < 1e-8);
    }
}
