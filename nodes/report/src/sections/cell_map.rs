//! A grid of cells coloured by a magnitude, with the number in each cell: error by region of the volume.

use serde::{Deserialize, Serialize};

use super::{Axis, State};
use crate::digits;
use crate::error::ReportError;
use crate::frame::{Area, Labels, WIDTH_PX, axis_text, draw_frame};
use crate::scale::Scale;
use crate::stats::max_abs;
use crate::svg::{Anchor, Drawing, Svg, text_width_px};
use crate::text::{MISSING, fixed};
use crate::theme::SEQUENTIAL_STEPS;

/// Height of a row of panels, px: title, cells, axis labels.
const ROW_PX: f64 = 28.0 + 150.0 + 46.0;
/// Height of a line of text, px.
const LINE_PX: f64 = 13.0;
/// Between two labels beside each other, px.
const GAP_PX: f64 = 6.0;

/// A panel: cells between the edges of two axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellPanel {
    /// Title above the panel.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Cell edges along x, ascending.
    pub x_edges: Vec<f64>,
    /// Cell edges along y, ascending.
    pub y_edges: Vec<f64>,
    /// Magnitude of each cell, x fastest; missing where nothing was measured.
    pub values: Vec<Option<f64>>,
    /// Which state of a correction it shows, for the page's switch between before and after.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<State>,
}

/// Cells coloured by a magnitude.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CellMap {
    /// Title of the figure.
    pub title: String,
    /// Sentence under the title.
    pub note: Option<String>,
    /// What the colour and the numbers show, with unit.
    pub value: Axis,
    /// Whether the values are uncertainties, which have two digits.
    #[serde(default)]
    pub is_uncertainty: bool,
    /// Panels side by side (1 to 4). Each row of panels has a colour scale of its own, from 0 to its largest.
    pub columns: usize,
    /// Panels, row by row.
    pub panels: Vec<CellPanel>,
}

impl CellMap {
    /// Refuses edges that do not ascend and a count of values that does not fit.
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        for panel in &self.panels {
            let ascending = |edges: &[f64]| edges.len() >= 2 && edges.windows(2).all(|w| w[0] < w[1]);
            if !ascending(&panel.x_edges) || !ascending(&panel.y_edges) {
                let what = format!("panel '{}' has edges that do not ascend", panel.title);
                return Err(ReportError::shape(&self.title, what, "give at least two ascending edges an axis"));
            }
            let cells = (panel.x_edges.len() - 1) * (panel.y_edges.len() - 1);
            if panel.values.len() != cells {
                let what = format!("panel '{}' has {} values for {cells} cells", panel.title, panel.values.len());
                return Err(ReportError::shape(&self.title, what, "give one value a cell, None if missing"));
            }
            if panel.values.iter().flatten().any(|&v| v < 0.0) {
                let what = format!("panel '{}' has a negative magnitude", panel.title);
                return Err(ReportError::shape(&self.title, what, "use a residual map for signed values"));
            }
        }
        Ok(())
    }

    /// Draws the figure.
    pub(crate) fn draw(&self) -> Result<Drawing, ReportError> {
        let columns = self.columns.clamp(1, 4);
        let cell = WIDTH_PX / columns as f64;
        let rows = self.panels.len().div_ceil(columns);
        let mut svg = Svg::new(WIDTH_PX, rows as f64 * ROW_PX);
        for (row, panels) in self.panels.chunks(columns).enumerate() {
            let values: Vec<f64> = panels.iter().flat_map(|p| p.values.iter().flatten().copied()).collect();
            let top = max_abs(&values).filter(|&m| m > 0.0).unwrap_or(1.0);
            // Those of the largest of the row of panels.
            let wanted = if self.is_uncertainty { digits::of_uncertainty(top) } else { digits::of_result(top) };
            for (column, panel) in panels.iter().enumerate() {
                let area = Area {
                    left: column as f64 * cell + 62.0,
                    top: row as f64 * ROW_PX + 28.0,
                    width: cell - 78.0,
                    height: 150.0,
                };
                panel.state.inspect(|state| svg.open(&format!("class=\"p{}\"", state.class())));
                panel.draw(&mut svg, area, (top, wanted), &self.value.unit);
                panel.state.inspect(|_| svg.close());
            }
        }
        svg.finish(&self.title)
    }
}

