//! Pictures of acceptance tests: errors against length with their limits, deviations along axes.
//!
//! Place in the flow: sections of the report. mm and µm.

use super::um;
use abbe_conformity::length::LengthErrors;
use abbe_conformity::positioning::{AxisFigures, DirectionFigures, TargetFigures};
use abbe_conformity::{MaximumPermissibleError, SupportedLimit};
use abbe_report::{Axis, Curve, CurveStyle, LinePanel, LinePlot, Section};

/// Colour of the tightest limit: beside the seven lines of the test, whose points have those before it.
const TIGHTEST: u8 = 8;
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
        errors.lines.iter().enumerate().map(|(k, line)| points(errors, &line.line, k)).collect();
    let tightest_at = |length_m: f64| tightest.at_m(length_m);
    curves.extend(both_sides("tightest A + L/K", CurveStyle::Line(TIGHTEST), longest_m, &tightest_at));
    if let Some(limit) = limit {
        let at = |length_m: f64| limit.at(length_m).metres();
        curves.extend(both_sides("limit", CurveStyle::Reference, longest_m, &at));
    }
    Section::LinePlot(LinePlot {
        title: title.to_owned(),
        note: Some(
            "Error of length measurement = measured − calibrated; every single measurement is a point.".to_owned(),
        ),
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

fn points(errors: &LengthErrors, line: &str, series: usize) -> Curve {
    let own = errors.sets.iter().filter(|set| set.line == line);
    let all: Vec<(f64, f64)> =
        own.flat_map(|set| set.errors.iter().map(|e| (set.calibrated_m * 1e3, um(e.metres())))).collect();
    Curve {
        name: line.to_owned(),
        style: CurveStyle::Points(series as u8 + 1),
        x: all.iter().map(|(x, _)| *x).collect(),
        y: all.iter().map(|(_, y)| Some(*y)).collect(),
        half_width: None,
    }
}

fn both_sides(name: &str, style: CurveStyle, longest_m: f64, at_m: &dyn Fn(f64) -> f64) -> [Curve; 2] {
    [1.0, -1.0].map(|side| {
        let lengths_m = (0..=LIMIT_STEPS).map(|k| longest_m * k as f64 / LIMIT_STEPS as f64);
        let (x, y) = lengths_m.map(|l| (l * 1e3, Some(side * um(at_m(l))))).unzip();
        Curve { name: name.to_owned(), style, x, y, half_width: None }
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
        half_width: Some(axis.targets.iter().map(|t| pick(t).map(|d| 2.0 * um(d.deviation_m))).collect()),
    }
}
