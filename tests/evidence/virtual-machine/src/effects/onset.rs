//! An effect that sets in during the run: nothing before a time, all of it from then on.
//!
//! Equation: contribution(t) = 0 for t < from, that of the inner effect for t ≥ from. The step is not smoothed: what
//! the inner effect has gathered by then (a creep, a warm-up) appears at once.

use std::sync::Arc;

use super::{Beam, Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::JointErrors;
use crate::plan::Plan;

/// An effect with the time at which it sets in.
#[derive(Debug, Clone)]
pub struct Onset {
    /// What sets in.
    pub effect: Arc<dyn Effect>,
    /// When (s since the campaign began).
    pub from_s: f64,
}

impl Effect for Onset {
    fn name(&self) -> &'static str {
        self.effect.name()
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("from_s", &[self.from_s])?;
        self.effect.check()
    }

    fn check_plan(&self, plan: &Plan) -> Result<(), SimulationError> {
        self.effect.check_plan(plan)
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        if moment.time_s >= self.from_s {
            self.effect.disturb_machine(moment, errors);
        }
    }

    fn station_shift_m(&self, moment: &Moment, station: u32, time_on_station_s: f64) -> [f64; 3] {
        if moment.time_s >= self.from_s {
            self.effect.station_shift_m(moment, station, time_on_station_s)
        } else {
            [0.0; 3]
        }
    }

    fn range_shift_m(&self, moment: &Moment, beam: &Beam) -> f64 {
        if moment.time_s >= self.from_s { self.effect.range_shift_m(moment, beam) } else { 0.0 }
    }
}
