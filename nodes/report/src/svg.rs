//! A small SVG writer: shapes in pixels with style classes, never a coordinate that is not finite.
//!
//! Colours live in the style sheet (`theme`), so one drawing serves light and dark pages and the PNG.
//! A generic plot crate was weighed against this: its SVG cannot follow the page's colour scheme.

use std::fmt::Write as _;

use crate::error::ReportError;
use crate::text::{escape, significant};

/// A finished drawing: SVG elements for a canvas of `width` x `height` pixels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Drawing {
    /// Canvas width in px.
    pub(crate) width: f64,
    /// Canvas height in px.
    pub(crate) height: f64,
    /// SVG elements, without the `<svg>` around them.
    pub(crate) body: String,
}

/// The writer.
#[derive(Debug)]
pub(crate) struct Svg {
    width: f64,
    height: f64,
    body: String,
    non_finite: bool,
    /// Attribute of the shapes that are drawn now: what they show, which the page's script links across figures.
    name: String,
}

/// Up to this many markers of a curve are drawn larger.
const FEW: usize = 300;

/// Horizontal anchor of a text.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Anchor {
    /// The text begins at the point.
    Start,
    /// The text is centred on the point.
    Middle,
    /// The text ends at the point.
    End,
}

impl Anchor {
    fn attribute(self) -> &'static str {
        match self {
            Self::Start => "",
            Self::Middle => " text-anchor=\"middle\"",
            Self::End => " text-anchor=\"end\"",
        }
    }
}

impl Svg {
    /// An empty canvas.
    pub(crate) fn new(width: f64, height: f64) -> Self {
        Self { width, height, body: String::new(), non_finite: false, name: String::new() }
    }

    /// What the shapes from here on show: a station, a line, a curve. Shapes of one name belong together across the figures of
    /// a page. `None` ends that.
    pub(crate) fn name(&mut self, name: Option<&str>) {
        let name = name.filter(|name| !name.is_empty());
        self.name = name.map(|name| format!(" data-n=\"{}\"", escape(name))).unwrap_or_default();
    }

