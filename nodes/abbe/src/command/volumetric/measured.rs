//! Measured diagonals, and how the model's compare with them.
//!
//! Place in the flow: only with `--diagonals`; nothing is fitted to them. Differences are measured − predicted (m). What was measured
//! has the repeatability of the machine at this target and at the first: dᵀ Σ d of both, over the runs.

use abbe_files::{DiagonalReading, read_diagonals_file};
use abbe_geometry::Vector3;
use abbe_geometry::volumetric::{Diagonal, LinePoint};
use abbe_measurement::correspondence::check_vectors;
use anyhow::{Context, ensure};
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
    /// Variance of one approach along the diagonal (m²).
    repeatability_m2: f64,
}

impl Comparison {
    /// Compares; `repeatability_m` is that of each axis (k = 1).
    pub(super) fn new(
        measured: MeasuredDiagonal,
        predicted: Vec<LinePoint>,
        [from_m, to_m]: [[f64; 3]; 2],
        repeatability_m: [f64; 3],
    ) -> Comparison {
        let along = (Vector3::from(to_m) - Vector3::from(from_m)).normalize();
        let repeatability_m2 = along.component_mul(&Vector3::from(repeatability_m)).norm_squared();
        Comparison { measured, predicted, repeatability_m2 }
    }

    /// Standard uncertainty of measured less predicted (m). At the first target both are zero by definition.
    fn u_m(&self, measured: &DiagonalReading, predicted: &LinePoint) -> f64 {
        let approaches = if measured.distance_m > 0.0 { 2.0 } else { 0.0 };
        let machine_m2 = approaches * self.repeatability_m2 / measured.runs.unwrap_or(1) as f64;
        (measured.u_m.powi(2) + predicted.u_m.powi(2) + machine_m2).sqrt()
    }

    fn pairs(&self) -> impl Iterator<Item = (&DiagonalReading, &LinePoint)> {
        self.measured.targets.iter().zip(&self.predicted)
    }

    pub(super) fn largest_difference_m(&self) -> f64 {
        self.pairs().map(|(m, p)| (m.deviation_m - p.deviation_m).abs()).fold(0.0, f64::max)
    }

    /// Targets whose difference exceeds what both uncertainties allow for 95 %.
    pub(super) fn outside(&self) -> usize {
        let beyond =
            |(m, p): &(&DiagonalReading, &LinePoint)| (m.deviation_m - p.deviation_m).abs() > BAND_95 * self.u_m(m, p);
        self.pairs().filter(beyond).count()
    }
}

impl MeasuredDiagonal {
    /// Readings (m) at the first target and at the other end of the stroke.
    ///
    /// # Errors
    /// Targets beyond that end.
    pub(super) fn ends_m(&self, bounds_m: &[(f64, f64); 3]) -> anyhow::Result<[[f64; 3]; 2]> {
        /// What a distance may be beyond the end (m): that of rounded distances.
        const ROUNDING_M: f64 = 1e-4;
        let [from_m, to_m] = self.diagonal.ends_m(bounds_m).map(Vector3::from);
        let length_m = (to_m - from_m).norm();
        let start_m = self.targets.iter().find_map(|target| target.start_m).unwrap_or(0.0);
        let last_m = self.targets.iter().map(|target| target.distance_m).fold(0.0, f64::max);
        ensure!(
            start_m < length_m && start_m + last_m <= length_m + ROUNDING_M,
            "diagonal {}: its last target would lie {:.3} mm from the end of the stroke where it begins (start_mm and distance_mm together), \
             and the diagonal of the stroke is {:.3} mm long; correct start_mm and distance_mm, or the stroke in the machine file",
            self.diagonal.name(),
            (start_m + last_m) * 1e3,
            length_m * 1e3
        );
        let first_m = from_m + (to_m - from_m) * (start_m / length_m);
        Ok([first_m.into(), to_m.into()])
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
