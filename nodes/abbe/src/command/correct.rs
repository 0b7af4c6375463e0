//! `abbe correct`: recorded scale readings in, the same with corrected coordinates out.
//!
//! Place in the flow: offline twin of the geometric and residual nodes; calls the same correcting function. CSV row
//! by row, also from standard input to standard output; bags message by message.

use super::bag_in_place;
use crate::output;
use crate::pipeline::is_bag;
use crate::residual::{load_residual, with_residual};
use abbe_files::{AtomicFile, FileError, ModelFile, Place, PointRow, PointsReader, PointsWriter};
use abbe_geometry::correct::correct;
use abbe_geometry::effects::State;
use abbe_geometry::model::IdentifiedVolume;
use abbe_graph::step::{GeometricStep, OwnedField, ResidualStep};
use abbe_graph::topics;
use abbe_msgs::bag::{BagWriter, messages};
use abbe_msgs::{Message, ScaleReading, Sha256};
use abbe_runtime::Shutdown;
use anyhow::{Context, ensure};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments of `correct`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Model file
    #[arg(long)]
    model: PathBuf,
    /// Refuse a model of another machine than the one of this machine file
    #[arg(long)]
    machine: Option<PathBuf>,
    /// Residual model that belongs to this model
    #[arg(long)]
    residual: Option<PathBuf>,
    /// CSV with scale readings, a bag, or - for standard input (CSV)
    #[arg(long = "in")]
    input: PathBuf,
    /// CSV or bag to write, or - for standard output (CSV)
    #[arg(long = "out")]
    output: PathBuf,
    /// Age in seconds from which a covariate of a bag is stale
    #[arg(long, default_value_t = 10.0)]
    max_covariate_age_s: f64,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let others = arguments.machine.iter().chain(&arguments.residual).map(PathBuf::as_path);
    output::check([arguments.output.as_path()], others.chain([arguments.input.as_path(), arguments.model.as_path()]))?;
    let (model, sha256) = match &arguments.machine {
        Some(machine) => ModelFile::load_for(&arguments.model, &abbe_files::read_machine(machine)?.machine.name)?,
        None => ModelFile::load(&arguments.model)?,
    };
    let residual = arguments.residual.as_deref().map(|path| load_residual(path, &model, &sha256)).transpose()?;
    check_kinds(&arguments.input, &arguments.output)?;
    if is_bag(&arguments.input) {
        return bag_in_place(&arguments.output, |unfinished| {
            correct_bag(arguments, model, sha256, residual, unfinished)
        });
    }
    let standard = |path: &Path| path.as_os_str() == "-";
    let name =
        if standard(&arguments.input) { "standard input".to_owned() } else { arguments.input.display().to_string() };
    let input: Box<dyn Read> = if standard(&arguments.input) {
        Box::new(std::io::stdin().lock())
    } else {
        Box::new(BufReader::new(File::open(&arguments.input).with_context(|| format!("{name}: cannot be opened"))?))
    };
    let shutdown = Shutdown::on_signals()?;
    let correcting = Correcting { model: &model, residual: residual.as_ref() };
    if standard(&arguments.output) {
        let output = BufWriter::new(std::io::stdout().lock());
        correct_csv(&correcting, input, &name, output, &shutdown)?;
        return Ok(());
    }
    let mut file = AtomicFile::create(&arguments.output)?;
    correct_csv(&correcting, input, &name, BufWriter::new(&mut file), &shutdown)?;
    Ok(file.commit()?)
}

/// What rows are corrected with.
struct Correcting<'a> {
    model: &'a ModelFile,
    residual: Option<&'a OwnedField>,
}

fn correct_csv(
    Correcting { model, residual }: &Correcting,
    input: Box<dyn Read>,
    name: &str,
    output: impl Write,
    shutdown: &Shutdown,
) -> anyhow::Result<()> {
    let machine = &model.model.parts().machine;
    let mut reader = PointsReader::new(input, name, machine.default_offset_m)?;
    let mut writer = PointsWriter::new(output, "output", reader.columns())?;
    let mut row = PointRow::default();
    while reader.read(&mut row)? {
        ensure!(!shutdown.requested(), "stopped on request; no output was written");
        check_offset_signs(&model.model.parts().identified, &row, name)?;
        let covariates = reader.covariates(&row);
        let state = State { reading_m: row.reading_m, offset_m: row.offset_m, covariates: &covariates };
        writer.write(&row, &with_residual(correct(&model.model, &state), *residual))?;
    }
    writer.finish()?.flush()?;
    Ok(())
}

/// Refuses an offset on the side where no offset of the campaign was: a sign error moves every lever arm.
fn check_offset_signs(identified: &IdentifiedVolume, row: &PointRow, name: &str) -> Result<(), FileError> {
    for (d, (lower, upper)) in identified.offset_m.iter().enumerate() {
        let offset_m = row.offset_m[d];
        let opposite = (*upper < 0.0 && offset_m > 0.0) || (*lower > 0.0 && offset_m < 0.0);
        if opposite {
            let column = ["offset_x_mm", "offset_y_mm", "offset_z_mm"][d];
            let problem = format!(
                "{} mm has the opposite sign of every offset the model was identified with ({} … {} mm)",
                offset_m * 1e3,
                lower * 1e3,
                upper * 1e3
            );
            let remedy = "correct its sign, or identify a model with such an offset";
            return Err(FileError::content(Place::file(name).line(row.line()).column(column), problem, remedy));
        }
    }
    Ok(())
}

/// Copies a bag and adds a corrected message after each scale reading.
fn correct_bag(
    arguments: &Arguments,
    model: ModelFile,
    sha256: [u8; 32],
    residual: Option<OwnedField>,
    unfinished: &Path,
) -> anyhow::Result<()> {
    let step =
        GeometricStep::new(Some((Arc::new(model.model), Sha256::from_bytes(sha256))), arguments.max_covariate_age_s);
    let residual = ResidualStep::new(residual);
    let mut writer = BagWriter::create(unfinished)?;
    let mut corrected = 0_u64;
    for message in messages(&arguments.input)? {
        let message = message?;
        writer.copy(&message)?;
        if message.ros_type() == ScaleReading::ROS_TYPE {
            let reading: ScaleReading = message.decode()?;
            let namespace = message.topic().strip_suffix(topics::SCALE_READING).unwrap_or("/").to_owned();
            let sample = residual.correct(&step.correct(&reading));
            writer.write(&format!("{namespace}{}", topics::CORRECTED), &sample, message.log_time_ns)?;
            corrected += 1;
        }
    }
    ensure!(corrected > 0, "{}: holds no {}; nothing to correct", arguments.input.display(), ScaleReading::ROS_TYPE);
    writer.finish()?;
    Ok(())
}

/// Refuses a bag under the name of a table and a table under the name of a bag.
fn check_kinds(input: &Path, output: &Path) -> anyhow::Result<()> {
    let ends = |ending: &str| output.extension().is_some_and(|extension| extension == ending);
    let (from, to) = (input.display(), output.display());
    if is_bag(input) {
        let table = ends("csv") || output.as_os_str() == "-";
        ensure!(!table, "{to}: {from} is a bag and gives a bag; name a folder, or a file ending in .mcap");
    } else {
        ensure!(!ends("mcap"), "{to}: {from} is CSV and gives CSV; name a file ending in .csv, or -");
    }
    Ok(())
}
