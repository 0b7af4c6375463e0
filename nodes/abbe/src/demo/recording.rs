//! The recording that the demo plays: the campaign's readings, then the verification points' scale readings.
//!
//! Place in the flow: a rosbag2-readable bag in the output folder, which the scale and tracer node play. Actual
//! positions of the verification points never enter it.

use super::shipped::Inputs;
use abbe_files::{MachineFile, PointRow, PointsReader, read_campaign_file};
use abbe_graph::topics;
use abbe_measurement::campaign::Campaign;
use abbe_msgs::bag::BagWriter;
use abbe_msgs::{Covariates, Message, ScaleReading, Stamp, Text, TracerReading};
use anyhow::Context;
use std::path::{Path, PathBuf};

/// Pause between the campaign and the verification points where the latter carry no time of their own (s).
const PAUSE_S: f64 = 60.0;

/// A written recording.
pub(super) struct Bag {
    pub(super) path: PathBuf,
    pub(super) namespace: String,
    pub(super) scale_readings: usize,
    pub(super) tracer_readings: usize,
    /// Sequence of the first verification point.
    pub(super) first_point: u64,
}

/// Writes the recording; an older one of the same name is replaced.
pub(super) fn write(machine: &MachineFile, inputs: &Inputs, out: &Path) -> anyhow::Result<Bag> {
    let path = out.join("recording");
    if path.exists() {
        std::fs::remove_dir_all(&path)
            .with_context(|| format!("{}: the old recording cannot be replaced", path.display()))?;
    }
    let campaign = read_campaign_file(&inputs.campaign, machine.machine.default_offset_m)?.campaign;
    let namespace = machine.machine.name.clone();
    let mut tape = Tape {
        writer: BagWriter::create(&path)?,
        namespace: namespace.clone(),
        frame_id: Text::new(&machine.machine.frame_id)?,
        next: 0,
    };
    for row in 0..campaign.readings.len() {
        tape.campaign_row(&campaign, row, machine)?;
    }
    let first_point = tape.next;
    let end_s = campaign.readings.iter().map(|r| r.time_s).fold(0.0, f64::max);
    tape.points(&inputs.verify, machine, end_s)?;
    let scale_readings = usize::try_from(tape.next)?;
    tape.writer.finish()?;
    Ok(Bag { path, namespace, scale_readings, tracer_readings: campaign.readings.len(), first_point })
}

struct Tape {
    writer: BagWriter,
    namespace: String,
    frame_id: Text<64>,
    next: u64,
}

impl Tape {
    fn write<M: Message>(&mut self, topic: &str, sample: &M) -> anyhow::Result<()> {
        let topic = format!("/{}/{topic}", self.namespace);
        Ok(self.writer.write(&topic, sample, u64::try_from(sample.stamp().to_nanos())?)?)
    }

    fn campaign_row(&mut self, campaign: &Campaign, row: usize, machine: &MachineFile) -> anyhow::Result<()> {
        let reading = &campaign.readings[row];
        let mut covariates = Covariates::new();
        for covariate in &campaign.covariates {
            if let Some(value) = covariate.values[row] {
                covariates.push(&covariate.name, value, 0.0)?;
            }
        }
        let stamp = Stamp::from_seconds(reading.time_s)?;
        let sequence = self.next;
        self.scale(stamp, reading.reading_m, reading.offset_m, covariates)?;
        let tracer = TracerReading {
            stamp,
            sequence,
            length_m: reading.length_m,
            u_length_m: machine.instrument.standard_m(reading.length_m),
            frame_id: self.frame_id,
            station: Text::new(&campaign.stations[reading.station as usize])?,
            line: Text::new(&campaign.lines[reading.line as usize])?,
        };
        self.write(topics::TRACER_READING, &tracer)
    }

    fn points(&mut self, path: &Path, machine: &MachineFile, end_s: f64) -> anyhow::Result<()> {
        let name = path.display().to_string();
        let file = std::fs::File::open(path).with_context(|| format!("{name}: cannot be opened"))?;
        let mut reader = PointsReader::verification(file, &name, machine.machine.default_offset_m)?;
        let names: Vec<String> = reader.columns().iter().filter(|c| is_covariate(c)).cloned().collect();
        let mut row = PointRow::default();
        let first = self.next;
        while reader.read(&mut row)? {
            use abbe_geometry::effects::{CovariateSource, CovariateValue};
            let source = reader.covariates(&row);
            let mut covariates = Covariates::new();
            for name in &names {
                if let CovariateValue::Fresh(value) = source.covariate(name) {
                    covariates.push(name, value, 0.0)?;
                }
            }
            let own_time_s = match source.covariate("time_s") {
                CovariateValue::Fresh(time_s) if time_s > end_s => time_s,
                _ => end_s + PAUSE_S + (self.next - first) as f64,
            };
            let (reading_m, offset_m) = (row.reading_m, row.offset_m);
            self.scale(Stamp::from_seconds(own_time_s)?, reading_m, offset_m, covariates)?;
        }
        Ok(())
    }

    fn scale(
        &mut self,
        stamp: Stamp,
        reading_m: [f64; 3],
        offset_m: [f64; 3],
        covariates: Covariates,
    ) -> anyhow::Result<()> {
        let reading =
            ScaleReading { stamp, sequence: self.next, reading_m, offset_m, covariates, frame_id: self.frame_id };
        self.next += 1;
        self.write(topics::SCALE_READING, &reading)
    }
}

/// Columns of a verification file that are logged quantities, not positions or names.
fn is_covariate(column: &str) -> bool {
    const OTHERS: [&str; 11] = [
        "point",
        "time_s",
        "x_mm",
        "y_mm",
        "z_mm",
        "offset_x_mm",
        "offset_y_mm",
        "offset_z_mm",
        "actual_x_mm",
        "actual_y_mm",
        "actual_z_mm",
    ];
    !OTHERS.contains(&column)
}
