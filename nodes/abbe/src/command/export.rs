//! `abbe export`: an identified model as tables of errors for controllers and other software.
//!
//! Place in the flow: after `identify`, before a controller. What a table cannot hold is named in its head and on standard
//! error.

use crate::exit::Ended;
use crate::next::Next;
use crate::output;
use crate::progress::Told;
use abbe_field::{Grid, Table, table_within};
use abbe_files::export::{
    About, ExportedFile, FORMATS, Format, LARGER, SampledGrid, TIP, Writer, format, geometric_error_m, of_places,
};
use abbe_files::{AtomicFile, FileError, ModelFile};
use abbe_geometry::Vector3;
use abbe_geometry::axis::Axis;
use abbe_geometry::correct::is_within;
use abbe_geometry::sampled::SampledErrors;
use anyhow::{Context, bail, ensure};
use std::cell::Cell;
use std::convert::Infallible;
use std::io::Write;
use std::path::PathBuf;

/// What interpolation may miss where neither a step nor an error is asked for (µm, µrad): less than corrected errors are uncertain
/// by.
const DEFAULT_WITHIN_UM: f64 = 0.1;
/// Nodes of the largest grid that is written.
const MOST_NODES: usize = 2_000_000;
/// Points of a grid after which it is told how many there were.
const TELL_EVERY: u64 = 10_000;
/// Share of a stroke that campaigns leave out at its ends without a word.
const UNSEEN_SHARE: f64 = 0.05;
/// Halvings of the step in search of a wanted interpolation error, from the whole stroke.
const MOST_HALVINGS: u32 = 16;

/// Arguments of `export`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Model file
    #[arg(long)]
    model: PathBuf,
    /// Format: csv, etalon-exchange, isg-csv, heidenhain-style, volumetric-grid, eight-corners, siemens-enc-comp, fanuc-pitch,
    /// linuxcnc-comp, klipper-skew or reprap-skew
    #[arg(long)]
    format: String,
    /// File to write; a folder for formats of several files
    #[arg(long)]
    out: PathBuf,
    /// Largest step between nodes
    #[arg(long, conflicts_with = "within_um")]
    step_mm: Option<f64>,
    /// Choose the step so that interpolation misses the model by at most this (µm; angles likewise in µrad); 0.1, if no step is
    /// given
    #[arg(long)]
    within_um: Option<f64>,
    /// Tip or reflector relative to the ram reference point, for grids and factors of skew: x,y,z (mm); the machine's default where
    /// it has one. Tables of one axis (siemens-enc-comp, fanuc-pitch, linuxcnc-comp) are made for the pivots without it, for the tip with it
    #[arg(long, value_delimiter = ',', num_args = 1, allow_hyphen_values = true, value_name = "X,Y,Z")]
    offset_mm: Option<Vec<f64>>,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let names = || FORMATS.iter().map(|format| format.name).collect::<Vec<_>>().join(", ");
    let format = format(&arguments.format).with_context(|| {
        format!("--format {:?}: there is no such format; choose one of {}", arguments.format, names())
    })?;
    for (option, value) in [("--step-mm", arguments.step_mm), ("--within-um", arguments.within_um)] {
        ensure!(value.is_none_or(|v| v.is_finite() && v > 0.0), "{option}: give a number above zero");
    }
    let (file, sha256) = ModelFile::load(&arguments.model)?;
    let about = About::new(&file, &sha256, &crate::pipeline::software());
    let (files, offset_m) = match format.writer {
        Writer::Functions(write) | Writer::Approaches(write) => {
            ensure!(
                arguments.offset_mm.is_none(),
                "--offset-mm is for grids, factors and tables of one axis; {} holds error functions",
                arguments.format
            );
            (of_functions(arguments, (format, write), &file, &about)?, None)
        }
        Writer::Positions(write) => {
            let offset_m = asked_offset_m(arguments)?;
            let about = offset_m.map_or_else(|| about.clone(), |offset_m| about.clone().for_tip(offset_m));
            (of_functions(arguments, (format, write), &file, &about)?, offset_m)
        }
        Writer::Factors(write) => {
            let offset_m = factors_offset_m(arguments, &file)?;
            (write(&about, offset_m)?, Some(offset_m))
        }
        Writer::Grid(write) => {
            let grid = grid(arguments, &file)?;
            (write(&about, &grid)?, Some(grid.offset_m))
        }
    };
    write_files(arguments, &files)?;
    if let Some(words) = outside_words(&file) {
        eprintln!("abbe: warning: {}: {words}", arguments.out.display());
    }
    for words in head_words(&files, LARGER) {
        eprintln!("abbe: warning: {}: {words}", arguments.out.display());
    }
    for words in about.not_measured(format) {
        eprintln!("abbe: warning: {}: {}", arguments.out.display(), with_signs(&words));
    }
    for what in about.left_out(format) {
        eprintln!(
            "abbe: {}: not in this table, and not corrected by it: {}",
            arguments.out.display(),
            with_signs(what)
        );
    }
    print_words(arguments, format, &files);
    Next::new(
        "to see what the controller makes of it, on lengths measured with it",
        "conformity --lengths LENGTHS.csv --probing bidirectional",
    )
    .print();
    if offset_m.is_none() || matches!(format.writer, Writer::Positions(_)) {
        judge_tables(arguments, &file, &about)?;
    }
    offset_m.map_or(Ok(()), |offset_m| judge(arguments, &file, offset_m))
}

