//! Bow of the X guideway by moisture: granite that is damp on top swells there.
//!
//! Equation: the arc of [`super::bow`], with κ = bow · (h − 50 %). Size: plates bend by 1 to 3 µm a metre between a dry and a damp room, 1e-6 /(m·%).

use super::bow::arch;
use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::JointErrors;

/// Circular bow of the X guideway by the humidity of the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MoistureBow {
    /// Curvature a percent of relative humidity above 50 % (1/(m·%)).
    pub curvature_per_percent: f64,
}

impl Effect for MoistureBow {
    fn name(&self) -> &'static str {
        "moisture_bow"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("curvature_per_percent", &[self.curvature_per_percent])
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        arch(self.curvature_per_percent * (moment.environment.humidity_pct() - 50.0), moment, errors);
    }
}
