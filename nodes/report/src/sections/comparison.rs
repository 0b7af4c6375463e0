//! Error before and after, the main plot: boxes by axis on the left, cumulative share on the right. A state between the
//! two, where there is one, has a colour of its own.

use serde::{Deserialize, Serialize};

use super::BoxGroup;
use super::boxes::{draw_box_legend, draw_boxes};
use crate::digits;
use crate::error::ReportError;
use crate::frame::{Area, Labels, WIDTH_PX, begin_panel, draw_empty, end_panel};
use crate::scale::{Scale, extent};
use crate::stats::{BoxStats, quantile_sorted, sorted};
use crate::svg::{Anchor, Drawing, Svg};
use crate::text::{fixed, with_unit};

/// From this ratio of largest to smallest on, the axis is logarithmic.
const LOG_RATIO: f64 = 20.0;
/// Quantiles drawn of a cumulative curve.
const QUANTILES: usize = 201;
/// Class of the state before, and of the last state.
const BEFORE: &str = "B";
const AFTER: &str = "A";
/// Class of the state between them.
const BETWEEN: &str = "M";

/// Magnitudes of one component in each state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ComparisonGroup {
    /// Name of the component: `x`, `y`, `z`, `3-D`.
    pub label: String,
    /// Magnitudes of each state, in the order of [`Comparison::states`] and in the unit of the comparison; empty where not
    /// measured.
    pub states: Vec<Vec<f64>>,
}

/// Error before and after by component; the last group is also shown as cumulative share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Title of the figure.
    pub title: String,
    /// Sentence under the title.
    pub note: Option<String>,
    /// What is compared, e.g. `error magnitude`.
    pub label: String,
    /// Its unit.
    pub unit: String,
    /// Names of the states, two or three: before, one between, after.
    pub states: Vec<String>,
    /// Components from left to right.
    pub groups: Vec<ComparisonGroup>,
}

