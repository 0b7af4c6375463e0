//! `abbe predict`: points in, the same points with the residual that a residual model predicts there out.
//!
//! Place in the flow: offline look at a residual model; nothing is corrected here, so the model need not say which
//! geometric model it belongs to. Points in the machine frame; residual = actual − corrected, with standard uncertainty.

use crate::exit::Ended;
use crate::next::{KNOWN_POINTS, Next};
use crate::output;
use abbe_files::{AtomicFile, PlainPoints, PredictedWriter, ResidualFile, hex};
use abbe_geometry::Vector3;
use abbe_geometry::correct::Added;
use abbe_runtime::Shutdown;
use anyhow::{Context, ensure};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

/// Arguments of `predict`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Residual model, as abbe train writes it
    #[arg(long)]
    model: PathBuf,
    /// CSV with points x_mm, y_mm, z_mm in the machine frame, or with the inputs of the model
    #[arg(long = "in")]
    input: PathBuf,
    /// CSV to write
    #[arg(long = "out")]
    output: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    output::check([arguments.output.as_path()], [arguments.input.as_path(), arguments.model.as_path()])?;
    let shutdown = Shutdown::on_signals()?;
    let (file, sha256) = ResidualFile::load(&arguments.model)?;
    let name = arguments.input.display().to_string();
    let input = File::open(&arguments.input).with_context(|| format!("{name}: cannot be opened"))?;
    let mut points = PlainPoints::new(input, &name, file.model.has_position(), file.model.covariates())?;
    let mut output = AtomicFile::create(&arguments.output)?;
    let shown = arguments.output.display().to_string();
    let mut writer = PredictedWriter::new(BufWriter::new(&mut output), &shown, &points)?;
    let (mut count, mut outside, mut first) = (0_u64, 0_u64, None);
    let (mut without, mut first_without) = (0_u64, None);
    while let Some(point_m) = points.next_point_m()? {
        ensure!(!shutdown.requested(), "stopped on request; no output was written");
        let at = file.model.at(&Vector3::from(point_m), &points.covariates());
        let added = at.map_or_else(Added::LeftOut, |at| Added::Residual(file.model.predict(at.as_slice())));
        match &added {
            Added::Residual(prediction) if prediction.inside => {}
            Added::Residual(_) => {
                outside += 1;
                first.get_or_insert(points.line());
            }
            Added::LeftOut(problem) => {
                without += 1;
                first_without.get_or_insert((points.line(), problem.to_string()));
            }
        }
        count += 1;
        writer.write(&points, &added)?;
    }
    writer.finish()?.flush()?;
    ensure!(count > 0, "{name}: the file holds a header but no point; give one row a point");
    output.commit()?;
    println!("{}", arguments.output.display());
    println!("  residual model    {}", hex(&sha256));
    println!("  points            {count}, {outside} of them outside the measured ones");
    let next = Next::new("to see what it is worth beside its geometric model", "verify --model MODEL.json");
    next.file("--residual", &arguments.model).text(KNOWN_POINTS).print();
    if let Some(line) = first {
        eprintln!(
            "abbe: warning: {name}: {outside} of {count} points lie outside the measured ones (first: line {line})"
        );
    }
    if let Some((line, problem)) = first_without {
        eprintln!(
            "abbe: warning: {name}: {without} of {count} points have no residual (first: line {line}): {problem}"
        );
    }
    ensure!(
        outside + without < count,
        Ended::nothing_inside(format!(
            "{name}: no point lies among the measured ones; do not use what is predicted there"
        ))
    );
    Ok(())
}
