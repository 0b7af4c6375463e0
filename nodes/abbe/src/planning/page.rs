//! The page of `abbe plan`: volume, stations and lines, the uncertainty over the volume, what each error and effect comes to.
//!
//! Place in the flow: beside the path; millimetres, micrometres, microradians, k = 1.

use super::{Sources, shape_words, size_words, time_words, unsaid_words};
use crate::provenance::file_name;
use abbe_diagnose::Foresight;
use abbe_plan::{Plan, Promise};
use abbe_report::{
    Axis, Callout, Cell, CellMap, CellPanel, Column, IsoLine, IsoPoint, Isometric, KeyFigure, KeyFigures, MetaItem,
    Quantity, Report, Section, TableSection, Tone,
};

/// Planes of Z shown.
const PLANES: usize = 3;
/// Lines of the path on the page; all of them are in the files.
const LINES: usize = 20;

/// The report.
pub(crate) fn report(sources: &Sources, plan: &Plan) -> Report {
    let mut sections = vec![key_figures(plan)];
    sections.extend(stopped(plan));
    sections.extend([picture(sources, plan), map(sources, &plan.promise), lines(plan), errors(&plan.promise)]);
    sections.extend(effects(&plan.promise));
    Report {
        title: format!("Planned campaign of {}", sources.machine.machine.name),
        lead: Some(
            "What identification will state of corrected points when this path has been measured, if the machine bends as \
             expected and lacks nothing that its model has no word for."
                .to_owned(),
        ),
        identity: sources.who.clone(),
        next: Some(super::next().step()),
        meta: vec![
            MetaItem::file("Machine file", &sources.files[0], None),
            MetaItem::file("Request", &sources.files[1], None),
            MetaItem { label: "Measured before".to_owned(), value: sources.campaign.map(file_name) },
            MetaItem::new("Measuring time", time_words(sources, plan)),
            MetaItem::new("Unknowns", plan.promise.unknowns.to_string()),
            MetaItem::new("Seed", sources.request.seed.to_string()),
            MetaItem::software(crate::pipeline::software()),
        ],
        main_plot: None,
        footer: Some(crate::pipeline::software()),
        sections,
    }
}

fn stopped(plan: &Plan) -> Option<Section> {
    plan.stopped.then(|| {
        Section::Callout(Callout {
            tone: Tone::Warning,
            title: "Stopped before the end".to_owned(),
            text: "The search was stopped on request. This is the best plan that it had found.".to_owned(),
        })
    })
}

fn key_figures(plan: &Plan) -> Section {
    let promise = &plan.promise;
    let figure = |label: &str, value: Quantity, unit: &str, detail: &str| KeyFigure {
        label: label.to_owned(),
        value: Some(value),
        unit: unit.to_owned(),
        detail: Some(detail.to_owned()),
        ..KeyFigure::default()
    };
    let um = |u_m: f64| Quantity::uncertainty(u_m * 1e6);
    let mut point = figure("corrected point", um(promise.u_m), "µm", "k = 1, in space, rms over the volume");
    point.before = plan.before.as_ref().map(|before| um(before.u_m));
    let figures = vec![
        point,
        figure("model alone", um(promise.u_model_m), "µm", "without the repeatability of one approach"),
        figure("largest", um(promise.largest_m.0), "µm", "of a point in the volume"),
        figure("measuring time", Quantity::new(plan.time_s / 3600.0, 1), "h", "with all changes of station and holder"),
        figure(
            "lines",
            Quantity::new(plan.lines.len() as f64, 0),
            "",
            &format!("from {} stations", plan.stations.len()),
        ),
    ];
    Section::KeyFigures(KeyFigures { title: "At a glance".to_owned(), figures })
}

fn picture(sources: &Sources, plan: &Plan) -> Section {
    let millimetres = |at_m: [f64; 3]| at_m.map(|v| v * 1e3);
    let volume = &sources.request.volume_m;
    let ends = plan.lines.iter().filter_map(|line| Some((line, *line.points_m.first()?, *line.points_m.last()?)));
    Section::Isometric(Isometric {
        title: "Stations and lines".to_owned(),
        note: Some("Lines are scale readings; each has the colour of the station that it is measured from.".to_owned()),
        unit: "mm".to_owned(),
        volume_min: std::array::from_fn(|d| volume[d].0 * 1e3),
        volume_max: std::array::from_fn(|d| volume[d].1 * 1e3),
        points: plan
            .stations
            .iter()
            .map(|s| IsoPoint { name: s.name.clone(), at: millimetres(s.position_m) })
            .collect(),
        lines: ends
            .map(|(line, from, to)| IsoLine { point: Some(line.station), from: millimetres(from), to: millimetres(to) })
            .collect(),
    })
}

