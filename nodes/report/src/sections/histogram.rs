//! Histograms, with the normal curve that the declared noise would give.

use serde::{Deserialize, Serialize};

use super::Axis;
use crate::error::ReportError;
use crate::frame::{Area, Labels, Swatch, WIDTH_PX, axis_text, begin_panel, draw_empty, draw_legend, end_panel, grid};
use crate::scale::Scale;
use crate::stats::{quantile_sorted, sorted};
use crate::svg::{Anchor, Drawing, Svg};
use crate::text::significant;

/// Points of the normal curve.
const CURVE_POINTS: usize = 121;

/// A histogram.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HistogramPanel {
    /// Title above the panel.
    pub title: String,
    /// What is counted, with unit.
    pub x: Axis,
    /// Edges of the bins, ascending and evenly spaced, in the unit of `x`.
    pub edges: Vec<f64>,
    /// Count in each bin.
    pub counts: Vec<u64>,
    /// Values below the first edge.
    pub below: u64,
    /// Values above the last edge.
    pub above: u64,
    /// Standard deviation of the normal curve about zero, in the unit of `x`.
    pub normal_sigma: Option<f64>,
}

/// Histograms side by side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Histogram {
    /// Title of the figure.
    pub title: String,
    /// Sentence under the title.
    pub note: Option<String>,
    /// Name of the normal curve in the legend.
    pub normal_name: Option<String>,
    /// Panels side by side (1 to 4).
    pub columns: usize,
    /// Panels, row by row.
    pub panels: Vec<HistogramPanel>,
}

impl HistogramPanel {
    /// Counts `values` in `bins` bins over a range symmetric about zero: 4.5 `normal_sigma`, or the 99.5 % quantile
    /// of the magnitudes where that is larger. What lies outside is counted and shown beside the ends.
    pub fn from_values(
        title: impl Into<String>,
        x: Axis,
        values: &[f64],
        bins: usize,
        normal_sigma: Option<f64>,
    ) -> Self {
        let magnitudes = sorted(&values.iter().map(|v| v.abs()).collect::<Vec<_>>());
        let reach = quantile_sorted(&magnitudes, 0.995).unwrap_or(0.0);
        let limit = reach.max(4.5 * normal_sigma.unwrap_or(0.0));
        let limit = if limit > 0.0 { limit } else { 1.0 };
        let bins = bins.clamp(1, 200);
        let width = 2.0 * limit / bins as f64;
        let mut counts = vec![0; bins];
        let (mut below, mut above) = (0, 0);
        for &value in values {
            if value < -limit {
                below += 1;
            } else if value > limit {
                above += 1;
            } else {
                counts[(((value + limit) / width) as usize).min(bins - 1)] += 1;
            }
        }
        Self {
            title: title.into(),
            x,
            edges: (0..=bins).map(|i| -limit + i as f64 * width).collect(),
            counts,
            below,
            above,
            normal_sigma,
        }
    }

    /// Height of the normal curve at `value` in counts a bin.
    fn normal(&self, value: f64) -> Option<f64> {
        let sigma = self.normal_sigma?;
        let total = self.counts.iter().sum::<u64>() + self.below + self.above;
        let width = self.edges.get(1)? - self.edges.first()?;
        let density = (-0.5 * (value / sigma).powi(2)).exp() / (sigma * (2.0 * std::f64::consts::PI).sqrt());
        Some(total as f64 * width * density)
    }

    fn draw(&self, svg: &mut Svg, area: Area) {
        let (low, high) = (self.edges[0], self.edges[self.edges.len() - 1]);
        let x = Scale::exact(low, high, area.left, area.right());
        let largest = self.counts.iter().copied().max().unwrap_or(0) as f64;
        let top = largest.max(self.normal(0.0).unwrap_or(0.0)).max(1.0);
        let y = Scale::exact(0.0, top * 1.06, area.bottom(), area.top);
        let labels = Labels {
            title: self.title.clone(),
            x: axis_text(&self.x),
            y: "readings".to_owned(),
            x_ticks: (area.width / 60.0) as usize,
            y_ticks: 5,
        };
        begin_panel(svg, area, &x, &y, &labels);
        for (edge, &count) in self.edges.windows(2).zip(&self.counts).filter(|(_, c)| **c > 0) {
            let (left, right) = (x.map(edge[0]), x.map(edge[1]));
            let (top, tip) = (y.map(count as f64), self.tip(edge[0], edge[1], count));
            svg.rect("f1 bar", (left + 0.4, top), (right - left - 0.8, area.bottom() - top), Some(&tip));
        }
        self.draw_normal(svg, &x, &y);
        end_panel(svg);
        self.draw_outside(svg, area);
        if self.counts.iter().all(|&c| c == 0) {
            draw_empty(svg, area);
        }
    }

