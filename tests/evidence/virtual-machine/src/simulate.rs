//! The simulation: a machine driven along a plan, watched by a tracer, in an environment.
//!
//! Place in the flow: a [`SimulationConfig`] goes in; readings come out one by one ([`ReadingStream`]) or as a
//! whole campaign with its truth ([`simulate_campaign`]). SI in the machine frame; covariates in the unit of
//! their column name. Same configuration, same bytes.
//! Equation: length = s(t) − s(t₀), s = |actual − station| + range effects + noise, t₀ the station's first
//! reading: its noise is part of every length of the station, and so of the dead path.

use std::sync::Arc;

use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::effects::{Beam, Effect, Moment};
use crate::environment::{Environment, EnvironmentConfig};
use crate::error::SimulationError;
use crate::instrument::InstrumentConfig;
use crate::machine::{JointErrors, MachineTruth, VirtualMachine};
use crate::plan::{Plan, Target, Targets};
use crate::random::{Purpose, normal, stream};

pub use crate::logged::covariate_names;

/// No tracer measures nearer than this (m); a plan that asks for it is refused.
pub const NEAREST_RANGE_M: f64 = 0.02;

/// Number of covariates of every simulated reading.
pub const COVARIATES: usize = 17;

/// Everything that makes one simulated campaign.
#[derive(Debug, Clone)]
pub struct SimulationConfig {
    /// Seed of noise, drift and outliers; machine and plan have seeds of their own.
    pub seed: u64,
    /// The machine.
    pub machine: MachineTruth,
    /// What is measured.
    pub plan: Plan,
    /// How well it is measured.
    pub instrument: InstrumentConfig,
    /// In what room.
    pub environment: EnvironmentConfig,
    /// Physics beyond the 21 errors.
    pub effects: Vec<Arc<dyn Effect>>,
}

impl SimulationConfig {
    /// Refuses a configuration that cannot be simulated and builds its machine.
    ///
    /// # Errors
    /// Names the key of the first setting that makes no sense.
    pub fn checked_machine(&self) -> Result<VirtualMachine, SimulationError> {
        let machine = VirtualMachine::new(self.machine.clone())?;
        self.plan.check(&self.machine.stroke_m)?;
        self.instrument.check()?;
        self.environment.check()?;
        for (place, effect) in self.effects.iter().enumerate() {
            let key = format!("effects[{place}].{}", effect.name());
            effect.check().and_then(|()| effect.check_plan(&self.plan)).map_err(|e| e.under(&key))?;
        }
        Ok(machine)
    }
}

/// What really happened at one reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadingTruth {
    /// Reflector (m, machine frame), with effects and repeatability.
    pub actual_m: [f64; 3],
    /// Tracer station at that time (m, machine frame).
    pub station_m: [f64; 3],
    /// Distance between the two (m).
    pub range_m: f64,
    /// What an outlier added to the length (m), if the reading was spoilt.
    pub outlier_m: Option<f64>,
}

/// One reading with everything logged beside it and its truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedReading {
    /// The reading as the instrument and the machine give it.
    pub reading: RangeReading,
    /// Logged quantities in the order of [`covariate_names`].
    pub covariates: [f64; COVARIATES],
    /// What really happened.
    pub truth: ReadingTruth,
    /// Absolute range that the station's lengths count from, as measured (m): the dead path of the fit.
    pub first_range_m: f64,
}

/// A whole campaign and its truth.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// What an identification may see.
    pub campaign: Campaign,
    /// What it must find.
    pub truth: CampaignTruth,
}

/// The truth behind a campaign.
#[derive(Debug, Clone)]
pub struct CampaignTruth {
    /// The machine, to be asked for errors and points; effects are not in it.
    pub machine: VirtualMachine,
    /// Station centres at their first readings (m, machine frame).
    pub stations_m: Vec<[f64; 3]>,
    /// Absolute range of each station's first reading as measured (m).
    pub first_ranges_m: Vec<f64>,
    /// One entry a reading.
    pub readings: Vec<ReadingTruth>,
}

/// The station that is being measured from.
#[derive(Debug, Clone, Copy)]
struct Reference {
    shown_m: f64,
    time_s: f64,
}

/// Iterator over the readings of a campaign; holds one reading at a time.
#[derive(Debug)]
pub struct ReadingStream<'a> {
    config: &'a SimulationConfig,
    machine: VirtualMachine,
    targets: Targets<'a>,
    environment: Environment,
    /// The same room, for effects.
    room: Arc<Environment>,
    path_m: Vec<[f64; 3]>,
    repeatability: ChaCha8Rng,
    range_noise: ChaCha8Rng,
    outliers: ChaCha8Rng,
    correlated_noise: ChaCha8Rng,
    /// Line of the reading before, and its correlated noise in standard deviations.
    correlated: Option<(u32, f64)>,
    reference: Option<Reference>,
}

