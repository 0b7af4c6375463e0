//! An outlying run: every length of one line is wrong by the same amount, a knock or a lost count.
//!
//! Equation: shift = size on the readings of that line, 0 on all others. If the line opens its station, the wrong
//! zero of length shifts all the others instead. Size: 1–50 µm.

use super::{Beam, Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::plan::Plan;

/// A constant on all lengths of one line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutlyingRun {
    /// Index of the line, counted through the whole plan from 0.
    pub line: u32,
    /// What its lengths are too long by (m).
    pub shift_m: f64,
}

impl Effect for OutlyingRun {
    fn name(&self) -> &'static str {
        "outlying_run"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("shift_m", &[self.shift_m])
    }

    fn check_plan(&self, plan: &Plan) -> Result<(), SimulationError> {
        let lines: usize = plan.stations.iter().map(|station| station.lines.len()).sum();
        if (self.line as usize) < lines {
            return Ok(());
        }
        Err(SimulationError::new(
            "line",
            format!("{} is not in the plan", self.line),
            format!("the plan has {lines} lines, counted from 0"),
        ))
    }

    fn range_shift_m(&self, _moment: &Moment, beam: &Beam) -> f64 {
        if beam.line == self.line { self.shift_m } else { 0.0 }
    }
}
