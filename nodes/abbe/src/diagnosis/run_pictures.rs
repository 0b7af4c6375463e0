//! What the pictures of positioning runs show: errors by target and direction, and what is left of them before and after what was found.
//!
//! Place in the flow: the rows of the file and the study's answer in, sections of the report out (mm, µm).

use abbe_diagnose::study::runs::{Approach, PositionSummary, Run, positions};
use abbe_diagnose::study::{LeftOver, StudyDiagnosis};
use abbe_report::{Axis, Curve, CurveStyle, LinePanel, LinePlot, Section, State};
use std::collections::{BTreeMap, BTreeSet};

/// What was measured, and what is left of it where anything was found.
pub(super) fn sections(runs: &[Run], diagnosis: &StudyDiagnosis) -> Vec<Section> {
    let left = (!diagnosis.effects.is_empty()).then(|| left(runs, &diagnosis.left)).flatten();
    measured(&positions(runs)).into_iter().chain(left).collect()
}

/// Targets that differ by less are one (m).
const ONE_M: f64 = 1e-9;
/// Sum of what is left at each target and the number of runs there.
type Means = BTreeMap<i64, (f64, usize)>;

/// Mean of what is left by target, axis and direction: in the colours of before and after, approaches in − dashed.
fn left(runs: &[Run], rows: &[LeftOver]) -> Option<Section> {
    let axes: BTreeSet<&str> = rows.iter().map(|row| runs[row.row].axis.as_str()).collect();
    let panel = |axis: &str| {
        let curves = [State::Before, State::After].into_iter().flat_map(|state| {
            [Approach::Positive, Approach::Negative].map(|approach| curve(runs, rows, (axis, state, approach)))
        });
        LinePanel {
            title: format!("Axis {axis}"),
            x: Axis::new("target", "mm"),
            y: Axis::new("error less what is modelled", "µm"),
            curves: curves.filter(|curve| !curve.x.is_empty()).collect(),
        }
    };
    let panels: Vec<LinePanel> = axes.into_iter().map(panel).collect();
    (!panels.is_empty()).then(|| {
        Section::LinePlot(LinePlot {
            title: "Before and after what was found".to_owned(),
            note: Some("Mean over the cycles of what is left of each run, by target and direction.".to_owned()),
            columns: panels.len().min(2),
            band_name: None,
            panels,
        })
    })
}

fn curve(runs: &[Run], rows: &[LeftOver], (axis, state, approach): (&str, State, Approach)) -> Curve {
    let mut means = Means::new();
    for row in rows {
        let run = &runs[row.row];
        if run.axis == axis && run.approach == approach {
            let left_m = if state == State::Before { row.before_m } else { row.after_m };
            let (sum, count) = means.entry((run.target_m / ONE_M).round() as i64).or_default();
            *sum += left_m;
            *count += 1;
        }
    }
    let (word, sign) = (
        if state == State::Before { "before" } else { "after" },
        if approach == Approach::Positive { "approach +" } else { "approach −" },
    );
    Curve {
        name: format!("{word}, {sign}"),
        style: if approach == Approach::Positive { CurveStyle::LineOf(state) } else { CurveStyle::DashedOf(state) },
        x: means.keys().map(|place| *place as f64 * ONE_M * 1e3).collect(),
        y: means.values().map(|(sum, count)| Some(sum / *count as f64 * 1e6)).collect(),
        also: None,
        half_width: None,
    }
}

/// The position table as a picture: mean error and two standard deviations by target and direction, an axis a panel.
fn measured(positions: &[PositionSummary]) -> Option<Section> {
    let mut axes: Vec<&str> = positions.iter().map(|p| p.axis.as_str()).collect();
    axes.dedup();
    let panel = |axis: &str| {
        let own: Vec<&PositionSummary> = positions.iter().filter(|p| p.axis == axis).collect();
        let curve = |name: &str, style: CurveStyle, of: fn(&PositionSummary) -> (Option<f64>, Option<f64>)| Curve {
            name: name.to_owned(),
            style,
            x: own.iter().map(|p| p.target_m * 1e3).collect(),
            y: own.iter().map(|p| of(p).0.map(|m| m * 1e6)).collect(),
            also: None,
            half_width: Some(own.iter().map(|p| of(p).1.map(|m| 2.0 * m * 1e6)).collect()),
        };
        LinePanel {
            title: format!("Axis {axis}"),
            x: Axis::new("target", "mm"),
            y: Axis::new("error (actual − target)", "µm"),
            curves: vec![
                curve("approach +", CurveStyle::APPROACH_POSITIVE, |p| (p.mean_positive_m, p.deviation_positive_m)),
                curve("approach −", CurveStyle::APPROACH_NEGATIVE, |p| (p.mean_negative_m, p.deviation_negative_m)),
            ],
        }
    };
    let panels: Vec<LinePanel> = axes.iter().map(|axis| panel(axis)).collect();
    (!panels.is_empty()).then(|| {
        Section::LinePlot(LinePlot {
            title: "What was measured".to_owned(),
            note: Some(
                "Mean over the cycles; the band is ± 2 standard deviations of one approach (ISO 230-2).".to_owned(),
            ),
            columns: panels.len().min(2),
            band_name: Some("± 2 standard deviations".to_owned()),
            panels,
        })
    })
}
