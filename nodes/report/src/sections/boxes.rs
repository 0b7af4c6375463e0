//! Box plots: quartiles, 5 % and 95 % whiskers, rms and largest value, by group and series.

use serde::{Deserialize, Serialize};

use super::{Axis, State};
use crate::error::ReportError;
use crate::frame::{Area, Labels, Swatch, WIDTH_PX, axis_text, draw_empty, draw_frame, draw_legend};
use crate::scale::{Scale, extent};
use crate::stats::BoxStats;
use crate::svg::{Anchor, Drawing, Svg};
use crate::text::{MISSING, significant};

/// From this width of a box with its gap on, there is room for the rms as a number.
const LABELLED_SLOT_PX: f64 = 48.0;

/// Series beside each other that leave room for it.
const LABELLED_SERIES: usize = 2;

/// A group of boxes beside each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BoxGroup {
    /// Name under the group.
    pub label: String,
    /// One box a series, in the order of the series' names.
    pub boxes: Vec<Option<BoxStats>>,
}

impl BoxGroup {
    /// Whether a series has a box here.
    fn is_told(&self) -> bool {
        self.boxes.iter().any(Option::is_some)
    }
}

/// A box plot with a linear axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BoxPlot {
    /// Title of the figure.
    pub title: String,
    /// Sentence under the title.
    pub note: Option<String>,
    /// What the groups are, e.g. `station`.
    pub groups_label: String,
    /// What the boxes show, with unit.
    pub value: Axis,
    /// Names of the series (at most six).
    pub series: Vec<String>,
    /// What the series are, where they are states of a correction; else each has the colour of its number.
    #[serde(default)]
    pub states: Vec<State>,
    /// Groups from left to right.
    pub groups: Vec<BoxGroup>,
}

impl BoxPlot {
    /// Refuses groups with another count of boxes than series.
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        if self.groups.is_empty() || self.series.is_empty() || self.series.len() > 6 {
            let what = "needs at least one group and one to six series";
            return Err(ReportError::shape(&self.title, what, "leave the section out or split it"));
        }
        match self.groups.iter().find(|g| g.boxes.len() != self.series.len()) {
            Some(group) => {
                let what = format!("group '{}' has {} boxes", group.label, group.boxes.len());
                Err(ReportError::shape(&self.title, what, "give one box a series, None if missing"))
            }
            None => Ok(()),
        }
    }

    /// The note with the groups that have no box: dashes side by side tell less than their names.
    pub(crate) fn full_note(&self) -> Option<String> {
        let empty: Vec<&str> = self.groups.iter().filter(|g| !g.is_told()).map(|g| g.label.as_str()).collect();
        let left_out = (!empty.is_empty()).then(|| format!("Left out, for want of values: {}.", empty.join(", ")));
        let parts: Vec<String> = self.note.iter().cloned().chain(left_out).collect();
        (!parts.is_empty()).then(|| parts.join(" "))
    }

    /// Draws the figure.
    pub(crate) fn draw(&self) -> Result<Drawing, ReportError> {
        let groups: Vec<BoxGroup> = self.groups.iter().filter(|g| g.is_told()).cloned().collect();
        let area = Area { left: 62.0, top: 34.0, width: WIDTH_PX - 78.0, height: 220.0 };
        let mut svg = Svg::new(WIDTH_PX, area.bottom() + 46.0);
        let class = |k: usize| self.states.get(k).map_or_else(|| (k + 1).to_string(), |state| state.class().to_owned());
        let classes: Vec<String> = (0..self.series.len()).map(class).collect();
        let series: Vec<_> = classes.iter().cloned().zip(self.series.iter().cloned()).collect();
        draw_box_legend(&mut svg, (area.left, 14.0), if series.len() > 1 { &series } else { &[] });
        let values = groups.iter().flat_map(|g| g.boxes.iter().flatten()).flat_map(|b| [b.p05, b.max]);
        let y = Scale::linear(extent(values.chain([0.0])), area.bottom(), area.top);
        let labels =
            Labels { x: self.groups_label.clone(), y: axis_text(&self.value), y_ticks: 6, ..Labels::default() };
        draw_boxes(&mut svg, area, &y, &labels, &groups, &classes, &self.value.unit);
        if groups.is_empty() {
            draw_empty(&mut svg, area);
        }
        svg.finish(&self.title)
    }
}

