//! Tilt of the A axis in the fork: out of square to the C axis (about y), or turned in its plane (about z).
//!
//! Formula: R_A → E(t)·R_A·E(t)ᵀ, t = (0, about_y, about_z) a rotation vector (rad) in the frame that C turns. About z it
//! equals a zero of C, up to the probe's pose. Typical 10–1000 µrad.

use super::{ANGLE, Known, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "tilt of A",
    formula: "R_A → E(t) R_A E(t)^T, t a small rotation about y or z of the fork",
    typical: "10-1000 µrad",
    source: "ISO 230-1:2012 (orientation of a rotary axis, EB0A and EC0A)",
    kind: Explanation::Attributed,
    decided_by: "measure the sphere at more C angles with A at both signs, up to half a turn of C",
    unknowns: &[
        Unknown { name: "about_y", unit: "rad", plausible: ANGLE },
        Unknown { name: "about_z", unit: "rad", plausible: ANGLE },
    ],
    groups: &[&[0], &[1]],
    motion,
};

fn motion(_pose: &Pose, part: &mut Motion) {
    part(0, Acts::TiltA(1), 1.0);
    part(1, Acts::TiltA(2), 1.0);
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn a_quarter_turn_shows_the_tilt_and_none_at_zero() {
        // About y: the axis points down by 1e-5; turned by 90° the probe, on +y, leans along x, and its own tilt is undone.
        assert_moves(&KNOWN, [90.0, 0.0], &[1e-5, 0.0], [5e-6, 0.0, 0.0]);
        assert_moves(&KNOWN, [90.0, 0.0], &[0.0, 1e-5], [-5e-6, 0.0, 0.0]);
        assert_moves(&KNOWN, [0.0, 0.0], &[1e-5, 1e-5], [0.0; 3]);
    }
}
