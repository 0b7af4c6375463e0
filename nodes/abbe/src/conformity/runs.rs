//! Positioning of axes after ISO 230-2 and along diagonals after ISO 230-6, from the runs that `abbe diagnose` reads too.
//!
//! Place in the flow: `abbe conformity --runs`. What is named by signs (`PPP`, `NP0` …) is a diagonal, everything else an axis.

use super::{Product, departure_callout, departure_json, departure_words, pictures, um};
use crate::pipeline::software;
use crate::provenance::made_from;
use abbe_conformity::Departure;
use abbe_conformity::diagonals::{self, DiagonalFigures, DiagonalKind};
use abbe_conformity::positioning::{self, AxisFigures};
use abbe_files::{hex, read_runs_file};
use abbe_measurement::positioning::Run;
use abbe_report::{Cell, Column, Identity, KeyFigure, KeyFigures, Quantity, Report, Section, TableSection, digits};
use anyhow::Context;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

const AXES: &str = "ISO 230-2";
const DIAGONALS: &str = "ISO 230-6";
/// Figures of an axis in the order of all tables.
const FIGURES: [&str; 13] =
    ["A", "A_up", "A_down", "R", "R_up", "R_down", "B", "B_mean", "E", "E_up", "E_down", "M", "targets"];

/// Runs by the name of their axis, or diagonal.
type ByAxis<'a> = BTreeMap<String, Vec<&'a Run>>;

/// Figures of runs.
pub(crate) fn run(path: &Path) -> anyhow::Result<Product> {
    let file = read_runs_file(path)?;
    let (mut axes, mut along): (ByAxis, ByAxis) = Default::default();
    for run in &file.rows {
        let group = if DiagonalKind::of(&run.axis).is_some() { &mut along } else { &mut axes };
        group.entry(run.axis.clone()).or_default().push(run);
    }
    one_name_each(axes.keys().chain(along.keys())).with_context(|| path.display().to_string())?;
    let evaluate = |(axis, list): (&String, &Vec<&Run>)| positioning::evaluate(axis, list);
    let axes: Vec<AxisFigures> =
        axes.iter().map(evaluate).collect::<Result<Vec<_>, _>>().with_context(|| path.display().to_string())?;
    let diagonals = (!along.is_empty())
        .then(|| diagonals::evaluate(&along).with_context(|| path.display().to_string()))
        .transpose()?;
    let (words, json) = (words(path, &axes, diagonals.as_ref()), json(&axes, diagonals.as_ref(), &file.sha256));
    let report = report(path, &file.sha256, &axes, diagonals.as_ref());
    Ok(Product {
        words,
        json,
        report,
        verdict: None,
        outside: None,
        figures: Vec::new(),
        method: ("ISO 230-2", Vec::new()),
    })
}

/// Refuses two spellings of one axis: each would have figures of a part of its runs.
fn one_name_each<'a>(names: impl Iterator<Item = &'a String>) -> anyhow::Result<()> {
    let mut seen: BTreeMap<String, &str> = BTreeMap::new();
    for name in names {
        if let Some(other) = seen.insert(name.to_uppercase(), name) {
            anyhow::bail!(
                "column axis: {other} and {name} are one axis in two spellings; write one name for all its runs"
            );
        }
    }
    Ok(())
}

/// In the order of [`FIGURES`], m, without the count.
fn figures(axis: &AxisFigures) -> [Option<f64>; 12] {
    [
        axis.accuracy_m,
        axis.accuracy_up_m,
        axis.accuracy_down_m,
        axis.repeatability_m,
        axis.repeatability_up_m,
        axis.repeatability_down_m,
        axis.reversal_m,
        axis.mean_reversal_m,
        axis.systematic_m,
        axis.systematic_up_m,
        axis.systematic_down_m,
        axis.mean_bidirectional_m,
    ]
}

fn axis_departures(axes: &[AxisFigures]) -> Vec<Departure> {
    axes.iter().flat_map(|axis| axis.departures.clone()).collect()
}