fn map(sources: &Sources, promise: &Promise) -> Section {
    let steps = promise.steps;
    let planes = (0..PLANES).map(|k| k * (steps - 1) / (PLANES - 1));
    let volume = &sources.request.volume_m;
    // Points stand in the middle of their cells.
    let edges = |axis: usize| -> Vec<f64> {
        let (low_m, high_m) = volume[axis];
        let step = (high_m - low_m) / (steps - 1) as f64;
        // A cell around each point of the grid, and no cell beyond the volume.
        let edge = |k: usize| (low_m + (k as f64 - 0.5) * step).clamp(low_m, high_m);
        (0..=steps).map(|k| edge(k) * 1e3).collect()
    };
    let panel = |plane: usize| CellPanel {
        title: format!("Z = {:.0} mm", promise.map[plane * steps * steps].0[2] * 1e3),
        x: Axis::new("X", "mm"),
        y: Axis::new("Y", "mm"),
        x_edges: edges(0),
        y_edges: edges(1),
        values: promise.map[plane * steps * steps..(plane + 1) * steps * steps]
            .iter()
            .map(|(_, u_m)| Some(u_m * 1e6))
            .collect(),
    };
    Section::CellMap(CellMap {
        title: "Uncertainty of corrected points in planes of Z".to_owned(),
        note: Some("Standard uncertainty in space, the largest over the tips.".to_owned()),
        value: Axis::new("uncertainty", "µm"),
        columns: PLANES,
        panels: planes.map(panel).collect(),
    })
}

fn table(title: &str, note: Option<&str>, columns: Vec<Column>, rows: Vec<Vec<Option<Cell>>>) -> Section {
    let (title, note) = (title.to_owned(), note.map(str::to_owned));
    Section::Table(TableSection { title, note, columns, rows, total_rows: None })
}

fn lines(plan: &Plan) -> Section {
    let text = |at_m: Option<&[f64; 3]>| at_m.map(|p| p.map(|v| format!("{:.0}", v * 1e3)).join(" "));
    let row = |line: &abbe_plan::Line| {
        vec![
            Cell::text(&line.name),
            text(line.points_m.first()).and_then(Cell::text),
            text(line.points_m.last()).and_then(Cell::text),
            Cell::count(line.points_m.len()),
            text(Some(&line.offset_m)).and_then(Cell::text),
            Cell::maybe(line.times_s.last().map(|s| s / 60.0), 1),
        ]
    };
    let columns = vec![
        Column::text("line"),
        Column::text("from, mm"),
        Column::text("to, mm"),
        Column::number("points", "1"),
        Column::text("offset, mm"),
        Column::number("done after", "min"),
    ];
    Section::Table(TableSection {
        title: "Path".to_owned(),
        note: Some("In the order of measurement; path.csv has every point.".to_owned()),
        columns,
        rows: plan.lines.iter().take(LINES).map(row).collect(),
        total_rows: Some(plan.lines.len()),
    })
}

fn errors(promise: &Promise) -> Section {
    let um = |u: f64| Cell::uncertainty(Some(u * 1e6));
    let row = |e: &abbe_plan::ErrorPromise| {
        let unit = if e.is_angle { "µrad" } else { "µm" };
        vec![Cell::text(&e.name), um(e.u_rms), um(e.u_largest), Cell::text(unit)]
    };
    let angle = |(name, u): &(String, f64)| vec![Cell::text(name), um(*u), None, Cell::text("µrad")];
    let columns = vec![
        Column::text("error"),
        Column::number("rms over the volume", "unit"),
        Column::number("largest", "unit"),
        Column::text("unit"),
    ];
    let rows = promise.errors.iter().map(row).chain(promise.squareness.iter().map(angle)).collect();
    table("Uncertainty of each error (k = 1)", None, columns, rows)
}

fn effects(promise: &Promise) -> Vec<Section> {
    match &promise.effects {
        Ok(effects) => tables(effects).into(),
        Err(problem) => vec![Section::Callout(Callout {
            tone: Tone::Warning,
            title: "Nothing is said of effects".to_owned(),
            text: unsaid_words(problem),
        })],
    }
}

fn tables(effects: &Foresight) -> [Section; 3] {
    let told = effects.told.iter().flat_map(|told| {
        told.parameters.iter().map(|p| {
            vec![
                Cell::text(named(told.title, &shape_words(&told.shape))),
                Cell::text(&p.name),
                Cell::text(size_words(p.u, p.unit)),
                Cell::text(size_words(p.found_from, p.unit)),
            ]
        })
    });
    let columns = ["effect", "parameter", "known to (k = 1)", "found from"].map(Column::text).to_vec();
    let told = table(
        "Effects that can be told",
        Some("A parameter that is found only from more than it can be is not told by itself, only with the others."),
        columns,
        told.collect(),
    );
    let hidden = effects.not_identifiable.iter().map(|n| {
        vec![
            Cell::text(n.name),
            Cell::text(shape_words(&n.shape)),
            Cell::number(n.alias_share * 1e2, 1),
            Cell::text(n.aliased_with.join(", ")),
            Cell::text(n.decided_by),
        ]
    });
    let columns = vec![
        Column::text("effect"),
        Column::text("shape"),
        Column::number("absorbed", "%"),
        Column::text("by"),
        Column::text("what would tell"),
    ];
    let hidden =
        table("Cannot be identified", Some("The model's own parameters absorb them."), columns, hidden.collect());
    let untestable = effects.untestable.iter().map(|u| vec![Cell::text(&u.title), Cell::text(&u.needs)]);
    let columns = ["effect", "needs"].map(Column::text).to_vec();
    [told, hidden, table("Not tested by this plan", None, columns, untestable.collect())]
}

/// An effect with its shape, where it has one.
fn named(title: &str, shape: &str) -> String {
    if shape.is_empty() { title.to_owned() } else { format!("{title} ({shape})") }
}
