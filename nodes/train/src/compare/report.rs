//! The page of `abbe compare`: which method these data speak for, and what each does on data held out.
//!
//! Place in the flow: after the trainings; micrometres, means over the seeds with their 95 % intervals.

use crate::data::Data;
use crate::report::{callout, capital, in_words};
use abbe_files::hex;
use abbe_report::{
    Axis, Bar, Bars, Cell, Column, Identity, KeyFigure, KeyFigures, MetaItem, NextStep, Quantity, Report, Section,
    TableSection, Tone, digits,
};
use abbe_residual_training::{Comparison, Interval, POSITION_ALONE, RivalRow};

/// The page.
pub(super) fn report(data: &Data, compared: &Comparison, identity: Identity, next: NextStep) -> Report {
    let mut sections = vec![answer(compared), figures(compared)];
    sections.extend(limits(data, compared));
    sections.extend([errors(compared), methods(compared), costs(compared)]);
    let mut meta = vec![MetaItem::file("Residuals", &data.file, Some(&hex(&data.sha256)))];
    if !compared.inputs.is_empty() {
        meta.push(MetaItem::new("Inputs", compared.inputs.join(" ")));
    }
    meta.push(MetaItem::software(abbe::software()));
    Report {
        title: "Methods for the residual compared".to_owned(),
        lead: Some(format!(
            "{} points of {}, held out by {}, {}; all methods on the same points and splits.",
            compared.points,
            data.file,
            if compared.flattering { "single points" } else { "blocks of space" },
            super::seeds(compared)
        )),
        identity,
        next: Some(next),
        meta,
        main_plot: None,
        footer: Some(abbe::software()),
        sections,
    }
}

fn answer(compared: &Comparison) -> Section {
    match &compared.recommendation {
        None => callout(Tone::Warning, "These data speak for no method", "None answered on all parts that judge."),
        Some(found) => {
            let tone = if found.method.ends_with(POSITION_ALONE) { Tone::Warning } else { Tone::Neutral };
            callout(
                tone,
                &format!("These data speak for {}", in_words(&found.method)),
                &format!("{}.", capital(&in_words(&found.why))),
            )
        }
    }
}

/// Of the method that the data speak for.
fn figures(compared: &Comparison) -> Section {
    let row =
        compared.recommendation.as_ref().and_then(|found| compared.rows.iter().find(|row| row.name() == found.method));
    let figure = |label: &str, of: fn(&RivalRow) -> Option<Interval>, unit: &str| {
        let interval = row.and_then(of);
        KeyFigure {
            label: label.to_owned(),
            value: interval.map(|interval| Quantity::with(interval.mean, half_width(&interval))),
            unit: unit.to_owned(),
            detail: interval.and_then(|interval| ends(&interval)),
            ..KeyFigure::default()
        }
    };
    Section::KeyFigures(KeyFigures {
        title: "Held out".to_owned(),
        figures: vec![
            figure("Mean square of a component", |row| row.mse_um2, "µm²"),
            figure("Mean magnitude of a component", |row| row.mae_um, "µm"),
            figure("95 % of the errors are below", |row| row.error_95_um, "µm"),
            figure("Worst error", |row| row.worst_um, "µm"),
        ],
    })
}

fn limits(data: &Data, compared: &Comparison) -> Vec<Section> {
    let mut list = Vec::new();
    if compared.flattering {
        let text = "Held-out points lie between points that were learnt from: regions in which nothing was measured are predicted worse. \
                    The split by blocks tells by how much.";
        list.push(callout(Tone::Warning, "These figures flatter", text));
    }
    if !compared.complete {
        list.push(callout(
            Tone::Warning,
            "Not complete",
            "It was stopped; the figures are those of the seeds that were done.",
        ));
    }
    if !data.left_out.is_empty() {
        let title = format!("{} vectors contradict all others and are left out", data.left_out.len());
        list.push(callout(Tone::Warning, &title, &data.left_out.join("; ")));
    }
    let missing =
        compared.rows.iter().filter_map(|row| Some(format!("{}: {}", in_words(&row.name()), row.missing.as_ref()?)));
    let missing: Vec<String> = missing.collect();
    if !missing.is_empty() {
        list.push(callout(Tone::Warning, "Methods without figures for some seed", &missing.join("; ")));
    }
    list
}

fn errors(compared: &Comparison) -> Section {
    let values = || compared.rows.iter().filter_map(|row| Some(row.mse_um2?.mean));
    Section::Bars(Bars {
        title: "Mean square on data held out, by method".to_owned(),
        note: Some("Mean over the seeds; the table has the 95 % interval of that mean.".to_owned()),
        value: Axis::new("mean square of a component", "µm²"),
        decimals: digits::of_group(values()),
        bars: compared
            .rows
            .iter()
            .map(|row| Bar { name: capital(&in_words(&row.name())), value: row.mse_um2.map(|interval| interval.mean) })
            .collect(),
    })
}

fn methods(compared: &Comparison) -> Section {
    let cell =
        |interval: &Option<Interval>| Cell::with(interval.map(|i| i.mean), interval.as_ref().and_then(half_width));
    let row = |row: &RivalRow| {
        vec![
            Cell::text(in_words(&row.name())),
            cell(&row.mse_um2),
            row.mse_um2.as_ref().and_then(ends).and_then(Cell::text),
            cell(&row.mae_um),
            row.mae_um.as_ref().and_then(ends).and_then(Cell::text),
            cell(&row.error_95_um),
            cell(&row.worst_um),
        ]
    };
    Section::Table(TableSection {
        title: "Errors on data held out".to_owned(),
        note: Some("Means over the seeds, and 95 % intervals of two of them.".to_owned()),
        columns: vec![
            Column::text("method"),
            Column::number("mean square", "µm²"),
            Column::text("95 % interval"),
            Column::number("mean magnitude", "µm"),
            Column::text("95 % interval"),
            Column::number("95 % below", "µm"),
            Column::number("worst", "µm"),
        ],
        rows: compared.rows.iter().map(row).collect(),
        total_rows: None,
    })
}

fn costs(compared: &Comparison) -> Section {
    let mean =
        |interval: &Option<Interval>, factor: f64, decimals| Cell::maybe(interval.map(|i| i.mean * factor), decimals);
    let row = |row: &RivalRow| {
        vec![Cell::text(in_words(&row.name())), mean(&row.training_s, 1.0, 2), mean(&row.prediction_s, 1e6, 1)]
    };
    Section::Table(TableSection {
        title: "What they cost".to_owned(),
        note: Some("On this machine, with whatever else it did.".to_owned()),
        columns: vec![Column::text("method"), Column::number("training", "s"), Column::number("a point", "µs")],
        rows: compared.rows.iter().map(row).collect(),
        total_rows: None,
    })
}

/// Half of the interval: what the mean is known to.
fn half_width(interval: &Interval) -> Option<f64> {
    Some((interval.high? - interval.low?) / 2.0).filter(|half| *half > 0.0)
}

/// The interval in words, with the digits of the mean.
fn ends(interval: &Interval) -> Option<String> {
    let decimals = digits::of(interval.mean, half_width(interval));
    let [low, high] = [interval.low?, interval.high?].map(|end| digits::plain(end, decimals).replace('-', "−"));
    Some(format!("{low} to {high}"))
}
