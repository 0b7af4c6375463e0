//! A campaign in memory as a source of scale and tracer readings.
//!
//! Place in the flow: behind the campaign-file and virtual-machine drivers. The stamp is the recorded time, so a
//! replay never sees the clock.

use super::{DriverError, ScaleDriver, TracerDriver};
use abbe_files::MachineFile;
use abbe_measurement::campaign::{Campaign, RangeReading};
use abbe_measurement::instrument::RangeUncertainty;
use abbe_msgs::{Covariates, MessageError, ScaleReading, Stamp, Text, TextError, TracerReading};

/// Plays one campaign, row by row.
pub(super) struct Recorded {
    campaign: Campaign,
    frame_id: String,
    instrument: RangeUncertainty,
    next: usize,
}

impl Recorded {
    pub(super) fn new(campaign: Campaign, machine: &MachineFile) -> Recorded {
        let frame_id = machine.machine.frame_id.clone();
        Recorded { campaign, frame_id, instrument: machine.instrument, next: 0 }
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
            // The recording does not say how far the reflector was; the length travelled stands for it.
            u_length_m: self.instrument.standard_m(reading.length_m),
            frame_id: text(row, "frame_id", &self.frame_id)?,
            station: text(row, "station", &self.campaign.stations[reading.station as usize])?,
            line: text(row, "line", &self.campaign.lines[reading.line as usize])?,
        }))
    }
}
