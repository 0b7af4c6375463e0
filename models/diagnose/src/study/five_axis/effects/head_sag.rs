//! Sag of the head: its weight turns it about A, the more so the further it leans out.
//!
//! Formula: θA → θA + k·sin θA, k in rad: moment of the head's weight times the compliance of its drive. Where A takes
//! three angles only, one of them zero and two opposite, it equals a gain. Typical 10–500 µrad.

use super::{ANGLE, Known, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "sag of the head",
    formula: "theta_A → theta_A + k sin(theta_A)",
    typical: "10-500 µrad",
    source: "moment of the weight over an elastic drive; ISO 230-1:2012, annex on deformation",
    kind: Explanation::Attributed,
    decided_by: "measure the sphere at more A angles, at least five over the whole range: a gain is straight in the angle, a sag is a sine",
    unknowns: &[Unknown { name: "sag", unit: "rad", plausible: ANGLE }],
    groups: &[&[0]],
    motion,
};

fn motion(pose: &Pose, part: &mut Motion) {
    part(0, Acts::AngleA, pose.a_rad.sin());
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn it_is_largest_with_the_head_level() {
        assert_moves(&KNOWN, [90.0, 0.0], &[1e-5], [0.0, 0.0, 5e-6]);
        assert_moves(&KNOWN, [0.0, 0.0], &[1e-5], [0.0; 3]);
    }
}
