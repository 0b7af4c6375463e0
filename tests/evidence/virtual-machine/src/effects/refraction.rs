//! Refraction left uncompensated, over the measured range and over the dead path.
//!
//! Equation: shown = range·(1 + range share·δn) + dead path·dead-path share·δn, with
//! δn = −0.96e-6/K·(T − 20) + 0.27e-6/hPa·(p − 1013.25) − 0.009e-6/%·(h − 50): denser air slows the light, so the
//! counter shows more. With `range_share` 0 only the dead path is affected.

use super::{Beam, Effect, Moment};
use crate::environment::EnvironmentState;
use crate::error::{SimulationError, require_finite};

/// Change of the refractive index by the air's temperature (1/K).
pub(super) const INDEX_PER_KELVIN: f64 = -0.96e-6;

/// Shares of the air's refraction that the instrument leaves in its length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refraction {
    /// Uncompensated share over the range; 0 for a compensating instrument, 1 for none.
    pub range_share: f64,
    /// Uncompensated share over the dead path.
    pub dead_path_share: f64,
}

impl Effect for Refraction {
    fn name(&self) -> &'static str {
        "refraction"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("range_share, dead_path_share", &[self.range_share, self.dead_path_share])
    }

    fn range_shift_m(&self, moment: &Moment, beam: &Beam) -> f64 {
        excess_index(&moment.environment) * (self.range_share * beam.range_m + self.dead_path_share * beam.dead_path_m)
    }
}

/// δn: refractive index of the air beyond that at 20 °C, 1013.25 hPa and 50 %.
pub(super) fn excess_index(air: &EnvironmentState) -> f64 {
    INDEX_PER_KELVIN * (air.air_c() - 20.0) + 0.27e-6 * (air.pressure_hpa() - 1013.25)
        - 0.009e-6 * (air.humidity_pct() - 50.0)
}