fn words(path: &Path, axes: &[AxisFigures], diagonals: Option<&DiagonalFigures>) -> String {
    let mut text = format!("{}: deviation = actual - target, µm\n", path.display());
    let along = diagonals.map_or(&[][..], |d| d.diagonals.as_slice());
    // Writing to a string cannot fail.
    let heads: String = FIGURES.iter().map(|name| format!(" {name:>8}")).collect();
    let _ = writeln!(text, "  {:<8}{heads}", "");
    for axis in axes.iter().chain(along) {
        let cell =
            |v: &Option<f64>| v.map_or_else(|| format!(" {:>8}", "-"), |v| format!(" {:>8}", digits::result(um(v))));
        let cells: String = figures(axis).iter().map(cell).collect();
        let _ = writeln!(text, "  {:<8}{cells} {:>8}", axis.axis, axis.targets.len());
    }
    for (kind, largest) in diagonals.iter().flat_map(|d| &d.largest) {
        let shown = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| digits::result(um(v)));
        let _ = writeln!(
            text,
            "  largest of the {} diagonals: A {}, R {}, B {}, E {}, M {}",
            kind_word(*kind),
            shown(largest.accuracy_m),
            shown(largest.repeatability_m),
            shown(largest.reversal_m),
            shown(largest.systematic_m),
            shown(largest.mean_bidirectional_m)
        );
    }
    if !axes.is_empty() {
        text.push_str(&departure_words(AXES, &axis_departures(axes)));
    }
    if let Some(diagonals) = diagonals {
        text.push_str(&departure_words(DIAGONALS, &diagonals.departures));
    }
    text
}

fn kind_word(kind: DiagonalKind) -> &'static str {
    match kind {
        DiagonalKind::Body => "body",
        DiagonalKind::Face => "face",
    }
}

fn json(axes: &[AxisFigures], diagonals: Option<&DiagonalFigures>, sha256: &[u8; 32]) -> Value {
    let largest: BTreeMap<&str, Value> = diagonals
        .iter()
        .flat_map(|d| &d.largest)
        .map(|(kind, l)| {
            let value = json!({
                "A_um": l.accuracy_m.map(um), "R_um": l.repeatability_m.map(um), "B_um": l.reversal_m.map(um),
                "E_um": l.systematic_m.map(um), "M_um": l.mean_bidirectional_m.map(um),
            });
            (kind_word(*kind), value)
        })
        .collect();
    json!({
        "deviation": "actual - target",
        "axes": axes.iter().map(axis_json).collect::<Vec<_>>(),
        "diagonals": diagonals.map(|d| d.diagonals.iter().map(axis_json).collect::<Vec<_>>()),
        "largest_of_diagonals": largest,
        "departures_230_2": departure_json(&axis_departures(axes)),
        "departures_230_6": diagonals.map(|d| departure_json(&d.departures)),
        "data_sha256": hex(sha256), "software": software(),
    })
}

fn axis_json(axis: &AxisFigures) -> Value {
    let mut value: serde_json::Map<String, Value> =
        FIGURES.iter().zip(figures(axis)).map(|(name, v)| (format!("{name}_um"), json!(v.map(um)))).collect();
    let targets: Vec<Value> = axis
        .targets
        .iter()
        .map(|t| {
            json!({
                "target_mm": t.target_m * 1e3,
                "mean_up_um": t.up.map(|d| um(d.mean_m)), "s_up_um": t.up.and_then(|d| d.deviation_m).map(um),
                "mean_down_um": t.down.map(|d| um(d.mean_m)), "s_down_um": t.down.and_then(|d| d.deviation_m).map(um),
                "B_um": t.reversal_m().map(um), "R_um": t.repeatability_m().map(um),
            })
        })
        .collect();
    value.insert("axis".to_owned(), json!(axis.axis));
    value.insert("targets".to_owned(), json!(targets));
    Value::Object(value)
}

fn report(path: &Path, sha256: &[u8; 32], axes: &[AxisFigures], diagonals: Option<&DiagonalFigures>) -> Report {
    let all: Vec<AxisFigures> =
        axes.iter().chain(diagonals.map_or(&[][..], |d| d.diagonals.as_slice())).cloned().collect();
    let mut sections = vec![key_figures(&all)];
    if !axes.is_empty() {
        sections.push(departure_callout(AXES, &axis_departures(axes)));
    }
    if let Some(diagonals) = diagonals {
        sections.push(departure_callout(DIAGONALS, &diagonals.departures));
    }
    let standards = match (axes.is_empty(), diagonals) {
        (true, _) => "diagonals after ISO 230-6",
        (false, None) => "axes after ISO 230-2",
        (false, Some(_)) => "axes after ISO 230-2 and diagonals after ISO 230-6",
    };
    sections.push(table(&all));
    sections.extend(pictures::positioning(&all));
    Report {
        title: "Positioning".to_owned(),
        lead: Some(format!("Figures of {standards}; deviation = actual − target.")),
        identity: Identity::default(),
        next: None,
        meta: made_from(path, sha256),
        main_plot: None,
        footer: Some(software()),
        sections,
    }
}

