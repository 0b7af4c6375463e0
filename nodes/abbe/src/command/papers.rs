//! `abbe papers`: published figures of the source papers beside what comes out when they are computed again.
//!
//! Place in the flow: nothing of a user's machine goes in; it shows what the methods are worth on the papers' own data
//! and set-ups. The same table goes to the terminal, to report.html and to figures.json.

use crate::next::Next;
use crate::progress::spinner;
use abbe_files::write_atomically;
use abbe_papers::{Figure, PAPERS, Paper, PaperError, Settings, Verdict};
use abbe_report::{
    Callout, Cell, Column, Identity, KeyFigure, KeyFigures, MetaItem, Quantity, Report, Section, TableSection, Tone,
    to_json,
};
use abbe_runtime::Shutdown;
use anyhow::{Context, bail, ensure};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

/// How often is looked whether the user wants to stop.
const LOOK_S: f64 = 0.1;
/// Width of the text on a terminal, characters.
const WIDTH: usize = 110;
/// The verdict on figures of a part of the runs.
const NOT_JUDGED: &str = "not judged";

/// Arguments of `papers`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Folder for report.html and figures.json
    #[arg(long, default_value = "out/papers")]
    out: PathBuf,
    /// Only this paper, by a part of its name ("zhang 2016"); may be given several times
    #[arg(long)]
    paper: Vec<String>,
    /// Share of the full number of simulated runs, above 0 up to 1; 1 for figures to quote (15 minutes of processor time
    /// for Chen 2020, 11 for Liang 2025, seconds for each of the others), 0.02 for a quick look
    #[arg(long, default_value_t = 1.0)]
    effort: f64,
    /// First seed of the simulations
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print figures.json on standard output
    #[arg(long)]
    json: bool,
}

/// What `figures.json` holds.
#[derive(Debug, Serialize)]
struct Document {
    software: String,
    seed: u64,
    effort: f64,
    figures: Vec<Row>,
    not_computed: Vec<NotComputed>,
}

/// One figure.
#[derive(Debug, Clone, Serialize)]
struct Row {
    paper: &'static str,
    place: String,
    what: String,
    published: Option<String>,
    reproduced: String,
    how: String,
    verdict: &'static str,
    reason: String,
}

/// A paper whose figures are not there, and why.
#[derive(Debug, Clone, Serialize)]
struct NotComputed {
    paper: &'static str,
    reason: String,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (effort, seed) = (arguments.effort, arguments.seed);
    ensure!(effort > 0.0 && effort <= 1.0, "--effort {effort}: write a number above 0 and up to 1");
    let papers = chosen(&arguments.paper)?;
    let out = &arguments.out;
    ensure!(!out.exists() || out.is_dir(), "--out {}: this is a file; name a folder", out.display());
    let shutdown = Shutdown::on_signals()?;
    let document = compute(&papers, Settings { seed, effort }, &shutdown)?;
    let json = to_json("papers", &document)?;
    write(out, &document, &json)?;
    match arguments.json {
        true => print!("{json}"),
        false => {
            println!("{}\n{}", words(&document), out.join("report.html").display());
            next(&document).print();
        }
    }
    if shutdown.requested() {
        bail!("stopped on request; {} of {} papers are in the report", done(&papers, &document), papers.len());
    }
    match document.not_computed.first() {
        None => Ok(()),
        Some(first) => bail!("{}: {}", first.paper, first.reason),
    }
}

/// The papers asked for.
fn chosen(names: &[String]) -> anyhow::Result<Vec<&'static Paper>> {
    let has = |paper: &Paper, name: &String| paper.name.to_lowercase().contains(&name.to_lowercase());
    for name in names {
        let known = || PAPERS.iter().map(|paper| paper.name).collect::<Vec<_>>().join(", ");
        ensure!(PAPERS.iter().any(|paper| has(paper, name)), "--paper {name:?}: not known; known are {}", known());
    }
    let is_chosen = |paper: &&Paper| names.is_empty() || names.iter().any(|name| has(paper, name));
    Ok(PAPERS.iter().filter(is_chosen).collect())
}

