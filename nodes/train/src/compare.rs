//! `abbe compare`: the residual network and its rivals on the same held-out data.
//!
//! Place in the flow: before a method is chosen. Residual vectors in, one table out: figures by seed with 95 % intervals of
//! their mean, the published figures beside them, and which method these data speak for.

mod report;

use crate::data::{self, Data};
use crate::inputs::Inputs;
use abbe::command::training::CompareArguments;
use abbe::identity::{Said, Who};
use abbe::next::Next;
use abbe::progress::spinner;
use abbe::{is_bag, output};
use abbe_files::{hex, write_atomically};
use abbe_geometry::Axis;
use abbe_residual_training::{CompareConfig, Comparison, Go, Interval, POSITION_ALONE, RivalRow, Subject, compare};
use abbe_runtime::Shutdown;
use anyhow::{Context, ensure};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub(crate) fn run(arguments: &CompareArguments) -> anyhow::Result<()> {
    output::check(arguments.html.iter().map(PathBuf::as_path), [arguments.residuals.as_path()])?;
    let shutdown = Shutdown::on_signals()?;
    let training = data::read_config(arguments.config.as_deref())?;
    let usual = CompareConfig::default();
    let config = CompareConfig { training, seeds: arguments.seeds.unwrap_or(usual.seeds), ..usual };
    ensure!(config.seeds > 0, "--seeds must be at least 1");
    let inputs = Inputs::of(&arguments.inputs)?;
    let data = Data::read_plane(&arguments.residuals, &inputs)?;
    // Before the trainings: an identity that contradicts the data is told at once.
    let who = who(arguments)?;
    let since = Instant::now();
    let clock = || since.elapsed().as_secs_f64();
    let bar = spinner(&format!("comparing on {} points", data.points()));
    let mut observe = |done: usize, all: usize| {
        bar.set_message(format!("{done} of {all} trainings"));
        if shutdown.requested() { Go::Stop } else { Go::On }
    };
    let measured = Axis::ALL.map(|axis| data.lacks.error != Some(axis));
    let subject = match inputs.is_position_alone() {
        true => Subject { measured, ..Subject::position(&data.field) },
        false => Subject { alone: data.alone.as_ref(), inputs: Some(&data.field), measured },
    };
    let compared = compare(&subject, &config, &clock, &mut observe);
    bar.finish_and_clear();
    let compared = compared.with_context(|| arguments.residuals.display().to_string())?;
    let next = next(arguments, &inputs, &compared);
    if let Some(path) = &arguments.html {
        let page = report::report(&data, &compared, who.shown, next.step());
        write_atomically(path, page.html()?.as_bytes())?;
    }
    match arguments.json {
        true => {
            let components: Vec<&str> =
                Axis::ALL.into_iter().filter(|axis| measured[axis.index()]).map(Axis::lower).collect();
            let plane = data.field.normal().map(|normal| Axis::ALL[normal].lower());
            let of = json!({
                "file": data.file, "sha256": hex(&data.sha256), "plane_across": plane, "components": components,
                "left_out": data.left_out,
            });
            let value = json!({ "data": of, "comparison": compared });
            println!("{}", serde_json::to_string_pretty(&value)?);
        }
        false => {
            say(&data, &compared);
            next.print();
        }
    }
    ensure!(compared.complete, "stopped on request; the table holds the seeds that were done");
    Ok(())
}

fn who(arguments: &CompareArguments) -> anyhow::Result<Who> {
    let tables: Vec<&Path> = Some(arguments.residuals.as_path()).into_iter().filter(|path| !is_bag(path)).collect();
    arguments.identity.gather(&Said { tables: &tables, ..Said::default() })
}

fn next(arguments: &CompareArguments, inputs: &Inputs, compared: &Comparison) -> Next {
    let next = Next::new("to make the one that these data speak for", "train");
    let next = next.file("--residuals", &arguments.residuals);
    let speaks_for_inputs =
        compared.recommendation.as_ref().is_some_and(|found| !found.method.ends_with(POSITION_ALONE));
    let is_plain = inputs.is_position_alone() || !speaks_for_inputs;
    let next = if is_plain { next } else { next.text(&format!("--inputs {}", inputs.words())) };
    next.text("--out residual.json")
}

/// How many splits and trainings stand behind the means, in words.
fn seeds(compared: &Comparison) -> String {
    match compared.config.seeds {
        1 => "1 seed".to_owned(),
        more => format!("{more} seeds"),
    }
}

fn say(data: &Data, compared: &Comparison) {
    let split = if compared.flattering { "single points (flattering)" } else { "blocks of space" };
    let plane = match (data.field.normal(), data.lacks.error) {
        (None, _) => String::new(),
        (Some(normal), None) => format!(" in a plane across {}", Axis::ALL[normal].letter()),
        (Some(normal), Some(axis)) => {
            format!(" in a plane across {} (component {} was not measured)", Axis::ALL[normal].letter(), axis.lower())
        }
    };
    if let Some(recommended) = &compared.recommendation {
        println!("these data speak for {}: {}", recommended.method, recommended.why);
        if recommended.method.ends_with(POSITION_ALONE) {
            println!("they do not show that the further inputs help on unseen data");
        }
    }
    println!("{}: {} points{plane}, held out by {split}, {}", data.file, compared.points, seeds(compared));
    if !compared.inputs.is_empty() {
        println!("inputs {}; the same points and split for all methods", compared.inputs.join(" "));
    }
    let head = ["method", "MSE µm² (95 %)", "MAE µm (95 %)", "95 % µm", "worst µm", "train s", "point µs"];
    let [method, mse, mae, most, worst, train, point] = head;
    let width = compared.rows.iter().map(|row| row.name().len()).fold(20, usize::max);
    println!("{method:<width$} {mse:>25} {mae:>25} {most:>9} {worst:>9} {train:>9} {point:>9}   Liang 2025: MSE, MAE");
    for row in &compared.rows {
        println!("{}", line(row, width));
    }
    println!(
        "published figures are of data that are not published; only the columns before them compare like with like"
    );
}

fn line(row: &RivalRow, width: usize) -> String {
    let published = row.rival.published().map_or(String::new(), |(mse, mae)| format!("{mse:.4}, {mae:.4}"));
    let mean = |interval: &Option<Interval>, factor: f64, decimals: usize| {
        interval.map_or_else(|| "-".to_owned(), |i| format!("{:.decimals$}", i.mean * factor))
    };
    let mut text = format!(
        "{:<width$} {:>25} {:>25} {:>9} {:>9} {:>9} {:>9}   {published}",
        row.name(),
        with_ends(&row.mse_um2),
        with_ends(&row.mae_um),
        mean(&row.error_95_um, 1.0, 3),
        mean(&row.worst_um, 1.0, 3),
        mean(&row.training_s, 1.0, 2),
        mean(&row.prediction_s, 1e6, 1)
    );
    if let Some(reason) = &row.missing {
        text += &format!("  ({} seeds without: {reason})", if row.seeds.is_empty() { "all" } else { "some" });
    }
    text.trim_end().to_owned()
}

fn with_ends(interval: &Option<Interval>) -> String {
    match interval {
        None => "-".to_owned(),
        Some(Interval { mean, low: Some(low), high: Some(high) }) => format!("{mean:.4} ({low:.4} to {high:.4})"),
        Some(Interval { mean, .. }) => format!("{mean:.4}"),
    }
}
