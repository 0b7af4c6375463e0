//! `abbe correct`: recorded scale readings in, the same with corrected coordinates out.
//!
//! Place in the flow: offline twin of the geometric and residual nodes; calls the same correcting function. CSV many rows
//! at a time from file to file, row by row to standard output; bags message by message. What the rows were worth is
//! said on standard error.

mod bag;
mod report;

use super::bag_in_place;
use crate::exit::Ended;
use crate::identity::{IdentityOptions, Said};
use crate::next::{KNOWN_POINTS, Next};
use crate::offset_sign::check_offset_signs;
use crate::output;
use crate::pipeline::{is_bag, software};
use crate::provenance::file_name;
use crate::residual::{inputs_of, load_residual, residual_meta};
use crate::rows::{Batch, MANY, Part};
use crate::tally::Tally;
use abbe_files::{AtomicFile, ModelFile, PointsReader, PointsWriter, TableFacts, hex, write_atomically};
use abbe_graph::step::OwnedField;
use abbe_report::MetaItem;
use abbe_runtime::Shutdown;
use anyhow::{Context, ensure};
use report::Corrections;
use std::cell::RefCell;
use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Standard output in messages.
const STANDARD: &str = "standard output";

/// Arguments of `correct`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Model file
    #[arg(long)]
    model: PathBuf,
    /// Refuse a model of another machine than the one of this machine file; its default_offset_mm is taken in place of the model's, also where it has none
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
    /// Page with what the rows are worth and how large the corrections are, as HTML; of a table
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// The same as PDF
    #[arg(long, value_name = "FILE")]
    pdf: Option<PathBuf>,
    /// Age in seconds from which a covariate of a bag is stale
    #[arg(long, default_value_t = 10.0)]
    max_covariate_age_s: f64,
    #[command(flatten)]
    identity: IdentityOptions,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let others = arguments.machine.iter().chain(&arguments.residual).map(PathBuf::as_path);
    let pages = [&arguments.html, &arguments.pdf].into_iter().flatten().map(PathBuf::as_path);
    let outputs = pages.chain([arguments.output.as_path()]);
    output::check(outputs, others.chain([arguments.input.as_path(), arguments.model.as_path()]))?;
    let machine = arguments.machine.as_deref().map(abbe_files::read_machine).transpose()?.map(|file| file.machine);
    let (model, sha256) = match &machine {
        Some(machine) => ModelFile::load_for(&arguments.model, machine)?,
        None => ModelFile::load(&arguments.model)?,
    };
    // The machine file says where the tip is now, the model where it was in the campaign.
    let default_offset_m = machine.as_ref().unwrap_or(&model.model.parts().machine).default_offset_m;
    let residual = arguments.residual.as_deref().map(|path| load_residual(path, &model, &sha256)).transpose()?;
    check_kinds(&arguments.input, &arguments.output)?;
    if is_bag(&arguments.input) {
        let has_page = arguments.html.is_some() || arguments.pdf.is_some();
        ensure!(!has_page, "--html and --pdf are of tables; {} is a bag", arguments.input.display());
        let name = arguments.input.display().to_string();
        let worth = bag_in_place(&arguments.output, |unfinished| {
            bag::correct(
                &bag::Bag { input: &arguments.input, max_covariate_age_s: arguments.max_covariate_age_s },
                (&model, sha256),
                residual,
                unfinished,
            )
        })?;
        worth.beside.iter().for_each(|words| eprintln!("abbe: {name}: {words}"));
        conclude(&worth.tally, &model, &name, "reading")?;
        next(arguments).print();
        return Ok(());
    }
    let shutdown = Shutdown::on_signals()?;
    let correcting = Correcting { model: &model, residual: residual.as_ref(), default_offset_m, shutdown: &shutdown };
    let (input, name) = input(&arguments.input)?;
    let of_model = (&sha256, &correcting);
    let tally = if is_standard(&arguments.output) {
        let worth = correct_csv(&correcting, input, &name, (BufWriter::new(std::io::stdout().lock()), STANDARD), true)?;
        write(arguments, pages_of(arguments, of_model, &worth, &name)?)?;
        worth.tally
    } else {
        let mut file = AtomicFile::create(&arguments.output)?;
        let written = arguments.output.display().to_string();
        let worth = correct_csv(&correcting, input, &name, (BufWriter::new(&mut file), &written), false)?;
        // What ends the input on Ctrl-C may be the same Ctrl-C.
        ensure!(!shutdown.requested(), Ended::stopped("stopped on request; no output was written".to_owned()));
        // A page that cannot be made is said before anything is there.
        let pages = pages_of(arguments, of_model, &worth, &name)?;
        file.commit()?;
        write(arguments, pages)?;
        worth.tally
    };
    conclude(&tally, &model, &name, "line")?;
    if !is_standard(&arguments.output) {
        next(arguments).print();
    }
    Ok(())
}