impl Comparison {
    /// Refuses a comparison without groups, with a group of other states, and negative magnitudes.
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        if self.groups.is_empty() || !(2..=3).contains(&self.states.len()) {
            let what = format!("{} groups and {} states", self.groups.len(), self.states.len());
            return Err(ReportError::shape(&self.title, what, "give a group or more, and two or three states"));
        }
        if let Some(group) = self.groups.iter().find(|g| g.states.len() != self.states.len()) {
            let what = format!("group '{}' has {} states of {}", group.label, group.states.len(), self.states.len());
            return Err(ReportError::shape(&self.title, what, "give one list a state, empty where not measured"));
        }
        match self.groups.iter().find(|g| g.states.iter().flatten().any(|&v| v < 0.0)) {
            Some(group) => {
                let what = format!("group '{}' has a negative magnitude", group.label);
                Err(ReportError::shape(&self.title, what, "pass magnitudes, not signed errors"))
            }
            None => Ok(()),
        }
    }

    /// Classes of the states.
    fn classes(&self) -> Vec<String> {
        let last = self.states.len().saturating_sub(1);
        let class = |index| match index {
            0 => BEFORE,
            index if index == last => AFTER,
            _ => BETWEEN,
        };
        (0..self.states.len()).map(|index| class(index).to_owned()).collect()
    }

    fn boxes(&self) -> Vec<BoxGroup> {
        let boxes = |g: &ComparisonGroup| g.states.iter().map(|values| BoxStats::of(values)).collect();
        self.groups.iter().map(|g| BoxGroup { label: g.label.clone(), boxes: boxes(g) }).collect()
    }

    /// Draws the figure.
    pub(crate) fn draw(&self) -> Result<Drawing, ReportError> {
        self.draw_with_height(330.0)
    }

    /// Draws the figure with plotting areas of a given height, px.
    pub(crate) fn draw_with_height(&self, height: f64) -> Result<Drawing, ReportError> {
        let left = Area { left: 62.0, top: 58.0, width: 540.0, height };
        let right = Area { left: 680.0, width: WIDTH_PX - 680.0 - 16.0, ..left };
        let mut svg = Svg::new(WIDTH_PX, left.bottom() + 46.0);
        let series: Vec<_> = self.classes().into_iter().zip(self.states.iter().cloned()).collect();
        draw_box_legend(&mut svg, (left.left, 14.0), &series);
        self.draw_boxes(&mut svg, left);
        self.draw_cumulative(&mut svg, right);
        svg.finish(&self.title)
    }

    fn draw_boxes(&self, svg: &mut Svg, area: Area) {
        let boxes = self.boxes();
        let values = || boxes.iter().flat_map(|g| g.boxes.iter().flatten());
        let range = extent(values().flat_map(|b| [b.p05, b.max]));
        let y = magnitude_scale(range, area.bottom(), area.top);
        let labels = Labels {
            title: "By component".to_owned(),
            y: with_unit(&self.label, &self.unit),
            y_ticks: 7,
            ..Labels::default()
        };
        draw_boxes(svg, area, &y, &labels, &boxes, &self.classes(), &self.unit);
    }

    fn draw_cumulative(&self, svg: &mut Svg, area: Area) {
        let Some(group) = self.groups.last() else { return };
        let samples: Vec<_> = group.states.iter().map(|values| sorted(values)).collect();
        let range = extent(samples.iter().flat_map(|s| [s.first(), s.last()].into_iter().flatten().copied()));
        let x = magnitude_scale(range, area.left, area.right());
        let y = Scale::exact(0.0, 100.0, area.bottom(), area.top);
        let labels = Labels {
            title: format!("Cumulative share, {}", group.label),
            x: with_unit(&format!("{} {}", group.label, self.label), &self.unit),
            y: "share of points / %".to_owned(),
            x_ticks: 6,
            y_ticks: 5,
        };
        begin_panel(svg, area, &x, &y, &labels);
        let classes = self.classes();
        let of_states = || samples.iter().zip(&classes).enumerate();
        for (number, (sample, class)) in of_states() {
            let curve: Vec<_> = (0..QUANTILES)
                .map(|i| i as f64 / (QUANTILES - 1) as f64)
                .filter_map(|p| quantile_sorted(sample, p).map(|v| (x.map(v), y.map(100.0 * p))))
                .collect();
            svg.name(self.states.get(number).map(String::as_str));
            svg.path(&format!("ln l{class}"), &curve, false);
        }
        // Above all curves, and each a line lower than the one before: those of curves that are near each other stay apart.
        for (number, (sample, class)) in of_states() {
            svg.name(self.states.get(number).map(String::as_str));
            self.draw_p95(svg, (sample.as_slice(), class.as_str()), (&x, &y), 4.0 + 14.0 * number as f64);
        }
        end_panel(svg);
        if samples.iter().all(Vec::is_empty) {
            draw_empty(svg, area);
        }
    }

    /// Marks the 95 % point of a cumulative curve with its value.
    fn draw_p95(&self, svg: &mut Svg, (sample, class): (&[f64], &str), (x, y): (&Scale, &Scale), below: f64) {
        let Some(p95) = quantile_sorted(sample, 0.95) else { return };
        let at = (x.map(p95), y.map(95.0));
        svg.circle(&format!("f{class}"), at, 3.4, None);
        let label = format!("95 %: {} {}", fixed(p95, digits::of_result(p95)), self.unit);
        // Left of the curve at the height of the label's foot, so that the curve does not run through it.
        let percent_px = (y.map(94.0) - at.1).abs().max(f64::MIN_POSITIVE);
        let foot = (95.0 - below / percent_px).max(0.0) / 100.0;
        let left = quantile_sorted(sample, foot).map_or(at.0, |value| x.map(value).min(at.0));
        svg.text(&format!("small halo f{class}"), (left - 5.0, at.1 + below), Anchor::End, &label);
    }
}

/// Logarithmic where the magnitudes span decades and none is zero, else linear from zero.
fn magnitude_scale(range: Option<(f64, f64)>, from: f64, to: f64) -> Scale {
    match range {
        Some((low, high)) if low > 0.0 && high / low > LOG_RATIO => Scale::log(low, high, from, to),
        Some((_, high)) if high > 0.0 => Scale::exact(0.0, 1.05 * high, from, to),
        _ => Scale::exact(0.0, 1.0, from, to),
    }
}
