//! Tilt of the C axis against Z of the machine, about X and about Y.
//!
//! Formula: R_C → E(t)·R_C·E(t)ᵀ, t = (about_x, about_y, 0) a rotation vector (rad) in the machine frame.
//! Typical 10–1000 µrad.

use super::{ANGLE, Known, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "tilt of C",
    formula: "R_C → E(t) R_C E(t)^T, t a small rotation about x or y of the machine",
    typical: "10-1000 µrad",
    source: "ISO 230-1:2012 (orientation of a rotary axis, EA0C and EB0C)",
    kind: Explanation::Attributed,
    decided_by: "measure the sphere at more C angles, up to half a turn either way, with A level and at both signs",
    unknowns: &[
        Unknown { name: "about_x", unit: "rad", plausible: ANGLE },
        Unknown { name: "about_y", unit: "rad", plausible: ANGLE },
    ],
    groups: &[&[0], &[1]],
    motion,
};

fn motion(_pose: &Pose, part: &mut Motion) {
    part(0, Acts::TiltC(0), 1.0);
    part(1, Acts::TiltC(1), 1.0);
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn half_a_turn_shows_twice_the_tilt() {
        // The probe hangs along −z: with C at 180° the axis, leaning by t, carries it over by 2·t·0.5 m.
        assert_moves(&KNOWN, [0.0, 180.0], &[1e-5, 0.0], [0.0, 1e-5, 0.0]);
        assert_moves(&KNOWN, [0.0, 180.0], &[0.0, 1e-5], [-1e-5, 0.0, 0.0]);
        assert_moves(&KNOWN, [40.0, 0.0], &[1e-5, 1e-5], [0.0; 3]);
    }
}
