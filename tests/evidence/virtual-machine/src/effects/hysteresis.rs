//! Hysteresis over travel: friction bends the drive, and after a reversal the axis comes round only over some way.
//!
//! Equation: δ = −½·size·z along the axis; z comes from the stops of the axis one after another, each move of length d towards
//! s = ±1 leaving z = s − (s − z)·exp(−d/travel) (Dahl 1968 with exponent 1). Before the first stop z was 0. Size: 0.1–3 µm.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite, require_positive};
use crate::machine::{Axis, JointErrors};

/// Moves further back than so many travels are forgotten.
const FORGOTTEN: f64 = 40.0;

/// Friction of one axis that remembers its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hysteresis {
    /// The axis.
    pub axis: Axis,
    /// Distance between both sides, far from a reversal (m).
    pub size_m: f64,
    /// Way over which it comes round (m).
    pub travel_m: f64,
}

impl Hysteresis {
    fn side(&self, path_m: &[[f64; 3]]) -> f64 {
        let axis = self.axis.index();
        let moves = || path_m.windows(2).map(|pair| pair[1][axis] - pair[0][axis]);
        let (mut gone_m, mut remembered) = (0.0, 0);
        for moved_m in moves().rev() {
            gone_m += f64::abs(moved_m);
            remembered += 1;
            if gone_m > FORGOTTEN * self.travel_m {
                break;
            }
        }
        let skipped = path_m.len().saturating_sub(1) - remembered;
        let towards = |side: f64, moved_m: f64| match moved_m {
            0.0 => side,
            _ => moved_m.signum() - (moved_m.signum() - side) * (-moved_m.abs() / self.travel_m).exp(),
        };
        moves().skip(skipped).fold(0.0, towards)
    }
}

impl Effect for Hysteresis {
    fn name(&self) -> &'static str {
        "hysteresis"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("size_m", &[self.size_m])?;
        require_positive("travel_m", self.travel_m)
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let axis = self.axis.index();
        errors.linear_m[axis][axis] -= 0.5 * self.size_m * self.side(moment.path_m);
    }
}
