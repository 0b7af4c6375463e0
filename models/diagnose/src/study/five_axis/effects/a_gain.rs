//! Gain of the A angle: the head turns by (1 + g) of what it indicates.
//!
//! Formula: θA → θA·(1 + g), g without unit. A gear or belt ratio, or an encoder with a wrong count. Typical 1e-5 to
//! 1e-3 (10–1000 µrad at 1 rad).

use super::{ANGLE, Known, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "gain of A",
    formula: "theta_A → theta_A (1 + g)",
    typical: "10-1000 µrad at 1 rad",
    source: "ISO 230-1:2012 (angular positioning EAA); ISO 230-2",
    kind: Explanation::Attributed,
    decided_by: "measure the sphere at more A angles, at least five over the whole range: a gain is straight in the angle, a sag is a sine",
    unknowns: &[Unknown { name: "gain", unit: "1", plausible: ANGLE }],
    groups: &[&[0]],
    motion,
};

fn motion(pose: &Pose, part: &mut Motion) {
    part(0, Acts::AngleA, pose.a_rad);
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn half_a_metre_at_ninety_degrees_rises_by_the_angle_gained() {
        let angle = std::f64::consts::FRAC_PI_2 * 1e-5;
        assert_moves(&KNOWN, [90.0, 0.0], &[1e-5], [0.0, 0.0, 0.5 * angle]);
        assert_moves(&KNOWN, [0.0, 30.0], &[1e-5], [0.0; 3]);
    }
}
