//! Load on the table: a heavy part bends the bed, more where the reflector is far from the supports.
//!
//! Equation: tip_z = compliance·load·sin(πu)·sin(πv), u and v the stroke fractions of X and Y. The frame is that
//! of the table: where the table sinks, the tip is higher above it than the machine says.
//! Size: 0.05–0.5 µm/kg.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::JointErrors;

/// Dish-shaped sinking of the bed under load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TableLoad {
    /// Sinking of the middle a kilogram (m/kg).
    pub compliance_m_kg: f64,
}

impl Effect for TableLoad {
    fn name(&self) -> &'static str {
        "table_load"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("compliance_m_kg", &[self.compliance_m_kg])
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let [u, v] = [0, 1].map(|axis| std::f64::consts::PI * moment.stroke_fraction(axis));
        errors.tip_m[2] += self.compliance_m_kg * moment.load_kg * u.sin() * v.sin();
    }
}
