//! Positioning runs after ISO 230-2: what a linear axis does beyond a mean offset, as a ladder of error on unseen cycles.
//!
//! Place in the flow: approaches to target positions (m, s) in, diagnosis out. Error = actual − indicated = measured −
//! target. Base model: one mean offset an axis. Candidates: position (smooth or target by target), reversal (constant,
//! smooth, target by target), drift with time and cycle, of all or target by target, a step of the offset, expansion of the scale with each logged temperature, periodic
//! error of unknown period, and any other logged quantity. Blocks are cycles. Reversal value after ISO 230-2: B = mean
//! error approaching in the positive direction less mean error approaching in the negative.

mod given;
mod instrument;
mod model;
mod naming;
mod order;
mod positions;
mod problem;
mod shape;
mod step;

use super::assemble;
use super::outcome::StudyDiagnosis;
use super::search::{Observe, StudyOptions};
use crate::error::DiagnoseError;
pub use abbe_measurement::positioning::{Approach, Run};
pub use positions::{PositionSummary, positions};
use problem::Runs;

/// Diagnoses positioning runs.
///
/// # Errors
/// Fewer than three cycles on an axis, figures that are not finite, errors of the size of another unit.
pub fn diagnose(runs: &[Run], options: &StudyOptions) -> Result<StudyDiagnosis, DiagnoseError> {
    diagnose_observed(runs, options, &mut |_| true)
}

/// The same, telling where it stands.
///
/// # Errors
/// As [`diagnose`], and [`DiagnoseError::Stopped`].
pub fn diagnose_observed(
    runs: &[Run],
    options: &StudyOptions,
    observe: &mut Observe,
) -> Result<StudyDiagnosis, DiagnoseError> {
    assemble::diagnose(&mut Runs::new(runs)?, options, observe)
}
