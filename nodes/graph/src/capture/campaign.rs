//! The campaign that was captured, as identification reads it.
//!
//! Place in the flow: journal → [`super::Capturer`] → here → `campaign.csv`. A zero of the tracer that jumped makes a station of
//! its own, with lines of its own. A station that its readings cannot place would keep the whole campaign from being identified:
//! it is left out, and told; the journal keeps it. SI.

use super::planned::Planned;
use abbe_files::Captured;
use abbe_geometry::chain::nominal_point_m;
use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};
use abbe_measurement::station_start::{PointAndLength, start};
use std::collections::{BTreeMap, BTreeSet};

/// What was captured.
#[derive(Debug, Clone, PartialEq)]
pub struct CapturedCampaign {
    /// Readings in the order of measurement.
    pub campaign: Campaign,
    /// Stations that are left out: name, readings, why.
    pub left_out: Vec<(String, usize, String)>,
}

/// The campaign of these readings.
pub fn campaign_of(planned: &Planned, taken: &[Option<Captured>], is_absolute: bool) -> CapturedCampaign {
    let mut readings: Vec<&Captured> = taken.iter().flatten().collect();
    readings.sort_by_key(|reading| (reading.stamp_ns, reading.point));
    let station = |reading: &Captured| (planned.line(reading.point).station, reading.zero);
    let mut left_out = Vec::new();
    let mut placed = BTreeSet::new();
    for key in readings.iter().map(|reading| station(reading)).collect::<BTreeSet<_>>() {
        let own = readings.iter().filter(|reading| station(reading) == key);
        let points: Vec<PointAndLength> =
            own.map(|reading| (nominal_point_m(reading.reading_m, reading.offset_m), reading.length_m)).collect();
        match start(&points, is_absolute) {
            Ok(_) => drop(placed.insert(key)),
            Err(why) => left_out.push((with_zero(&planned.stations[key.0].name, key.1), points.len(), why.to_string())),
        }
    }
    readings.retain(|reading| placed.contains(&station(reading)));
    let first_ns = readings.first().map_or(0, |reading| reading.stamp_ns);
    let mut campaign = Campaign::default();
    let names: BTreeSet<&String> = readings.iter().flat_map(|reading| reading.covariates.keys()).collect();
    let mut columns: BTreeMap<&String, Vec<Option<f64>>> = names.into_iter().map(|name| (name, Vec::new())).collect();
    for reading in readings {
        let line = planned.line(reading.point);
        let station = with_zero(&planned.stations[line.station].name, reading.zero);
        let line = with_zero(&line.name, reading.zero);
        campaign.readings.push(RangeReading {
            station: index(&mut campaign.stations, station),
            line: index(&mut campaign.lines, line),
            time_s: (reading.stamp_ns - first_ns) as f64 * 1e-9,
            reading_m: reading.reading_m,
            offset_m: reading.offset_m,
            length_m: reading.length_m,
        });
        columns.iter_mut().for_each(|(name, values)| values.push(reading.covariates.get(*name).copied()));
    }
    let covariates = columns.into_iter().map(|(name, values)| Covariate { name: name.clone(), values });
    campaign.covariates = covariates.collect();
    CapturedCampaign { campaign, left_out }
}

/// The name of a station or line that counts from this zero of the tracer.
fn with_zero(name: &str, zero: u32) -> String {
    match zero {
        0 => name.to_owned(),
        later => format!("{name}-zero{}", later + 1),
    }
}

fn index(names: &mut Vec<String>, name: String) -> u32 {
    match names.iter().position(|known| *known == name) {
        Some(place) => place as u32,
        None => {
            names.push(name);
            names.len() as u32 - 1
        }
    }
}
