//! Five-axis machine: which flaw of head or axes moves a sphere's centre with the pose it is measured in.
//!
//! Place in the flow: fitted sphere centres in (indicated A, C, probe distance, X, Y, Z; rad and m), diagnosis out. Base
//! model: sphere centre S0, probe direction R_p and probe zero T_p, nine unknowns, linear (Zhang 2016, eq. 3–7):
//! S0 = S1 + R_C·R_A·(d·R_p + T_p), with S1 the centre fitted to the indicated positions; the same rows as in
//! [`abbe_measurement::probe_pose`], which calibrates with them. Candidates stand in `effects`; blocks are poses: all centres measured at the same angles are left out together.

mod chain;
mod effects;
mod pairs;
mod problem;

use super::assemble;
use super::outcome::StudyDiagnosis;
use super::search::{Observe, StudyOptions};
use super::view::View;
use crate::error::DiagnoseError;
use problem::Spheres;

pub use abbe_measurement::probe_pose::SphereCentre;

/// Diagnoses the residual of the nine-unknown model.
///
/// # Errors
/// Fewer than four poses, angles that do not determine the base model, figures that are not finite.
pub fn diagnose(centres: &[SphereCentre], options: &StudyOptions) -> Result<StudyDiagnosis, DiagnoseError> {
    diagnose_observed(centres, options, &mut |_| true)
}

/// The same, telling where it stands.
///
/// # Errors
/// As [`diagnose`], and [`DiagnoseError::Stopped`].
pub fn diagnose_observed(
    centres: &[SphereCentre],
    options: &StudyOptions,
    observe: &mut Observe,
) -> Result<StudyDiagnosis, DiagnoseError> {
    let mut spheres = Spheres::new(centres)?;
    let mut diagnosis = assemble::diagnose(&mut spheres, options, observe)?;
    let rows = diagnosis.rows;
    let view = View::new(&mut spheres, rows, |_| true);
    diagnosis.alternatives = pairs::alternatives(&view)?;
    pairs::name_aliases(&view, &mut diagnosis)?;
    Ok(diagnosis)
}
