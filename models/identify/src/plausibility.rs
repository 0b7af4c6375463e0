//! Checks of a campaign before and after the stations are placed: numbers, strokes, contradictions.
//!
//! Place in the flow: first step of identification. What no machine error can make is named here (with
//! [`crate::contradiction`]) instead of being spread over twenty-one error functions.

use crate::contradiction;
use crate::error::IdentifyError;
use crate::station_start::{PointAndLength, StationStart, start};
use abbe_geometry::machine::Machine;
use abbe_measurement::campaign::{Campaign, RangeReading};

/// Readings that place a station for a start: more add nothing, since the errors are not in yet.
const START_READINGS: usize = 4000;
/// How far beyond the stroke a scale may read: overtravel, as a share of the stroke.
const OVERTRAVEL: f64 = 0.02;

/// Refuses what is not a finite reading inside the machine, and campaigns too small to identify.
pub(crate) fn check_readings(machine: &Machine, campaign: &Campaign) -> Result<(), IdentifyError> {
    if campaign.stations.len() < 2 {
        return Err(IdentifyError::TooFewStations { found: campaign.stations.len() });
    }
    for (index, reading) in campaign.readings.iter().enumerate() {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let checks = [
            (finite(&reading.reading_m), "the axis position"),
            (finite(&reading.offset_m), "the offset"),
            (reading.length_m.is_finite(), "the length"),
            (reading.time_s.is_finite(), "the time"),
        ];
        if let Some((_, what)) = checks.into_iter().find(|(ok, _)| !ok) {
            return Err(IdentifyError::NotFinite { reading: index + 1, what });
        }
        let lists =
            [("station", reading.station, campaign.stations.len()), ("line", reading.line, campaign.lines.len())];
        if let Some((what, index_in_list, _)) = lists.into_iter().find(|(_, k, len)| *k as usize >= *len) {
            return Err(IdentifyError::Dangling { reading: index + 1, what, index: index_in_list });
        }
        check_stroke(machine, index, reading)?;
    }
    Ok(())
}

fn check_stroke(machine: &Machine, index: usize, reading: &RangeReading) -> Result<(), IdentifyError> {
    match beyond_stroke(machine, reading.reading_m) {
        None => Ok(()),
        Some(BeyondStroke { axis, position_mm, lower_mm, upper_mm }) => Err(IdentifyError::OutsideStroke {
            reading: index + 1,
            axis,
            position_mm,
            lower_mm,
            upper_mm,
            machine: machine.name.clone(),
        }),
    }
}

/// An axis that stands where its machine cannot go, in the unit of messages.
pub(crate) struct BeyondStroke {
    pub(crate) axis: char,
    pub(crate) position_mm: f64,
    pub(crate) lower_mm: f64,
    pub(crate) upper_mm: f64,
}

/// The first axis whose reading (m) lies beyond stroke and overtravel.
pub(crate) fn beyond_stroke(machine: &Machine, reading_m: [f64; 3]) -> Option<BeyondStroke> {
    let mut axes = ['X', 'Y', 'Z'].into_iter().zip(reading_m.into_iter().zip(machine.stroke_m));
    let is_beyond = |(_, (position_m, (lower_m, upper_m))): &(char, (f64, (f64, f64)))| {
        let slack_m = (upper_m - lower_m) * OVERTRAVEL;
        !(lower_m - slack_m..=upper_m + slack_m).contains(position_m)
    };
    axes.find(is_beyond).map(|(axis, (position_m, (lower_m, upper_m)))| BeyondStroke {
        axis,
        position_mm: position_m * 1e3,
        lower_mm: lower_m * 1e3,
        upper_mm: upper_m * 1e3,
    })
}

/// Places all stations from nominal points and refuses lines that contradict them.
pub(crate) fn place_stations(campaign: &Campaign, absolute: bool) -> Result<Vec<StationStart>, IdentifyError> {
    let mut by_station: Vec<Vec<usize>> = vec![Vec::new(); campaign.stations.len()];
    campaign.readings.iter().enumerate().for_each(|(k, r)| by_station[r.station as usize].push(k));
    let place = |(indices, name): (&Vec<usize>, &String)| {
        let stride = indices.len().div_ceil(START_READINGS);
        let points: Vec<PointAndLength> =
            indices.iter().step_by(stride.max(1)).map(|k| contradiction::point(&campaign.readings[*k])).collect();
        start(&points, absolute)
            .map_err(|error| IdentifyError::Station { station: name.clone(), problem: error.to_string() })
    };
    let placed: Vec<StationStart> = by_station.iter().zip(&campaign.stations).map(place).collect::<Result<_, _>>()?;
    for (station, indices) in by_station.iter().enumerate() {
        contradiction::check(campaign, indices, &placed, station, absolute)?;
    }
    Ok(placed)
}
