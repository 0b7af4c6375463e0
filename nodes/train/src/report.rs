//! The report of a training: what held-out data say, loss curves, and where the residuals lie.
//!
//! Place in the flow: `abbe train` writes it beside the residual model. Opens without a network.

use crate::data::Data;
use abbe_files::{ResidualFile, hex};
use abbe_geometry::Vector3;
use abbe_report::{
    Axis, Callout, Cell, Column, Curve, CurveStyle, Heading, Identity, KeyFigure, KeyFigures, LinePanel, LinePlot,
    MapPanel, MapPoint, MetaItem, NextStep, Quantity, Report, ResidualMap, Section, TableSection, Tone,
};
use abbe_residual_training::{HeldOutScores, POSITION_ALONE, Trained, TrainingRecord, ZERO};

/// Methods: name and words.
const METHODS: [(&str, &str); 7] = [
    ("perceptron-kriging", "perceptrons with kriging"),
    ("residual-perceptron", "residual perceptron"),
    ("genetic-swarm", "genetic swarm"),
    ("deep-belief", "deep belief network"),
    ("idw", "inverse distances"),
    ("kriging-network", "kriging with a network"),
    (ZERO, "no residual model"),
];
/// Colours of the losses: others than those of before and after.
const TRAINING: u8 = 7;
const VALIDATION: u8 = 5;
const AXES: [&str; 3] = ["X", "Y", "Z"];

/// The page.
pub(crate) fn html(
    trained: &Trained,
    file: &ResidualFile,
    data: &Data,
    (made, identity, next): (MetaItem, Identity, NextStep),
) -> anyhow::Result<String> {
    let record = &trained.record;
    let mut sections = vec![answer(record), figures(record)];
    if record.flattering {
        let text = "Held-out points lie between points that were learnt from. Regions in which nothing was measured are \
                    predicted worse than these figures say; the split by blocks tells by how much.";
        sections.push(callout(Tone::Warning, "These figures flatter", text));
    }
    if !record.complete {
        let text = "The training was stopped. The model holds the best so far; abbe train --resume goes on.";
        sections.push(callout(Tone::Warning, "Not complete", text));
    }
    if !data.left_out.is_empty() {
        let title = format!("{} vectors contradict all others and are left out", data.left_out.len());
        sections.push(callout(Tone::Warning, &title, &data.left_out.join("; ")));
    }
    sections.push(heading("Methods on data held out"));
    sections.push(methods(record));
    sections.push(scatter(trained, data));
    if !record.curves.is_empty() {
        sections.push(heading("Training"));
        sections.push(losses(record));
    }
    if let Some(places_m) = data.places_m() {
        sections.push(heading("Residuals"));
        sections.push(residuals(data, &places_m));
    }
    let report = Report {
        title: "Residual model".to_owned(),
        lead: Some(format!("What geometry leaves, learnt from {} ({} points).", data.file, data.points())),
        identity,
        next: Some(next),
        meta: std::iter::once(made).chain(meta(record, file, data)).collect(),
        main_plot: None,
        footer: Some(file.software.clone()),
        sections,
    };
    Ok(report.html()?)
}

/// Names of methods as people read them; configuration and JSON have the program's.
pub(crate) fn in_words(text: &str) -> String {
    METHODS.iter().fold(text.to_owned(), |text, (name, words)| text.replace(name, words))
}

/// A text that begins a sentence.
pub(crate) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

fn heading(title: &str) -> Section {
    Section::Heading(Heading { title: title.to_owned(), intro: None })
}

pub(crate) fn callout(tone: Tone, title: &str, text: &str) -> Section {
    Section::Callout(Callout { tone, title: title.to_owned(), text: text.to_owned() })
}