/// Legend of the parts of a box after the series' own entries.
pub(crate) fn draw_box_legend(svg: &mut Svg, at: (f64, f64), series: &[(String, String)]) {
    let patches: Vec<_> =
        series.iter().map(|(class, name)| (Swatch::Patch(format!("f{class} bar")), name.clone())).collect();
    let x = draw_legend(svg, at, &patches);
    let value = if series.len() > LABELLED_SERIES { "" } else { ", with its value" };
    let key = format!("box: quartiles and median  ·  whiskers: 5 % and 95 %  ·  ■ rms{value}  ·  ● largest");
    svg.text("small muted", (x, at.1), Anchor::Start, &key);
}

/// Draws groups of boxes on a given scale; shared with the before/after comparison.
pub(crate) fn draw_boxes(
    svg: &mut Svg,
    area: Area,
    y: &Scale,
    labels: &Labels,
    groups: &[BoxGroup],
    classes: &[String],
    unit: &str,
) {
    let count = groups.len().max(1) as f64;
    let x = Scale::exact(0.0, count, area.left, area.right());
    draw_frame(svg, area, &x, y, labels);
    let slot = (area.width / count * 0.8 / classes.len() as f64).min(64.0);
    for (index, group) in groups.iter().enumerate() {
        let middle = x.map(index as f64 + 0.5);
        svg.name(Some(&group.label));
        svg.text("", (middle, area.bottom() + 17.0), Anchor::Middle, &group.label);
        // The numbers stand right of their boxes: shifted to the left, boxes and numbers together are centred.
        let shift = if slot >= LABELLED_SLOT_PX && classes.len() > 1 { 12.0 } else { 0.0 };
        let first = middle - shift - slot * (classes.len() as f64 - 1.0) / 2.0;
        for (series, (stats, class)) in group.boxes.iter().zip(classes).enumerate() {
            let centre = first + slot * series as f64;
            match stats {
                Some(stats) => {
                    draw_box(svg, (centre, 0.26 * slot), y, stats, class, unit);
                    if slot >= LABELLED_SLOT_PX {
                        let at = (centre + 0.26 * slot + 4.0, y.map(stats.rms) + 4.0);
                        svg.text(&format!("small halo f{class}"), at, Anchor::Start, &significant(stats.rms, 3));
                    }
                }
                None => svg.text("muted", (centre, area.bottom() - 8.0), Anchor::Middle, MISSING),
            }
        }
    }
    svg.name(None);
}

fn draw_box(svg: &mut Svg, (centre, half): (f64, f64), y: &Scale, stats: &BoxStats, class: &str, unit: &str) {
    let (p05, q25, q75, p95) = (y.map(stats.p05), y.map(stats.q25), y.map(stats.q75), y.map(stats.p95));
    let (left, right) = (centre - half, centre + half);
    let whiskers = [
        [(centre, p05), (centre, q25)],
        [(centre, q75), (centre, p95)],
        [(left + half / 2.0, p05), (right - half / 2.0, p05)],
        [(left + half / 2.0, p95), (right - half / 2.0, p95)],
    ];
    svg.segments(&format!("wh l{class}"), &whiskers);
    let tip = format!(
        "n {}, rms {}, median {}, 95 % {}, largest {} {unit}",
        stats.count,
        significant(stats.rms, 3),
        significant(stats.median, 3),
        significant(stats.p95, 3),
        significant(stats.max, 3)
    );
    svg.rect(&format!("box o{class}"), (left, q75), (2.0 * half, q25 - q75), None);
    svg.rect(&format!("b{class} o{class}"), (left, q75), (2.0 * half, q25 - q75), Some(&tip));
    let median = y.map(stats.median);
    svg.line(&format!("med l{class}"), (left, median), (right, median));
    svg.rect(&format!("f{class}"), (centre - 3.5, y.map(stats.rms) - 3.5), (7.0, 7.0), Some(&tip));
    svg.circle(&format!("f{class}"), (centre, y.map(stats.max)), 2.8, Some(&tip));
}
