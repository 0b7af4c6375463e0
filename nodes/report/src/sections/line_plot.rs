//! Curves over an axis, in one or several panels: lines with bands, dashed references, points.

use serde::{Deserialize, Serialize};

use super::Axis;
use crate::error::ReportError;
use crate::frame::{
    self, Area, Labels, Swatch, WIDTH_PX, axis_text, begin_panel, draw_legend, drawn, end_panel, grid, one_in,
};
use crate::scale::{Scale, extent};
use crate::svg::{Drawing, Svg};
use crate::theme::SERIES;

/// What a correction did to it: the same colour and marker in every figure of every report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Without the correction.
    Before,
    /// With a part of it.
    Between,
    /// With all of it.
    After,
}

impl State {
    /// Of so many states in a row, before first and after last.
    pub fn of(index: usize, count: usize) -> Self {
        match index {
            0 => Self::Before,
            index if index + 1 == count => Self::After,
            _ => Self::Between,
        }
    }

    /// Letter of the state's style classes.
    pub(crate) fn class(self) -> &'static str {
        match self {
            Self::Before => "B",
            Self::Between => "M",
            Self::After => "A",
        }
    }

    /// Token of the state's colour.
    pub(crate) fn variable(self) -> &'static str {
        match self {
            Self::Before => "before",
            Self::Between => "between",
            Self::After => "after",
        }
    }

    /// Whose marker it takes.
    fn marker(self) -> u8 {
        match self {
            Self::Before => 2,
            Self::Between => 4,
            Self::After => 1,
        }
    }
}

/// How far points before and after a correction are drawn beside where they are, px.
const BESIDE_PX: i8 = 5;
/// Share of the way to the next position that points beside their own may take.
const OWN_SIDE: f64 = 0.4;
/// Positions this close are one to the eye, px.
const ONE_PLACE_PX: f64 = 4.0;

/// How a curve is drawn. Series count from 1; colours and markers repeat after eight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CurveStyle {
    /// A line in the colour of a series.
    Line(u8),
    /// A dashed line in the colour of the text: truth, reference, declared value.
    Reference,
    /// Points in the colour of a series.
    Points(u8),
    /// The same, drawn so many pixels to the right of where they are: one of several series with values at the same positions.
    PointsBeside(u8, i8),
    /// A line in the colour of a state.
    LineOf(State),
    /// A dashed line in the colour of a state.
    DashedOf(State),
    /// Points in the colour of a state; those before and after stand beside each other, so that equal ones are both seen.
    PointsOf(State),
}

impl CurveStyle {
    /// A line for approaches in + direction: no colour of a [`State`].
    pub const APPROACH_POSITIVE: Self = Self::Line(3);
    /// A line for approaches in − direction: no colour of a [`State`].
    pub const APPROACH_NEGATIVE: Self = Self::Line(6);

    /// Class of its band, and by its number the token of its colour.
    #[cfg(test)]
    pub(crate) fn of_series(self) -> Option<u8> {
        match self {
            Self::Line(series) | Self::Points(series) | Self::PointsBeside(series, _) => Some(Self::series(series)),
            _ => None,
        }
    }

    fn series(series: u8) -> u8 {
        (series.max(1) - 1) % SERIES + 1
    }

    fn stroke_class(self) -> String {
        match self {
            Self::Line(series) => format!("ln l{}", Self::series(series)),
            Self::Reference => "ink dash".to_owned(),
            Self::Points(series) | Self::PointsBeside(series, _) => format!("f{}", Self::series(series)),
            Self::LineOf(state) => format!("ln l{}", state.class()),
            Self::DashedOf(state) => format!("dash l{}", state.class()),
            Self::PointsOf(state) => format!("f{}", state.class()),
        }
    }

    /// The series of points; `None` for lines.
    fn marker(self) -> Option<u8> {
        match self {
            Self::Points(series) | Self::PointsBeside(series, _) => Some(Self::series(series)),
            Self::PointsOf(state) => Some(state.marker()),
            Self::Line(_) | Self::LineOf(_) | Self::DashedOf(_) | Self::Reference => None,
        }
    }

    /// How far points are drawn beside where they are, px.
    fn beside_px(self) -> i8 {
        match self {
            Self::PointsBeside(_, beside_px) => beside_px,
            Self::PointsOf(State::Before) => -BESIDE_PX,
            Self::PointsOf(State::After) => BESIDE_PX,
            _ => 0,
        }
    }

    fn band_class(self) -> String {
        match self {
            Self::Line(series) | Self::Points(series) | Self::PointsBeside(series, _) => {
                format!("b{}", Self::series(series))
            }
            Self::LineOf(state) | Self::DashedOf(state) | Self::PointsOf(state) => format!("b{}", state.class()),
            Self::Reference => "none".to_owned(),
        }
    }
}

