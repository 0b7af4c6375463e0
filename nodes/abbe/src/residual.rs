//! A residual model beside the geometric model it belongs to, for the commands that correct.
//!
//! Place in the flow: `correct`, `verify` and `replay` load it here; `correct` on CSV and `verify` add it to a corrected
//! row through [`abbe_geometry::correct::add_residual`], which the residual node calls as well.

use crate::provenance::file_name;
use abbe_files::{FileError, LoadedResidual, ModelFile, ResidualFile, hex};
use abbe_geometry::correct::{Correction, add_residual};
use abbe_geometry::effects::CovariateSource;
use abbe_graph::step::OwnedField;
use abbe_msgs::Sha256;
use abbe_report::MetaItem;
use std::path::Path;
use std::sync::Arc;

/// Loads a residual model; refused where it belongs to another machine or another geometric model.
pub(crate) fn load_residual(path: &Path, model: &ModelFile, sha256: &[u8; 32]) -> Result<OwnedField, FileError> {
    let (file, own) = ResidualFile::load_for_model(path, &model.model.parts().machine.name, sha256)?;
    Ok(OwnedField { field: Arc::new(LoadedResidual::new(file.model, own)), model_sha256: Sha256::from_bytes(*sha256) })
}

/// A correction with what the residual model adds to it, which finds its further inputs among these covariates; what was rejected
/// stays so, and what the residual model gives no number for is.
pub(crate) fn with_residual(
    mut correction: Correction,
    residual: Option<&OwnedField>,
    covariates: &dyn CovariateSource,
) -> Correction {
    if let (Some(OwnedField { field, .. }), Some(covariance_m2)) = (residual, &mut correction.covariance_m2) {
        match add_residual(&mut correction.position_m, covariance_m2, field.as_ref(), covariates) {
            None => return correction.rejected(),
            Some(added) => correction.status = correction.status.max(added.status()),
        }
    }
    correction
}

/// The line of a report that names a residual model with its hash; none without one.
pub(crate) fn residual_meta(path: Option<&Path>, residual: Option<&OwnedField>) -> Option<MetaItem> {
    let (path, owned) = path.zip(residual)?;
    Some(MetaItem::file("Residual model", &file_name(path), Some(&hex(&owned.field.sha256()))))
}

/// Covariates that a residual model asks for; none without one.
pub(crate) fn inputs_of(residual: Option<&OwnedField>) -> Vec<String> {
    residual.map_or(Vec::new(), |owned| owned.field.covariates().to_vec())
}
