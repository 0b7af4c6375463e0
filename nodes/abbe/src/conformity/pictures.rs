//! Pictures of acceptance tests: errors against length with their limits, deviations along axes.
//!
//! Place in the flow: sections of the report. mm and µm.

use super::um;
use abbe_conformity::length::{LengthErrors, LengthSet};
use abbe_conformity::positioning::{AxisFigures, DirectionFigures, TargetFigures};
use abbe_conformity::{MaximumPermissibleError, SupportedLimit};
use abbe_report::{Axis, Curve, CurveStyle, LinePanel, LinePlot, Section, State};

/// Colour of the tightest limit: beside the seven lines of the test, whose points have those before it.
const TIGHTEST: u8 = 8;
/// Lines measure the same lengths: their points are drawn side by side, so far from each other (px).
const BESIDE_PX: i32 = 5;
/// Steps in which a limit is drawn: one with a cap has a bend.
const LIMIT_STEPS: usize = 40;

/// All errors as points by measuring line, the limit on both sides, and the tightest limit that holds them.
pub(crate) fn errors_against_length(
    title: &str,
    errors: &LengthErrors,
    limit: Option<&MaximumPermissibleError>,
    tightest: &SupportedLimit,
) -> Section {
    let longest_m = errors.lines.iter().map(|line| line.longest_m).fold(0.0, f64::max);
    let mut curves: Vec<Curve> =
        errors.lines.iter().enumerate().map(|(k, line)| points(errors, &line.line, (k, errors.lines.len()))).collect();
    let tightest_at = |length_m: f64| tightest.at_m(length_m);
    curves.extend(both_sides("tightest A + L/K", CurveStyle::Line(TIGHTEST), longest_m, &tightest_at));
    if let Some(limit) = limit {
        curves.extend(limit_lines(limit, longest_m));
    }
    let note = match errors.lines.len() {
        1 => "Error of length measurement = measured − calibrated; every single measurement is a point.",
        _ => {
            "Error of length measurement = measured − calibrated; every single measurement is a point. Lines that share a length have \
             their points side by side, about that length."
        }
    };
    Section::LinePlot(LinePlot {
        title: title.to_owned(),
        note: Some(note.to_owned()),
        columns: 1,
        band_name: None,
        panels: vec![LinePanel {
            title: errors.test.symbol(),
            x: Axis::new("calibrated length", "mm"),
            y: Axis::new("error", "µm"),
            curves,
        }],
    })
}

/// Errors of all lines as they are before and after a correction, each state in its colour, and the limit.
pub(crate) fn states_against_length(
    stages: &[(&str, State, &LengthErrors)],
    limit: Option<&MaximumPermissibleError>,
) -> Section {
    let lines = stages.iter().flat_map(|(_, _, errors)| &errors.lines);
    let longest_m = lines.map(|line| line.longest_m).fold(0.0, f64::max);
    let mut curves: Vec<Curve> = stages
        .iter()
        .map(|(title, state, errors)| Curve {
            name: (*title).to_owned(),
            style: CurveStyle::PointsOf(*state),
            ..measurements(errors.sets.iter())
        })
        .collect();
    if let Some(limit) = limit {
        curves.extend(limit_lines(limit, longest_m));
    }
    Section::LinePlot(LinePlot {
        title: "Errors against length, before and after correction".to_owned(),
        note: Some(
            "Every single measurement of every line is a point; the chapters below tell the lines apart.".to_owned(),
        ),
        columns: 1,
        band_name: None,
        panels: vec![LinePanel {
            title: String::new(),
            x: Axis::new("calibrated length", "mm"),
            y: Axis::new("error", "µm"),
            curves,
        }],
    })
}

fn limit_lines(limit: &MaximumPermissibleError, longest_m: f64) -> [Curve; 2] {
    both_sides("limit", CurveStyle::Reference, longest_m, &|length_m| limit.at(length_m).metres())
}

/// Every measurement of some gauges: error over length.
fn measurements<'a>(sets: impl Iterator<Item = &'a LengthSet>) -> Curve {
    let all: Vec<(f64, f64)> =
        sets.flat_map(|set| set.errors.iter().map(|e| (set.calibrated_m * 1e3, um(e.metres())))).collect();
    Curve {
        name: String::new(),
        style: CurveStyle::Points(1),
        x: all.iter().map(|(x, _)| *x).collect(),
        y: all.iter().map(|(_, y)| Some(*y)).collect(),
        also: None,
        half_width: None,
    }
}

fn points(errors: &LengthErrors, line: &str, (series, all_lines): (usize, usize)) -> Curve {
    Curve {
        name: line.to_owned(),
        style: CurveStyle::PointsBeside(series as u8 + 1, beside_px(series, all_lines)),
        ..measurements(errors.sets.iter().filter(|set| set.line == line))
    }
}

/// Where the points of a line stand among those of all lines, about the middle; many lines move closer.
fn beside_px(series: usize, all_lines: usize) -> i8 {
    let (place, last) = (series as i32, all_lines.max(1) as i32 - 1);
    let apart_px = if last > 8 { 40.0 / f64::from(last) } else { f64::from(BESIDE_PX) };
    (apart_px * (f64::from(place) - f64::from(last) / 2.0)) as i8
}

fn both_sides(name: &str, style: CurveStyle, longest_m: f64, at_m: &dyn Fn(f64) -> f64) -> [Curve; 2] {
    [1.0, -1.0].map(|side| {
        let lengths_m = (0..=LIMIT_STEPS).map(|k| longest_m * k as f64 / LIMIT_STEPS as f64);
        let (x, y) = lengths_m.map(|l| (l * 1e3, Some(side * um(at_m(l))))).unzip();
        Curve { name: name.to_owned(), style, x, y, also: None, half_width: None }
    })
}

/// Mean deviation and ± 2 s by direction, an axis or diagonal a panel.
pub(crate) fn positioning(axes: &[AxisFigures]) -> Option<Section> {
    let panel = |axis: &AxisFigures| LinePanel {
        title: axis.axis.clone(),
        x: Axis::new("target", "mm"),
        y: Axis::new("deviation (actual − target)", "µm"),
        curves: vec![
            direction(axis, "approach +", CurveStyle::APPROACH_POSITIVE, |target| target.up),
            direction(axis, "approach −", CurveStyle::APPROACH_NEGATIVE, |target| target.down),
        ],
    };
    (!axes.is_empty()).then(|| {
        Section::LinePlot(LinePlot {
            title: "Positioning".to_owned(),
            note: Some("Mean of the cycles with ± 2 standard deviations of one approach.".to_owned()),
            columns: axes.len().min(2),
            band_name: Some("± 2 standard deviations".to_owned()),
            panels: axes.iter().map(panel).collect(),
        })
    })
}

fn direction(
    axis: &AxisFigures,
    name: &str,
    style: CurveStyle,
    pick: fn(&TargetFigures) -> Option<DirectionFigures>,
) -> Curve {
    Curve {
        name: name.to_owned(),
        style,
        x: axis.targets.iter().map(|t| t.target_m * 1e3).collect(),
        y: axis.targets.iter().map(|t| pick(t).map(|d| um(d.mean_m))).collect(),
        also: None,
        half_width: Some(axis.targets.iter().map(|t| Some(2.0 * um(pick(t)?.deviation_m?))).collect()),
    }
}
