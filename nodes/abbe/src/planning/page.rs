//! The page of `abbe plan`: volume, stations and lines, the uncertainty over the volume, what each error and effect comes to.
//!
//! Place in the flow: beside the path; millimetres, micrometres, microradians, k = 1.

use super::{Outcome, Sources, outcome, readings_words, shape_in_words, tables, time_words, um};
use abbe_geometry::effects::Wish;
use abbe_plan::{Plan, Promise};
use abbe_report::{
    Axis, Callout, CellMap, CellPanel, Identity, IsoLine, IsoPoint, Isometric, KeyFigure, KeyFigures, MetaItem,
    Quantity, Report, Section, Tone,
};

/// Planes of Z shown.
const PLANES: usize = 3;

/// The report.
pub(crate) fn report(sources: &Sources, plan: &Plan) -> Report {
    let mut sections = vec![key_figures(plan)];
    sections.extend(stopped(plan));
    sections.extend(sources.request.tell.iter().map(|wish| wished(&plan.promise, wish)));
    sections.extend([bent(plan), tables::open(&plan.promise)]);
    sections.extend([picture(sources, plan), tables::stations(plan), map(sources, &plan.promise)]);
    sections.extend(tables::errors(&plan.promise));
    sections.push(tables::path(plan));
    sections.extend(tables::effects(&plan.promise));
    Report {
        title: format!("Planned campaign of {}", sources.machine.machine.name),
        lead: Some(
            "What identification will state of corrected points when this path has been measured, if the machine bends as \
             expected and lacks nothing that its model has no word for."
                .to_owned(),
        ),
        // What is not measured yet has no certificate, no day and no temperature.
        identity: Identity { certificate: None, measured: None, temperature_c: None, ..sources.who.clone() },
        next: Some(super::next().step()),
        meta: made_from(sources, plan),
        main_plot: None,
        footer: Some(crate::pipeline::software()),
        sections,
    }
}

fn made_from(sources: &Sources, plan: &Plan) -> Vec<MetaItem> {
    let figures = [
        MetaItem::new("Measuring time", time_words(sources, plan).replace("s2", "s²")),
        MetaItem::new("Unknowns", plan.promise.unknowns.to_string()),
        MetaItem::new("Seed", sources.request.seed.to_string()),
        MetaItem::software(crate::pipeline::software()),
    ];
    sources.files.iter().cloned().chain(figures).collect()
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

/// What will come of an effect that the request asks for.
fn wished(promise: &Promise, wish: &Wish) -> Section {
    let shape = shape_in_words(&wish.shape);
    let shape = if shape.is_empty() { shape } else { format!(" ({shape})") };
    let title = format!("{}{shape}", crate::diagnosis::title(&wish.name));
    let (tone, text) = match outcome(promise, wish) {
        Outcome::Told(words) => (Tone::Good, format!("It can be told: {words}")),
        Outcome::Not(words) => (Tone::Warning, format!("It cannot be told: {words}")),
    };
    Section::Callout(Callout { tone, title, text })
}

/// What the promise hangs on.
fn bent(plan: &Plan) -> Section {
    let [half, twice] = plan.if_bent_m.map(um);
    Section::Callout(Callout {
        tone: Tone::Neutral,
        title: "What it hangs on".to_owned(),
        text: format!(
            "If the errors bend half as much as believed, a corrected point has {half} µm, and {twice} µm if they bend twice as much."
        ),
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
    let [x, y, z] = promise.largest_m.1.map(|v| v * 1e3);
    let mut point =
        figure("uncertainty of a corrected point", um(promise.u_m), "µm", "k = 1, in space, rms over the volume");
    point.before = plan.before.as_ref().map(|before| um(before.u_m));
    let figures = vec![
        point,
        figure(
            "uncertainty of the model alone",
            um(promise.u_model_m),
            "µm",
            "without the repeatability of one approach",
        ),
        figure(
            "largest uncertainty of a corrected point",
            um(promise.largest_m.0),
            "µm",
            &format!("at X {x:.0}, Y {y:.0}, Z {z:.0} mm"),
        ),
        figure("measuring time", Quantity::new(plan.time_s / 3600.0, 1), "h", "with all changes of station and holder"),
        figure(
            "lines",
            Quantity::new(plan.lines.len() as f64, 0),
            "",
            &format!("from {} stations; {}", plan.stations.len(), readings_words(plan)),
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
            .map(|(line, from, to)| IsoLine {
                names: vec![line.name.clone()],
                point: Some(line.station),
                from: millimetres(from),
                to: millimetres(to),
            })
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
        state: None,
    };
    Section::CellMap(CellMap {
        title: "Uncertainty of corrected points in planes of Z".to_owned(),
        note: Some("Standard uncertainty in space, the largest over the tips.".to_owned()),
        value: Axis::new("uncertainty", "µm"),
        is_uncertainty: true,
        columns: PLANES,
        panels: planes.map(panel).collect(),
    })
}
