//! The monitor node's step: measured against predicted range, and what that says about the model's health.
//!
//! Place in the flow: takes corrected coordinates and tracer readings of the same instants in any order of
//! arrival; gives one range residual a tracer reading and a running verdict. Instants are matched by stamp within
//! a tolerance, so replay gives what live gave. A sample is judged by the model that it names: its stations and its
//! covariance, and no other's. What effects of that model read (temperatures, the time since the campaign began) comes
//! with the scale reading of the sample; where it does not, nothing is predicted, and that is said. Nothing is predicted
//! either from samples of another frame, of several publishers, or whose stamp does not follow: an instant is all that joins
//! the two streams.

use super::asked::{Asked, Scales};
use super::health::{Health, Window};
use super::pairs::Pairs;
use super::stream::{Mark, StationWatch, StreamCounts, StreamWatch, Verdict};
use abbe_geometry::effects::{CovariateSource, NoCovariates, State};
use abbe_geometry::model::MachineModel;
use abbe_geometry::predict::{Sighted, Unpredictable, predicted_length};
use abbe_geometry::{Matrix3, Vector3};
use abbe_msgs::{
    CorrectedCoordinates, CorrectionStatus, RangeResidual, ResidualStatus, ScaleReading, Sha256, TracerReading,
};
use std::collections::VecDeque;
use std::sync::Arc;

/// Models kept for samples that come late: the newest, and those it replaced.
const KEPT_MODELS: usize = 3;
/// Pairs kept while the model that their sample names, or its scale reading, is awaited: 4 s at 1 kHz.
const AWAITING: usize = 4096;

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

/// A corrected sample and the tracer reading of its instant.
type Pair = (CorrectedCoordinates, TracerReading);

/// A model, and what it asks of a sample.
#[derive(Clone)]
struct Known {
    model: Arc<MachineModel>,
    sha256: Sha256,
    asked: Arc<Asked>,
}

impl Known {
    fn new(model: Arc<MachineModel>, sha256: Sha256) -> Known {
        Known { asked: Arc::new(Asked::by(&model)), model, sha256 }
    }
}

/// Matches and compares.
pub struct MonitorStep {
    /// The newest last.
    models: VecDeque<Known>,
    settings: MonitorSettings,
    frame_id: String,
    corrected: StreamWatch,
    tracers: StationWatch,
    foreign: Foreign,
    pairs: Pairs<CorrectedCoordinates>,
    /// Nothing where the scale readings do not come here.
    scales: Option<Scales>,
    awaiting_model: VecDeque<Pair>,
    awaiting_scales: VecDeque<Pair>,
    /// Why the latest reading that lacked something was not predicted.
    lacking: Option<String>,
    /// Model of the latest corrected sample: the window is about it.
    in_use: Sha256,
    window: Window,
    out_of_bounds: u64,
    unpredicted: u64,
}

/// Samples of another frame.
#[derive(Default)]
struct Foreign {
    corrected: u64,
    tracer: u64,
}

impl MonitorStep {
    /// A monitor that knows this model.
    pub fn new(model: Arc<MachineModel>, sha256: Sha256, settings: MonitorSettings) -> MonitorStep {
        MonitorStep {
            frame_id: model.parts().machine.frame_id.clone(),
            corrected: StreamWatch::default(),
            tracers: StationWatch::default(),
            foreign: Foreign::default(),
            models: VecDeque::from([Known::new(model, sha256)]),
            settings,
            pairs: Pairs::new(settings.match_within_s),
            scales: None,
            awaiting_model: VecDeque::new(),
            awaiting_scales: VecDeque::new(),
            lacking: None,
            in_use: sha256,
            window: Window::new(settings.window),
            out_of_bounds: 0,
            unpredicted: 0,
        }
    }

    /// The same with scale readings, whose covariates older than `max_covariate_age_s` (s) are stale.
    pub fn with_scales(self, max_covariate_age_s: f64) -> MonitorStep {
        MonitorStep { scales: Some(Scales::new(max_covariate_age_s)), ..self }
    }

    /// From now on, a covariate of more than this age (s) is stale.
    pub fn set_max_covariate_age_s(&mut self, max_covariate_age_s: f64) {
        if let Some(scales) = &mut self.scales {
            scales.set_max_age_s(max_covariate_age_s);
        }
    }

    /// Judges by other bounds from now on. With another window, or other instants that are the same, the verdict begins
    /// anew: what lies behind was judged by the old ones.
    pub fn judge_by(&mut self, settings: MonitorSettings) {
        let before = std::mem::replace(&mut self.settings, settings);
        self.pairs.within(settings.match_within_s);
        if (before.window, before.match_within_s) != (settings.window, settings.match_within_s) {
            self.window = Window::new(settings.window);
        }
    }