/// A curve: values over positions, with an optional band.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// Name in the legend; curves of one name share one entry.
    pub name: String,
    /// What its points belong to beside its name, such as one line of a station: the page picks them out by either.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub also: Option<String>,
    /// How it is drawn.
    pub style: CurveStyle,
    /// Positions in the unit of the panel's x axis.
    pub x: Vec<f64>,
    /// Values in the unit of the panel's y axis; a missing value breaks the line.
    pub y: Vec<Option<f64>>,
    /// Half width of the band (e.g. 95 %) at every position, in the unit of the y axis.
    pub half_width: Option<Vec<Option<f64>>>,
}

/// A panel of a line plot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LinePanel {
    /// Title above the panel.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Curves, drawn in this order.
    pub curves: Vec<Curve>,
}

/// Curves in one or several panels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LinePlot {
    /// Title of the figure.
    pub title: String,
    /// Sentence under the title.
    pub note: Option<String>,
    /// Panels side by side (1 to 4).
    pub columns: usize,
    /// Name of the bands in the legend, e.g. `95 % band`.
    pub band_name: Option<String>,
    /// Panels, row by row.
    pub panels: Vec<LinePanel>,
}

impl Curve {
    /// (position, value, half width) of the points that are not missing, in runs without a gap.
    fn runs(&self) -> Vec<Vec<(f64, f64, f64)>> {
        let mut runs = vec![Vec::new()];
        for (index, (&x, y)) in self.x.iter().zip(&self.y).enumerate() {
            match (y, runs.last_mut()) {
                (Some(y), Some(run)) => run.push((x, *y, self.half_width_at(index).unwrap_or(0.0))),
                _ => runs.push(Vec::new()),
            }
        }
        runs.retain(|run| !run.is_empty());
        runs
    }

    fn half_width_at(&self, index: usize) -> Option<f64> {
        self.half_width.as_ref()?.get(index).copied().flatten()
    }

    fn draw_band(&self, svg: &mut Svg, x: &Scale, y: &Scale) {
        if self.half_width.is_none() {
            return;
        }
        for run in self.runs() {
            let upper = run.iter().map(|&(px, py, h)| (x.map(px), y.map(py + h)));
            let lower = run.iter().rev().map(|&(px, py, h)| (x.map(px), y.map(py - h)));
            let outline: Vec<_> = upper.chain(lower).collect();
            svg.path(&self.style.band_class(), &outline, true);
        }
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        [Some(self.name.as_str()), self.also.as_deref()].into_iter().flatten()
    }

    /// `beside` is the share of the shift of its points that there is room for, `count` that of all points of its name.
    fn draw(&self, svg: &mut Svg, (x, y): (&Scale, &Scale), beside: f64, count: usize) {
        let marker = self.style.marker();
        let step = if marker.is_some() { one_in(count) } else { 1 };
        let beside_px = (f64::from(self.style.beside_px()) * beside) as i8;
        for run in self.runs() {
            let pixels: Vec<_> = drawn(&run, step).map(|&(px, py, _)| (x.map(px), y.map(py))).collect();
            match marker {
                Some(series) => svg.markers(series, &self.style.stroke_class(), &pixels, (beside_px, count)),
                None => svg.path(&self.style.stroke_class(), &pixels, false),
            }
        }
    }
}

