//! Scale of the linear axes: X, Y or Z travels more than it indicates.
//!
//! Formula: shift = g·Q along the axis, Q the indicated position (m), g without unit. Typical 1–50 µm/m.

use super::{Known, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "scale of axis",
    formula: "shift = g Q along X, Y or Z",
    typical: "1-50 µm/m",
    source: "ISO 230-2 (positioning of linear axes)",
    kind: Explanation::Attributed,
    decided_by: "measure a calibrated length or a laser interferometer along the axis",
    unknowns: &[
        Unknown { name: "x", unit: "1", plausible: 2e-4 },
        Unknown { name: "y", unit: "1", plausible: 2e-4 },
        Unknown { name: "z", unit: "1", plausible: 2e-4 },
    ],
    groups: &[&[0], &[1], &[2]],
    motion,
};

fn motion(pose: &Pose, part: &mut Motion) {
    (0..3).for_each(|k| part(k, Acts::Shift(k), pose.reading_m[k]));
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn four_tenths_of_a_metre_grow_in_proportion() {
        assert_moves(&KNOWN, [30.0, 0.0], &[1e-5, 2e-5, 0.0], [4e-6, 4e-6, 0.0]);
    }
}