    /// The same of what belongs to several, such as a reading to its station and its line. A tab stands between the names.
    pub(crate) fn names<'n>(&mut self, names: impl Iterator<Item = &'n str>) {
        let names: Vec<&str> = names.filter(|name| !name.is_empty()).collect();
        self.name(Some(&names.join("\t")));
    }

    /// Begins a group with these attributes, which are escaped already.
    pub(crate) fn open(&mut self, attributes: &str) {
        self.push(format_args!("<g {attributes}>"));
    }

    /// Ends the group that was begun last.
    pub(crate) fn close(&mut self) {
        self.push(format_args!("</g>"));
    }

    /// A coordinate with two decimals at most; remembers if one was not finite.
    pub(crate) fn number(&mut self, value: f64) -> String {
        if !value.is_finite() {
            self.non_finite = true;
            return "0".to_owned();
        }
        let text = format!("{value:.2}");
        let text = text.trim_end_matches('0').trim_end_matches('.');
        if text == "-0" { "0".to_owned() } else { text.to_owned() }
    }

    fn push(&mut self, element: std::fmt::Arguments<'_>) {
        // Writing to a String cannot fail.
        let _ = self.body.write_fmt(element);
        self.body.push('\n');
    }

    /// A straight line.
    pub(crate) fn line(&mut self, class: &str, from: (f64, f64), to: (f64, f64)) {
        self.path(class, &[from, to], false);
    }

    /// A polyline, or a polygon when `closed`.
    pub(crate) fn path(&mut self, class: &str, points: &[(f64, f64)], closed: bool) {
        if points.is_empty() {
            return;
        }
        let mut d = String::new();
        for (index, &(x, y)) in points.iter().enumerate() {
            let (x, y) = (self.number(x), self.number(y));
            let command = if index == 0 { 'M' } else { 'L' };
            let _ = write!(d, "{command}{x} {y}");
        }
        if closed {
            d.push('Z');
        }
        let name = self.name.clone();
        self.push(format_args!("<path class=\"{class}\"{name} d=\"{d}\"/>"));
    }

    /// Many straight segments of one class in one element.
    pub(crate) fn segments(&mut self, class: &str, segments: &[[(f64, f64); 2]]) {
        if segments.is_empty() {
            return;
        }
        let mut d = String::new();
        for &[from, to] in segments {
            let (x1, y1) = (self.number(from.0), self.number(from.1));
            let (x2, y2) = (self.number(to.0), self.number(to.1));
            let _ = write!(d, "M{x1} {y1}L{x2} {y2}");
        }
        let name = self.name.clone();
        self.push(format_args!("<path class=\"{class}\"{name} d=\"{d}\"/>"));
    }

    /// Many dots of one class in one element: zero-length strokes with round caps. `values` are what the dots stand for, for
    /// the page's script.
    pub(crate) fn dots(&mut self, class: &str, points: &[(f64, f64)], values: &[f64]) {
        if points.is_empty() {
            return;
        }
        let mut d = String::new();
        for &(x, y) in points {
            let (x, y) = (self.number(x), self.number(y));
            let _ = write!(d, "M{x} {y}h.01");
        }
        let values: Vec<String> = values.iter().map(|v| significant(*v, 3).replace('−', "-")).collect();
        let (name, values) = (self.name.clone(), values.join(" "));
        self.push(format_args!("<path class=\"dot {class}\"{name} data-v=\"{values}\" d=\"{d}\"/>"));
    }

    /// Many markers of one class in one element; each of the eight series has a shape of its own, so that they are told
    /// apart without colours. They are drawn so far to the right of their points, whatever the page's script enlarges: it reads the
    /// points themselves. `of` is how many of the series there are in all: the fewer, the larger.
    pub(crate) fn markers(&mut self, series: u8, class: &str, points: &[(f64, f64)], (beside_px, of): (i8, usize)) {
        if points.is_empty() {
            return;
        }
        let mut d = String::new();
        let outline = marker(series, if of <= FEW { 1.6 } else { 1.0 });
        let (beside, shift) = match beside_px {
            0 => (String::new(), String::new()),
            px => (format!(" data-s=\"{px}\""), format!("m{px} 0")),
        };
        for &(x, y) in points {
            let (x, y) = (self.number(x), self.number(y));
            let _ = write!(d, "M{x} {y}{shift}{outline}");
        }
        let name = self.name.clone();
        self.push(format_args!("<path class=\"mark {class}\"{name}{beside} d=\"{d}\"/>"));
    }

    /// A rectangle with an optional tooltip.
    pub(crate) fn rect(&mut self, class: &str, (x, y): (f64, f64), (w, h): (f64, f64), tip: Option<&str>) {
        let (x, y) = (self.number(x), self.number(y));
        let (w, h) = (self.number(w.max(0.0)), self.number(h.max(0.0)));
        let (tip, name) = (tooltip(tip), self.name.clone());
        self.push(format_args!(
            "<rect class=\"{class}\"{name} x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\">{tip}</rect>"
        ));
    }

    /// A circle with an optional tooltip.
    pub(crate) fn circle(&mut self, class: &str, (x, y): (f64, f64), r: f64, tip: Option<&str>) {
        let (x, y, r) = (self.number(x), self.number(y), self.number(r));
        let (tip, name) = (tooltip(tip), self.name.clone());
        self.push(format_args!("<circle class=\"{class}\"{name} cx=\"{x}\" cy=\"{y}\" r=\"{r}\">{tip}</circle>"));
    }

    /// A text, escaped.
    pub(crate) fn text(&mut self, class: &str, (x, y): (f64, f64), anchor: Anchor, text: &str) {
        let (x, y) = (self.number(x), self.number(y));
        let (anchor, text, name) = (anchor.attribute(), escape(text), self.name.clone());
        self.push(format_args!("<text class=\"{class}\"{name} x=\"{x}\" y=\"{y}\"{anchor}>{text}</text>"));
    }

    /// A text turned to read upwards, centred on the point, escaped.
    pub(crate) fn text_up(&mut self, class: &str, (x, y): (f64, f64), text: &str) {
        let (x, y) = (self.number(x), self.number(y));
        let text = escape(text);
        self.push(format_args!(
            "<text class=\"{class}\" transform=\"translate({x} {y}) rotate(-90)\" text-anchor=\"middle\">{text}</text>"
        ));
    }

    /// A finished drawing with its left top corner here, made smaller by a factor.
    pub(crate) fn place(&mut self, drawing: &Drawing, (x, y): (f64, f64), scale: f64) {
        let (x, y, scale) = (self.number(x), self.number(y), format!("{scale:.4}"));
        self.push(format_args!("<g transform=\"translate({x} {y}) scale({scale})\">{}</g>", drawing.body));
    }

    /// The drawing, or an error if a coordinate was not finite.
    pub(crate) fn finish(self, section: &str) -> Result<Drawing, ReportError> {
        if self.non_finite {
            return Err(ReportError::Overflow { section: section.to_owned() });
        }
        Ok(Drawing { width: self.width, height: self.height, body: self.body })
    }
}