/// What a table came to.
#[derive(Default)]
struct Worth {
    tally: Tally,
    corrections: Corrections,
}

/// Page and PDF, where they are asked for.
fn pages_of(
    arguments: &Arguments,
    (sha256, Correcting { model, residual, .. }): (&[u8; 32], &Correcting),
    worth: &Worth,
    name: &str,
) -> anyhow::Result<[Option<Vec<u8>>; 2]> {
    if arguments.html.is_none() && arguments.pdf.is_none() {
        return Ok([None, None]);
    }
    let machine = model.model.parts().machine.name.as_str();
    // A pipe was read to its end, and has nothing more.
    let is_there = |path: &&Path| !is_standard(path) && path.metadata().is_ok_and(|metadata| metadata.is_file());
    let tables: Vec<&Path> = Some(arguments.input.as_path()).into_iter().filter(is_there).collect();
    let who = arguments.identity.gather(&Said { machine_name: Some(machine), tables: &tables, ..Said::default() })?;
    let input = if is_standard(&arguments.input) { name.to_owned() } else { file_name(&arguments.input) };
    let hashes = tables.iter().map(|table| Ok(hex(&TableFacts::read(table)?.sha256)));
    let hash = hashes.collect::<anyhow::Result<Vec<String>>>()?.pop();
    let mut meta = vec![
        MetaItem::file("Readings", &input, hash.as_deref()),
        MetaItem::file("Model", &file_name(&arguments.model), Some(&hex(sha256))),
    ];
    meta.extend(residual_meta(arguments.residual.as_deref(), *residual));
    meta.push(MetaItem::software(software()));
    let report = report::report(report::Page {
        machine,
        input: &input,
        identity: who.shown,
        meta,
        tally: &worth.tally,
        outside: worth.tally.sentences(&model.model),
        corrections: &worth.corrections,
        doubts: model.said_against().collect(),
        next: next(arguments).step(),
    });
    let html = arguments.html.as_ref().map(|_| report.html()).transpose().context("--html")?;
    let pdf = arguments.pdf.as_ref().map(|_| report.pdf()).transpose().context("--pdf")?;
    Ok([html.map(String::into_bytes), pdf])
}

fn write(arguments: &Arguments, pages: [Option<Vec<u8>>; 2]) -> anyhow::Result<()> {
    for (path, page) in [&arguments.html, &arguments.pdf].into_iter().zip(pages) {
        if let (Some(path), Some(page)) = (path, page) {
            write_atomically(path, &page)?;
        }
    }
    Ok(())
}

/// What the corrected coordinates are worth.
fn next(arguments: &Arguments) -> Next {
    let verify = Next::new("to see what corrected coordinates are worth", "verify").file("--model", &arguments.model);
    let residual = arguments.residual.iter();
    residual.fold(verify, |verify, path| verify.file("--residual", path)).text(KNOWN_POINTS)
}

/// Says what the rows were worth.
fn conclude(tally: &Tally, model: &ModelFile, name: &str, place: &str) -> anyhow::Result<()> {
    eprintln!("abbe: {}", tally.words(&model.model, name, place));
    Ok(tally.judge(name)?)
}

fn is_standard(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// The input and its name in messages.
fn input(path: &Path) -> anyhow::Result<(Box<dyn Read>, String)> {
    if is_standard(path) {
        return Ok((Box::new(std::io::stdin().lock()), "standard input".to_owned()));
    }
    let name = path.display().to_string();
    let file = File::open(path).with_context(|| format!("{name}: cannot be opened"))?;
    Ok((Box::new(file), name))
}

/// What rows are corrected with.
struct Correcting<'a> {
    model: &'a ModelFile,
    residual: Option<&'a OwnedField>,
    /// Of tip or reflector, for a table without columns of it (m).
    default_offset_m: Option<[f64; 3]>,
    shutdown: &'a Shutdown,
}

