//! Once-per-turn displacement with the C angle, whatever its cause: an empirical term.
//!
//! Formula: shift = s·sin θC + c·(1 − cos θC) along machine x, y or z (m), each direction a candidate of its own. It says
//! that the error follows the angle, not why.

use super::{Known, LENGTH, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "harmonic of C with",
    formula: "shift = s sin(theta_C) + c (1 - cos(theta_C)) along machine x, y or z",
    typical: "10-1000 µm",
    source: "none: it describes, it does not explain",
    kind: Explanation::Empirical,
    decided_by: "measure the sphere at more C angles, evenly over the whole range",
    unknowns: &[
        Unknown { name: "sine_x", unit: "m", plausible: LENGTH },
        Unknown { name: "cosine_x", unit: "m", plausible: LENGTH },
        Unknown { name: "sine_y", unit: "m", plausible: LENGTH },
        Unknown { name: "cosine_y", unit: "m", plausible: LENGTH },
        Unknown { name: "sine_z", unit: "m", plausible: LENGTH },
        Unknown { name: "cosine_z", unit: "m", plausible: LENGTH },
    ],
    groups: &[&[0, 1], &[2, 3], &[4, 5]],
    motion,
};

fn motion(pose: &Pose, part: &mut Motion) {
    let (sine, cosine) = pose.c_rad.sin_cos();
    for k in 0..3 {
        part(2 * k, Acts::Shift(k), sine);
        part(2 * k + 1, Acts::Shift(k), 1.0 - cosine);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn it_vanishes_at_zero_and_reads_off_at_the_quarter_turn() {
        let angles = [33.0, 90.0];
        assert_moves(&KNOWN, angles, &[1e-5, 2e-5, 0.0, 0.0, 0.0, 4e-5], [3e-5, 0.0, 4e-5]);
        assert_moves(&KNOWN, [0.0, 0.0], &[1e-5; 6], [0.0; 3]);
    }
}
