//! Offsets on the side where no offset of the campaign was.
//!
//! Place in the flow: what reads positions of points asks before it corrects them, tables and bags alike. A sign error moves every lever arm.

use abbe_files::{FileError, Place, PointRow};
use abbe_geometry::model::IdentifiedVolume;
use abbe_graph::step::opposite_offset;

/// What to do about it.
pub(crate) const SIGN_REMEDY: &str = "correct its sign, or identify a model with such an offset";

/// Refuses an offset on the side where no offset of the campaign was: a sign error moves every lever arm.
pub(crate) fn check_offset_signs(identified: &IdentifiedVolume, row: &PointRow, name: &str) -> Result<(), FileError> {
    let Some((d, problem)) = opposite_sign(identified, row.offset_m) else { return Ok(()) };
    let column = ["offset_x_mm", "offset_y_mm", "offset_z_mm"][d];
    Err(FileError::content(Place::file(name).line(row.line()).column(column), problem, SIGN_REMEDY))
}

/// Which part of an offset has the sign that no offset of the campaign had, and what is wrong with it.
pub(crate) fn opposite_sign(identified: &IdentifiedVolume, offset_m: [f64; 3]) -> Option<(usize, String)> {
    let d = opposite_offset(identified, offset_m)?;
    let (lower, upper) = identified.offset_m[d];
    let problem = format!(
        "{} mm has the opposite sign of every offset the model was identified with ({} … {} mm)",
        offset_m[d] * 1e3,
        lower * 1e3,
        upper * 1e3
    );
    Some((d, problem))
}
