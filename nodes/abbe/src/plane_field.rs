//! Measured vectors of a volume or a plane, as a field.
//!
//! Place in the flow: `interpolate` and the program that trains read tables of vectors here. Points and errors in m, machine
//! frame.

use abbe_field::MeasuredField;
use abbe_files::{Lacks, StudyFile, read_plane_vectors_file, tip_of};
use abbe_geometry::{Axis, Vector3};
use anyhow::Context;
use std::path::Path;

/// Measured vectors of a volume or a plane.
pub struct PlaneField {
    /// Points and errors; a component that was not measured is a copy of another, which is not shown to anybody.
    pub field: MeasuredField,
    /// What was not measured.
    pub lacks: Lacks,
    /// Line of each point in the file, from 1.
    pub lines: Vec<u64>,
    /// SHA-256 of the bytes of the file.
    pub sha256: [u8; 32],
    /// Offset of the tip that was measured (m, ram frame), where the file says it.
    pub tip_m: Option<[f64; 3]>,
}

/// Reads vectors of a volume or a plane. Of a plane a component that is zero in every row was not measured.
pub fn plane_field(path: &Path) -> anyhow::Result<PlaneField> {
    let StudyFile { rows, lines, sha256, .. } = read_plane_vectors_file(path)?;
    let poses: std::collections::BTreeSet<_> = rows.iter().map(|row| &row.pose).collect();
    anyhow::ensure!(
        poses.len() < 2,
        "{}: the vectors are of {} poses, each shifted and turned by an unknown amount; take one of them, or what abbe \
         diagnose makes of all",
        path.display(),
        poses.len()
    );
    let tip_m = tip_of(&rows);
    let first = &rows[0];
    let lacking = |lacks: [bool; 3]| Axis::ALL.into_iter().find(|axis| lacks[axis.index()]);
    let mut lacks = Lacks { position: lacking(first.position_lacks), error: lacking(first.residual_lacks) };
    let points_m: Vec<Vector3<f64>> = rows.iter().map(|row| row.position_m.into()).collect();
    let mut errors_m: Vec<Vector3<f64>> = rows.iter().map(|row| row.residual_m.into()).collect();
    let u_m: Option<Vec<Vector3<f64>>> = rows.iter().map(|row| row.u_m.map(Vector3::from)).collect();
    // Points are counted from 0 in messages of the library, rows of a file are not: the row is the point's place in it.
    let of_rows = || format!("{} (points are its rows, from 0)", path.display());
    let field = MeasuredField::volume_or_plane(points_m, errors_m.clone(), u_m).with_context(of_rows)?;
    if lacks.error.is_none() && field.plane().is_some() {
        lacks.error = Axis::ALL.into_iter().find(|axis| errors_m.iter().all(|error| error[axis.index()] == 0.0));
    }
    let Some(axis) = lacks.error else { return Ok(PlaneField { field, lacks, lines, sha256, tip_m }) };
    let other = (axis.index() + 1) % 3;
    errors_m.iter_mut().for_each(|error| error[axis.index()] = error[other]);
    Ok(PlaneField { field: field.with_errors(errors_m).with_context(of_rows)?, lacks, lines, sha256, tip_m })
}