/// An error where the whole table of an axis is for readings that were not measured.
fn judge_tables(arguments: &Arguments, file: &ModelFile, about: &About) -> anyhow::Result<()> {
    let parts = file.model.parts();
    let words = |axis: Axis| {
        let [(from, to), (lower, upper)] =
            [parts.identified.reading_m, parts.machine.stroke_m].map(|all_m| all_m[axis.index()]);
        format!(
            "{}: the stroke is {:.4} to {:.4} mm, readings from {:.4} to {:.4} mm were measured",
            axis.letter(),
            lower * 1e3,
            upper * 1e3,
            from * 1e3,
            to * 1e3
        )
    };
    let outside: Vec<String> = about.axes_outside().into_iter().map(words).collect();
    ensure!(
        outside.is_empty(),
        Ended::nothing_inside(format!(
            "{}: no node is inside what the model was identified from, so do not use it: {}; see whether runs and strokes count from the same \
             zero",
            arguments.out.display(),
            outside.join("; ")
        ))
    );
    Ok(())
}

/// An error where the whole grid is for a tip that was not measured.
fn judge(arguments: &Arguments, file: &ModelFile, offset_m: [f64; 3]) -> anyhow::Result<()> {
    let bounds_m = &file.model.parts().identified.offset_m;
    let mm = |values_m: [f64; 3]| values_m.map(|v| format!("{:.4}", v * 1e3)).join(" ");
    ensure!(
        offset_m.into_iter().zip(bounds_m).all(|(v, b)| is_within(*b, v)),
        Ended::nothing_inside(format!(
            "{}: no node is inside what the model was identified from: the tip is at {} mm, offsets from {} to {} mm were \
             measured; see --offset-mm",
            arguments.out.display(),
            mm(offset_m),
            mm(bounds_m.map(|b| b.0)),
            mm(bounds_m.map(|b| b.1)),
        ))
    );
    Ok(())
}

/// The tip for which factors hold: that asked for, the machine's, or the middle of those that were measured.
fn factors_offset_m(arguments: &Arguments, file: &ModelFile) -> anyhow::Result<[f64; 3]> {
    for (option, value) in [("--step-mm", arguments.step_mm), ("--within-um", arguments.within_um)] {
        ensure!(value.is_none(), "{option} is for tables; {} holds one number a plane", arguments.format);
    }
    let parts = file.model.parts();
    let usual_m = parts.machine.default_offset_m.unwrap_or(parts.offset_centre_m);
    Ok(asked_offset_m(arguments)?.unwrap_or(usual_m))
}

/// The offset asked for (m).
fn asked_offset_m(arguments: &Arguments) -> anyhow::Result<Option<[f64; 3]>> {
    let offset_m = match arguments.offset_mm.as_deref() {
        None => return Ok(None),
        Some([x, y, z]) => [x / 1e3, y / 1e3, z / 1e3],
        Some(other) => bail!("--offset-mm has {} numbers; write three, x,y,z", other.len()),
    };
    ensure!(offset_m.iter().all(|v| v.is_finite() && v.abs() < 10.0), "--offset-mm: give three numbers in millimetres");
    Ok(Some(offset_m))
}

/// Files of error functions.
type OfFunctions = fn(&About, &SampledErrors) -> Result<Vec<ExportedFile>, FileError>;