impl LinePlot {
    /// Refuses curves whose lists differ in length and negative bands.
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        for curve in self.panels.iter().flat_map(|p| &p.curves) {
            let lengths = [Some(curve.y.len()), curve.half_width.as_ref().map(Vec::len)];
            if lengths.into_iter().flatten().any(|n| n != curve.x.len()) {
                let what = format!("curve '{}' has x, y and half_width of different length", curve.name);
                return Err(ReportError::shape(&self.title, what, "give one value a position, None if missing"));
            }
            if curve.half_width.iter().flatten().flatten().any(|&h| h < 0.0) {
                let what = format!("curve '{}' has a negative half width", curve.name);
                return Err(ReportError::shape(&self.title, what, "pass the half width of the band, at least 0"));
            }
        }
        Ok(())
    }

    /// Draws the figure.
    pub(crate) fn draw(&self) -> Result<Drawing, ReportError> {
        let legend = self.legend();
        let top = if legend.is_empty() { 0.0 } else { 22.0 };
        let panel_height = match self.columns {
            0 | 1 => 260.0,
            2 => 220.0,
            _ => 138.0,
        };
        let (areas, height) = grid(self.panels.len(), self.columns, panel_height, top);
        let mut svg = Svg::new(WIDTH_PX, height);
        draw_legend(&mut svg, (62.0, 14.0), &legend);
        for (panel, area) in self.panels.iter().zip(areas) {
            panel.draw(&mut svg, area);
        }
        svg.finish(&self.title)
    }

    /// The note, with what the drawing leaves out of curves of very many points.
    pub(crate) fn full_note(&self) -> Option<String> {
        let points = |panel: &LinePanel| {
            let points = panel.curves.iter().filter(|curve| curve.style.marker().is_some());
            points.map(|curve| one_in(panel.points_of(&curve.name))).max()
        };
        let step = self.panels.iter().filter_map(points).max().unwrap_or(1);
        let thinned = (step > 1).then(|| format!("One point in {step} is drawn; all of them are in the JSON file."));
        let parts: Vec<String> = self.note.iter().cloned().chain(thinned).collect();
        (!parts.is_empty()).then(|| parts.join(" "))
    }

    fn legend(&self) -> Vec<(Swatch, String)> {
        let mut entries: Vec<(Swatch, String)> = Vec::new();
        for curve in self.panels.iter().flat_map(|p| &p.curves) {
            let class = curve.style.stroke_class();
            let swatch = match curve.style.marker() {
                Some(series) => Swatch::Marker(series, class),
                None => Swatch::Line(class),
            };
            let entry = (swatch, curve.name.clone());
            if !curve.name.is_empty() && !entries.contains(&entry) {
                entries.push(entry);
            }
        }
        let banded = self.panels.iter().flat_map(|p| &p.curves).find(|c| c.half_width.is_some());
        if let (Some(curve), Some(name)) = (banded, &self.band_name) {
            entries.push((Swatch::Patch(curve.style.band_class()), name.clone()));
        }
        entries
    }
}

impl LinePanel {
    /// Wanted marks on the horizontal axis; numbers of things have no marks between them.
    fn x_ticks(&self, area: Area, (low, high): (f64, f64)) -> usize {
        let wanted = (area.width / 60.0) as usize;
        let counts = self.x.unit == "1" && self.curves.iter().flat_map(|c| &c.x).all(|x| x.fract() == 0.0);
        if counts { wanted.min((high - low) as usize + 1) } else { wanted }
    }

    /// All points of a name, whatever else they belong to.
    fn points_of(&self, name: &str) -> usize {
        self.curves.iter().filter(|curve| curve.name == name).map(|curve| curve.x.len()).sum()
    }

    /// Share of the shifts of points beside each other with which none comes near those of the next position.
    fn room_beside(&self, x: &Scale) -> f64 {
        let points = || self.curves.iter().filter(|curve| curve.style.marker().is_some());
        let widest = points().map(|curve| curve.style.beside_px().unsigned_abs()).max().unwrap_or(0);
        if widest == 0 {
            return 1.0;
        }
        let mut places: Vec<f64> = points().flat_map(Curve::runs).flatten().map(|(at, ..)| x.map(at)).collect();
        places.sort_by(f64::total_cmp);
        let gaps = places.windows(2).map(|pair| pair[1] - pair[0]).filter(|gap| *gap > ONE_PLACE_PX);
        (OWN_SIDE * gaps.fold(f64::INFINITY, f64::min) / f64::from(widest)).min(1.0)
    }

    fn draw(&self, svg: &mut Svg, area: Area) {
        let all = || self.curves.iter().flat_map(Curve::runs).flatten();
        let x_range = extent(all().map(|p| p.0)).unwrap_or((0.0, 1.0));
        let points = self.curves.iter().any(|c| c.style.marker().is_some());
        // Points need a margin, or those at the ends would stick out of the frame.
        let x = if points {
            Scale::linear(Some(x_range), area.left, area.right())
        } else {
            Scale::exact(x_range.0, x_range.1, area.left, area.right())
        };
        // Zero is always in sight: an error is judged against it.
        let y_range = extent(all().flat_map(|(_, y, h)| [y - h, y + h]).chain([0.0]));
        let y = Scale::linear(y_range, area.bottom(), area.top);
        let labels = Labels {
            title: self.title.clone(),
            x: axis_text(&self.x),
            y: axis_text(&self.y),
            x_ticks: self.x_ticks(area, x_range),
            y_ticks: (area.height / 26.0) as usize,
        };
        begin_panel(svg, area, &x, &y, &labels);
        svg.line("zero", (area.left, y.map(0.0)), (area.right(), y.map(0.0)));
        for curve in &self.curves {
            svg.names(curve.names());
            curve.draw_band(svg, &x, &y);
        }
        let beside = self.room_beside(&x);
        for curve in &self.curves {
            svg.names(curve.names());
            curve.draw(svg, (&x, &y), beside, self.points_of(&curve.name));
        }
        end_panel(svg);
        if all().next().is_none() {
            frame::draw_empty(svg, area);
        }
    }
}
