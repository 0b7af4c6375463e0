//! The monitor node's step: measured against predicted range, and what that says about the model's health.
//!
//! Place in the flow: takes corrected coordinates and tracer readings of the same instants in any order of
//! arrival; gives one range residual a tracer reading and a running verdict. Instants are matched by stamp within
//! a tolerance, so replay gives what live gave.

use abbe_geometry::Vector3;
use abbe_geometry::correct::predicted_length_m;
use abbe_geometry::model::MachineModel;
use abbe_msgs::{CorrectedCoordinates, RangeResidual, ResidualStatus, Sha256, TracerReading};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// Samples kept while their counterpart is awaited.
const WAITING_SAMPLES: usize = 20_000;

/// What the monitor judges by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MonitorSettings {
    /// A single residual is out of bounds beyond this many standard uncertainties.
    pub single_bound: f64,
    /// Residuals over which the mean square is taken.
    pub window: usize,
    /// Stamps this close are the same instant (s).
    pub match_within_s: f64,
}

/// Verdict over the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HealthState {
    /// Too few residuals to say.
    Unknown,
    /// Residuals are as large as their uncertainties say.
    Consistent,
    /// The mean square is larger than chance allows (99.9 %): the model lacks something, or something changed.
    Degraded,
}

/// Figures behind the verdict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    /// The verdict.
    pub state: HealthState,
    /// Residuals in the window.
    pub residuals: usize,
    /// Mean of (residual/u)² over the window; `None` while it is empty.
    pub mean_square: Option<f64>,
    /// Rms residual over the window (m); `None` while it is empty.
    pub rms_m: Option<f64>,
    /// Single residuals out of bounds since the start.
    pub out_of_bounds: u64,
    /// Tracer readings that nothing could be predicted for.
    pub unpredicted: u64,
}

/// Matches and compares.
pub struct MonitorStep {
    model: Arc<MachineModel>,
    sha256: Sha256,
    settings: MonitorSettings,
    corrected: BTreeMap<i64, CorrectedCoordinates>,
    waiting: BTreeMap<i64, Vec<TracerReading>>,
    window: VecDeque<(f64, f64)>,
    out_of_bounds: u64,
    unpredicted: u64,
}

impl MonitorStep {
    /// A monitor for this model.
    pub fn new(model: Arc<MachineModel>, sha256: Sha256, settings: MonitorSettings) -> MonitorStep {
        MonitorStep {
            model,
            sha256,
            settings,
            corrected: BTreeMap::new(),
            waiting: BTreeMap::new(),
            window: VecDeque::new(),
            out_of_bounds: 0,
            unpredicted: 0,
        }
    }

    /// Takes a corrected sample; gives the residuals of tracer readings that waited for it.
    pub fn corrected(&mut self, sample: &CorrectedCoordinates) -> Vec<RangeResidual> {
        let nanos = sample.stamp.to_nanos();
        let readings: Vec<i64> = self.waiting.range(self.around(nanos)).map(|(stamp, _)| *stamp).collect();
        let mut residuals = Vec::new();
        for stamp in readings {
            for reading in self.waiting.remove(&stamp).unwrap_or_default() {
                residuals.push(self.compare(sample, &reading));
            }
        }
        self.corrected.insert(nanos, *sample);
        if self.corrected.len() > WAITING_SAMPLES {
            self.corrected.pop_first();
        }
        residuals
    }

    /// Takes a tracer reading; gives its residual if the corrected sample of that instant is there already.
    pub fn tracer(&mut self, reading: &TracerReading) -> Option<RangeResidual> {
        let nanos = reading.stamp.to_nanos();
        let nearest = self.corrected.range(self.around(nanos)).min_by_key(|(stamp, _)| (*stamp - nanos).abs());
        match nearest.map(|(_, sample)| *sample) {
            Some(sample) => Some(self.compare(&sample, reading)),
            None => {
                self.waiting.entry(nanos).or_default().push(*reading);
                if self.waiting.len() > WAITING_SAMPLES {
                    self.waiting.pop_first();
                    self.unpredicted += 1;
                }
                None
            }
        }
    }

    /// The verdict so far.
    pub fn health(&self) -> Health {
        let count = self.window.len();
        let mean =
            |of: fn(&(f64, f64)) -> f64| (count > 0).then(|| self.window.iter().map(of).sum::<f64>() / count as f64);
        let mean_square = mean(|(residual_m, u_m)| (residual_m / u_m).powi(2));
        // χ²/n has variance 2/n: 3.3 deviations above 1 happen once in a thousand windows of a sound model.
        let limit = 1.0 + 3.3 * (2.0 / count.max(1) as f64).sqrt();
        let state = match mean_square {
            Some(mean_square) if count >= self.settings.window.min(30) => {
                if mean_square > limit {
                    HealthState::Degraded
                } else {
                    HealthState::Consistent
                }
            }
            _ => HealthState::Unknown,
        };
        Health {
            state,
            residuals: count,
            mean_square,
            rms_m: mean(|(residual_m, _)| residual_m * residual_m).map(f64::sqrt),
            out_of_bounds: self.out_of_bounds,
            unpredicted: self.unpredicted,
        }
    }

    fn around(&self, nanos: i64) -> std::ops::RangeInclusive<i64> {
        let tolerance = (self.settings.match_within_s * 1e9) as i64;
        nanos.saturating_sub(tolerance)..=nanos.saturating_add(tolerance)
    }

    fn compare(&mut self, sample: &CorrectedCoordinates, reading: &TracerReading) -> RangeResidual {
        let mut residual = RangeResidual {
            stamp: reading.stamp,
            sequence: reading.sequence,
            measured_length_m: reading.length_m,
            predicted_length_m: 0.0,
            residual_m: 0.0,
            u_residual_m: 0.0,
            model_sha256: self.sha256,
            frame_id: reading.frame_id,
            station: reading.station,
            residual_valid: false,
            status: ResidualStatus::NotCorrected,
        };
        if !sample.corrected_valid || sample.model_sha256 != self.sha256 {
            self.unpredicted += 1;
            return residual;
        }
        let position_m = Vector3::from(sample.corrected_m);
        let predicted =
            predicted_length_m(&self.model, sample.reading_m, sample.offset_m, &position_m, reading.station.as_str());
        let Some((predicted_m, u_model_m)) = predicted else {
            self.unpredicted += 1;
            return RangeResidual { status: ResidualStatus::UnknownStation, ..residual };
        };
        residual.predicted_length_m = predicted_m;
        residual.residual_m = reading.length_m - predicted_m;
        residual.u_residual_m = u_model_m.hypot(reading.u_length_m);
        residual.residual_valid = true;
        self.judge(&mut residual);
        residual
    }

    fn judge(&mut self, residual: &mut RangeResidual) {
        let inside = residual.residual_m.abs() <= self.settings.single_bound * residual.u_residual_m;
        residual.status = if inside { ResidualStatus::Consistent } else { ResidualStatus::OutOfBounds };
        self.out_of_bounds += u64::from(!inside);
        self.window.push_back((residual.residual_m, residual.u_residual_m));
        if self.window.len() > self.settings.window {
            self.window.pop_front();
        }
    }
}
