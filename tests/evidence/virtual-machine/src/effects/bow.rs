//! Bow of the X guideway under a temperature gradient: warm on top, it arches.
//!
//! Equation: with κ = bow · (T_top − T_bottom), the arc of a circle through both ends of the stroke,
//! z(s) = R·(cos(κ(s − h)) − cos(κh))  with R = 1/κ, s from the stroke's start, h half the stroke, and
//! the tangent angle about Y: EBX = κ(s − h). Size: curvature a kelvin, about α/height = 1e-5 /(m·K).

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::JointErrors;

/// Circular bow of the X guideway.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GradientBow {
    /// Curvature a kelvin of bridge gradient (1/(m·K)).
    pub curvature_per_kelvin: f64,
}

impl Effect for GradientBow {
    fn name(&self) -> &'static str {
        "gradient_bow"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("curvature_per_kelvin", &[self.curvature_per_kelvin])
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        arch(self.curvature_per_kelvin * moment.environment.bridge_gradient_k(), moment, errors);
    }
}

/// Bends the X guideway to the arc of a circle.
pub(super) fn arch(curvature: f64, moment: &Moment, errors: &mut JointErrors) {
    let [start, end] = moment.stroke_m[0];
    let half_m = 0.5 * (end - start);
    let from_middle_m = moment.reading_m[0] - start - half_m;
    // (cos a − cos b)/κ written as a product of sines: no cancellation, and 0 at κ = 0.
    let (sum, difference) = (half_m + from_middle_m, half_m - from_middle_m);
    let rise_m = if curvature == 0.0 {
        0.0
    } else {
        2.0 * (0.5 * curvature * sum).sin() * (0.5 * curvature * difference).sin() / curvature
    };
    errors.linear_m[0][2] += rise_m;
    // Rising with x turns x toward z, which is a negative turn about Y; beyond the middle it falls.
    errors.angular_rad[0][1] += curvature * from_middle_m;
}