/// Written at the step asked for; else at the largest that misses no more than is wanted. Where nothing was asked for, the finest that
/// the format holds is good enough, and one that it refuses is halved.
fn of_functions(
    arguments: &Arguments,
    (format, write): (&Format, OfFunctions),
    file: &ModelFile,
    about: &About,
) -> anyhow::Result<Vec<ExportedFile>> {
    let sampled = |step_m: f64| SampledErrors::of(&file.model, step_m).map(|errors| about.at_tip(errors));
    if let Some(step_mm) = arguments.step_mm {
        return Ok(write(about, &sampled(step_mm / 1e3)?)?);
    }
    let (within_um, is_asked) = (arguments.within_um.unwrap_or(DEFAULT_WITHIN_UM), arguments.within_um.is_some());
    let longest_m = file.model.parts().machine.travel_m().into_iter().fold(0.0, f64::max);
    let mut finest = None;
    // Where a controller may go in steps, more rows are smaller steps.
    let halvings = if is_asked || !format.is_stepped { 0..=MOST_HALVINGS } else { 0..=0 };
    for halvings in halvings {
        let errors = sampled(longest_m / f64::from(1_u32 << halvings))?;
        if !is_asked && !format.holds(&errors) {
            break;
        }
        let (linear_m, angular_rad) = errors.missed();
        if linear_m.max(angular_rad) <= within_um / 1e6 && (is_asked || !format.is_stepped) {
            return Ok(write(about, &errors)?);
        }
        finest = Some(errors);
    }
    if let (false, Some(most)) = (is_asked, format.most_points) {
        // All the rows that it holds: the last halving uses little more than half of them.
        finest = Some(sampled(longest_m / (most - 1) as f64)?);
    }
    let (false, Some(finest), Some(most)) = (is_asked, finest, format.most_points) else {
        let finest_mm = longest_m * 1e3 / f64::from(1_u32 << MOST_HALVINGS);
        ensure!(!is_asked, "--within-um {within_um}: no step down to {finest_mm:.4} mm does that; ask for more");
        bail!(
            "{}: no step down to {finest_mm:.4} mm misses the model by {within_um} µm or less, which is asked for by default; ask for more \
             with --within-um, or for a step with --step-mm",
            format.name
        )
    };
    // What the model does not know at all is a graver reason than what steps miss.
    let written = write(about, &finest)?;
    let ((missed_m, _), largest_m) = (finest.missed(), largest_m(&finest));
    ensure!(
        missed_m < 0.5 * largest_m,
        "{}: at the nodes that it holds ({most} of an axis) interpolation misses {:.3} µm of errors of at most {:.3} µm: such a table \
         corrects nothing; correct with abbe correct, or ask for a step with --step-mm",
        format.name,
        missed_m * 1e6,
        largest_m * 1e6
    );
    Ok(written)
}

/// The largest linear error at the nodes (m).
fn largest_m(errors: &SampledErrors) -> f64 {
    let linear = errors.axes.iter().flat_map(|axis| &axis.errors).flat_map(|node| &node[..3]);
    linear.fold(0.0, |most, error| error.abs().max(most))
}

fn grid(arguments: &Arguments, file: &ModelFile) -> anyhow::Result<SampledGrid> {
    let machine = &file.model.parts().machine;
    let offset_m = match (asked_offset_m(arguments)?, machine.default_offset_m) {
        (Some(offset_m), _) | (None, Some(offset_m)) => offset_m,
        (None, None) => bail!(
            "a grid holds for one tip, and the machine declares no default_offset_mm; give --offset-mm x,y,z, where the tip \
             stands from the ram reference point"
        ),
    };
    let effects = of_places(&file.model);
    let (told, points) = (Told::new("the grid"), Cell::new(0_u64));
    let error_m = |p: &Vector3<f64>| {
        points.set(points.get() + 1);
        if points.get().is_multiple_of(TELL_EVERY) {
            told.say(format!("{} points looked at", points.get()));
        }
        Ok::<_, Infallible>(geometric_error_m(&file.model, &effects, (*p).into(), offset_m))
    };
    let (table, missed) = match arguments.step_mm {
        None => {
            let within_um = arguments.within_um.unwrap_or(DEFAULT_WITHIN_UM);
            table_within(machine.stroke_m, within_um / 1e6, MOST_NODES, error_m)?
        }
        Some(step_mm) => {
            let step_m = step_mm / 1e3;
            let steps = machine.travel_m().map(|travel_m| ((travel_m / step_m - 1e-9).ceil()).max(1.0));
            let nodes: f64 = steps.iter().map(|n| n + 1.0).product();
            ensure!(nodes <= MOST_NODES as f64, "--step-mm {}: {nodes} nodes; {MOST_NODES} are the most", step_m * 1e3);
            let table = Table::of(Grid::regular(machine.stroke_m, steps.map(|n| n as usize))?, error_m)?;
            let missed = table.interpolation_error(error_m)?;
            (table, missed)
        }
    };
    told.finish();
    Ok(SampledGrid { table, missed_m: missed.largest_m.max(), offset_m })
}