    fn tip(&self, low: f64, high: f64, count: u64) -> String {
        format!("{} to {} {}: {count}", significant(low, 3), significant(high, 3), self.x.unit)
    }

    fn draw_normal(&self, svg: &mut Svg, x: &Scale, y: &Scale) {
        let (low, high) = (self.edges[0], self.edges[self.edges.len() - 1]);
        let curve: Vec<_> = (0..CURVE_POINTS)
            .map(|i| low + (high - low) * i as f64 / (CURVE_POINTS - 1) as f64)
            .filter_map(|v| self.normal(v).map(|n| (x.map(v), y.map(n))))
            .collect();
        svg.path("ln ink", &curve, false);
    }

    fn draw_outside(&self, svg: &mut Svg, area: Area) {
        let y = area.top + 12.0;
        if self.below > 0 {
            svg.text("small muted", (area.left + 6.0, y), Anchor::Start, &format!("← {} below", self.below));
        }
        if self.above > 0 {
            svg.text("small muted", (area.right() - 6.0, y), Anchor::End, &format!("{} above →", self.above));
        }
    }
}

impl Histogram {
    /// Refuses bins that do not fit the counts, uneven bins and a σ that is not positive.
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        for panel in &self.panels {
            let name = &panel.title;
            let step = panel.edges.get(1).zip(panel.edges.first()).map(|(b, a)| b - a).unwrap_or(0.0);
            let even = panel.edges.windows(2).all(|w| (w[1] - w[0] - step).abs() <= 1e-6 * step);
            if step <= 0.0 || !even || panel.counts.len() + 1 != panel.edges.len() {
                let what = format!("panel '{name}' has edges that are not even, ascending and one more than counts");
                return Err(ReportError::shape(&self.title, what, "build it with HistogramPanel::from_values"));
            }
            if panel.normal_sigma.is_some_and(|s| s <= 0.0) {
                let what = format!("panel '{name}' has a normal_sigma that is not above 0");
                return Err(ReportError::shape(&self.title, what, "pass a positive σ or None"));
            }
        }
        Ok(())
    }

    /// Draws the figure.
    pub(crate) fn draw(&self) -> Result<Drawing, ReportError> {
        let legend = match &self.normal_name {
            Some(name) if self.panels.iter().any(|p| p.normal_sigma.is_some()) => {
                vec![(Swatch::Line("ln ink".to_owned()), name.clone())]
            }
            _ => Vec::new(),
        };
        let top = if legend.is_empty() { 0.0 } else { 22.0 };
        let (areas, height) = grid(self.panels.len(), self.columns, 210.0, top);
        let mut svg = Svg::new(WIDTH_PX, height);
        draw_legend(&mut svg, (62.0, 14.0), &legend);
        for (panel, area) in self.panels.iter().zip(areas) {
            panel.draw(&mut svg, area);
        }
        svg.finish(&self.title)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_counted_once() {
        let values: Vec<f64> = (0..1000).map(|i| (f64::from(i) - 499.5) * 0.01).collect();
        let panel = HistogramPanel::from_values("p", Axis::new("r", "µm"), &values, 31, Some(0.5));
        assert_eq!(panel.counts.iter().sum::<u64>() + panel.below + panel.above, 1000);
        assert!(panel.below > 0 && panel.above > 0);
    }

    #[test]
    fn normal_curve_encloses_the_sample() {
        let panel = HistogramPanel::from_values("p", Axis::new("r", "µm"), &[0.1; 500], 90, Some(1.0));
        let total: f64 = panel.edges.windows(2).map(|w| panel.normal((w[0] + w[1]) / 2.0).unwrap()).sum();
        assert!((total - 500.0).abs() < 0.5, "{total}");
    }
}
