//! Tape scale of two pieces that do not meet as one: behind the splice all graduations stand off by the same.
//!
//! Equation: δ = size · H(reading − place), along the axis, H the step from 0 to 1. Size: 1–20 µm.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::{Axis, JointErrors};

/// A splice of one scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Splice {
    /// The axis whose scale is spliced.
    pub axis: Axis,
    /// By how much the second piece stands off (m).
    pub size_m: f64,
    /// Reading at which it begins (m).
    pub at_m: f64,
}

impl Effect for Splice {
    fn name(&self) -> &'static str {
        "splice"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("size_m, at_m", &[self.size_m, self.at_m])
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let axis = self.axis.index();
        if moment.reading_m[axis] > self.at_m {
            errors.linear_m[axis][axis] += self.size_m;
        }
    }
}
