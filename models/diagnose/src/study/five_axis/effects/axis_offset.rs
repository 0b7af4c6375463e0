//! Offset of the A axis from the C axis: the two do not meet.
//!
//! Formula: q = Q + R_C·(o + R_A·(…)), o = (x, y, z) in metres in the frame that C turns. Along x the probe's zero takes
//! it over, along z the sphere's centre does; only y, across both axes, is a flaw of the head by itself.
//! Typical 10–1000 µm.

use super::{Known, LENGTH, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "offset of A from C along",
    formula: "q = Q + R_C (o + R_A (d R_p + T_p)), o the offset in the frame that C turns",
    typical: "10-1000 µm",
    source: "ISO 230-1:2012 (position of a rotary axis, EY0A against EY0C)",
    kind: Explanation::Attributed,
    decided_by: "measure the sphere at C = 0 and 180 degrees with A = 0, and at A = +90 and -90 degrees with C = 0",
    unknowns: &[
        Unknown { name: "x", unit: "m", plausible: LENGTH },
        Unknown { name: "y", unit: "m", plausible: LENGTH },
        Unknown { name: "z", unit: "m", plausible: LENGTH },
    ],
    groups: &[&[0], &[1], &[2]],
    motion,
};

fn motion(_pose: &Pose, part: &mut Motion) {
    (0..3).for_each(|k| part(k, Acts::Offset(k), 1.0));
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn the_offset_turns_with_c_and_not_with_a() {
        assert_moves(&KNOWN, [50.0, 0.0], &[1e-5, 2e-5, 3e-5], [1e-5, 2e-5, 3e-5]);
        assert_moves(&KNOWN, [-20.0, 90.0], &[1e-5, 2e-5, 3e-5], [-2e-5, 1e-5, 3e-5]);
    }
}
