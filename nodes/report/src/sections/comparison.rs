//! Error before and after, the main plot: boxes by axis on the left, cumulative share on the right. A state between the
//! two, where there is one, has a colour of its own.

use serde::{Deserialize, Serialize};

use super::boxes::{draw_box_legend, draw_boxes};
use super::{BoxGroup, State};
use crate::digits;
use crate::error::ReportError;
use crate::frame::{Area, Labels, TITLE_ABOVE_PX, WIDTH_PX, begin_panel, draw_empty, end_panel};
use crate::scale::{Scale, extent};
use crate::stats::{BoxStats, quantile_sorted, sorted};
use crate::svg::{Anchor, Drawing, Svg};
use crate::text::{fixed, significant, with_unit};

/// From this ratio of largest to smallest on, the axis is logarithmic.
const LOG_RATIO: f64 = 20.0;
/// Quantiles drawn of a cumulative curve.
const QUANTILES: usize = 201;
/// Radius of the mark of a quantile; of its label height, line, width of a character at most, and distance from a curve, px.
const MARK_PX: f64 = 3.4;
const TEXT_PX: f64 = 9.0;
const LINE_PX: f64 = 14.0;
const LABEL_PX: f64 = 5.8;
const GAP_PX: f64 = 5.0;

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
        let count = self.states.len();
        (0..count).map(|index| State::of(index, count).class().to_owned()).collect()
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
        let Some(whole) = boxes.last() else { return };
        let rms: Vec<String> = whole.boxes.iter().flatten().map(|of| significant(of.rms, 3)).collect();
        let text = format!("{}, rms: {} {}", whole.label, rms.join(" → "), self.unit);
        svg.text("strong", (area.right(), area.top - TITLE_ABOVE_PX), Anchor::End, &text);
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
        let curves: Vec<Vec<(f64, f64)>> = samples.iter().map(|sample| cumulative(sample, (&x, &y))).collect();
        let classes = self.classes();
        for (number, (curve, class)) in curves.iter().zip(&classes).enumerate() {
            svg.name(self.states.get(number).map(String::as_str));
            svg.path(&format!("ln l{class}"), curve, false);
        }
        let p95: Vec<_> = samples.iter().map(|sample| quantile_sorted(sample, 0.95)).collect();
        let marks: Vec<_> = p95.iter().flatten().map(|value| (x.map(*value), y.map(95.0))).collect();
        let mut places = Places { within: area, curves: &curves, marks, taken: Vec::new() };
        for (number, (value, class)) in p95.iter().zip(&classes).enumerate() {
            let Some(value) = value else { continue };
            let at = (x.map(*value), y.map(95.0));
            let text = format!("95 %: {} {}", fixed(*value, digits::of_result(*value)), self.unit);
            svg.name(self.states.get(number).map(String::as_str));
            svg.circle(&format!("f{class}"), at, MARK_PX, None);
            let (point, anchor) = places.take(number, at, &text);
            svg.text(&format!("small halo f{class}"), point, anchor, &text);
        }
        end_panel(svg);
        if samples.iter().all(Vec::is_empty) {
            draw_empty(svg, area);
        }
    }
}

/// Cumulative share of sorted values as a curve, px.
fn cumulative(sample: &[f64], (x, y): (&Scale, &Scale)) -> Vec<(f64, f64)> {
    let shares = (0..QUANTILES).map(|i| i as f64 / (QUANTILES - 1) as f64);
    shares.filter_map(|p| quantile_sorted(sample, p).map(|v| (x.map(v), y.map(100.0 * p)))).collect()
}

/// Where labels of curves that rise to the right may stand: none touches a curve, a mark or another label.
struct Places<'a> {
    within: Area,
    curves: &'a [Vec<(f64, f64)>],
    marks: Vec<(f64, f64)>,
    taken: Vec<Area>,
}

