//! Waves along an axis: its error repeats with its position.
//!
//! Place in the flow: candidates of the study of vectors, some an axis. The search sets one after the other to the best of all periods that the positions resolve,
//! and it pays for as many. With a machine the wave is the registered effect, of the reading of the axis. m, 1/m.

use super::ResidualVector;
use super::quantities::PLAUSIBLE_M;
use crate::error::DiagnoseError;
use crate::explanation::Explanation;
use crate::study::candidate::{Candidate, Goes, ModelTerm};
use crate::study::smooth::{levels, range};
use abbe_geometry::chain::{ErrorValues, chain_point};
use abbe_geometry::effects::{Known, ParameterSpec, Shape, construct, known};
use abbe_geometry::machine::Machine;
use abbe_geometry::{Axis, ErrorId};
use faer::Mat;
use std::f64::consts::TAU;

/// The effect of a machine that it is.
pub(super) const REGISTERED: &str = "periodic_scale";
/// Cycles over the range of positions that are scanned, and their step: between two a wave loses a fifth at most, and the best is refined.
const CYCLES: (f64, f64) = (2.0, 200.0);
/// Fewest cycles of what is called a wave. Fewer describe a smooth error: of vectors that a model leaves, what its functions could not bend to.
const NAMED: f64 = 5.0;
const STEP: f64 = 0.5;
/// Waves of one axis at most.
const MOST: usize = 6;

/// A wave of one axis.
#[derive(Debug, Clone)]
pub(super) struct Wave {
    pub(super) axis: Axis,
    known: &'static Known,
    /// The slowest, by how much more each of the others turns (1/m), and how many there are.
    scan: (f64, f64, usize),
    frequency: f64,
    /// What the reading of the axis is less than the position (m), and what its error does to the position.
    less_m: f64,
    sign: f64,
    parameters: Vec<ParameterSpec>,
}

impl Wave {
    /// Of all axes along which vectors lie, and whose component was measured.
    pub(super) fn all(
        vectors: &[ResidualVector],
        measured: [bool; 3],
        machine: Option<&Machine>,
    ) -> Result<Vec<Wave>, DiagnoseError> {
        let Some(known) = known(REGISTERED) else { return Ok(Vec::new()) };
        let mut waves = Vec::new();
        for axis in Axis::ALL.into_iter().filter(|axis| measured[axis.index()]) {
            let values: Vec<f64> = vectors.iter().map(|vector| vector.position_m[axis.index()]).collect();
            let Some((low, high)) = range(&values) else { continue };
            let (less_m, sign) = machine.map_or((0.0, 1.0), |machine| acting(machine, axis));
            let parameters = match machine {
                Some(machine) => construct(REGISTERED, &shape(axis, high - low), machine)?.parameters(),
                None => ["sine", "cosine"].map(|name| ParameterSpec::new(name, "m", PLAUSIBLE_M)).to_vec(),
            };
            // Beyond half as many cycles as there are positions along the axis nothing is resolved.
            let most = (levels(&values) as f64 / 2.0).min(CYCLES.1);
            let count = ((most - CYCLES.0) / STEP).ceil().max(0.0) as usize;
            if count == 0 {
                continue;
            }
            let [frequency, step] = [CYCLES.0, STEP].map(|cycles| cycles / (high - low));
            let wave = Wave { axis, known, scan: (frequency, step, count), frequency, less_m, sign, parameters };
            waves.extend(std::iter::repeat_n(wave, MOST));
        }
        Ok(waves)
    }

    pub(super) fn candidate(&self) -> Candidate {
        let (axis, period_mm) = (self.axis.lower(), 1e3 / self.frequency);
        let cycles = CYCLES.0 * self.frequency / self.scan.0;
        let decimals = if period_mm < 100.0 { 4 } else { 1 };
        Candidate {
            name: format!("{} of {}, period {period_mm:.decimals$} mm", self.known.title, self.axis.letter()),
            formula: format!("{}; typical {}", self.known.formula, self.known.typical),
            kind: if cycles < NAMED { Explanation::Empirical } else { Explanation::Attributed },
            family: format!("{REGISTERED} {axis}"),
            covariates: Vec::new(),
            parameters: self.parameters.clone(),
            decided_by: self.known.decided_by.to_owned(),
            essential: Vec::new(),
            stands_apart: true,
            goes: Goes::ByEvidence,
        }
    }

    /// Its frequency, and how far on either side a better one may lie that no other of the scan is nearer to.
    pub(super) fn frequency(&self) -> (f64, f64) {
        (self.frequency, self.scan.1)
    }

    /// All frequencies that are tried.
    pub(super) fn scan(&self) -> Vec<f64> {
        let (first, step, count) = self.scan;
        (0..count).map(|k| first + step * k as f64).collect()
    }

    /// How many these are.
    pub(super) fn count(&self) -> usize {
        self.scan.2
    }

    /// Whether the search has taken a frequency for it.
    pub(super) fn is_set(&self) -> bool {
        self.frequency != self.scan.0
    }

    pub(super) fn set(&mut self, frequency: f64) {
        self.frequency = frequency;
    }

    /// The slowest again.
    pub(super) fn reset(&mut self) {
        self.frequency = self.scan.0;
    }

    /// What it does with a frequency to one component at positions along its axis (m) with these standard uncertainties (m).
    pub(super) fn columns(&self, frequency: f64, rows: impl ExactSizeIterator<Item = (f64, f64)>) -> Mat<f64> {
        let mut columns = Mat::zeros(rows.len(), 2);
        for (row, (position_m, sigma_m)) in rows.enumerate() {
            let (sine, cosine) = (TAU * frequency * (position_m - self.less_m)).sin_cos();
            columns[(row, 0)] = self.sign * sine / sigma_m;
            columns[(row, 1)] = self.sign * cosine / sigma_m;
        }
        columns
    }

    pub(super) fn term(&self) -> ModelTerm {
        let shape = shape(self.axis, self.frequency.recip());
        ModelTerm { effect: REGISTERED, shape, map: Mat::identity(2, 2), table: None }
    }
}

fn shape(axis: Axis, period_m: f64) -> Shape {
    Shape::new().text("axis", axis.lower()).number("period_m", period_m)
}

/// What the reading of an axis is less than the position, and what its error does to the position along it.
fn acting(machine: &Machine, axis: Axis) -> (f64, f64) {
    let offset_m = machine.default_offset_m.unwrap_or([0.0; 3]);
    let point = chain_point(machine, [0.0; 3], offset_m, &ErrorValues::ZERO);
    (offset_m[axis.index()], point.by_error[ErrorId::linear(axis, axis).index()][axis.index()])
}