impl CellPanel {
    /// Letter of the colour map: that of the state, and where there is none the one of the state after.
    fn colour_map(&self) -> &'static str {
        self.state.filter(|state| *state != State::After).map_or("", State::class)
    }

    /// Where a cell lies, in words.
    fn place(&self, i: usize, j: usize) -> String {
        let along = |axis: &Axis, edges: &[f64], k: usize| {
            format!("{} {} … {} {}", axis.label, fixed(edges[k], 0), fixed(edges[k + 1], 0), axis.unit)
        };
        format!("{}, {}", along(&self.x, &self.x_edges, i), along(&self.y, &self.y_edges, j))
    }

    /// Decimals of the numbers: those wanted, fewer where even the widest cells are too narrow.
    fn decimals(&self, wanted: u8, widest_px: f64) -> u8 {
        let fits =
            |decimals: u8| self.values.iter().flatten().all(|v| text_width_px(&fixed(*v, decimals)) <= widest_px);
        (0..=wanted).rev().find(|decimals| fits(*decimals)).unwrap_or(wanted)
    }

    fn draw(&self, svg: &mut Svg, area: Area, (top, wanted): (f64, u8), unit: &str) {
        let limits = |edges: &[f64]| (edges.first().copied().unwrap_or(0.0), edges.last().copied().unwrap_or(1.0));
        let ((x0, x1), (y0, y1)) = (limits(&self.x_edges), limits(&self.y_edges));
        let x = Scale::exact(x0, x1, area.left, area.right());
        let y = Scale::exact(y0, y1, area.bottom(), area.top);
        let columns = self.x_edges.len() - 1;
        let widths = self.x_edges.windows(2).map(|edges| x.map(edges[1]) - x.map(edges[0]));
        let decimals = self.decimals(wanted, widths.fold(0.0, f64::max));
        for (index, value) in self.values.iter().enumerate() {
            let (i, j) = (index % columns, index / columns);
            let left_top = (x.map(self.x_edges[i]), y.map(self.y_edges[j + 1]));
            let right_bottom = (x.map(self.x_edges[i + 1]), y.map(self.y_edges[j]));
            let size = (right_bottom.0 - left_top.0, right_bottom.1 - left_top.1);
            let step = value.map(|v| ((v / top * SEQUENTIAL_STEPS as f64) as usize).min(SEQUENTIAL_STEPS - 1));
            let step = step.map(|step| format!("{}{step}", self.colour_map()));
            let class = step.as_ref().map_or_else(|| "none edge".to_owned(), |s| format!("q{s} edge"));
            let tip = value.map(|v| format!("{}: {} {unit}", self.place(i, j), fixed(v, wanted)));
            svg.rect(&class, left_top, size, tip.as_deref());
            let text = value.map_or_else(|| MISSING.to_owned(), |v| fixed(v, decimals));
            // A number that would be cut is left to the colour.
            if text_width_px(&text) > size.0 || LINE_PX > size.1 {
                continue;
            }
            // The pointer reads the cell behind it.
            let ink = step.map_or_else(|| "behind".to_owned(), |s| format!("t{s} behind"));
            let middle = (left_top.0 + size.0 / 2.0, left_top.1 + size.1 / 2.0 + 4.0);
            svg.text(&ink, middle, Anchor::Middle, &text);
        }
        let labels =
            Labels { title: self.title.clone(), x: axis_text(&self.x), y: axis_text(&self.y), ..Labels::default() };
        draw_frame(svg, area, &x, &y, &labels);
        let width = |edge: f64| text_width_px(&fixed(edge, 0));
        for edge in apart(&self.x_edges, |a, b| x.map(b) - x.map(a) > (width(a) + width(b)) / 2.0 + GAP_PX) {
            let at = (x.map(edge), area.bottom() + 17.0);
            svg.text("small muted", at, Anchor::Middle, &fixed(edge, 0));
        }
        for edge in apart(&self.y_edges, |a, b| y.map(a) - y.map(b) > LINE_PX) {
            svg.text("small muted", (area.left - 7.0, y.map(edge) + 4.0), Anchor::End, &fixed(edge, 0));
        }
    }
}

/// Those of ascending edges whose labels do not touch each other; the first and the last are among them.
fn apart(edges: &[f64], is_apart: impl Fn(f64, f64) -> bool) -> Vec<f64> {
    let Some((&last, others)) = edges.split_last() else { return Vec::new() };
    let mut kept: Vec<f64> = Vec::new();
    for (k, &edge) in others.iter().enumerate() {
        if k == 0 || (kept.last().is_none_or(|&before| is_apart(before, edge)) && is_apart(edge, last)) {
            kept.push(edge);
        }
    }
    kept.push(last);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits_of_the_largest_and_fewer_where_a_cell_is_narrow() {
        let panel = CellPanel {
            title: String::new(),
            x: Axis::new("X", "mm"),
            y: Axis::new("Y", "mm"),
            x_edges: vec![0.0, 1.0, 2.0],
            y_edges: vec![0.0, 1.0],
            values: vec![Some(40.1234), None],
            state: Some(State::After),
        };
        assert_eq!(panel.decimals(digits::of_result(40.1234), 100.0), 1);
        assert_eq!(panel.decimals(1, text_width_px("40")), 0);
        // Where not even that fits the number is left out, whatever its decimals; the pointer reads it.
        assert_eq!(panel.decimals(1, 1.0), 1);
        let map = CellMap {
            title: "error".to_owned(),
            note: None,
            value: Axis::new("error", "µm"),
            is_uncertainty: false,
            columns: 1,
            panels: vec![panel],
        };
        let body = map.draw().unwrap().body;
        assert!(body.contains("<title>X 0 … 1 mm, Y 0 … 1 mm: 40.1 µm</title>"));
        assert!(body.starts_with("<g class=\"pA\">"), "the switch before/after leaves it: {body}");
        // Maps before a correction were as blue as those after it.
        let before = CellMap { panels: vec![CellPanel { state: Some(State::Before), ..map.panels[0].clone() }], ..map };
        let last = SEQUENTIAL_STEPS - 1;
        assert!(body.contains(&format!("\"q{last} edge\"")), "{body}");
        assert!(before.draw().unwrap().body.contains(&format!("\"qB{last} edge\"")));
    }

    /// The cells of a plan are narrow at both ends of an axis: 0, 67 … 733, 800.
    #[test]
    fn regress_labels_of_narrow_cells_do_not_touch() {
        let wide = |a: f64, b: f64| b - a > 100.0;
        assert_eq!(apart(&[0.0, 67.0, 200.0, 733.0, 800.0], wide), [0.0, 200.0, 800.0]);
        assert_eq!(apart(&[0.0, 800.0], wide), [0.0, 800.0]);
        assert_eq!(apart(&[0.0, 8.0], wide), [0.0, 8.0]);
    }
}
