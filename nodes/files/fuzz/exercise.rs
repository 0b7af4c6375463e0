//! A table that is handed through: what `abbe predict` does with it. Shared by the fuzz target and the property test.

use abbe_files::{PlainPoints, PredictedWriter};
use abbe_geometry::correct::Added;
use abbe_geometry::residual_field::ResidualPrediction;
use abbe_geometry::{Matrix3, Vector3};

/// The points of a table and the table as it is handed through; `None` where it is refused.
pub(crate) fn handed_through(bytes: &[u8]) -> Option<(Vec<[f64; 3]>, Vec<u8>)> {
    let mut input = PlainPoints::new(bytes, "fuzz", true, &[]).ok()?;
    let mut writer = PredictedWriter::new(Vec::new(), "out", &input).ok()?;
    let (residual_m, covariance_m2) = (Vector3::new(1.5e-6, 0.0, -2e-6), Matrix3::identity() * 1e-12);
    let mut points = Vec::new();
    while let Some(point_m) = input.next_point_m().ok()? {
        points.push(point_m);
        writer.write(&input, &Added::Residual(ResidualPrediction { residual_m, covariance_m2, inside: true })).ok()?;
    }
    Some((points, writer.finish().ok()?))
}
