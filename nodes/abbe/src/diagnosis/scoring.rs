//! Error of two models at points whose actual position is known: nothing but a score, after everything is decided.
//!
//! Place in the flow: verification file and the two models in, figures in µm out, after rigid alignment of each.
//! Intervals: normal, of the mean square over points. They hold for such points; they do not know that neighbouring
//! points share an error.

use crate::verification::{VerificationPoints, correct_points, errors};
use abbe_files::ModelFile;
use abbe_geometry::correct::Status;
use abbe_msgs::Sha256;
use abbe_report::diagnosis::{ErrorFigures, File, Record, Verification};
use anyhow::Context;
use std::path::Path;

/// Half width of a 95 % interval in standard deviations.
const BAND_95: f64 = 1.96;
/// Square micrometres in a square metre.
const UM2: f64 = 1e12;

/// A verification file in memory.
pub(super) struct Points {
    name: String,
    shown: String,
    bytes: Vec<u8>,
}

impl Points {
    /// Reads the file and checks its columns and rows, so that a bad file is refused before any work is done.
    pub(super) fn read(path: &Path, model: &ModelFile) -> anyhow::Result<Points> {
        let shown = path.display().to_string();
        let bytes = std::fs::read(path).with_context(|| format!("{shown}: cannot be opened"))?;
        let points = Points { name: super::name_of(path), shown, bytes };
        points.errors(model)?;
        Ok(points)
    }

    fn errors(&self, model: &ModelFile) -> anyhow::Result<(VerificationPoints, Vec<f64>)> {
        let points = correct_points(self.bytes.as_slice(), &self.shown, model, None)?;
        let errors = errors(&points).with_context(|| self.shown.clone())?;
        let squares = errors.iter().map(|v| v.after_m.norm_squared() * UM2).collect();
        Ok((points, squares))
    }

    /// Fills in what only these points tell.
    pub(super) fn score(&self, record: &mut Record, before: &ModelFile, after: &ModelFile) -> anyhow::Result<()> {
        let (_, squares_before) = self.errors(before)?;
        let (points, squares_after) = self.errors(after)?;
        fill(&mut record.before, &squares_before);
        fill(&mut record.after, &squares_after);
        let gains: Vec<f64> = squares_before.iter().zip(&squares_after).map(|(b, a)| b - a).collect();
        let count = |status: Status| points.tally.count(status) as usize;
        record.verification = Some(Verification {
            file: File { file: self.name.clone(), sha256: Sha256::of(&self.bytes).to_hex() },
            points: points.rows.len(),
            extrapolated: count(Status::Extrapolated),
            covariate_missing: count(Status::CovariateMissing),
            gain_interval_um2: interval(&gains),
        });
        Ok(())
    }
}

fn fill(figures: &mut ErrorFigures, squares_um2: &[f64]) {
    let root = |v: f64| v.max(0.0).sqrt();
    figures.verify_rms_um = mean(squares_um2).map(root);
    figures.verify_interval_um = interval(squares_um2).map(|(low, high)| (root(low), root(high)));
    figures.verify_max_um = squares_um2.iter().copied().reduce(f64::max).map(root);
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// 95 % interval of the mean.
fn interval(values: &[f64]) -> Option<(f64, f64)> {
    let (mean, count) = (mean(values)?, values.len() as f64);
    if values.len() < 2 {
        return None;
    }
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let half_width = BAND_95 * (variance / count).sqrt();
    Some((mean - half_width, mean + half_width))
}
