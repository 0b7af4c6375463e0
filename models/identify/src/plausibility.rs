//! Checks of a campaign before and after the stations are placed: numbers, strokes, contradictions.
//!
//! Place in the flow: first step of identification. A reflector offset with the wrong sign, swapped columns or a
//! line from another station disagree by millimetres, where machine errors are micrometres; they are named
//! here instead of being spread over twenty-one error functions.

use crate::error::IdentifyError;
use crate::station_start::{PointAndLength, StationStart, residual_m, start};
use abbe_geometry::chain::nominal_point_m;
use abbe_geometry::machine::Machine;
use abbe_measurement::campaign::{Campaign, RangeReading};

/// Disagreement of a whole line (rms, m) that no machine error makes: fifty times a poor machine's.
const CONTRADICTION_M: f64 = 2e-3;
/// Readings that place a station for a start: more add nothing, since the errors are not in yet.
const START_READINGS: usize = 4000;
/// How much better an explanation must fit to be offered.
const CLEARLY_BETTER: f64 = 0.2;
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
        check_stroke(machine, index, reading)?;
    }
    Ok(())
}

fn check_stroke(machine: &Machine, index: usize, reading: &RangeReading) -> Result<(), IdentifyError> {
    for (axis, (position_m, (lower_m, upper_m))) in
        ['X', 'Y', 'Z'].into_iter().zip(reading.reading_m.into_iter().zip(machine.stroke_m))
    {
        let slack_m = (upper_m - lower_m) * OVERTRAVEL;
        if !(lower_m - slack_m..=upper_m + slack_m).contains(&position_m) {
            return Err(IdentifyError::OutsideStroke {
                reading: index + 1,
                axis,
                position_mm: position_m * 1e3,
                lower_mm: lower_m * 1e3,
                upper_mm: upper_m * 1e3,
                machine: machine.name.clone(),
            });
        }
    }
    Ok(())
}

/// Places all stations from nominal points and refuses lines that contradict them.
pub(crate) fn place_stations(campaign: &Campaign, absolute: bool) -> Result<Vec<StationStart>, IdentifyError> {
    let mut by_station: Vec<Vec<usize>> = vec![Vec::new(); campaign.stations.len()];
    campaign.readings.iter().enumerate().for_each(|(k, r)| by_station[r.station as usize].push(k));
    let place = |(station, indices): (usize, &Vec<usize>)| {
        let stride = indices.len().div_ceil(START_READINGS);
        let points: Vec<PointAndLength> =
            indices.iter().step_by(stride.max(1)).map(|k| point(&campaign.readings[*k])).collect();
        let name = &campaign.stations[station];
        let found = start(&points, absolute)
            .map_err(|error| IdentifyError::Station { station: name.clone(), problem: error.to_string() })?;
        check_lines(campaign, indices, &found, absolute)?;
        Ok(found)
    };
    by_station.iter().enumerate().map(place).collect()
}

fn point(reading: &RangeReading) -> PointAndLength {
    (nominal_point_m(reading.reading_m, reading.offset_m), reading.length_m)
}

/// Refuses the worst line of a station when it contradicts the station's fit.
fn check_lines(
    campaign: &Campaign,
    indices: &[usize],
    station: &StationStart,
    absolute: bool,
) -> Result<(), IdentifyError> {
    let mut worst: Option<(f64, &[usize])> = None;
    for line in indices.chunk_by(|a, b| campaign.readings[*a].line == campaign.readings[*b].line) {
        let rms_m = line_rms_m(campaign, line, station, point);
        if worst.is_none_or(|(most, _)| rms_m > most) {
            worst = Some((rms_m, line));
        }
    }
    match worst {
        Some((rms_m, line)) if rms_m > CONTRADICTION_M => Err(contradiction(campaign, indices, line, rms_m, absolute)),
        _ => Ok(()),
    }
}

fn line_rms_m(
    campaign: &Campaign,
    line: &[usize],
    station: &StationStart,
    point: impl Fn(&RangeReading) -> PointAndLength,
) -> f64 {
    // The median, not the mean square: single outliers are for the robust weights, not for this check.
    let mut squares: Vec<f64> =
        line.iter().map(|k| residual_m(station, &point(&campaign.readings[*k])).powi(2)).collect();
    squares.sort_by(f64::total_cmp);
    squares[squares.len() / 2].sqrt()
}

/// Names the line, and the sign that explains it if one does.
fn contradiction(campaign: &Campaign, indices: &[usize], line: &[usize], rms_m: f64, absolute: bool) -> IdentifyError {
    let of_line = campaign.readings[line[0]].line;
    let explained = (0..3).find(|d| {
        let flipped = |reading: &RangeReading| {
            let mut reading = *reading;
            reading.offset_m[*d] = -reading.offset_m[*d];
            point(&reading)
        };
        // The station from all other lines, so that the suspect does not speak for itself.
        let others: Vec<PointAndLength> = indices
            .iter()
            .filter(|k| campaign.readings[**k].line != of_line)
            .map(|k| point(&campaign.readings[*k]))
            .collect();
        start(&others, absolute).is_ok_and(|s| line_rms_m(campaign, line, &s, flipped) < CLEARLY_BETTER * rms_m)
    });
    let explanation = match explained {
        Some(d) => format!(
            "it agrees when offset_{}_mm of the line changes its sign: correct the sign of that offset",
            ['x', 'y', 'z'][d]
        ),
        None => "check its station name, its offsets, the order and unit of x, y, z, and whether the beam was lost"
            .to_owned(),
    };
    let first = &campaign.readings[line[0]];
    IdentifyError::Contradiction {
        line: campaign.lines[first.line as usize].clone(),
        station: campaign.stations[first.station as usize].clone(),
        first: line[0] + 1,
        last: line[line.len() - 1] + 1,
        residual_mm: rms_m * 1e3,
        explanation,
    }
}