/// Outline of a marker from its middle, some 5 px across, enlarged by a factor.
fn marker(series: u8, factor: f64) -> String {
    let short = |value: f64| format!("{}", (value * factor * 100.0).round() / 100.0 + 0.0);
    let corners: &[(f64, f64)] = match (series.max(1) - 1) % 8 {
        0 => {
            let (radius, width) = (short(2.2), short(4.4));
            return format!("m-{radius} 0a{radius} {radius} 0 1 0 {width} 0a{radius} {radius} 0 1 0 -{width} 0z");
        }
        // Square, triangle, diamond.
        1 => &[(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)],
        2 => &[(0.0, -2.7), (2.5, 1.7), (-2.5, 1.7)],
        3 => &[(0.0, -2.9), (2.9, 0.0), (0.0, 2.9), (-2.9, 0.0)],
        // Plus.
        4 => &[
            (-0.7, -2.7),
            (0.7, -2.7),
            (0.7, -0.7),
            (2.7, -0.7),
            (2.7, 0.7),
            (0.7, 0.7),
            (0.7, 2.7),
            (-0.7, 2.7),
            (-0.7, 0.7),
            (-2.7, 0.7),
            (-2.7, -0.7),
            (-0.7, -0.7),
        ],
        // Triangle that points down, bar, upright bar.
        5 => &[(0.0, 2.7), (2.5, -1.7), (-2.5, -1.7)],
        6 => &[(-2.8, -0.8), (2.8, -0.8), (2.8, 0.8), (-2.8, 0.8)],
        _ => &[(-0.8, -2.8), (0.8, -2.8), (0.8, 2.8), (-0.8, 2.8)],
    };
    let mut out = String::new();
    let mut last = (0.0, 0.0);
    for (index, &(x, y)) in corners.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = write!(out, "{}{} {}", if index == 0 { 'm' } else { 'l' }, short(x - last.0), short(y - last.1));
        last = (x, y);
    }
    out.push('z');
    out
}

fn tooltip(tip: Option<&str>) -> String {
    tip.map(|t| format!("<title>{}</title>", escape(t))).unwrap_or_default()
}

/// Width in px that a text of 12 px takes, by the mean advance of the font; for spacing only.
pub(crate) fn text_width_px(text: &str) -> f64 {
    6.6 * text.chars().count() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coordinate_that_is_not_finite_is_refused() {
        let mut svg = Svg::new(10.0, 10.0);
        svg.line("ax", (0.0, f64::NAN), (1.0, 1.0));
        assert!(matches!(svg.finish("S"), Err(ReportError::Overflow { section }) if section == "S"));
    }

    #[test]
    fn numbers_are_short_and_stable() {
        let mut svg = Svg::new(10.0, 10.0);
        svg.line("ax", (-0.0001, 1.50), (2.0, 1.0 / 3.0));
        assert_eq!(svg.finish("S").unwrap().body, "<path class=\"ax\" d=\"M0 1.5L2 0.33\"/>\n");
    }
}