fn meta(record: &TrainingRecord, file: &ResidualFile, data: &Data) -> Vec<MetaItem> {
    let item = |label: &str, value: Option<String>| MetaItem { label: label.to_owned(), value };
    let owner = file.owner.as_ref();
    let mut items = vec![
        item("Geometric model", owner.map(|owner| format!("SHA-256 {}", hex(&owner.model_sha256)))),
        MetaItem::file("Residuals", &data.file, Some(&hex(&data.sha256))),
        item("Seed", Some(file.seed.to_string())),
        item("Trained on", Some(record.device.clone())),
    ];
    if !record.inputs.is_empty() {
        items.push(item("Inputs", Some(record.inputs.join(" "))));
    }
    items.push(MetaItem::software(&file.software));
    items
}

fn answer(record: &TrainingRecord) -> Section {
    let recommended = &record.recommendation;
    // The title names it.
    let text = match (recommended.method == ZERO, recommended.method == record.kind) {
        (false, true) => format!("{}.", capital(&recommended.why)),
        _ => format!("{}: {}.", recommended.method, recommended.why),
    };
    let text = in_words(&text);
    match (recommended.method == ZERO, recommended.method == record.kind) {
        _ if recommended.method.ends_with(POSITION_ALONE) => {
            callout(Tone::Warning, "Held-out data do not show that the further inputs help", &text)
        }
        (true, _) => callout(Tone::Bad, "Held-out data speak for no residual model", &text),
        (false, true) => callout(Tone::Good, &format!("Held-out data speak for {}", in_words(&record.kind)), &text),
        (false, false) => {
            callout(Tone::Warning, &format!("Made: {}; held-out data speak for another", in_words(&record.kind)), &text)
        }
    }
}

fn of<'a>(record: &'a TrainingRecord, method: &str) -> Option<&'a HeldOutScores> {
    record.held_out.iter().find(|scores| scores.method == method)
}

fn figures(record: &TrainingRecord) -> Section {
    let (zero, made) = (of(record, ZERO), of(record, &record.kind));
    let rms = |scores: Option<&HeldOutScores>| scores.map(|s| Quantity::result(s.scores.mse_um2.sqrt()));
    let worst = |scores: Option<&HeldOutScores>| scores.map(|s| Quantity::result(s.scores.worst_um));
    let figure = |label: &str, before, value, unit: &str, detail: &str| KeyFigure {
        label: label.to_owned(),
        before,
        value,
        unit: unit.to_owned(),
        detail: Some(detail.to_owned()),
        tone: Tone::Neutral,
    };
    let coverage = made.and_then(|scores| scores.coverage_95).map(|share| Quantity::new(share * 100.0, 1));
    Section::KeyFigures(KeyFigures {
        title: "Held out".to_owned(),
        figures: vec![
            figure(
                "Residual on data held out, rms a component",
                rms(zero),
                rms(made),
                "µm",
                "without and with the model",
            ),
            figure("Worst point held out", worst(zero), worst(made), "µm", "length of the vector"),
            figure("Within the 95 % interval", None, coverage, "%", "components held out; 95 is right"),
        ],
    })
}

fn methods(record: &TrainingRecord) -> Section {
    let row = |scores: &HeldOutScores| {
        let figures = &scores.scores;
        vec![
            Cell::text(in_words(&scores.method)),
            Cell::result(Some(figures.mse_um2)),
            Cell::result(Some(figures.mae_um)),
            Cell::result(Some(figures.error_95_um)),
            Cell::result(Some(figures.worst_um)),
            Cell::maybe(scores.coverage_95.map(|share| share * 100.0), 1),
            Cell::count(scores.points),
        ]
    };
    Section::Table(TableSection {
        title: "Figures by method".to_owned(),
        note: Some(
            "Errors of predictions. The same folds for all; a point is predicted by models that saw none of its block."
                .to_owned(),
        ),
        columns: vec![
            Column::text("method"),
            Column::number("mean square", "µm²"),
            Column::number("mean absolute", "µm"),
            Column::number("95 % error", "µm"),
            Column::number("worst", "µm"),
            Column::number("within 95 % interval", "%"),
            Column::number("points", "1"),
        ],
        rows: record.held_out.iter().map(row).collect(),
        total_rows: None,
    })
}

