//! Squareness of the linear axes: Y against X, Z against X and Z against Y.
//!
//! Formula: shift_x = −c0y·Y + b0z·Z, shift_y = −a0z·Z, angles in rad, positions indicated (m); names after ISO 230-1.
//! Typical 10–100 µrad.

use super::{Known, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "squareness",
    formula: "shift_x = -C0Y Y + B0Z Z, shift_y = -A0Z Z",
    typical: "10-100 µrad",
    source: "ISO 230-1:2012 (squareness of linear axes)",
    kind: Explanation::Attributed,
    decided_by: "measure the face diagonals, or a ball plate, with the linear axes alone",
    unknowns: &[
        Unknown { name: "C0Y", unit: "rad", plausible: 3e-4 },
        Unknown { name: "B0Z", unit: "rad", plausible: 3e-4 },
        Unknown { name: "A0Z", unit: "rad", plausible: 3e-4 },
    ],
    groups: &[&[0], &[1], &[2]],
    motion,
};

fn motion(pose: &Pose, part: &mut Motion) {
    part(0, Acts::Shift(0), -pose.reading_m.y);
    part(1, Acts::Shift(0), pose.reading_m.z);
    part(2, Acts::Shift(1), -pose.reading_m.z);
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn the_axes_lean_about_the_axis_named() {
        assert_moves(&KNOWN, [30.0, 0.0], &[1e-5, 2e-5, 3e-5], [-2e-6 + 12e-6, -18e-6, 0.0]);
    }
}
