//! Verification: how far indicated and corrected points lie from where the tip really was.
//!
//! Place in the flow: `verify` and the demo. The reference has a frame of its own, so points are aligned rigidly
//! first; nothing here ever feeds a fit.

use crate::offset_sign::check_offset_signs;
use crate::residual::{inputs_of, with_residual};
use crate::tally::{Tally, why_rejected};
use abbe_files::{ModelFile, PointRow, PointsReader};
use abbe_geometry::Vector3;
use abbe_geometry::chain::nominal_point_m;
use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::State;
use abbe_graph::step::OwnedField;
use abbe_measurement::alignment::aligned_residuals_m;
use abbe_measurement::correspondence::{self, Pair};
use anyhow::{Context, bail, ensure};
use std::io::Read;

/// One verification point with its errors (m, actual − position, aligned).
pub(crate) struct Verified {
    pub(crate) reading_m: [f64; 3],
    pub(crate) before_m: Vector3<f64>,
    pub(crate) after_m: Vector3<f64>,
}

/// Points of a verification file: readings, offsets, covariates and actual positions.
#[derive(Default)]
pub(crate) struct VerificationPoints {
    pub(crate) rows: Vec<PointRow>,
    pub(crate) corrected_m: Vec<Vector3<f64>>,
    /// What they were worth, in all.
    pub(crate) tally: Tally,
}

impl VerificationPoints {
    /// How many are extrapolated.
    pub(crate) fn extrapolated(&self) -> usize {
        self.tally.count(Status::Extrapolated) as usize
    }
}

/// Reads a verification file and corrects each point with the model, and the residual model where there is one.
///
/// # Errors
/// What is wrong with the file; actual positions that are not those of the readings, with the likely mistake.
pub(crate) fn correct_points(
    input: impl Read,
    name: &str,
    model: &ModelFile,
    residual: Option<&OwnedField>,
) -> anyhow::Result<VerificationPoints> {
    let default_offset_m = model.model.parts().machine.default_offset_m;
    let inputs = inputs_of(residual);
    let followed = model.model.reads().into_iter().chain(inputs.clone());
    let mut reader = PointsReader::verification(input, name, default_offset_m)?.following(followed);
    let mut points = VerificationPoints { tally: Tally::asking(inputs), ..VerificationPoints::default() };
    let mut row = PointRow::default();
    while reader.read(&mut row)? {
        let covariates = reader.covariates(&row);
        let state = State { reading_m: row.reading_m, offset_m: row.offset_m, covariates: &covariates };
        let correction = with_residual(correct(&model.model, &state), residual, &covariates);
        check_offset_signs(&model.model.parts().identified, &row, name)?;
        ensure!(
            correction.status != Status::Rejected,
            "{name}, line {}: the point is rejected: {}; correct or remove it",
            row.line(),
            why_rejected(&model.model, &state)
        );
        points.tally.add(&model.model, &state, correction.status, row.line());
        points.corrected_m.push(correction.position_m);
        points.rows.push(row.clone());
    }
    let pair = |row: &PointRow| {
        let actual_m = row.actual_m.map(Vector3::from)?;
        Some(Pair { reading_m: row.reading_m, offset_m: row.offset_m, actual_m })
    };
    let pairs: Vec<Pair> = points.rows.iter().filter_map(pair).collect();
    // In all columns: of rounded positions a repeated reading may be the same, its time is not.
    if let Some(places) = correspondence::copied(points.rows.iter().map(|row| row.cells().collect::<Vec<_>>())) {
        let [first, second] = <[usize; 2]>::from(places).map(|k| points.rows[k].line());
        bail!(
            "{name}, line {second}: the row repeats line {first} to the last digit, and would count twice; a copy is no second measurement: \
             remove it (readings repeated on the machine differ by its noise)"
        );
    }
    correspondence::check_all(&pairs).with_context(|| format!("{name} (points count from 1)"))?;
    Ok(points)
}

/// Errors before and after, aligned rigidly to the reference.
pub(crate) fn errors(points: &VerificationPoints) -> anyhow::Result<Vec<Verified>> {
    let actual: Vec<Vector3<f64>> = points.rows.iter().filter_map(|row| row.actual_m).map(Vector3::from).collect();
    let indicated: Vec<Vector3<f64>> = points.rows.iter().map(|r| nominal_point_m(r.reading_m, r.offset_m)).collect();
    let before = aligned_residuals_m(&indicated, &actual)?;
    let after = aligned_residuals_m(&points.corrected_m, &actual)?;
    let list = points.rows.iter().zip(before).zip(after);
    Ok(list.map(|((row, before_m), after_m)| Verified { reading_m: row.reading_m, before_m, after_m }).collect())
}

/// Rms and largest motion of points (m), each with where it was, but for how all of them are shifted and turned; `None` where they do not fix
/// how they lie.
pub(crate) fn rms_and_max_aligned_m(moved: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)>) -> Option<(f64, f64)> {
    let (from, to): (Vec<_>, Vec<_>) = moved.map(|(at_m, by_m)| (at_m, at_m + by_m)).unzip();
    Some(rms_and_max_m(aligned_residuals_m(&from, &to).ok()?.into_iter()))
}

/// Rms and largest length of some vectors (m).
pub(crate) fn rms_and_max_m(vectors: impl Iterator<Item = Vector3<f64>>) -> (f64, f64) {
    let (mut sum, mut count, mut most) = (0.0, 0.0_f64, 0.0_f64);
    for vector in vectors {
        sum += vector.norm_squared();
        count += 1.0;
        most = most.max(vector.norm());
    }
    ((sum / count.max(1.0)).sqrt(), most)
}