/// An input that has everything written so far leave before it waits for more: rows that come one by one go on one by one, and a
/// file is still read and written in large pieces.
struct FlushFirst<R, F> {
    input: R,
    flush: F,
}

impl<R: Read, F: FnMut() -> std::io::Result<()>> Read for FlushFirst<R, F> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        (self.flush)()?;
        self.input.read(buffer)
    }
}

/// Corrects a table, and writes it to what goes by this name. `is_stream` where rows leave as they come: then a number with two readings is refused at its row.
fn correct_csv(
    Correcting { model, residual, default_offset_m, shutdown }: &Correcting,
    input: Box<dyn Read>,
    name: &str,
    (output, written): (impl Write, &str),
    is_stream: bool,
) -> anyhow::Result<Worth> {
    let writer = RefCell::new(None);
    let flush = || writer.borrow_mut().as_mut().map_or(Ok(()), PointsWriter::flush);
    let reader = PointsReader::new(FlushFirst { input, flush }, name, *default_offset_m)?;
    let inputs = inputs_of(*residual);
    let mut reader = reader.following(model.model.reads().into_iter().chain(inputs.clone()));
    let points = PointsWriter::new(output, written, &reader)?;
    let form = points.form();
    *writer.borrow_mut() = Some(points);
    let room = if is_stream { 1 } else { MANY };
    let mut batch = Batch::new(&reader, &model.model, &inputs, room);
    let mut ahead = Batch::new(&reader, &model.model, &inputs, room);
    let mut worth = Worth { tally: Tally::asking(inputs), ..Worth::default() };
    let mut fill = |batch: &mut Batch| {
        batch.clear();
        while let Some(row) = batch.read(&mut reader)? {
            ensure!(!shutdown.requested(), Ended::stopped("stopped on request".to_owned()));
            check_offset_signs(&model.model.parts().identified, row, name)?;
        }
        if is_stream && !batch.rows().is_empty() {
            reader.refuse_open_numbers()?;
        }
        Ok::<(), anyhow::Error>(())
    };
    fill(&mut batch)?;
    while !batch.rows().is_empty() {
        let correct = || batch.corrected(&model.model, *residual, form);
        // A row of a stream leaves before the next one is waited for; those of a file are read while others are corrected.
        let (parts, next) = match is_stream {
            true => (correct(), None),
            false => beside(correct, || Some(fill(&mut ahead))),
        };
        if let Some(writer) = writer.borrow_mut().as_mut() {
            write_corrected(&batch, model, parts?, writer, &mut worth)?;
        }
        next.unwrap_or_else(|| fill(&mut ahead))?;
        std::mem::swap(&mut batch, &mut ahead);
    }
    ensure!(worth.tally.rows() > 0, "{name}: the file holds a header but no row; give one row for each point");
    if let Some(writer) = writer.take() {
        writer.finish()?.flush()?;
    }
    Ok(worth)
}

/// Both outcomes; the first comes from a thread of its own.
fn beside<A: Send, B>(first: impl FnOnce() -> A + Send, second: impl FnOnce() -> B) -> (A, B) {
    std::thread::scope(|scope| {
        let first = scope.spawn(first);
        let second = second();
        // Where the thread panics, so does who waits for it.
        (first.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)), second)
    })
}

/// Writes and counts the rows of a batch.
fn write_corrected(
    batch: &Batch,
    model: &ModelFile,
    parts: Vec<Part>,
    writer: &mut PointsWriter<impl Write>,
    worth: &mut Worth,
) -> anyhow::Result<()> {
    for part in parts {
        let mut outcomes = part.statuses.iter().zip(&part.moved);
        batch.visit(part.rows(), |row, state| {
            let Some((status, moved)) = outcomes.next() else { return };
            worth.tally.add(&model.model, state, *status, row.line());
            if let Some(moved) = moved {
                worth.corrections.add(state.reading_m, row.line(), *moved);
            }
        });
        writer.append(&batch.rows()[part.rows()], part.text)?;
    }
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