/// One file under the name asked for, several in a folder of that name; each appears whole.
fn write_files(arguments: &Arguments, files: &[ExportedFile]) -> anyhow::Result<()> {
    let (out, inputs) = (arguments.out.as_path(), [arguments.model.as_path()]);
    if let [single] = files {
        output::check([out], inputs)?;
        return Ok(abbe_files::write_atomically(out, single.text.as_bytes())?);
    }
    ensure!(!out.exists() || out.is_dir(), "--out {}: this format has several files; name a folder", out.display());
    let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
    output::check_in_folder(out, &names, inputs)?;
    std::fs::create_dir_all(out).with_context(|| format!("{}: the folder cannot be made", out.display()))?;
    let mut written = Vec::new();
    for exported in files {
        let path = out.join(&exported.name);
        let mut file = AtomicFile::create(&path)?;
        file.write_all(exported.text.as_bytes()).with_context(|| format!("{}: cannot be written", path.display()))?;
        written.push(file);
    }
    Ok(written.into_iter().try_for_each(AtomicFile::commit)?)
}

/// The error that the step follows from, where it was not given.
fn wanted_um(arguments: &Arguments) -> Option<f64> {
    arguments.step_mm.is_none().then(|| arguments.within_um.unwrap_or(DEFAULT_WITHIN_UM))
}

/// What the files say of the step and what interpolation misses, or of what factors leave.
fn missed_words(files: &[ExportedFile]) -> Option<String> {
    ["interpolation: ", "fit: "].into_iter().find_map(|label| head_words(files, label).next())
}

/// What stands behind a label in the heads of the files.
fn head_words<'a>(files: &'a [ExportedFile], label: &'a str) -> impl Iterator<Item = String> + 'a {
    files.iter().flat_map(|file| file.text.lines()).filter_map(move |line| line.split(label).nth(1)).map(with_signs)
}

/// Words of a table's head, which is ASCII since controllers take nothing else, with the signs that a terminal has.
fn with_signs(words: &str) -> String {
    words.replace(" um", " µm").replace(" urad", " µrad")
}

/// Where the tables go beyond what was measured: they reach over the whole stroke.
fn outside_words(file: &ModelFile) -> Option<String> {
    let parts = file.model.parts();
    let measured = parts.identified.reading_m.iter().zip(&parts.machine.stroke_m).zip(["X", "Y", "Z"]);
    let beyond = measured.filter_map(|((seen, stroke), axis)| {
        let left_out = 1.0 - (seen.1.min(stroke.1) - seen.0.max(stroke.0)) / (stroke.1 - stroke.0);
        let said =
            || format!("{:.0} % of {axis} (measured: {:.1} … {:.1} mm)", left_out * 1e2, seen.0 * 1e3, seen.1 * 1e3);
        (left_out > UNSEEN_SHARE).then(said)
    });
    let beyond: Vec<String> = beyond.collect();
    (!beyond.is_empty()).then(|| format!("extrapolated, beyond what was measured: {}", beyond.join(", ")))
}

fn print_words(arguments: &Arguments, format: &Format, files: &[ExportedFile]) {
    println!("{}: {} ({})", arguments.out.display(), format.name, format.title);
    if let Some(missed) = missed_words(files) {
        let is_of_steps = !matches!(format.writer, Writer::Factors(_));
        let asked = wanted_um(arguments)
            .filter(|_| is_of_steps)
            .map_or_else(String::new, |um| format!(" (asked for: {um} µm)"));
        let most =
            format.most_points.map_or_else(String::new, |most| format!("; {most} nodes of an axis are the most"));
        let asked = asked + &most;
        println!("  {missed}{asked}");
    }
    head_words(files, TIP).for_each(|words| println!("  {words}"));
    println!("  {}", format.source);
}
