//! Zero of the A angle: the head is turned by a constant angle beyond what it indicates.
//!
//! Formula: θA → θA + z (rad). A probe whose direction and zero are unknown takes it over entirely, as both hang on the
//! A axis; with a calibrated probe it shows. Typical 10–1000 µrad.

use super::{ANGLE, Known, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "zero of A",
    formula: "theta_A → theta_A + z",
    typical: "10-1000 µrad",
    source: "ISO 230-1:2012 (zero position of a rotary axis, EA0A)",
    kind: Explanation::Attributed,
    decided_by: "measure with a probe or test mandrel whose direction is calibrated apart from the machine",
    unknowns: &[Unknown { name: "zero", unit: "rad", plausible: ANGLE }],
    groups: &[&[0]],
    motion,
};

fn motion(_pose: &Pose, part: &mut Motion) {
    part(0, Acts::AngleA, 1.0);
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn half_a_metre_of_probe_swings_by_the_angle() {
        assert_moves(&KNOWN, [0.0, 0.0], &[1e-5], [0.0, 5e-6, 0.0]);
        assert_moves(&KNOWN, [90.0, 0.0], &[1e-5], [0.0, 0.0, 5e-6]);
    }
}
