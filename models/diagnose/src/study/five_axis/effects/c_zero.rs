//! Zero of the C angle: the A axis is not parallel to X where C indicates zero.
//!
//! Formula: θC → θC + z (rad). The same as a tilt of the A axis about Z, up to the probe's own pose; and a probe whose
//! direction is unknown cannot tell the two. Typical 10–1000 µrad.

use super::{ANGLE, Known, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "zero of C",
    formula: "theta_C → theta_C + z",
    typical: "10-1000 µrad",
    source: "ISO 230-1:2012 (zero position of a rotary axis, EC0C)",
    kind: Explanation::Attributed,
    decided_by: "square the A axis to X with an indicator on the fork while A turns, without any probe on the head",
    unknowns: &[Unknown { name: "zero", unit: "rad", plausible: ANGLE }],
    groups: &[&[0]],
    motion,
};

fn motion(_pose: &Pose, part: &mut Motion) {
    part(0, Acts::AngleC, 1.0);
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn it_shows_with_the_head_level_only() {
        assert_moves(&KNOWN, [90.0, 0.0], &[1e-5], [-5e-6, 0.0, 0.0]);
        assert_moves(&KNOWN, [0.0, 0.0], &[1e-5], [0.0; 3]);
    }
}
