//! The monitor node's step: measured against predicted range, and what that says about the model's health.
//!
//! Place in the flow: takes corrected coordinates and tracer readings of the same instants in any order of
//! arrival; gives one range residual a tracer reading and a running verdict. Instants are matched by stamp within
//! a tolerance, so replay gives what live gave. A sample is judged by the model that it names: its stations and its
//! covariance, and no other's.

use super::health::{Health, Window};
use super::pairs::Pairs;
use abbe_geometry::correct::predicted_length_m;
use abbe_geometry::model::MachineModel;
use abbe_geometry::{Matrix3, Vector3};
use abbe_msgs::{CorrectedCoordinates, RangeResidual, ResidualStatus, Sha256, TracerReading};
use std::collections::VecDeque;
use std::sync::Arc;

/// Models kept for samples that come late: the newest, and those it replaced.
const KEPT_MODELS: usize = 3;
/// Pairs kept while the model that their sample names is awaited: 4 s at 1 kHz.
const AWAITING_MODEL: usize = 4096;

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

/// Matches and compares.
pub struct MonitorStep {
    /// The newest last.
    models: VecDeque<(Arc<MachineModel>, Sha256)>,
    settings: MonitorSettings,
    pairs: Pairs<CorrectedCoordinates>,
    awaiting_model: VecDeque<(CorrectedCoordinates, TracerReading)>,
    /// Model of the latest corrected sample: the window is about it.
    in_use: Sha256,
    window: Window,
    out_of_bounds: u64,
    unpredicted: u64,
}

impl MonitorStep {
    /// A monitor that knows this model.
    pub fn new(model: Arc<MachineModel>, sha256: Sha256, settings: MonitorSettings) -> MonitorStep {
        MonitorStep {
            models: VecDeque::from([(model, sha256)]),
            settings,
            pairs: Pairs::new(settings.match_within_s),
            awaiting_model: VecDeque::new(),
            in_use: sha256,
            window: Window::new(settings.window),
            out_of_bounds: 0,
            unpredicted: 0,
        }
    }

    /// Makes a further model known; gives the residuals of pairs that awaited it. It is in use from the first
    /// corrected sample that names it.
    pub fn learn(&mut self, model: Arc<MachineModel>, sha256: Sha256) -> Vec<RangeResidual> {
        self.models.retain(|(_, known)| *known != sha256);
        self.models.push_back((model, sha256));
        if self.models.len() > KEPT_MODELS {
            self.models.pop_front();
        }
        let awaiting = std::mem::take(&mut self.awaiting_model);
        let (ready, awaiting): (VecDeque<_>, _) =
            awaiting.into_iter().partition(|(sample, _)| sample.model_sha256 == sha256);
        self.awaiting_model = awaiting;
        ready.iter().map(|(sample, reading)| self.compare(sample, reading)).collect()
    }

    /// Model that samples name and that is not known; `None` when there is none.
    pub fn awaited_model(&self) -> Option<Sha256> {
        self.awaiting_model.back().map(|(sample, _)| sample.model_sha256)
    }

    /// Takes a corrected sample; gives the residuals of tracer readings that waited for it.
    pub fn corrected(&mut self, sample: &CorrectedCoordinates) -> Vec<RangeResidual> {
        if !sample.model_sha256.is_none() && sample.model_sha256 != self.in_use {
            self.in_use = sample.model_sha256;
            self.window = Window::new(self.settings.window);
        }
        let readings = self.pairs.sample(sample.stamp, *sample);
        readings.iter().filter_map(|reading| self.pair(sample, reading)).collect()
    }

    /// Takes a tracer reading; gives its residual if the corrected sample of that instant is there already. Where that
    /// sample's model is awaited, gives the residual that it has to give up for it, if any.
    pub fn tracer(&mut self, reading: &TracerReading) -> Option<RangeResidual> {
        let sample = self.pairs.reading(reading)?;
        self.pair(&sample, reading)
    }

    /// At the end: what still awaits its model, as not corrected.
    pub fn give_up(&mut self) -> Vec<RangeResidual> {
        let waiting = std::mem::take(&mut self.awaiting_model);
        waiting.iter().map(|(sample, reading)| self.compare(sample, reading)).collect()
    }

    /// The verdict so far.
    pub fn health(&self) -> Health {
        Health {
            state: self.window.state(),
            model_sha256: self.in_use,
            residuals: self.window.len(),
            mean_square: self.window.mean_square(),
            rms_m: self.window.rms_m(),
            unsound: self.window.unsound(),
            out_of_bounds: self.out_of_bounds,
            unpredicted: self.unpredicted + self.pairs.alone(),
        }
    }

    /// Judges a pair, or keeps it until its model is known; the oldest that waits too long is told as not corrected.
    fn pair(&mut self, sample: &CorrectedCoordinates, reading: &TracerReading) -> Option<RangeResidual> {
        if !sample.corrected_valid || self.model(sample.model_sha256).is_some() {
            return Some(self.compare(sample, reading));
        }
        self.awaiting_model.push_back((*sample, *reading));
        if self.awaiting_model.len() <= AWAITING_MODEL {
            return None;
        }
        let (sample, reading) = self.awaiting_model.pop_front()?;
        Some(self.compare(&sample, &reading))
    }

    fn model(&self, sha256: Sha256) -> Option<Arc<MachineModel>> {
        self.models.iter().find(|(_, known)| *known == sha256).map(|(model, _)| Arc::clone(model))
    }

    fn compare(&mut self, sample: &CorrectedCoordinates, reading: &TracerReading) -> RangeResidual {
        let mut residual = RangeResidual {
            stamp: reading.stamp,
            sequence: reading.sequence,
            measured_length_m: reading.length_m,
            predicted_length_m: 0.0,
            residual_m: 0.0,
            u_residual_m: 0.0,
            model_sha256: sample.model_sha256,
            frame_id: reading.frame_id,
            station: reading.station,
            residual_valid: false,
            status: ResidualStatus::NotCorrected,
        };
        let model = self.model(sample.model_sha256).filter(|_| sample.corrected_valid);
        let Some(model) = model else {
            self.unpredicted += 1;
            return residual;
        };
        let position_m = Vector3::from(sample.corrected_m);
        let covariance_m2 = Matrix3::from_row_slice(&sample.covariance_m2);
        let CorrectedCoordinates { reading_m, offset_m, .. } = *sample;
        let station = reading.station.as_str();
        let predicted = predicted_length_m(&model, reading_m, offset_m, &position_m, &covariance_m2, station);
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
        // A late sample of the model before is judged, but says nothing about the model in use.
        if residual.model_sha256 == self.in_use {
            self.window.push(residual.stamp, residual.residual_m, residual.u_residual_m);
        }
    }
}