/// Axes whose figures have a card each; of more, one card an axis.
const FEW: usize = 2;

/// Accuracy of each axis, else what there is of it, and its largest other figures.
fn key_figures(all: &[AxisFigures]) -> Section {
    let figures = match all.len() <= FEW {
        true => all.iter().flat_map(cards).collect(),
        false => all.iter().map(card).collect(),
    };
    Section::KeyFigures(KeyFigures { title: "Largest figures".to_owned(), figures })
}

/// The figures that stand for an axis: sign, name, value (m).
fn leading(axis: &AxisFigures) -> Vec<(&'static str, &'static str, f64)> {
    let accuracy = [
        ("A", "accuracy", axis.accuracy_m),
        ("A↑", "accuracy in +", axis.accuracy_up_m),
        ("A↓", "accuracy in −", axis.accuracy_down_m),
    ];
    let beside = [
        ("R", "repeatability", axis.repeatability_m),
        ("B", "reversal value", axis.reversal_m),
        ("E", "systematic error", axis.systematic_m),
        ("M", "mean bidirectional error", axis.mean_bidirectional_m),
    ];
    let known = |(sign, name, value): (&'static str, &'static str, Option<f64>)| Some((sign, name, value?));
    let first = accuracy.into_iter().find_map(known);
    first.into_iter().chain(beside.into_iter().filter_map(known)).collect()
}

/// A card for each figure of an axis.
fn cards(axis: &AxisFigures) -> Vec<KeyFigure> {
    let card = |(sign, name, value_m): (&str, &str, f64)| KeyFigure {
        label: format!("{name} {sign}, {}", axis_words(axis)),
        value: Some(Quantity::result(um(value_m))),
        unit: "µm".to_owned(),
        detail: Some(format!("over {} targets", axis.targets.len())),
        ..KeyFigure::default()
    };
    leading(axis).into_iter().map(card).collect()
}

/// One card for an axis, the rest of its figures under the first.
fn card(axis: &AxisFigures) -> KeyFigure {
    let figures = leading(axis);
    let beside = figures.iter().skip(1);
    let beside = beside.map(|(sign, name, value)| format!("{name} {sign} {}", Quantity::result(um(*value)).text()));
    let (sign, name, value) =
        figures.first().map_or(("A", "accuracy", None), |(sign, name, v)| (*sign, *name, Some(*v)));
    KeyFigure {
        label: format!("{name} {sign}, {}", axis_words(axis)),
        value: value.map(|value_m| Quantity::result(um(value_m))),
        unit: "µm".to_owned(),
        detail: Some(beside.collect::<Vec<_>>().join(", ")).filter(|text| !text.is_empty()),
        ..KeyFigure::default()
    }
}

fn axis_words(axis: &AxisFigures) -> String {
    let is_diagonal = DiagonalKind::of(&axis.axis).is_some();
    format!("{} {}", if is_diagonal { "diagonal" } else { "axis" }, axis.axis)
}

fn table(all: &[AxisFigures]) -> Section {
    let columns = FIGURES.iter().map(|name| {
        let unit = if *name == "targets" { "1" } else { "µm" };
        Column::number(name.replace("_up", "↑").replace("_down", "↓").replace("B_mean", "mean B"), unit)
    });
    let row = |axis: &AxisFigures| {
        let values = figures(axis).into_iter().map(|v| Cell::result(v.map(um)));
        [Cell::text(&axis.axis)].into_iter().chain(values).chain([Cell::count(axis.targets.len())]).collect()
    };
    Section::Table(TableSection {
        title: "Figures".to_owned(),
        note: Some(
            "A accuracy, R repeatability, B reversal, E systematic error, M mean bidirectional error; ↑ approached in +, ↓ in −, without \
             arrow bidirectional."
                .to_owned(),
        ),
        columns: [Column::text("axis")].into_iter().chain(columns).collect(),
        rows: all.iter().map(row).collect(),
        total_rows: None,
    })
}