    /// Makes a further model known; gives the residuals of pairs that awaited it. It is in use from the first
    /// corrected sample that names it.
    pub fn learn(&mut self, model: Arc<MachineModel>, sha256: Sha256) -> Vec<RangeResidual> {
        self.models.retain(|known| known.sha256 != sha256);
        self.models.push_back(Known::new(model, sha256));
        if self.models.len() > KEPT_MODELS {
            self.models.pop_front();
        }
        let awaiting = std::mem::take(&mut self.awaiting_model);
        let (ready, awaiting): (VecDeque<_>, _) =
            awaiting.into_iter().partition(|(sample, _)| sample.model_sha256 == sha256);
        self.awaiting_model = awaiting;
        ready.iter().filter_map(|(sample, reading)| self.pair(sample, reading)).collect()
    }

    /// Takes a scale reading; gives the residuals of pairs that awaited it, or one that was lost before it.
    pub fn scale(&mut self, reading: &ScaleReading) -> Vec<RangeResidual> {
        // The geometric node answers one of another frame; here it would stand for this machine's.
        let is_own = reading.frame_id.as_str() == self.frame_id;
        let Some(scales) = self.scales.as_mut().filter(|_| is_own) else { return Vec::new() };
        scales.keep(reading);
        let awaiting = std::mem::take(&mut self.awaiting_scales);
        let (ready, awaiting): (VecDeque<_>, _) =
            awaiting.into_iter().partition(|(sample, _)| !scales.may_come(sample));
        self.awaiting_scales = awaiting;
        ready.iter().map(|(sample, reading)| self.compare(sample, reading)).collect()
    }

    /// Why the latest reading that lacked something was not predicted; `None` while none did.
    pub fn lacking(&self) -> Option<&str> {
        self.lacking.as_deref()
    }

    /// Model that samples name and that is not known; `None` when there is none.
    pub fn awaited_model(&self) -> Option<Sha256> {
        self.awaiting_model.back().map(|(sample, _)| sample.model_sha256)
    }

    /// Takes a corrected sample; gives the residuals of tracer readings that waited for it.
    pub fn corrected(&mut self, sample: &CorrectedCoordinates) -> Vec<RangeResidual> {
        if sample.frame_id.as_str() != self.frame_id {
            self.foreign.corrected += 1;
            return Vec::new();
        }
        let sample = &match self.corrected.look(Mark::from(sample)) {
            // Whatever else is said of it: an instant is all that joins the two streams.
            Verdict::OutOfOrder if sample.corrected_valid => {
                CorrectedCoordinates { status: CorrectionStatus::OutOfOrder, ..*sample }
            }
            verdict => verdict.apply(*sample),
        };
        // Of several correctors none is the one in use.
        let is_one = sample.status != CorrectionStatus::SeveralSources;
        if is_one && !sample.model_sha256.is_none() && sample.model_sha256 != self.in_use {
            self.in_use = sample.model_sha256;
            self.window = Window::new(self.settings.window);
        }
        let pairs = self.pairs.sample(sample.stamp, *sample);
        pairs.iter().filter_map(|(sample, reading)| self.pair(sample, reading)).collect()
    }

    /// Takes a tracer reading; gives its residual if the corrected sample of that instant is there already. Where that
    /// sample's model is awaited, gives the residual that it has to give up for it, if any.
    pub fn tracer(&mut self, reading: &TracerReading) -> Option<RangeResidual> {
        let refused = if reading.frame_id.as_str() != self.frame_id {
            self.foreign.tracer += 1;
            Some(ResidualStatus::OtherFrame)
        } else {
            match self.tracers.look(reading) {
                Verdict::InOrder => None,
                Verdict::OutOfOrder => Some(ResidualStatus::OutOfOrder),
                Verdict::SeveralSources => Some(ResidualStatus::SeveralSources),
            }
        };
        if let Some(status) = refused {
            return Some(self.unpredicted(reading, Sha256::NONE, status));
        }
        let sample = self.pairs.reading(reading)?;
        self.pair(&sample, reading)
    }

    /// What was found of the corrected samples, and of the tracer readings.
    pub fn streams(&self) -> [StreamCounts; 2] {
        let Foreign { corrected, tracer } = self.foreign;
        [
            StreamCounts { other_frame: corrected, ..self.corrected.counts() },
            StreamCounts { other_frame: tracer, ..self.tracers.counts() },
        ]
    }

