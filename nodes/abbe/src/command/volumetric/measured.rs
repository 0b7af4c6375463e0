//! Measured diagonals, and how the model's compare with them.
//!
//! Place in the flow: only with `--diagonals`; nothing is fitted to them. Differences are measured − predicted (m).

use abbe_files::{DiagonalReading, read_diagonals_file};
use abbe_geometry::Vector3;
use abbe_geometry::volumetric::{Diagonal, LinePoint};
use abbe_measurement::correspondence::check_vectors;
use anyhow::Context;
use std::path::Path;

/// Factor of a 95 % interval of a normal distribution.
const BAND_95: f64 = 1.96;

/// One diagonal as measured.
#[derive(Debug, Clone)]
pub(super) struct MeasuredDiagonal {
    pub(super) diagonal: Diagonal,
    pub(super) targets: Vec<DiagonalReading>,
}

/// One diagonal as measured and as the model says.
pub(super) struct Comparison {
    pub(super) measured: MeasuredDiagonal,
    pub(super) predicted: Vec<LinePoint>,
}

impl Comparison {
    pub(super) fn new(measured: MeasuredDiagonal, predicted: Vec<LinePoint>) -> Comparison {
        Comparison { measured, predicted }
    }

    fn pairs(&self) -> impl Iterator<Item = (&DiagonalReading, &LinePoint)> {
        self.measured.targets.iter().zip(&self.predicted)
    }

    pub(super) fn largest_difference_m(&self) -> f64 {
        self.pairs().map(|(m, p)| (m.deviation_m - p.deviation_m).abs()).fold(0.0, f64::max)
    }

    /// Targets whose difference exceeds what both uncertainties allow for 95 %.
    pub(super) fn outside(&self) -> usize {
        let beyond = |(m, p): &(&DiagonalReading, &LinePoint)| {
            (m.deviation_m - p.deviation_m).abs() > BAND_95 * m.u_m.hypot(p.u_m)
        };
        self.pairs().filter(beyond).count()
    }
}

/// Reads measured diagonals, one group a diagonal in the order of the file.
pub(super) fn read(path: &Path) -> anyhow::Result<Vec<MeasuredDiagonal>> {
    let mut groups: Vec<MeasuredDiagonal> = Vec::new();
    let readings = read_diagonals_file(path)?;
    let deviations_m: Vec<Vector3<f64>> = readings.iter().map(|reading| Vector3::x() * reading.deviation_m).collect();
    check_vectors(&deviations_m, false).with_context(|| path.display().to_string())?;
    for reading in readings {
        match groups.iter_mut().find(|group| group.diagonal == reading.diagonal) {
            Some(group) => group.targets.push(reading),
            None => groups.push(MeasuredDiagonal { diagonal: reading.diagonal, targets: vec![reading] }),
        }
    }
    Ok(groups)
}
