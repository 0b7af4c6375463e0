//! Positions coloured by a signed value (a residual) on a scale symmetric about zero.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Axis;
use crate::error::ReportError;
use crate::frame::{
    Area, Labels, WIDTH_PX, axis_text, begin_panel, diverging_step, draw_diverging_bar, draw_empty, drawn, end_panel,
    one_in,
};
use crate::scale::{Scale, extent};
use crate::stats::{max_abs, quantile_sorted, sorted};
use crate::svg::{Drawing, Svg};
use crate::text::significant;
use crate::theme::DIVERGING_STEPS;

/// Space right of the panels for the colour bar, px.
const BAR_SPACE_PX: f64 = 96.0;
/// Largest height of a panel's plotting area, px.
const MAX_HEIGHT_PX: f64 = 420.0;

/// Up to this many points of a panel are drawn as large dots.
const SPARSE: usize = 1200;

/// A position with a value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MapPoint {
    /// Horizontal position in the unit of the panel's x axis.
    pub x: f64,
    /// Vertical position in the unit of the panel's y axis.
    pub y: f64,
    /// Value in the unit of the map's colour scale.
    pub value: f64,
}

/// A panel of a map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapPanel {
    /// Title above the panel.
    pub title: String,
    /// Horizontal axis; its unit must be that of the vertical one, since both share one scale.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Points.
    pub points: Vec<MapPoint>,
    /// What each point belongs to, such as the stations and lines whose readings it is the mean of: the page picks it out by them.
    /// Empty where points belong to nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub of: Vec<Vec<String>>,
}

/// Positions coloured by a signed value; panels side by side, true to scale, one colour bar.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResidualMap {
    /// Title of the figure.
    pub title: String,
    /// Sentence under the title.
    pub note: Option<String>,
    /// What the colour shows, with unit.
    pub value: Axis,
    /// End of the colour scale (±); `None` takes the 99 % quantile of the magnitudes. The note tells how many
    /// points lie beyond it.
    pub limit: Option<f64>,
    /// Panels, side by side (at most four).
    pub panels: Vec<MapPanel>,
}

impl ResidualMap {
    /// Refuses a scale that is not positive, too many panels and axes of different unit.
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        if self.limit.is_some_and(|l| l <= 0.0) {
            return Err(ReportError::shape(&self.title, "limit is not above 0", "pass a positive limit or None"));
        }
        if self.panels.len() > 4 {
            let what = format!("{} panels", self.panels.len());
            return Err(ReportError::shape(&self.title, what, "split the map, at most 4 panels fit side by side"));
        }
        if let Some(panel) = self.panels.iter().find(|p| !p.of.is_empty() && p.of.len() != p.points.len()) {
            let what = format!(
                "panel '{}' says of {} points what they belong to, and has {}",
                panel.title,
                panel.of.len(),
                panel.points.len()
            );
            return Err(ReportError::shape(&self.title, what, "say it of every point or of none"));
        }
        match self.panels.iter().find(|p| p.x.unit != p.y.unit) {
            Some(panel) => {
                let what = format!("panel '{}' has axes in different units", panel.title);
                Err(ReportError::shape(&self.title, what, "use one unit for both, the map is true to scale"))
            }
            None => Ok(()),
        }
    }

    fn values(&self) -> Vec<f64> {
        self.panels.iter().flat_map(|p| p.points.iter().map(|q| q.value)).collect()
    }

    /// End of the colour scale.
    fn limit_or_default(&self) -> f64 {
        let magnitudes: Vec<f64> = self.values().iter().map(|v| v.abs()).collect();
        self.limit.or_else(|| quantile_sorted(&sorted(&magnitudes), 0.99)).filter(|&limit| limit > 0.0).unwrap_or(1.0)
    }

    /// The note with what the drawing leaves out: points beyond the scale, points thinned out.
    pub(crate) fn full_note(&self) -> Option<String> {
        let mut parts: Vec<String> = self.note.iter().cloned().collect();
        let limit = self.limit_or_default();
        // Panels show the same points from several sides: the fullest panel counts them once.
        let beyond = |p: &MapPanel| p.points.iter().filter(|q| q.value.abs() > limit).count();
        let count = self.panels.iter().map(beyond).max().unwrap_or(0);
        if count > 0 {
            let max = max_abs(&self.values()).unwrap_or(0.0);
            parts.push(format!(
                "{count} points lie beyond ±{} {} (largest {}) and carry the end colours.",
                significant(limit, 2),
                self.value.unit,
                significant(max, 3)
            ));
        }
        let step = self.panels.iter().map(|p| one_in(p.points.len())).max().unwrap_or(1);
        if step > 1 {
            parts.push(format!("One point in {step} is drawn; all of them are in the JSON file."));
        }
        (!parts.is_empty()).then(|| parts.join(" "))
    }

    /// Draws the figure.
    pub(crate) fn draw(&self) -> Result<Drawing, ReportError> {
        let count = self.panels.len().max(1) as f64;
        let cell = (WIDTH_PX - BAR_SPACE_PX) / count;
        let width = cell - 62.0 - 16.0;
        let ranges: Vec<_> = self.panels.iter().map(MapPanel::ranges).collect();
        // One scale for all panels, so that lengths compare between them.
        let px_per_unit =
            ranges.iter().map(|(x, y)| (width / span(*x)).min(MAX_HEIGHT_PX / span(*y))).fold(f64::INFINITY, f64::min);
        let height = ranges.iter().map(|(_, y)| span(*y) * px_per_unit).fold(80.0, f64::max);
        let limit = self.limit_or_default();
        let mut svg = Svg::new(WIDTH_PX, 28.0 + height + 46.0);
        for (index, (panel, (x, y))) in self.panels.iter().zip(&ranges).enumerate() {
            let (w, h) = (span(*x) * px_per_unit, span(*y) * px_per_unit);
            let area = Area { left: index as f64 * cell + 62.0, top: 28.0 + height - h, width: w, height: h };
            panel.draw(&mut svg, area, *x, *y, limit);
        }
        let bar = Area { left: WIDTH_PX - 62.0, top: 40.0, width: 13.0, height: height - 24.0 };
        let beyond = self.values().iter().any(|v| v.abs() > limit);
        draw_diverging_bar(&mut svg, bar, limit, &axis_text(&self.value), beyond);
        svg.finish(&self.title)
    }
}

