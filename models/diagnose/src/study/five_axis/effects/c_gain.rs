//! Gain of the C angle: the fork turns by (1 + g) of what it indicates.
//!
//! Formula: θC → θC·(1 + g), g without unit. Typical 1e-5 to 1e-3 (10–1000 µrad at 1 rad).

use super::{ANGLE, Known, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "gain of C",
    formula: "theta_C → theta_C (1 + g)",
    typical: "10-1000 µrad at 1 rad",
    source: "ISO 230-1:2012 (angular positioning ECC); ISO 230-2",
    kind: Explanation::Attributed,
    decided_by: "measure the sphere at more C angles, up to half a turn either way, with the head tilted",
    unknowns: &[Unknown { name: "gain", unit: "1", plausible: ANGLE }],
    groups: &[&[0]],
    motion,
};

fn motion(pose: &Pose, part: &mut Motion) {
    part(0, Acts::AngleC, pose.c_rad);
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn with_the_head_level_the_probe_swings_by_the_angle_gained() {
        // At A = 90° the probe, straight down in the head, points along +y of the fork.
        let angle = std::f64::consts::FRAC_PI_2 * 1e-5;
        assert_moves(&KNOWN, [90.0, 90.0], &[1e-5], [0.0, -0.5 * angle, 0.0]);
        assert_moves(&KNOWN, [0.0, 90.0], &[1e-5], [0.0; 3]);
    }
}