/// Computes on a thread of its own, so that Ctrl-C keeps the papers that are done.
fn compute(papers: &[&'static Paper], settings: Settings, shutdown: &Shutdown) -> anyhow::Result<Document> {
    let (send, receive) = mpsc::channel();
    let list = papers.to_vec();
    std::thread::Builder::new()
        .name("papers".to_owned())
        .spawn(move || {
            for paper in list {
                // Nobody listens any more after Ctrl-C.
                if send.send((paper.name, (paper.figures)(&settings))).is_err() {
                    return;
                }
            }
        })
        .context("no thread can be started")?;
    let bar = spinner("papers");
    let mut results: Vec<(&'static str, Result<Vec<Figure>, PaperError>)> = Vec::new();
    while results.len() < papers.len() && !shutdown.requested() {
        let under_way = papers.get(results.len()).map_or("", |paper| paper.name);
        bar.set_message(format!("{under_way} ({} of {})", results.len() + 1, papers.len()));
        match receive.recv_timeout(Duration::from_secs_f64(LOOK_S)) {
            Ok(result) => results.push(result),
            Err(mpsc::RecvTimeoutError::Timeout) => {}
            Err(mpsc::RecvTimeoutError::Disconnected) => break,
        }
    }
    bar.finish_and_clear();
    Ok(document(papers, settings, results))
}

fn document(
    papers: &[&'static Paper],
    settings: Settings,
    results: Vec<(&'static str, Result<Vec<Figure>, PaperError>)>,
) -> Document {
    let mut document = Document {
        software: format!("abbe {}", env!("CARGO_PKG_VERSION")),
        seed: settings.seed,
        effort: settings.effort,
        figures: Vec::new(),
        not_computed: Vec::new(),
    };
    let unfinished = papers.iter().skip(results.len()).map(|paper| paper.name);
    let unfinished: Vec<_> =
        unfinished.map(|paper| NotComputed { paper, reason: "stopped before it was done".to_owned() }).collect();
    for (paper, result) in results {
        match result {
            Ok(figures) => document.figures.extend(figures.into_iter().map(|figure| row(paper, figure))),
            Err(error) => document.not_computed.push(NotComputed { paper, reason: error.to_string() }),
        }
    }
    document.not_computed.extend(unfinished);
    document
}

fn row(paper: &'static str, figure: Figure) -> Row {
    let Figure { place, what, published, reproduced, how, verdict, reason } = figure;
    Row { paper, place: place.to_owned(), what, published, reproduced, how, verdict: word(verdict), reason }
}

/// A verdict in words.
fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::NotJudged => NOT_JUDGED,
        Verdict::Reproduced => "reproduced",
        Verdict::Better => "better",
        Verdict::DoesNotFollow => "does not follow from the published data",
        Verdict::NotPublished => "data not published",
    }
}

/// The verdict for a reader: where there is none, why.
fn readable(row: &Row, effort: f64) -> String {
    match row.verdict {
        NOT_JUDGED => format!("{NOT_JUDGED}: {:.0} % of the runs", 100.0 * effort),
        verdict => verdict.to_owned(),
    }
}

/// Papers all of whose figures are there.
fn done(papers: &[&'static Paper], document: &Document) -> usize {
    let is_missing = |paper: &&&Paper| document.not_computed.iter().any(|missing| missing.paper == paper.name);
    papers.iter().filter(|paper| !is_missing(paper)).count()
}

fn write(folder: &Path, document: &Document, json: &str) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: the folder cannot be made", folder.display()))?;
    write_atomically(&folder.join("report.html"), report(document).html()?.as_bytes())?;
    write_atomically(&folder.join("figures.json"), json.as_bytes())?;
    Ok(())
}

/// All of the runs after a part of them, the same with a user's own data after all.
fn next(document: &Document) -> Next {
    match document.effort < 1.0 {
        true => Next::new("to compare with what was published", "papers"),
        false => Next::new("to see the methods at work on a recorded campaign", "demo"),
    }
}

fn report(document: &Document) -> Report {
    let mut sections = answer(document);
    sections.extend(document.not_computed.iter().map(missing));
    sections.extend(PAPERS.iter().filter_map(|paper| table(paper.name, document)));
    Report {
        title: "Published figures, computed again".to_owned(),
        lead: Some("What the source papers report, what comes out here, how, and what can be said.".to_owned()),
        identity: Identity::default(),
        next: Some(next(document).step()),
        meta: vec![
            MetaItem::new("Seed", document.seed.to_string()),
            MetaItem::new("Share of the full number of runs", format!("{:.0} %", 100.0 * document.effort)),
            MetaItem::software(&document.software),
        ],
        main_plot: None,
        footer: Some(document.software.clone()),
        sections,
    }
}

/// Why some figures are not judged; `None` where all are.
fn part_of_the_runs(document: &Document) -> Option<String> {
    document.figures.iter().any(|row| row.verdict == NOT_JUDGED).then(|| {
        format!(
            "Those not judged are of random runs, of which {:.0} % were made: enough to see that it works, not to compare with what was \
             published.",
            document.effort * 100.0
        )
    })
}

/// How many figures came out how.
fn counts(document: &Document) -> Vec<(String, usize)> {
    let mut counts: Vec<(String, usize)> = Vec::new();
    for row in &document.figures {
        let verdict = row.verdict.to_owned();
        match counts.iter_mut().find(|(name, _)| *name == verdict) {
            Some((_, count)) => *count += 1,
            None => counts.push((verdict, 1)),
        }
    }
    counts
}

/// The same on a terminal, and why some are not judged.
fn answer_in_words(document: &Document) -> String {
    let each = counts(document).into_iter().map(|(verdict, count)| format!("{count} {verdict}"));
    let counted = format!("Of {} figures: {}.", document.figures.len(), each.collect::<Vec<_>>().join(", "));
    [Some(counted), part_of_the_runs(document)].into_iter().flatten().map(|line| line + "\n").collect()
}

/// The same on the page.
fn answer(document: &Document) -> Vec<Section> {
    let figure = |(label, count): (String, usize)| KeyFigure {
        label,
        value: Some(Quantity::new(count as f64, 0)),
        detail: Some(format!("of {} figures", document.figures.len())),
        ..KeyFigure::default()
    };
    let counted =
        KeyFigures { title: "Verdicts".to_owned(), figures: counts(document).into_iter().map(figure).collect() };
    let not_judged = part_of_the_runs(document).map(|text| Callout {
        tone: Tone::Warning,
        title: "A part of the runs".to_owned(),
        text,
    });
    std::iter::once(Section::KeyFigures(counted)).chain(not_judged.map(Section::Callout)).collect()
}

fn missing(missing: &NotComputed) -> Section {
    Section::Callout(Callout { tone: Tone::Bad, title: missing.paper.to_owned(), text: missing.reason.clone() })
}

fn table(paper: &str, document: &Document) -> Option<Section> {
    // The verdict beside the figure: a narrow screen shows the first columns.
    let columns = ["figure", "verdict", "published", "here", "why, and how it was computed"];
    let rows: Vec<_> = document.figures.iter().filter(|row| row.paper == paper).collect();
    let cells = |row: &&Row| {
        vec![
            Cell::text(format!("{}: {}", row.place, row.what)),
            Cell::text(readable(row, document.effort)),
            Cell::text(row.published.as_deref().unwrap_or("not in the paper")),
            Cell::text(&row.reproduced),
            Cell::text(format!("{} ({})", row.reason, row.how)),
        ]
    };
    (!rows.is_empty()).then(|| {
        Section::Table(TableSection {
            title: paper.to_owned(),
            note: None,
            columns: columns.map(Column::text).into(),
            rows: rows.iter().map(cells).collect(),
            total_rows: None,
        })
    })
}

/// The table for a terminal: a figure takes a few lines, since its texts are sentences.
fn words(document: &Document) -> String {
    let mut text = answer_in_words(document);
    let mut paper = "";
    for row in &document.figures {
        if row.paper != paper {
            paper = row.paper;
            text += &format!("{paper}\n");
        }
        text += &format!("  {}, {}: {}\n", row.place, row.what, readable(row, document.effort).to_uppercase());
        text += &format!("    published  {}\n", row.published.as_deref().unwrap_or("-"));
        text += &format!("    here       {}\n", row.reproduced);
        text += &wrapped(&format!("{} ({})", row.reason, row.how));
    }
    for missing in &document.not_computed {
        text += &format!("{}: NOT COMPUTED: {}\n", missing.paper, missing.reason);
    }
    text
}

/// A text broken into lines, set in.
fn wrapped(text: &str) -> String {
    const INDENT: &str = "               ";
    let mut lines = vec![String::from(INDENT)];
    for part in text.split_whitespace() {
        let Some(line) = lines.last_mut() else { break };
        if line.chars().count() + part.chars().count() + 1 > WIDTH && line.len() > INDENT.len() {
            lines.push(format!("{INDENT}{part}"));
        } else {
            let gap = if line.len() > INDENT.len() { " " } else { "" };
            line.push_str(gap);
            line.push_str(part);
        }
    }
    lines.join("\n") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(published: Option<&str>) -> Figure {
        Figure {
            place: "Table 1",
            what: "station error, µm".to_owned(),
            published: published.map(str::to_owned),
            reproduced: "0.1".to_owned(),
            how: "1000 runs".to_owned(),
            verdict: Verdict::Better,
            reason: "because".to_owned(),
        }
    }

    fn of(results: Vec<(&'static str, Result<Vec<Figure>, PaperError>)>) -> Document {
        document(&chosen(&[]).unwrap(), Settings { seed: 1, effort: 1.0 }, results)
    }

    /// At low effort nothing was judged, not even figures of the papers' own data.
    #[test]
    fn regress_a_part_of_the_runs_judges_what_needs_none_and_nothing_else() {
        let settings = Settings { seed: 1, effort: 0.02 };
        let of_data = Figure { verdict: Verdict::DoesNotFollow, ..figure(Some("0.2")) };
        let results = vec![("Chen 2020", Ok(vec![of_data, settings.of_runs(figure(Some("0.2")))]))];
        let made = document(&chosen(&[]).unwrap(), settings, results);
        let page = report(&made).html().unwrap();
        let page = page.split("<main>").nth(1).unwrap().split("</main>").next().unwrap();
        let json = to_json("papers", &made).unwrap();
        for said in [page, &words(&made), &json].map(str::to_lowercase) {
            assert!(
                said.contains(NOT_JUDGED) && said.contains("does not follow") && !said.contains("better"),
                "{said}"
            );
        }
        assert!(words(&made).starts_with("Of 2 figures: 1 does not follow from the published data, 1 not judged."));
        let whole = Settings { seed: 1, effort: 1.0 };
        let made = document(&chosen(&[]).unwrap(), whole, vec![("Chen 2020", Ok(vec![whole.of_runs(figure(None))]))]);
        assert!(words(&made).contains("BETTER") && !words(&made).to_lowercase().contains(NOT_JUDGED));
    }

    #[test]
    fn a_paper_is_chosen_by_a_part_of_its_name_and_an_unknown_one_is_refused_with_those_that_are_known() {
        let names = |parts: &[&str]| chosen(&parts.iter().map(|p| (*p).to_owned()).collect::<Vec<_>>());
        assert_eq!(names(&["zhang 2016"]).unwrap().len(), 1);
        assert_eq!(names(&["zhang", "CHEN"]).unwrap().len(), 3);
        assert_eq!(names(&[]).unwrap().len(), PAPERS.len());
        let refused = names(&["abbe 1890"]).err().unwrap().to_string();
        assert!(refused.contains("abbe 1890") && refused.contains("Liang 2025"), "{refused}");
    }

    #[test]
    fn papers_that_were_not_reached_and_those_that_failed_are_named() {
        let failed = PaperError { paper: "Zhang 2016", place: "Table 2", problem: "no rank".to_owned() };
        let made = of(vec![("Chen 2020", Ok(vec![figure(None)])), ("Zhang 2016", Err(failed))]);
        let missing: Vec<_> = made.not_computed.iter().map(|m| (m.paper, m.reason.as_str())).collect();
        assert_eq!(missing[0], ("Zhang 2016", "Zhang 2016, Table 2: no rank"));
        assert_eq!(missing.len(), PAPERS.len() - 1);
        assert_eq!(done(&chosen(&[]).unwrap(), &made), 1);
        assert!(words(&made).contains("NOT COMPUTED: stopped before it was done"));
    }

    #[test]
    fn the_table_shows_a_missing_published_figure_as_missing() {
        let made = of(vec![("Chen 2020", Ok(vec![figure(None), figure(Some("0.2"))]))]);
        let text = words(&made);
        assert!(text.contains("published  -") && text.contains("published  0.2") && text.contains("BETTER"), "{text}");
        let html = report(&made).html().unwrap();
        assert!(html.contains("station error") && html.to_lowercase().contains("stopped before it was done"), "{html}");
        assert!(to_json("papers", &made).unwrap().contains("\"published\": null"));
    }
}