impl Places<'_> {
    /// Foot and anchor of a label of this curve: as near to the mark as there is room, left of the curve before right of it.
    fn take(&mut self, curve: usize, at: (f64, f64), text: &str) -> ((f64, f64), Anchor) {
        let width = LABEL_PX * text.chars().count() as f64;
        let rows = ((self.within.bottom() - at.1) / LINE_PX) as usize;
        let lefts = (0..rows.max(1)).flat_map(|row| [(row, false), (row, true)]);
        let places = lefts.map(|(row, is_right)| {
            let foot = at.1 + 4.0 + LINE_PX * row as f64;
            // At its foot the curve is farthest left, at its head farthest right.
            let edge = self.edge(curve, (foot - TEXT_PX - GAP_PX, foot + GAP_PX), is_right).unwrap_or(at.0);
            let mark = if row == 0 { MARK_PX } else { 0.0 };
            let left = if is_right { edge.max(at.0 + mark) + GAP_PX } else { edge.min(at.0 - mark) - GAP_PX - width };
            (Area { left, top: foot - TEXT_PX, width, height: TEXT_PX }, is_right)
        });
        // Where there is room nowhere it stands where it belongs.
        let all: Vec<(Area, bool)> = places.collect();
        let free = all.iter().find(|(place, _)| self.is_free(*place)).or(all.first());
        let Some(&(place, is_right)) = free else { return (at, Anchor::End) };
        self.taken.push(place);
        match is_right {
            true => ((place.left, place.bottom()), Anchor::Start),
            false => ((place.right(), place.bottom()), Anchor::End),
        }
    }

    /// Where a curve is farthest left or right between two heights, px.
    fn edge(&self, curve: usize, (top, bottom): (f64, f64), is_right: bool) -> Option<f64> {
        let own = self.curves.get(curve)?.iter().filter(|(_, y)| (top..=bottom).contains(y)).map(|(x, _)| *x);
        if is_right { own.reduce(f64::max) } else { own.reduce(f64::min) }
    }

    fn is_free(&self, place: Area) -> bool {
        let overlaps = |(left, right): (f64, f64), (top, bottom): (f64, f64)| {
            left < place.right() + GAP_PX / 2.0
                && right > place.left - GAP_PX / 2.0
                && top < place.bottom() + GAP_PX / 2.0
                && bottom > place.top - GAP_PX / 2.0
        };
        let is_within = place.left >= self.within.left && place.right() <= self.within.right();
        // Quantiles go up: the box of two that follow each other holds what is drawn between them.
        let crosses = |pair: &[(f64, f64)]| overlaps((pair[0].0, pair[1].0), (pair[1].1, pair[0].1));
        is_within
            && !self.curves.iter().any(|curve| curve.windows(2).any(crosses))
            && !self.marks.iter().any(|(x, y)| overlaps((x - MARK_PX, x + MARK_PX), (y - MARK_PX, y + MARK_PX)))
            && !self.taken.iter().any(|other| overlaps((other.left, other.right()), (other.top, other.bottom())))
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

#[cfg(test)]
mod tests {
    use super::*;

    /// In the picture of the README the label of the middle curve lay on the curve beside it.
    #[test]
    fn regress_labels_of_quantiles_touch_no_curve() {
        let area = Area { left: 0.0, top: 0.0, width: 360.0, height: 330.0 };
        // Straight curves that rise by 330 px over 60 px, 70 px from each other: a label of 80 px has no room between them.
        let straight = |from: f64| (0..=100).map(|k| (from + 0.6 * f64::from(k), 330.0 - 3.3 * f64::from(k))).collect();
        let curves: Vec<Vec<(f64, f64)>> = [100.0, 170.0, 300.0].map(straight).to_vec();
        let mark = |curve: &Vec<(f64, f64)>| curve[95];
        let marks: Vec<_> = curves.iter().map(mark).collect();
        let mut places = Places { within: area, curves: &curves, marks: marks.clone(), taken: Vec::new() };
        for (curve, at) in marks.iter().enumerate() {
            places.take(curve, *at, "95 %: 1.70 µm");
        }
        for (number, place) in places.taken.iter().enumerate() {
            let inside = |(x, y): &(f64, f64)| {
                (place.left..=place.right()).contains(x) && (place.top..=place.bottom()).contains(y)
            };
            assert!(!curves.iter().flatten().any(inside), "label {number} at {place:?} lies on a curve");
            let is_apart = |other: &Area| {
                place.right() < other.left
                    || other.right() < place.left
                    || place.bottom() < other.top
                    || other.bottom() < place.top
            };
            assert!(
                places.taken.iter().enumerate().all(|(k, other)| k == number || is_apart(other)),
                "{:?}",
                places.taken
            );
        }
        assert!(places.taken[0].right() < marks[0].0, "where there is room it stands left of its curve");
    }
}
