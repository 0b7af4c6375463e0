//! Residuals before and after as pictures: over the quantity found, by station, over time.
//!
//! In: one entry an observation, µm. Out: line plots of binned means with bands, and box plots.

use super::bins::{Point, binned};
use super::names::{axis, in_words};
use crate::sections::{Axis, BoxGroup, BoxPlot, Curve, CurveStyle, LinePanel, LinePlot, Section, State};
use crate::stats::BoxStats;

/// Blocks beyond which boxes would be too narrow to read.
const MOST_BOXES: usize = 24;

/// Residuals of the observations used both before and after.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Residuals {
    /// What a residual is, such as `range residual`.
    pub label: String,
    /// With the model as it was (µm).
    pub before_um: Vec<f64>,
    /// With everything found (µm).
    pub after_um: Vec<f64>,
    /// Time (s since the first reading); `None` where there is none.
    pub time_s: Option<Vec<f64>>,
    /// What the groups are, such as `station`.
    pub groups_label: String,
    /// Names of the groups.
    pub groups: Vec<String>,
    /// Group of each observation, an index into `groups`.
    pub group: Vec<usize>,
    /// One view for each effect found and each quantity it depends on.
    pub views: Vec<View>,
}

/// A quantity to see the residuals over.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Effect that the view belongs to.
    pub effect: String,
    /// The quantity.
    pub x: Axis,
    /// Its value at each observation.
    pub values: Vec<f64>,
    /// Share of the direction in which the effect acts in each residual, and what the vertical axis then shows; `None`
    /// shows the mean residual.
    pub share: Option<(String, Vec<f64>)>,
    /// Observations told apart by something else.
    pub split: Option<Split>,
}

/// Observations in two or three kinds.
#[derive(Debug, Clone, PartialEq)]
pub struct Split {
    /// Names of the kinds.
    pub names: Vec<String>,
    /// Kind of each observation, an index into `names`; `None` for those that tell nothing of the effect.
    pub of: Vec<Option<usize>>,
}

impl Residuals {
    /// Pictures of what the effects do: one a view.
    pub(super) fn effects(&self) -> Vec<Section> {
        let is_first = |k: usize| self.views[..k].iter().all(|earlier| earlier.effect != self.views[k].effect);
        self.views.iter().enumerate().map(|(k, view)| self.picture(view, is_first(k))).collect()
    }

    fn picture(&self, view: &View, explained: bool) -> Section {
        let note = "Every point is an estimate over the observations around it; the band is its 95 % interval. What \
                    the model lacks shows as a curve before and is gone after. The geometry of the model before has \
                    taken up a part of the effect, so that the curve may be smaller than the effect.";
        Section::LinePlot(LinePlot {
            title: format!("Residual before and after: {}, over {}", in_words(&view.effect), in_words(&view.x.label)),
            note: explained.then(|| note.to_owned()),
            columns: 1,
            band_name: Some("95 % interval".to_owned()),
            panels: vec![self.panel(view, false)],
        })
    }

    /// The residuals over a quantity; once where nothing was added.
    fn panel(&self, view: &View, is_one_state: bool) -> LinePanel {
        let y = match &view.share {
            Some((label, _)) => Axis::new(label, "µm"),
            None => Axis::new(format!("mean {}", self.label), "µm"),
        };
        let kinds = view.split.as_ref().map_or(1, |split| split.names.len());
        let mut curves = Vec::new();
        let states = [(State::Before, "before", &self.before_um), (State::After, "after", &self.after_um)];
        for (state, word, residuals) in states.into_iter().take(if is_one_state { 1 } else { 2 }) {
            let word = if is_one_state { "with this model" } else { word };
            for kind in 0..kinds {
                let name = match &view.split {
                    Some(split) => format!("{word}, {}", split.names[kind]),
                    None => word.to_owned(),
                };
                let style = if kind == 0 { CurveStyle::LineOf(state) } else { CurveStyle::DashedOf(state) };
                curves.push(curve(name, style, &view.points(residuals, kind)));
            }
        }
        LinePanel { title: String::new(), x: axis(&view.x), y, curves }
    }

    /// Residuals over time.
    pub(super) fn over_time(&self, is_one_state: bool) -> Option<Section> {
        let time_s = self.time_s.as_ref()?;
        let minutes: Vec<f64> = time_s.iter().map(|t| t / 60.0).collect();
        let view =
            View { effect: String::new(), x: Axis::new("time", "min"), values: minutes, share: None, split: None };
        Some(Section::LinePlot(LinePlot {
            title: "Residual over time".to_owned(),
            note: Some("Means over observations that follow each other, with their 95 % interval.".to_owned()),
            columns: 1,
            band_name: Some("95 % interval".to_owned()),
            panels: vec![self.panel(&view, is_one_state)],
        }))
    }

    /// Residuals by group.
    pub(super) fn by_group(&self, is_one_state: bool) -> Option<Section> {
        if self.groups.is_empty() || self.groups.len() > MOST_BOXES {
            return None;
        }
        let of = |residuals: &[f64], group: usize| {
            let members = residuals.iter().zip(&self.group).filter(|(_, g)| **g == group);
            BoxStats::of(&members.map(|(r, _)| r.abs()).collect::<Vec<_>>())
        };
        let shown = match is_one_state {
            true => vec![("with this model", State::Before, &self.before_um)],
            false => vec![("before", State::Before, &self.before_um), ("after", State::After, &self.after_um)],
        };
        let groups = self.groups.iter().enumerate().map(|(k, label)| BoxGroup {
            label: label.clone(),
            boxes: shown.iter().map(|(_, _, residuals)| of(residuals, k)).collect(),
        });
        Some(Section::BoxPlot(BoxPlot {
            title: format!("Residual by {}", self.groups_label),
            note: None,
            groups_label: self.groups_label.clone(),
            value: Axis::new(format!("{}, magnitude", self.label), "µm"),
            series: shown.iter().map(|(name, ..)| (*name).to_owned()).collect(),
            states: shown.iter().map(|(_, state, _)| *state).collect(),
            groups: groups.collect(),
        }))
    }
}

impl View {
    fn points(&self, residuals: &[f64], kind: usize) -> Vec<Point> {
        let share = |k: usize| self.share.as_ref().and_then(|(_, s)| s.get(k).copied()).unwrap_or(1.0);
        let is_kind = |k: usize| self.split.as_ref().is_none_or(|split| split.of.get(k) == Some(&Some(kind)));
        let all = self.values.iter().zip(residuals).enumerate();
        all.filter(|(k, _)| is_kind(*k)).map(|(k, (x, r))| (*x, share(k), *r)).collect()
    }
}

fn curve(name: String, style: CurveStyle, points: &[Point]) -> Curve {
    let found = binned(points);
    Curve { name, style, x: found.x, y: found.y, also: None, half_width: Some(found.half_width) }
}
