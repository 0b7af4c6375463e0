//! Horizontal bars: one value a name, with the number at the bar's end.

use serde::{Deserialize, Serialize};

use super::Axis;
use crate::error::ReportError;
use crate::frame::{Area, Labels, WIDTH_PX, axis_text, draw_frame};
use crate::scale::{Scale, extent};
use crate::svg::{Anchor, Drawing, Svg, text_width_px};
use crate::text::{MISSING, fixed, significant};

/// Height of a bar with its gap, px.
const ROW_PX: f64 = 24.0;
/// Least space for the names, px, and that between a name and its bar.
const NAME_PX: f64 = 230.0;
const GAP_PX: f64 = 10.0;

/// A bar.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bar {
    /// Name left of the bar.
    pub name: String,
    /// Value in the unit of the axis.
    pub value: Option<f64>,
}

/// Horizontal bars.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bars {
    /// Title of the figure.
    pub title: String,
    /// Sentence under the title.
    pub note: Option<String>,
    /// What the bars show, with unit.
    pub value: Axis,
    /// Decimals of the numbers at the bars.
    pub decimals: u8,
    /// Bars from top to bottom.
    pub bars: Vec<Bar>,
}

impl Bars {
    /// Refuses a figure without bars.
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        if self.bars.is_empty() {
            return Err(ReportError::shape(&self.title, "there is no bar", "leave the section out"));
        }
        Ok(())
    }

    /// Draws the figure.
    pub(crate) fn draw(&self) -> Result<Drawing, ReportError> {
        // No name is cut, but bars have half of the width at least.
        let longest_px = self.bars.iter().map(|bar| text_width_px(&bar.name) + 2.0 * GAP_PX);
        let left = longest_px.fold(NAME_PX, f64::max).min(WIDTH_PX / 2.0 - 90.0);
        let area = Area { left, top: 6.0, width: WIDTH_PX - left - 90.0, height: ROW_PX * self.bars.len() as f64 };
        let mut svg = Svg::new(WIDTH_PX, area.bottom() + 44.0);
        let range = extent(self.bars.iter().filter_map(|b| b.value).chain([0.0]));
        let (low, high) = range.unwrap_or((0.0, 1.0));
        let x = Scale::exact(low, if high > low { high } else { low + 1.0 }, area.left, area.right());
        let y = Scale::exact(0.0, 1.0, area.bottom(), area.top);
        let labels = Labels { x: axis_text(&self.value), x_ticks: 8, ..Labels::default() };
        draw_frame(&mut svg, area, &x, &y, &labels);
        for (index, bar) in self.bars.iter().enumerate() {
            bar.draw(&mut svg, (area.left, area.top + index as f64 * ROW_PX), &x, (self.decimals, &self.value.unit));
        }
        svg.line("zero", (x.map(0.0), area.top), (x.map(0.0), area.bottom()));
        svg.finish(&self.title)
    }
}

impl Bar {
    fn draw(&self, svg: &mut Svg, (start, top): (f64, f64), x: &Scale, (decimals, unit): (u8, &str)) {
        let base = top + ROW_PX / 2.0 + 4.0;
        svg.text("", (start - GAP_PX, base), Anchor::End, &self.name);
        let Some(value) = self.value else {
            svg.text("muted", (x.map(0.0) + 6.0, base), Anchor::Start, MISSING);
            return;
        };
        let (left, right) = (x.map(value.min(0.0)), x.map(value.max(0.0)));
        let tip = format!("{}: {} {unit}", self.name, shown(value, decimals));
        svg.rect("f1 bar", (left, top + 4.0), (right - left, ROW_PX - 8.0), Some(&tip));
        svg.text("small muted", (right + 6.0, base), Anchor::Start, &shown(value, decimals));
    }
}

/// A value with its decimals; one that would read as nothing with two digits.
fn shown(value: f64, decimals: u8) -> String {
    let is_lost = value != 0.0 && value.abs() < 0.5 * 10f64.powi(-i32::from(decimals));
    if is_lost { significant(value, 2) } else { fixed(value, decimals) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_long_name_begins_inside_of_the_drawing() {
        let long = "perceptron with residual blocks (position alone)";
        let bars = Bars {
            title: "What each method leaves".to_owned(),
            note: None,
            value: Axis::new("error", "µm"),
            decimals: 2,
            bars: vec![Bar { name: long.to_owned(), value: Some(1.0) }],
        };
        let drawing = bars.draw().unwrap();
        let before = drawing.body.split(&format!(">{long}<")).next().unwrap();
        let end_px: f64 = before.rsplit(" x=\"").next().unwrap().split('"').next().unwrap().parse().unwrap();
        assert!(end_px > text_width_px(long), "it ends at {end_px} px");
    }

    #[test]
    fn regress_a_short_step_is_not_shown_as_none() {
        assert_eq!([0.0, 0.0012, 0.09, 6.48].map(|s| shown(s, 2)), ["0.00", "0.0012", "0.09", "6.48"]);
    }
}
