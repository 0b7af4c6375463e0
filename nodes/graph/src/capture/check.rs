//! Each reading against those before it, from the second of a station on.
//!
//! Place in the flow: [`super::Capturer`] asks before it takes a reading. What a station's readings say of each other is in
//! [`GrowingStation`]; points are as indicated, with the error that an uncorrected machine is said to have, until the campaign so
//! far is identified, and then as that model corrects them, with its own uncertainty. So a zero that jumped by tenths of a
//! millimetre is told at the second reading of a campaign, and one of micrometres once there is a model. Machine frame, m.

use super::config::CheckConfig;
use super::planned::Planned;
use abbe_files::{Captured, MachineFile};
use abbe_geometry::Vector3;
use abbe_geometry::chain::nominal_point_m;
use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::model::MachineModel;
use abbe_geometry::unseen_expansion::UnseenExpansions;
use abbe_measurement::growing_station::{GrowingStation, Sighting};
use std::collections::BTreeMap;

/// Standard uncertainties within which a reading agrees: where the weights of a fit reject.
const AGREES: f64 = 6.0;
/// Standard uncertainties within which another explanation holds.
const EXPLAINS: f64 = 3.0;
/// Readings on either side of a jump that is found afterwards.
const ON_EITHER_SIDE: usize = 3;
/// A difference that is no jump (m): what drift and temperature do to a station without anything having happened.
const LEAST_M: f64 = 3e-6;

/// What a reading says beside those before it.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Judgement {
    /// Nothing was known that it could be held against.
    First,
    /// It agrees: measured less expected (m) and its standard uncertainty.
    Agrees(f64, f64),
    /// It does not; and the offsets (m) with which it would.
    Differs { off_m: f64, u_m: f64, offsets_m: Vec<[f64; 3]> },
}

/// The stations as they grow.
pub(super) struct Checks {
    config: CheckConfig,
    machine: MachineFile,
    model: Option<MachineModel>,
    /// By station and number of the tracer's zero.
    stations: BTreeMap<(usize, u32), (GrowingStation, Vec<Captured>)>,
}

impl Checks {
    pub(super) fn new(config: CheckConfig, machine: MachineFile) -> Checks {
        Checks { config, machine, model: None, stations: BTreeMap::new() }
    }

    /// Takes a reading that counts.
    pub(super) fn add(&mut self, planned: &Planned, station: usize, reading: &Captured) {
        let key = (station, reading.zero);
        let absolute = self.machine.absolute_range;
        let before = self.stations.remove(&key);
        let mut own = before.unwrap_or_else(|| (self.growing(planned, station, absolute), Vec::new()));
        own.0.add(self.sighting(&own.0, reading));
        own.1.push(reading.clone());
        self.stations.insert(key, own);
    }

    /// Forgets all readings; what the model says stays.
    pub(super) fn forget(&mut self) {
        self.stations.clear();
    }

    /// The points whose readings count from another zero than those before, with the jump (m), where the later ones say so.
    pub(super) fn jump(&self, station: usize, zero: u32) -> Option<(Vec<usize>, f64)> {
        let (growing, readings) = self.stations.get(&(station, zero))?;
        let jump = growing.jump(ON_EITHER_SIDE)?;
        let is_sure = jump.size_m.abs() > (AGREES * jump.u_m).max(LEAST_M);
        is_sure.then(|| (readings[jump.from..].iter().map(|reading| reading.point).collect(), jump.size_m))
    }

    /// From now on points are as this model corrects them.
    pub(super) fn learn(&mut self, model: MachineModel) {
        // What its data leave open of expansions is no tolerance for a jump.
        let strict = model.with_unseen_expansions(UnseenExpansions::default());
        self.model = Some(strict.unwrap_or(model));
        let stations = std::mem::take(&mut self.stations);
        for (key, (mut growing, readings)) in stations {
            let sightings = readings.iter().map(|reading| self.sighting(&growing, reading)).collect();
            growing.replace(sightings);
            self.stations.insert(key, (growing, readings));
        }
    }

    /// Holds a reading against those of its station and zero.
    pub(super) fn judge(&self, planned: &Planned, station: usize, reading: &Captured) -> Judgement {
        let fresh;
        let growing = match self.stations.get(&(station, reading.zero)) {
            Some((growing, _)) => growing,
            None => {
                fresh = self.growing(planned, station, self.machine.absolute_range);
                &fresh
            }
        };
        let Some((off_m, u_m)) = self.off(growing, reading) else { return Judgement::First };
        if off_m.abs() <= (AGREES * u_m).max(LEAST_M) {
            return Judgement::Agrees(off_m, u_m);
        }
        let explains = |offset_m: &[f64; 3]| {
            let tried = Captured { offset_m: *offset_m, ..reading.clone() };
            *offset_m != reading.offset_m
                && self.off(growing, &tried).is_some_and(|(off_m, u_m)| off_m.abs() <= EXPLAINS * u_m)
        };
        let mut offsets_m: Vec<[f64; 3]> = Vec::new();
        for line in &planned.lines {
            if !offsets_m.contains(&line.offset_m) && explains(&line.offset_m) {
                offsets_m.push(line.offset_m);
            }
        }
        Judgement::Differs { off_m, u_m, offsets_m }
    }

    fn growing(&self, planned: &Planned, station: usize, absolute: bool) -> GrowingStation {
        GrowingStation::new(planned.stations[station].position_m, self.config.station_mm / 1e3, absolute)
    }

    /// Measured less expected length and its standard uncertainty (m).
    fn off(&self, growing: &GrowingStation, reading: &Captured) -> Option<(f64, f64)> {
        let sighting = self.sighting(growing, reading);
        let expected = growing.expected(&sighting.position_m)?;
        Some((sighting.length_m - expected.length_m, expected.u_m.hypot(sighting.u_m)))
    }

    /// The point as it is known now, with its uncertainty along the beam.
    fn sighting(&self, growing: &GrowingStation, reading: &Captured) -> Sighting {
        let nominal_m: Vector3<f64> = nominal_point_m(reading.reading_m, reading.offset_m);
        let raw_m = self.config.raw_error_um / 1e6;
        let range_m = (nominal_m - growing.position_m()).norm();
        let u_range_m = self.machine.instrument.standard_m(range_m).hypot(reading.u_length_m);
        let (position_m, u_m) = match &self.model {
            None => (nominal_m, raw_m),
            Some(model) => {
                let state =
                    State { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates: &NoCovariates };
                let found = correct(model, &state);
                let along = (found.position_m - growing.position_m()) / range_m.max(f64::MIN_POSITIVE);
                match (found.covariance_m2, found.status) {
                    // Outside of what was measured the model's uncertainty is a lower bound.
                    (Some(_), Status::Extrapolated) => (found.position_m, raw_m),
                    (Some(covariance_m2), _) => (found.position_m, along.dot(&(covariance_m2 * along)).max(0.0).sqrt()),
                    (None, _) => (nominal_m, raw_m),
                }
            }
        };
        Sighting { position_m, u_m: u_m.hypot(u_range_m), length_m: reading.length_m }
    }
}

/// Whether readings are off by the same amount, as after a jump of the zero: the mean (m).
pub(super) fn same_jump(off: &[(f64, f64)]) -> Option<f64> {
    let mean_m = off.iter().map(|(off_m, _)| off_m).sum::<f64>() / off.len().max(1) as f64;
    let is_near = |(off_m, u_m): &(f64, f64)| (off_m - mean_m).abs() <= (EXPLAINS * u_m).max(LEAST_M);
    (off.len() > 1 && off.iter().all(is_near)).then_some(mean_m)
}
