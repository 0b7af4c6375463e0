//! Bow of a column sideways: the air warms its outside, and its inside follows the scale that it carries.
//!
//! Equation: with κ = bow · (T_air − T_scale) of that axis, both behind a first-order lag, a cantilever clamped at the lower end of the stroke bends
//! to the arc of a circle: at s it stands off by (1 − cos κs)/κ and is turned by κs. Size: α/width, 1e-5 to 1e-4 /(m·K).

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite, require_positive};
use crate::machine::{Axis, JointErrors};

/// Circular bow of an axis toward another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColumnBow {
    /// The axis that bends.
    pub axis: Axis,
    /// The axis along which its upper end moves.
    pub toward: Axis,
    /// Curvature a kelvin (1/(m·K)).
    pub curvature_per_kelvin: f64,
    /// Time constant behind the sensors (s).
    pub lag_s: f64,
}

impl Effect for ColumnBow {
    fn name(&self) -> &'static str {
        "column_bow"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("curvature_per_kelvin", &[self.curvature_per_kelvin])?;
        require_positive("lag_s", self.lag_s)?;
        match self.axis == self.toward {
            true => Err(SimulationError::new("toward", "it is the axis that bends", "name another axis")),
            false => Ok(()),
        }
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let (axis, toward) = (self.axis.index(), self.toward.index());
        let behind = moment.room.behind(moment.time_s, self.lag_s);
        let curvature = self.curvature_per_kelvin * (behind.air_c() - behind.scale_c()[axis]);
        let s_m = moment.reading_m[axis] - moment.stroke_m[axis][0];
        let angle = curvature * s_m;
        // (1 − cos a)/κ without cancellation, and 0 at κ = 0.
        let off_m = if curvature == 0.0 { 0.0 } else { 2.0 * (0.5 * angle).sin().powi(2) / curvature };
        errors.linear_m[axis][toward] += off_m;
        // Of x, y, z each turns into the next about the one after that: right-handed where `toward` follows `axis`.
        let sign = if (axis + 1) % 3 == toward { 1.0 } else { -1.0 };
        errors.angular_rad[axis][3 - axis - toward] += sign * angle;
    }
}