    /// At the end: what waited for a nearer sample, and what still awaits its model or its scale reading, as not predicted.
    pub fn give_up(&mut self) -> Vec<RangeResidual> {
        let last = self.pairs.finish();
        let mut residuals: Vec<RangeResidual> =
            last.iter().filter_map(|(sample, reading)| self.pair(sample, reading)).collect();
        let mut waiting = std::mem::take(&mut self.awaiting_model);
        waiting.append(&mut self.awaiting_scales);
        residuals.extend(waiting.iter().map(|(sample, reading)| self.compare(sample, reading)));
        residuals
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

    /// Judges a pair, or keeps it until its model and its scale reading are there; the oldest that waits too long is told as
    /// not predicted.
    fn pair(&mut self, sample: &CorrectedCoordinates, reading: &TracerReading) -> Option<RangeResidual> {
        let waiting = match self.model(sample.model_sha256) {
            _ if !sample.corrected_valid => return Some(self.compare(sample, reading)),
            None => &mut self.awaiting_model,
            Some(known) => match &self.scales {
                Some(scales) if known.asked.covariates && scales.may_come(sample) => &mut self.awaiting_scales,
                _ => return Some(self.compare(sample, reading)),
            },
        };
        waiting.push_back((*sample, *reading));
        if waiting.len() <= AWAITING {
            return None;
        }
        let (sample, reading) = waiting.pop_front()?;
        Some(self.compare(&sample, &reading))
    }

    fn model(&self, sha256: Sha256) -> Option<Known> {
        self.models.iter().find(|known| known.sha256 == sha256).cloned()
    }

    /// A tracer reading that nothing is predicted for, and why.
    fn unpredicted(&mut self, reading: &TracerReading, model_sha256: Sha256, status: ResidualStatus) -> RangeResidual {
        self.unpredicted += 1;
        blank(reading, model_sha256, status)
    }

    fn compare(&mut self, sample: &CorrectedCoordinates, reading: &TracerReading) -> RangeResidual {
        let known = self.model(sample.model_sha256).filter(|_| sample.corrected_valid);
        let predicted = match (sample.status, &known) {
            (CorrectionStatus::SeveralSources, _) => Err(ResidualStatus::SeveralSources),
            (CorrectionStatus::OutOfOrder, _) => Err(ResidualStatus::OutOfOrder),
            (_, Some(known)) => self.predict(known, sample, reading),
            (_, None) => Err(ResidualStatus::NotCorrected),
        };
        match predicted {
            Ok((predicted_m, u_model_m)) => {
                let mut residual = blank(reading, sample.model_sha256, ResidualStatus::Consistent);
                residual.predicted_length_m = predicted_m;
                residual.residual_m = reading.length_m - predicted_m;
                residual.u_residual_m = u_model_m.hypot(reading.u_length_m);
                residual.residual_valid = true;
                self.judge(&mut residual);
                residual
            }
            Err(status) => self.unpredicted(reading, sample.model_sha256, status),
        }
    }

    /// Length (m) and its standard uncertainty (m) without the instrument's, or the status that says why there is none.
    fn predict(
        &mut self,
        known: &Known,
        sample: &CorrectedCoordinates,
        reading: &TracerReading,
    ) -> Result<(f64, f64), ResidualStatus> {
        let line = reading.line.as_str();
        if known.asked.runs.iter().any(|run| run == line) {
            self.lacking = Some(format!(
                "the model holds line {line} of its campaign to be an outlying run, and a line of that name need not be \
                 the same run; give runs names of their own"
            ));
            return Err(ResidualStatus::NotPredicted);
        }
        let covariates = self.scales.as_ref().and_then(|scales| scales.of(sample));
        let source: &dyn CovariateSource = match &covariates {
            Some(covariates) => covariates,
            None => &NoCovariates,
        };
        let state = State { reading_m: sample.reading_m, offset_m: sample.offset_m, covariates: source };
        let sighted = Sighted {
            station: reading.station.as_str(),
            line,
            residual_m: Vector3::from(sample.residual_correction_m),
            covariance_m2: Matrix3::from_row_slice(&sample.covariance_m2),
        };
        match predicted_length(&known.model, &state, &sighted) {
            Ok(predicted) => Ok((predicted.length_m, predicted.u_m)),
            Err(Unpredictable::Station(_)) => Err(ResidualStatus::UnknownStation),
            Err(problem @ (Unpredictable::Covariate(_) | Unpredictable::NotFinite)) => {
                let unseen = if self.scales.is_none() {
                    "; no scale reading comes to the monitor: add an edge from scale to monitor"
                } else {
                    ""
                };
                self.lacking = Some(format!("{problem}{unseen}"));
                Err(ResidualStatus::NotPredicted)
            }
        }
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

/// A residual of a tracer reading without figures.
fn blank(reading: &TracerReading, model_sha256: Sha256, status: ResidualStatus) -> RangeResidual {
    RangeResidual {
        stamp: reading.stamp,
        sequence: reading.sequence,
        measured_length_m: reading.length_m,
        predicted_length_m: 0.0,
        residual_m: 0.0,
        u_residual_m: 0.0,
        model_sha256,
        frame_id: reading.frame_id,
        station: reading.station,
        residual_valid: false,
        status,
    }
}
