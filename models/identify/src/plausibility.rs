//! Checks of a campaign before and after the stations are placed: numbers, strokes, contradictions.
//!
//! Place in the flow: first step of identification. What no machine error can make is named here (with
//! [`crate::contradiction`]) instead of being spread over twenty-one error functions.

use crate::contradiction;
use crate::error::IdentifyError;
use crate::station_start::{PointAndLength, StationStart, start};
use abbe_geometry::machine::Machine;
use abbe_measurement::campaign::{Campaign, RangeReading};
use abbe_measurement::subset::spread;

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
        let part = spread(indices.len(), START_READINGS).into_iter();
        let points: Vec<PointAndLength> =
            part.map(|place| contradiction::point(&campaign.readings[indices[place]])).collect();
        start(&points, absolute).or_else(|error| {
            // A few lines of another station may lead the start astray: what contradicts the rest is then named below.
            if let Some(station) = contradiction::without_some_lines(campaign, indices, absolute) {
                return Ok(station);
            }
            let mut likely = contradiction::of_whole_station(campaign, indices, absolute);
            if likely.is_empty()
                && let Some(problem) = contradiction::of_new_zeros(campaign, indices, absolute)
            {
                return Err(IdentifyError::Station { station: name.clone(), problem });
            }
            likely.insert(0, error.to_string());
            let problem = likely.join("; or ");
            Err(IdentifyError::Station { station: name.clone(), problem })
        })
    };
    let placed: Vec<StationStart> = by_station.iter().zip(&campaign.stations).map(place).collect::<Result<_, _>>()?;
    for (station, indices) in by_station.iter().enumerate() {
        contradiction::check(campaign, indices, &placed, station, absolute)?;
    }
    Ok(placed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_geometry::Vector3;

    /// Lines of eleven points along X that fill a volume, read from two stations: every eleventh of them lies in a plane.
    #[test]
    fn regress_a_raster_whose_lines_are_as_long_as_a_stride_places_its_stations() {
        let stations = [Vector3::new(-0.4, 1.2, 0.3), Vector3::new(1.1, -0.5, 0.6)];
        let count = 11 * START_READINGS;
        let reading = |(station, k): (u32, usize)| {
            let (place, line) = (k % 11, k / 11);
            let [x, y, z] = [place as f64 * 0.07, (line % 63) as f64 * 0.01, (line / 63) as f64 * 0.01];
            let point_m = Vector3::new(x, y, z);
            let length_m = (point_m - stations[station as usize]).norm() - 0.2;
            let (reading_m, offset_m) = ([x, y, z], [0.0; 3]);
            RangeReading { station, line: line as u32, time_s: k as f64, reading_m, offset_m, length_m }
        };
        let campaign = Campaign {
            stations: ["S1", "S2"].map(str::to_owned).to_vec(),
            lines: (0..count / 11).map(|k| k.to_string()).collect(),
            readings: (0..2).flat_map(|station| (0..count).map(move |k| (station, k))).map(reading).collect(),
            covariates: Vec::new(),
        };
        let placed = place_stations(&campaign, false).unwrap();
        for (found, truth) in placed.iter().zip(stations) {
            assert!((found.position_m - truth).norm() < 1e-9, "{found:?}");
        }
    }
}
