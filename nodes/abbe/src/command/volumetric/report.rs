//! The page of `abbe volumetric`: largest error, map in planes of Z, diagonals with their bands.
//!
//! Place in the flow: last step; millimetres and micrometres, uncertainties k = 2.

use super::{ALIGNED, Answer, expanded_m, extreme, lower_bound};
use crate::next::Next;
use abbe_geometry::volumetric::{LinePoint, MapPoint};
use abbe_report::{
    Axis, Callout, CellMap, CellPanel, Curve, CurveStyle, KeyFigure, KeyFigures, LinePanel, LinePlot, MetaItem,
    Quantity, Report, Section, State, Tone, Vector, Vectors, digits,
};

/// Planes of Z shown, lowest to highest.
const PLANES: usize = 3;
/// Cells of a plane along each side at most: more cannot be read.
const CELLS: usize = 8;

/// The report.
pub(super) fn report(answer: &Answer, next: &Next) -> Report {
    let [x, y, z] = answer.offset_m.map(|v| digits::plain(v * 1e3, 1).replace('-', "−"));
    Report {
        title: format!("Volumetric error of {}", answer.machine),
        lead: Some(
            "Error = actual − indicated, as the model predicts it before correction, in the frame of the model: how the whole lies in it is in \
             the error."
                .to_owned(),
        ),
        identity: answer.who.clone(),
        next: Some(next.step()),
        meta: vec![
            MetaItem::file("Model", &answer.model_file, Some(&answer.model_sha256)),
            MetaItem::new("Offset of the tip", format!("X {x}, Y {y}, Z {z} mm")),
            MetaItem::new("Grid", format!("{0} × {0} × {0} points", answer.steps)),
            MetaItem::software(crate::pipeline::software()),
        ],
        main_plot: None,
        footer: Some(crate::pipeline::software()),
        sections: [key_figures(answer)]
            .into_iter()
            .chain(outside(answer))
            .chain(answer.doubts.iter().map(|doubt| doubtful(doubt)))
            .chain([map(answer), vectors(answer), diagonals(answer)])
            .collect(),
    }
}

fn doubtful(doubt: &str) -> Section {
    Section::Callout(Callout {
        tone: Tone::Warning,
        title: "What speaks against this model".to_owned(),
        text: doubt.to_owned(),
    })
}

/// How much of the map is outside of what the model was identified from: the answer is worth no more than that.
fn outside(answer: &Answer) -> Option<Section> {
    let (outside, all) = (answer.extrapolated(), answer.map.len());
    if answer.all_lack() {
        return Some(Section::Callout(Callout {
            tone: Tone::Warning,
            title: "With its effects in the middle".to_owned(),
            text: "The model's effects read logged quantities, and a map has none: each effect stands in the middle of what it read in the campaign. \
                   The uncertainty holds what it does over that range."
                .to_owned(),
        }));
    }
    (outside > 0).then(|| {
        Section::Callout(Callout {
            tone: if outside == all { Tone::Bad } else { Tone::Warning },
            title: "Outside of what was measured".to_owned(),
            text: format!(
                "{outside} of {all} points lie outside of the volume or the offsets that the model was identified from, or lack \
                 covariates: what is shown there is extrapolated, and its uncertainty is a lower bound."
            ),
        })
    })
}

fn key_figures(answer: &Answer) -> Section {
    let figure = |label: &str, value_m: Option<f64>, u_m: Option<f64>, detail: Option<String>| KeyFigure {
        label: label.to_owned(),
        value: value_m.map(|v_m| Quantity::with(v_m * 1e6, u_m.map(|u_m| u_m * 1e6))),
        unit: "µm".to_owned(),
        detail,
        ..KeyFigure::default()
    };
    let place = |reading_m: [f64; 3]| {
        let [x, y, z] = reading_m.map(|v| v * 1e3);
        format!("at X {x:.0}, Y {y:.0}, Z {z:.0} mm")
    };
    let largest = answer.largest();
    let mut figures = vec![
        figure(
            "largest error",
            largest.map(|p| p.error_m.norm()),
            largest.map(expanded_m),
            largest
                .map(|p| format!("± {} µm (k = 2), {}", digits::uncertainty(expanded_m(p) * 1e6), place(p.reading_m))),
        ),
        figure(
            "rms over the grid",
            Some(answer.rms_m()),
            None,
            Some(format!("{} points extrapolated", answer.extrapolated())),
        ),
    ];
    if let Some((rms_m, largest_m)) = answer.aligned_m() {
        let detail =
            format!("rms {} µm; without the shift and turn of the whole, {ALIGNED}", digits::result(rms_m * 1e6));
        figures.push(figure("largest error, aligned", Some(largest_m), None, Some(detail)));
    }
    figures.extend(answer.diagonals.iter().map(|(diagonal, points)| {
        let (value, u_m) = extreme(points).unzip();
        figure(
            &format!("diagonal {}", diagonal.name()),
            value,
            u_m,
            u_m.map(|u_m| {
                format!("± {} µm (k = 2), largest on it{}", digits::uncertainty(u_m * 1e6), lower_bound(points))
            }),
        )
    }));
    Section::KeyFigures(KeyFigures { title: "At a glance".to_owned(), figures })
}

