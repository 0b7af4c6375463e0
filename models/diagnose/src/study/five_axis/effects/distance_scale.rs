//! Scale of the probe's distance reading.
//!
//! Formula: d → d·(1 + s), s without unit. A direction R_p whose length is free takes it over entirely: then the length
//! of R_p *is* 1 + s. Typical 1e-4 to 1e-3 for conoscopic and triangulating probes.

use super::{Known, Motion, Unknown};
use crate::explanation::Explanation;
use crate::study::five_axis::chain::{Acts, Pose};

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "scale of the probe's distance",
    formula: "d → d (1 + s)",
    typical: "100-1000 µm/m",
    source: "data sheets of laser probes (linearity)",
    kind: Explanation::Attributed,
    decided_by: "calibrate the probe against a step gauge or an interferometer along its beam",
    unknowns: &[Unknown { name: "scale", unit: "1", plausible: 5e-3 }],
    groups: &[&[0]],
    motion,
};

fn motion(_pose: &Pose, part: &mut Motion) {
    part(0, Acts::Distance, 1.0);
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_moves;
    use super::KNOWN;

    #[test]
    fn a_tenth_of_a_metre_read_long_moves_the_point_along_the_beam() {
        assert_moves(&KNOWN, [0.0, 0.0], &[1e-3], [0.0, 0.0, -1e-4]);
        assert_moves(&KNOWN, [90.0, 0.0], &[1e-3], [0.0, 1e-4, 0.0]);
    }
}