impl<'a> ReadingStream<'a> {
    /// Checks the configuration and stands ready before the first reading.
    ///
    /// # Errors
    /// Names the key of the first setting that makes no sense.
    pub fn new(config: &'a SimulationConfig) -> Result<Self, SimulationError> {
        let machine = config.checked_machine()?;
        let environment = Environment::new(&config.environment, config.seed);
        Ok(Self {
            config,
            machine,
            targets: config.plan.targets(),
            room: Arc::new(environment.clone()),
            environment,
            path_m: Vec::new(),
            repeatability: stream(config.seed, Purpose::Repeatability),
            range_noise: stream(config.seed, Purpose::RangeNoise),
            outliers: stream(config.seed, Purpose::Outliers),
            correlated_noise: stream(config.seed, Purpose::CorrelatedNoise),
            correlated: None,
            reference: None,
        })
    }

    fn measure(&mut self, target: &Target) -> Result<SimulatedReading, SimulationError> {
        let mut path_m = std::mem::take(&mut self.path_m);
        path_m.push(target.reading_m);
        let room = Arc::clone(&self.room);
        let measured = self.measure_at(target, &moment_of(target, &self.config.machine, &room, &path_m));
        self.path_m = path_m;
        measured
    }

    fn measure_at(&mut self, target: &Target, moment: &Moment) -> Result<SimulatedReading, SimulationError> {
        if target.first_of_station {
            self.reference = None;
            self.correlated = None;
        }
        let mut extra = disturbance(&self.config.effects, moment);
        for axis in 0..3 {
            let stops_m = self.config.instrument.repeatability_m[axis];
            extra.linear_m[axis][axis] += stops_m * normal(&mut self.repeatability);
        }
        let actual_m = self.machine.disturbed_point_m(target.reading_m, target.offset_m, &extra);
        let beam = self.beam(target, moment, actual_m)?;
        let outlier_m = self.outlier_m(target);
        let shown_m = self.shown_m(moment, &beam, outlier_m) + self.correlated_m(target);
        let reference = *self.reference.get_or_insert(Reference { shown_m, time_s: target.time_s });
        let reading = RangeReading {
            station: target.station,
            line: target.line,
            time_s: target.time_s,
            reading_m: target.reading_m,
            offset_m: target.offset_m,
            length_m: self.displayed_m(shown_m - reference.shown_m),
        };
        Ok(SimulatedReading {
            reading,
            covariates: covariates(target, self.environment.logged(&moment.environment)),
            truth: ReadingTruth {
                actual_m,
                station_m: self.station_m(target, moment)?,
                range_m: beam.range_m,
                outlier_m,
            },
            first_range_m: reference.shown_m,
        })
    }

    fn time_on_station_s(&self, target: &Target) -> f64 {
        let since = self.reference.map_or(target.time_s, |r| r.time_s);
        target.time_s - since
    }

    fn station_m(&self, target: &Target, moment: &Moment) -> Result<[f64; 3], SimulationError> {
        let time_s = self.time_on_station_s(target);
        let mut out = self.station(target)?.position_m;
        for effect in &self.config.effects {
            let shift_m = effect.station_shift_m(moment, target.station, time_s);
            for d in 0..3 {
                out[d] += shift_m[d];
            }
        }
        Ok(out)
    }