/// Dots of one colour that belong to the same: places (px) and values.
type Dots = (Vec<(f64, f64)>, Vec<f64>);

/// Length of a range.
fn span((low, high): (f64, f64)) -> f64 {
    high - low
}

/// A range with 4 % margin and a width even for a single value.
fn margin(range: Option<(f64, f64)>) -> (f64, f64) {
    let (low, high) = range.unwrap_or((0.0, 1.0));
    let half = (0.54 * (high - low)).max(1e-6 * low.abs().max(high.abs())).max(f64::MIN_POSITIVE);
    let half = if high > low { half } else { half.max(0.5) };
    let middle = low / 2.0 + high / 2.0;
    (middle - half, middle + half)
}

impl MapPanel {
    fn ranges(&self) -> ((f64, f64), (f64, f64)) {
        (margin(extent(self.points.iter().map(|p| p.x))), margin(extent(self.points.iter().map(|p| p.y))))
    }

    fn draw(&self, svg: &mut Svg, area: Area, x: (f64, f64), y: (f64, f64), limit: f64) {
        let x = Scale::exact(x.0, x.1, area.left, area.right());
        let y = Scale::exact(y.0, y.1, area.bottom(), area.top);
        let labels = Labels {
            title: self.title.clone(),
            x: axis_text(&self.x),
            y: axis_text(&self.y),
            x_ticks: (area.width / 48.0) as usize,
            y_ticks: (area.height / 40.0) as usize,
        };
        begin_panel(svg, area, &x, &y, &labels);
        // Small residuals first, so that the large ones are never hidden below them.
        let middle = DIVERGING_STEPS / 2;
        let mut groups: BTreeMap<(usize, usize, &[String]), Dots> = BTreeMap::new();
        let places: Vec<usize> = (0..self.points.len()).collect();
        for place in drawn(&places, one_in(places.len())) {
            let (point, of) = (self.points[*place], self.of.get(*place).map_or(&[][..], Vec::as_slice));
            let step = diverging_step(point.value, limit);
            let (dots, values) = groups.entry((step.abs_diff(middle), step, of)).or_default();
            dots.push((x.map(point.x), y.map(point.y)));
            values.push(point.value);
        }
        let size = if self.points.len() > SPARSE { "" } else { "dot3 " };
        for ((_, step, of), (dots, values)) in groups {
            svg.names(of.iter().map(String::as_str));
            svg.dots(&format!("{size}d{step}"), &dots, &values);
        }
        svg.name(None);
        end_panel(svg);
        if self.points.is_empty() {
            draw_empty(svg, area);
        }
    }
}
