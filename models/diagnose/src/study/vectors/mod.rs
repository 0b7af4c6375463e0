//! Residual vectors of any calibration: what a model that is not ours lacks.
//!
//! Place in the flow: residuals (actual − predicted, m) with positions and whatever was logged in, diagnosis out. Base
//! model: a rigid motion of the frame, six unknowns. Candidates: every registered effect that moves the tip, where a
//! machine says which chain stands behind the positions; and, without any chain, each component of the residual as a
//! smooth function of each logged quantity and each pair, once or twice a turn of each angle, and with a step in time. The 21 errors of a
//! chain are not part of the base, so what they do shows up as dependence on position. Blocks are those of the file,
//! else stretches of time, else cells of space.
//!
//! Vectors in a plane, or of a plate in one or several poses, are named further: scales and squareness of the axes they
//! span (`plate`); where a machine is given, angular errors of its axes (`angle`). Each pose has a rigid motion of its own. Where the plate was turned and its points are named, only
//! what differs between its poses is used, from which its own form has gone (`turned`).

mod angle;
mod blocks;
mod drift;
mod given;
mod linear;
mod model;
mod order;
mod plate;
mod problem;
mod quantities;
mod registered;
mod shape;
mod step;
mod turned;
mod wave;

use super::assemble;
use super::outcome::StudyDiagnosis;
use super::search::{Observe, StudyOptions};
use crate::error::DiagnoseError;
use crate::logs::mended_rows;
use abbe_geometry::machine::Machine;
pub use abbe_measurement::residual_vector::ResidualVector;
use problem::Vectors;
use turned::Turned;

/// What a diagnosis of vectors is of; its rows are components, of which a vector has three.
pub const OF: &str = "residual vectors";

/// Diagnoses residual vectors; `machine` names the chain behind the positions, its default offset that of the tip.
///
/// # Errors
/// Too few vectors, figures that are not finite, an effect that does not fit the machine.
pub fn diagnose(
    vectors: &[ResidualVector],
    machine: Option<&Machine>,
    options: &StudyOptions,
) -> Result<StudyDiagnosis, DiagnoseError> {
    diagnose_observed(vectors, machine, options, &mut |_| true)
}

/// The same, telling where it stands.
///
/// # Errors
/// As [`diagnose`], and [`DiagnoseError::Stopped`].
pub fn diagnose_observed(
    vectors: &[ResidualVector],
    machine: Option<&Machine>,
    options: &StudyOptions,
    observe: &mut Observe,
) -> Result<StudyDiagnosis, DiagnoseError> {
    let (rows, mut notes) = given::given(vectors)?;
    let mut kept: Vec<ResidualVector> = rows.iter().map(|row| vectors[*row].clone()).collect();
    let times_s: Vec<Option<f64>> = kept.iter().map(|vector| vector.time_s).collect();
    let (logged, said) = mended_rows(&times_s, &kept.iter().map(|vector| &vector.covariates).collect::<Vec<_>>());
    kept.iter_mut().zip(logged).for_each(|(vector, covariates)| vector.covariates = covariates);
    notes.extend(said);
    let mut study = Vectors::new(&kept, rows, notes, machine)?;
    if options.instrument_checked {
        study.without_drifts();
    }
    match turned::contrasts(&study)? {
        None => {
            study.note_unturned();
            assemble::diagnose(&mut study, options, observe)
        }
        Some(contrasts) => assemble::diagnose(&mut Turned::new(study, contrasts)?, options, observe),
    }
}