    fn station(&self, target: &Target) -> Result<&'a crate::plan::StationPlan, SimulationError> {
        let place = target.station as usize;
        self.config.plan.stations.get(place).ok_or_else(|| {
            SimulationError::new(
                format!("plan.stations[{place}]"),
                "no such station",
                "this is a fault of the simulator, not of its configuration",
            )
        })
    }

    fn beam(&self, target: &Target, moment: &Moment, actual_m: [f64; 3]) -> Result<Beam, SimulationError> {
        let station_m = self.station_m(target, moment)?;
        let mut along = [0.0; 3];
        for d in 0..3 {
            along[d] = actual_m[d] - station_m[d];
        }
        let range_m = along.iter().map(|v| v * v).sum::<f64>().sqrt();
        if range_m < NEAREST_RANGE_M {
            return Err(SimulationError::new(
                format!("plan.stations[{}].position_m", target.station),
                format!("the reflector comes within {range_m} m of the station"),
                format!("keep {NEAREST_RANGE_M} m between them"),
            ));
        }
        Ok(Beam {
            station: target.station,
            line: target.line,
            time_on_station_s: self.time_on_station_s(target),
            range_m,
            dead_path_m: self.station(target)?.dead_path_m,
            toward_reflector: along.map(|v| v / range_m),
        })
    }

    fn outlier_m(&mut self, target: &Target) -> Option<f64> {
        let outliers = self.config.instrument.outliers?;
        // Both are drawn for every reading, so that the fraction does not change which sign comes when.
        let (chance, upward) = (self.outliers.random::<f64>(), self.outliers.random::<bool>());
        if target.first_of_station || chance >= outliers.fraction {
            return None;
        }
        Some(if upward { outliers.size_m } else { -outliers.size_m })
    }

    /// A first-order autoregression that is stationary from its first reading on.
    fn correlated_m(&mut self, target: &Target) -> f64 {
        let Some(noise) = self.config.instrument.correlated else { return 0.0 };
        let new = normal(&mut self.correlated_noise);
        let before = self.correlated.filter(|(line, _)| !noise.by_line || *line == target.line);
        let now = match before {
            Some((_, before)) => noise.neighbours * before + (1.0 - noise.neighbours.powi(2)).sqrt() * new,
            None => new,
        };
        self.correlated = Some((target.line, now));
        noise.deviation_m * now
    }

    fn shown_m(&mut self, moment: &Moment, beam: &Beam, outlier_m: Option<f64>) -> f64 {
        let effects = &self.config.effects;
        let shifts: f64 = effects.iter().map(|e| e.range_shift_m(moment, beam)).sum();
        let deviation_m = self.config.instrument.range.standard_m(beam.range_m);
        let noise_m = deviation_m * normal(&mut self.range_noise);
        beam.range_m + shifts + noise_m + outlier_m.unwrap_or(0.0)
    }

    fn displayed_m(&self, length_m: f64) -> f64 {
        match self.config.instrument.resolution_m {
            Some(step_m) => (length_m / step_m).round() * step_m,
            None => length_m,
        }
    }
}

impl Iterator for ReadingStream<'_> {
    type Item = Result<SimulatedReading, SimulationError>;

    fn next(&mut self) -> Option<Self::Item> {
        let target = self.targets.next()?;
        Some(self.measure(&target))
    }
}

/// Runs the whole campaign and keeps it in memory.
///
/// # Errors
/// Names the key of the first setting that makes no sense.
pub fn simulate_campaign(config: &SimulationConfig) -> Result<Simulated, SimulationError> {
    let mut campaign = Campaign::default();
    for station in &config.plan.stations {
        campaign.stations.push(station.name.clone());
        campaign.lines.extend(station.lines.iter().map(|line| line.name.clone()));
    }
    campaign.covariates =
        covariate_names().map(|name| Covariate { name: name.to_owned(), values: Vec::new() }).collect();
    let stream = ReadingStream::new(config)?;
    let mut truth = CampaignTruth {
        machine: stream.machine.clone(),
        stations_m: config.plan.stations.iter().map(|s| s.position_m).collect(),
        first_ranges_m: Vec::new(),
        readings: Vec::new(),
    };
    for simulated in stream {
        let simulated = simulated?;
        if simulated.reading.station as usize == truth.first_ranges_m.len() {
            truth.first_ranges_m.push(simulated.first_range_m);
        }
        campaign.readings.push(simulated.reading);
        truth.readings.push(simulated.truth);
        for (column, value) in campaign.covariates.iter_mut().zip(simulated.covariates) {
            column.values.push(Some(value));
        }
    }
    Ok(Simulated { campaign, truth })
}

/// What the effects add to joints and tip at one moment.
pub(crate) fn disturbance(effects: &[Arc<dyn Effect>], moment: &Moment) -> JointErrors {
    let mut extra = JointErrors::default();
    for effect in effects {
        effect.disturb_machine(moment, &mut extra);
    }
    extra
}

/// What effects know of a standstill; the path ends there.
pub(crate) fn moment_of<'a>(
    target: &Target,
    machine: &MachineTruth,
    room: &'a Environment,
    path_m: &'a [[f64; 3]],
) -> Moment<'a> {
    Moment {
        time_s: target.time_s,
        reading_m: target.reading_m,
        stroke_m: machine.stroke_m,
        offset_m: target.offset_m,
        direction: target.direction,
        feed_m_s: target.feed_m_s,
        acceleration_m_s2: target.acceleration_m_s2,
        load_kg: target.load_kg,
        environment: room.state(target.time_s),
        room,
        path_m,
    }
}

/// The covariates of one reading in the units of their column names.
pub(crate) fn covariates(target: &Target, sensors: [f64; 9]) -> [f64; COVARIATES] {
    let mut out = [0.0; COVARIATES];
    out[..3].copy_from_slice(&target.direction);
    out[3] = target.feed_m_s * 1e3;
    out[4..7].copy_from_slice(&target.acceleration_m_s2.map(|a| a * 1e3));
    out[7] = target.load_kg;
    out[8..].copy_from_slice(&sensors);
    out
}