/// Largest error in each cell of X and Y, for the lowest, middle and highest plane of Z.
fn map(answer: &Answer) -> Section {
    let planes = (0..PLANES).map(|k| k * (answer.steps - 1) / (PLANES - 1));
    Section::CellMap(CellMap {
        title: "Volumetric error in planes of Z".to_owned(),
        note: Some("The largest length of the error vector in each cell, in µm; all points are in map.csv.".to_owned()),
        value: Axis::new("largest error", "µm"),
        is_uncertainty: false,
        columns: PLANES,
        panels: planes.map(|plane| panel(answer, plane)).collect(),
    })
}

/// The error of every point as a vector.
fn vectors(answer: &Answer) -> Section {
    let point = |point: &MapPoint| Vector {
        at: point.reading_m.map(|v| v * 1e3),
        states: [Some((point.error_m * 1e6).into()), None],
    };
    Section::Vectors(Vectors {
        title: "Error vectors in the volume".to_owned(),
        note: Some("Each line runs from a point of the grid along its error vector.".to_owned()),
        position_unit: "mm".to_owned(),
        vector_unit: "µm".to_owned(),
        vector_in_position: 1e-3,
        volume_min: answer.bounds_m.map(|(lower, _)| lower * 1e3),
        volume_max: answer.bounds_m.map(|(_, upper)| upper * 1e3),
        states: vec![("before correction".to_owned(), State::Before)],
        points: answer.map.iter().map(point).collect(),
    })
}

fn panel(answer: &Answer, plane: usize) -> CellPanel {
    let (steps, cells) = (answer.steps, CELLS.min(answer.steps - 1));
    let at = |axis: usize, share: f64| {
        let (lower_m, upper_m) = answer.bounds_m[axis];
        (lower_m + (upper_m - lower_m) * share) * 1e3
    };
    let edges = |axis: usize| (0..=cells).map(|k| at(axis, k as f64 / cells as f64)).collect();
    let mut values: Vec<Option<f64>> = vec![None; cells * cells];
    // A point on an edge belongs to the cell above it, the last one to the last cell.
    let cell = |step: usize| (step * cells / (steps - 1)).min(cells - 1);
    for (k, point) in answer.map[plane * steps * steps..(plane + 1) * steps * steps].iter().enumerate() {
        let entry = &mut values[cell(k / steps) * cells + cell(k % steps)];
        let error_um = point.error_m.norm() * 1e6;
        *entry = Some(entry.map_or(error_um, |largest| largest.max(error_um)));
    }
    CellPanel {
        title: format!("Z = {:.0} mm", at(2, plane as f64 / (steps - 1) as f64)),
        x: Axis::new("X", "mm"),
        y: Axis::new("Y", "mm"),
        x_edges: edges(0),
        y_edges: edges(1),
        values,
        state: Some(State::Before),
    }
}

fn diagonals(answer: &Answer) -> Section {
    let panels = answer.diagonals.iter().map(|(diagonal, points)| {
        let mut curves = vec![predicted(points)];
        for comparison in answer.comparisons.iter().filter(|c| c.measured.diagonal == *diagonal) {
            let targets = &comparison.measured.targets;
            curves.push(Curve {
                name: "measured".to_owned(),
                style: CurveStyle::Points(3),
                x: targets.iter().map(|t| t.distance_m * 1e3).collect(),
                y: targets.iter().map(|t| Some(t.deviation_m * 1e6)).collect(),
                also: None,
                half_width: None,
            });
        }
        LinePanel { title: diagonal.name(), x: Axis::new("distance", "mm"), y: Axis::new("deviation", "µm"), curves }
    });
    Section::LinePlot(LinePlot {
        title: "Positioning along the body diagonals".to_owned(),
        note: Some(
            "Actual minus nominal distance from the first target; P and N are the signs of the motion of X, Y and Z."
                .to_owned(),
        ),
        columns: 2,
        band_name: Some("k = 2".to_owned()),
        panels: panels.collect(),
    })
}

fn predicted(points: &[LinePoint]) -> Curve {
    Curve {
        name: "model".to_owned(),
        style: CurveStyle::LineOf(State::Before),
        x: points.iter().map(|p| p.distance_m * 1e3).collect(),
        y: points.iter().map(|p| Some(p.deviation_m * 1e6)).collect(),
        also: None,
        half_width: Some(points.iter().map(|p| Some(2e6 * p.u_m)).collect()),
    }
}