/// Predicted over measured residual at points that the model did not learn from, one panel a component.
fn scatter(trained: &Trained, data: &Data) -> Section {
    let measured_m = data.field.errors_m();
    let panel = |d: usize| {
        let points = trained.held_out.iter().filter_map(|p| Some((measured_m.get(p.index)?[d], p.predicted_m[d])));
        let points: Vec<_> = points.map(|(measured, predicted)| (measured * 1e6, predicted * 1e6)).collect();
        let ends = points.iter().flat_map(|(measured, predicted)| [*measured, *predicted]);
        let (low, high) = ends.fold((0.0_f64, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
        LinePanel {
            title: format!("component {}", AXES[d]),
            x: Axis::new("measured", "µm"),
            y: Axis::new("predicted", "µm"),
            curves: vec![
                Curve {
                    name: "equal".to_owned(),
                    style: CurveStyle::Reference,
                    x: vec![low, high],
                    y: vec![Some(low), Some(high)],
                    also: None,
                    half_width: None,
                },
                Curve {
                    name: "held out".to_owned(),
                    style: CurveStyle::Points(1),
                    x: points.iter().map(|p| p.0).collect(),
                    y: points.iter().map(|p| Some(p.1)).collect(),
                    also: None,
                    half_width: None,
                },
            ],
        }
    };
    Section::LinePlot(LinePlot {
        title: "Predicted over measured".to_owned(),
        note: Some("Points held out; on the dashed line a prediction is right.".to_owned()),
        columns: 3,
        band_name: None,
        panels: (0..3).map(panel).collect(),
    })
}

/// Loss curves: one panel a kind of network.
fn losses(record: &TrainingRecord) -> Section {
    let mut kinds: Vec<&str> = record.curves.iter().map(|curve| curve.kind.as_str()).collect();
    kinds.dedup();
    let panel = |kind: &&str| {
        let own = record.curves.iter().filter(|curve| curve.kind == *kind);
        let curve = |name: &str, style, losses: &[f64], first: usize| Curve {
            name: name.to_owned(),
            style,
            x: (first..first + losses.len()).map(|epoch| epoch as f64).collect(),
            y: losses.iter().map(|loss| loss.is_finite().then_some(*loss)).collect(),
            also: None,
            half_width: None,
        };
        LinePanel {
            title: in_words(kind),
            x: Axis::new("epoch", "1"),
            y: Axis::new("mean squared error", "units of the network²"),
            curves: own
                .flat_map(|c| {
                    [
                        curve("training", CurveStyle::Line(TRAINING), &c.training_loss, 1),
                        // The first is that before any step.
                        curve("validation", CurveStyle::Line(VALIDATION), &c.validation_loss, 0),
                    ]
                })
                .collect(),
        }
    };
    Section::LinePlot(LinePlot {
        title: "Loss".to_owned(),
        note: Some("One pair of curves a member; the parameters of the best validation loss are kept.".to_owned()),
        columns: kinds.len().clamp(1, 2),
        band_name: None,
        panels: kinds.iter().map(panel).collect(),
    })
}

/// The residuals that were learnt from, from above, one panel a component.
fn residuals(data: &Data, places_m: &[Vector3<f64>]) -> Section {
    let points = places_m.iter().zip(data.field.errors_m());
    let panel = |d: usize| MapPanel {
        title: format!("component {}", AXES[d]),
        x: Axis::new("X", "mm"),
        y: Axis::new("Y", "mm"),
        points: points
            .clone()
            .map(|(point, residual)| MapPoint { x: point.x * 1e3, y: point.y * 1e3, value: residual[d] * 1e6 })
            .collect(),
        of: Vec::new(),
    };
    Section::ResidualMap(ResidualMap {
        title: "What geometry leaves".to_owned(),
        note: Some("Measured residuals, actual − corrected, seen along Z.".to_owned()),
        value: Axis::new("residual", "µm"),
        limit: None,
        panels: (0..3).map(panel).collect(),
    })
}
