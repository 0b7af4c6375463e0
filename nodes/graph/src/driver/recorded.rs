//! A campaign in memory as a source of scale and tracer readings.
//!
//! Place in the flow: behind the campaign-file and virtual-machine drivers. The stamp is the recorded time, so a
//! replay never sees the clock. An interferometer's uncertainty grows with the distance of the reflector, not with the
//! length travelled since the first reading; the distance follows from the recording itself, whose points and lengths
//! place each station. Lengths in m.

use super::{DriverError, ScaleDriver, TracerDriver};
use abbe_files::MachineFile;
use abbe_geometry::chain::nominal_point_m;
use abbe_measurement::campaign::{Campaign, RangeReading};
use abbe_measurement::instrument::RangeUncertainty;
use abbe_measurement::station_start::{PointAndLength, start};
use abbe_measurement::subset::spread;
use abbe_msgs::{Covariates, MessageError, ScaleReading, Stamp, Text, TextError, TracerReading};

/// Readings that place a station at most: a micrometre of distance is more than an uncertainty asks for.
const PLACING_READINGS: usize = 4000;

/// Plays one campaign, row by row.
pub(super) struct Recorded {
    campaign: Campaign,
    frame_id: String,
    instrument: RangeUncertainty,
    /// Distance at length zero of each station (m); `None` where the recording does not tell it.
    dead_paths_m: Vec<Option<f64>>,
    next: usize,
}

impl Recorded {
    pub(super) fn new(campaign: Campaign, machine: &MachineFile) -> Recorded {
        let frame_id = machine.machine.frame_id.clone();
        let dead_path_m = |station| if machine.absolute_range { Some(0.0) } else { dead_path_m(&campaign, station) };
        let dead_paths_m = (0..campaign.stations.len()).map(dead_path_m).collect();
        Recorded { campaign, frame_id, instrument: machine.instrument, dead_paths_m, next: 0 }
    }

    /// Standard uncertainty of a length (m, k = 1) at the distance of its reflector.
    fn u_length_m(&self, reading: &RangeReading) -> f64 {
        // Without the distance the length travelled is a lower bound, of which `dead_path_m` warned.
        let dead_path_m = self.dead_paths_m[reading.station as usize].unwrap_or(0.0);
        self.instrument.standard_m(reading.length_m + dead_path_m)
    }

    fn take(&mut self) -> Option<(usize, RangeReading)> {
        let reading = self.campaign.readings.get(self.next)?;
        self.next += 1;
        Some((self.next - 1, *reading))
    }

    fn covariates(&self, row: usize) -> Result<Covariates, DriverError> {
        let mut table = Covariates::new();
        for covariate in &self.campaign.covariates {
            if let Some(value) = covariate.values[row] {
                table
                    .push(&covariate.name, value, 0.0)
                    .map_err(|source| DriverError::Covariate { reading: row + 1, source })?;
            }
        }
        Ok(table)
    }
}

/// Distance at length zero (m) of a station, from its indicated points and lengths.
fn dead_path_m(campaign: &Campaign, station: usize) -> Option<f64> {
    let readings: Vec<&RangeReading> = campaign.readings.iter().filter(|r| r.station as usize == station).collect();
    let point = |r: &RangeReading| (nominal_point_m(r.reading_m, r.offset_m), r.length_m);
    let part = spread(readings.len(), PLACING_READINGS).into_iter();
    let points: Vec<PointAndLength> = part.map(|place| point(readings[place])).collect();
    match start(&points, false) {
        Ok(placed) => Some(placed.dead_path_m),
        Err(problem) => {
            let station = &campaign.stations[station];
            tracing::warn!(
                "station {station}: {problem}. How far the reflector was is not known; the uncertainty of its lengths is \
                 stated for the length travelled, which is a lower bound"
            );
            None
        }
    }
}

fn stamp(row: usize, time_s: f64) -> Result<Stamp, DriverError> {
    Stamp::from_seconds(time_s).map_err(|source: MessageError| DriverError::Message { reading: row + 1, source })
}

fn text<const N: usize>(row: usize, what: &'static str, value: &str) -> Result<Text<N>, DriverError> {
    Text::new(value).map_err(|source: TextError| DriverError::Text { reading: row + 1, what, source })
}

impl ScaleDriver for Recorded {
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError> {
        let Some((row, reading)) = self.take() else { return Ok(None) };
        Ok(Some(ScaleReading {
            stamp: stamp(row, reading.time_s)?,
            sequence: row as u64,
            reading_m: reading.reading_m,
            offset_m: reading.offset_m,
            covariates: self.covariates(row)?,
            frame_id: text(row, "frame_id", &self.frame_id)?,
        }))
    }
}

impl TracerDriver for Recorded {
    fn next_reading(&mut self) -> Result<Option<TracerReading>, DriverError> {
        let Some((row, reading)) = self.take() else { return Ok(None) };
        Ok(Some(TracerReading {
            stamp: stamp(row, reading.time_s)?,
            sequence: row as u64,
            length_m: reading.length_m,
            u_length_m: self.u_length_m(&reading),
            frame_id: text(row, "frame_id", &self.frame_id)?,
            station: text(row, "station", &self.campaign.stations[reading.station as usize])?,
            line: text(row, "line", &self.campaign.lines[reading.line as usize])?,
        }))
    }
}
