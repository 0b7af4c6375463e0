//! Reflector holders that are not as long as entered: each offset of a plan has a constant error of its own.
//!
//! Equation: shift = v(offset) · beam, v a normal vector drawn for each distinct offset. It is an error of the
//! measuring set-up, not of the machine: verification asks for the true tip and is left alone. The ram's turns of
//! some µrad do not matter to a vector of some µm. Size: 0.5–5 µm.

use super::{Beam, Effect, Moment};
use crate::error::{SimulationError, require_not_negative};
use crate::random::{Purpose, normal, stream};

/// A wrong length of every reflector holder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReflectorOffset {
    /// Seed of the vectors.
    pub seed: u64,
    /// Standard deviation of each component (m).
    pub size_m: f64,
}

impl ReflectorOffset {
    /// Error of the holder that is entered with this offset (m, ram frame).
    pub fn error_m(&self, offset_m: [f64; 3]) -> [f64; 3] {
        // Holders are told apart by the bits of what was entered; the multiplier spreads them over all seeds.
        let holder = offset_m.iter().fold(self.seed, |sum, value| {
            (sum.rotate_left(21) ^ (value + 0.0).to_bits()).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        });
        let mut generator = stream(holder, Purpose::ReflectorOffset);
        [0; 3].map(|_| self.size_m * normal(&mut generator))
    }
}

impl Effect for ReflectorOffset {
    fn name(&self) -> &'static str {
        "reflector_offset"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_not_negative("size_m", self.size_m)
    }

    fn range_shift_m(&self, moment: &Moment, beam: &Beam) -> f64 {
        let error_m = self.error_m(moment.offset_m);
        (0..3).map(|d| error_m[d] * beam.toward_reflector[d]).sum()
    }
}
