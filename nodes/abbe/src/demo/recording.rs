//! The recording that the demo plays: the campaign's readings, then the verification points' scale readings.
//!
//! Place in the flow: a rosbag2-readable bag in the output folder, which the scale and tracer node play. Actual
//! positions of the verification points never enter it.

use super::shipped::Inputs;
use abbe_files::{MachineFile, PointRow, PointsReader};
use abbe_geometry::effects::{CovariateSource, CovariateValue};
use abbe_graph::driver::DriverConfig;
use abbe_graph::record::Tape;
use abbe_msgs::{Covariates, ScaleReading, Stamp, Text};
use anyhow::Context;
use std::path::{Path, PathBuf};

/// Pause between the campaign and the verification points where the latter carry no time of their own (s).
const PAUSE_S: f64 = 60.0;

/// A written recording.
pub(super) struct Bag {
    pub(super) path: PathBuf,
    pub(super) namespace: String,
    pub(super) scale_readings: usize,
    pub(super) tracer_readings: u64,
    /// Sequence of the first verification point.
    pub(super) first_point: u64,
}

impl Bag {
    /// Readings that a diagnosis waits for: nine tenths of what the tracer gives. By then every station has been heard, and a
    /// state that set in within the first tenth is still diagnosed.
    pub(super) fn diagnosed_readings(&self) -> usize {
        usize::try_from(self.tracer_readings * 9 / 10).unwrap_or(usize::MAX).max(1)
    }
}

/// Writes the recording; an older one of the same name is replaced.
pub(super) fn write(machine: &MachineFile, inputs: &Inputs, out: &Path) -> anyhow::Result<Bag> {
    let path = out.join("recording");
    if path.exists() {
        std::fs::remove_dir_all(&path)
            .with_context(|| format!("{}: the old recording cannot be replaced", path.display()))?;
    }
    let namespace = machine.machine.name.clone();
    let mut tape = Tape::create(&path, &namespace)?;
    tape.play(&DriverConfig::Campaign { file: inputs.campaign.clone() }, Path::new(""), machine)?;
    let (first_point, _) = tape.counts();
    add_points(&mut tape, &inputs.verify, machine)?;
    let (scale_readings, tracer_readings) = tape.counts();
    tape.finish()?;
    Ok(Bag { path, namespace, scale_readings: usize::try_from(scale_readings)?, tracer_readings, first_point })
}

/// Adds the scale readings of the verification points, later than everything before.
fn add_points(tape: &mut Tape, path: &Path, machine: &MachineFile) -> anyhow::Result<()> {
    let name = path.display().to_string();
    let file = std::fs::File::open(path).with_context(|| format!("{name}: cannot be opened"))?;
    let mut reader = PointsReader::verification(file, &name, machine.machine.default_offset_m)?;
    let names: Vec<String> = reader.columns().iter().filter(|c| is_covariate(c)).cloned().collect();
    let frame_id = Text::new(&machine.machine.frame_id)?;
    let end_s = tape.latest().map_or(0.0, Stamp::to_seconds);
    let (first, _) = tape.counts();
    let mut row = PointRow::default();
    while reader.read(&mut row)? {
        let source = reader.covariates(&row);
        let mut covariates = Covariates::new();
        for name in &names {
            if let CovariateValue::Fresh(value) = source.covariate(name) {
                covariates.push(name, value, 0.0)?;
            }
        }
        let (sequence, _) = tape.counts();
        let time_s = match source.covariate("time_s") {
            CovariateValue::Fresh(time_s) if time_s > end_s => time_s,
            _ => end_s + PAUSE_S + (sequence - first) as f64,
        };
        let stamp = Stamp::from_seconds(time_s)?;
        let (reading_m, offset_m) = (row.reading_m, row.offset_m);
        tape.scale(&ScaleReading { stamp, sequence, reading_m, offset_m, covariates, frame_id })?;
    }
    Ok(())
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
