//! How long moves and lines take.
//!
//! Place in the flow: the budget of a plan and the time stamps of its points. A move of a distance d with feed v and
//! acceleration a takes d/v + v/a, or 2√(d/a) where the feed is not reached; then the machine stands still to be measured.

use abbe_measurement::planned::Motion;

/// Time of a straight move (s).
pub(crate) fn move_s(distance_m: f64, feed_m_s: f64, acceleration_m_s2: f64) -> f64 {
    if distance_m <= feed_m_s * feed_m_s / acceleration_m_s2 {
        2.0 * (distance_m / acceleration_m_s2).sqrt()
    } else {
        distance_m / feed_m_s + feed_m_s / acceleration_m_s2
    }
}

/// Time of a line of evenly spaced points from its first to its last, each with its standstill (s).
pub(crate) fn line_s(motion: &Motion, length_m: f64, points: u32, feed_m_s: f64) -> f64 {
    let steps = f64::from(points.saturating_sub(1));
    let moves_s = steps * move_s(length_m / steps.max(1.0), feed_m_s, motion.acceleration_m_s2);
    moves_s + f64::from(points) * motion.dwell_s
}

/// Fastest of the feeds: moves between lines (m/s).
pub(crate) fn fastest_m_s(motion: &Motion) -> f64 {
    motion.feeds_m_s.iter().fold(0.0, |most: f64, feed| most.max(*feed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_move_reaches_its_feed_and_a_short_one_does_not() {
        // 0.5 s to 0.1 m/s, 0.95 m at it, 0.5 s to stand: 10.5 s for 1 m.
        assert!((move_s(1.0, 0.1, 0.2) - 10.5).abs() < 1e-12);
        // Half of 0.02 m in 0.1 · √10 s, and as long to stop.
        assert!((move_s(0.02, 0.1, 0.2) - 2.0 * 0.1_f64.sqrt()).abs() < 1e-12);
        let at_the_limit = 0.1 * 0.1 / 0.2;
        assert!((move_s(at_the_limit, 0.1, 0.2) - move_s(at_the_limit * (1.0 + 1e-12), 0.1, 0.2)).abs() < 1e-9);
        assert_eq!(move_s(0.0, 0.1, 0.2), 0.0);
    }
}
