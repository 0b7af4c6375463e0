//! The main plot as PNG: title and sentences, the figure, a footer; rasterised with the embedded font only. The picture
//! grows with the sentences: none is cut.

use std::sync::Arc;

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use crate::error::ReportError;
use crate::frame::WIDTH_PX;
use crate::report::Report;
use crate::sections::Section;
use crate::svg::{Anchor, Drawing, Svg};
use crate::theme;

/// Width of the PNG, px.
const PNG_WIDTH_PX: f64 = 1600.0;
/// Margin left and right of the drawing, in drawing units.
const MARGIN: f64 = 36.0;
/// Space above the drawing, with up to two lines of text.
const TOP: f64 = 88.0;
/// First line of text, and from one to the next.
const FIRST_LINE: f64 = 63.0;
const NEXT_LINE: f64 = 17.0;
/// Space below the drawing.
const BOTTOM: f64 = 34.0;
/// Characters of the sentence under the title that fit a line.
const LINE_CHARS: usize = 145;
/// Height of a comparison's plotting areas, so that its PNG is 1600 x 900 with up to two lines of text.
const COMPARISON_HEIGHT: f64 = 422.0;

/// The fonts of the rasteriser; the fonts of the machine are never looked at.
const FONTS: [&[u8]; 2] = [include_bytes!("../fonts/Inter-Regular.otf"), include_bytes!("../fonts/Inter-SemiBold.otf")];

impl Report {
    /// The main plot as PNG, 1600 px wide, on white, drawn with the embedded font.
    ///
    /// # Errors
    /// As [`Report::check`]; [`ReportError::MainPlot`] where `main_plot` names no figure.
    pub fn png(&self) -> Result<Vec<u8>, ReportError> {
        self.check()?;
        main_plot(self)
    }
}

/// The PNG of a checked report's main plot.
fn main_plot(report: &Report) -> Result<Vec<u8>, ReportError> {
    let wrong = |what: String| ReportError::MainPlot { what };
    let index = report.main_plot.ok_or_else(|| wrong("none is chosen".to_owned()))?;
    let count = report.sections.len();
    let section =
        report.sections.get(index).ok_or_else(|| wrong(format!("section {index} is chosen, there are {count}")))?;
    let drawing = match section {
        Section::Comparison(comparison) => comparison.draw_with_height(COMPARISON_HEIGHT)?,
        other => match other.drawing() {
            Some(drawn) => drawn?.0,
            None => return Err(wrong(format!("section {index} '{}' is not a figure", other.title()))),
        },
    };
    rasterise(&standalone(report, section.title(), &drawing)?)
}

/// A stand-alone SVG document: header, the drawing, footer, colours written out.
fn standalone(report: &Report, title: &str, drawing: &Drawing) -> Result<String, ReportError> {
    let width = WIDTH_PX + 2.0 * MARGIN;
    let lines = lines(report.lead.as_deref().unwrap_or(&report.title));
    let top = TOP + NEXT_LINE * lines.len().saturating_sub(2) as f64;
    let height = top + drawing.height + BOTTOM;
    let mut svg = Svg::new(width, height);
    svg.rect("paper", (0.0, 0.0), (width, height), None);
    svg.text("headline", (MARGIN, 40.0), Anchor::Start, title);
    for (number, line) in lines.iter().enumerate() {
        svg.text("subline", (MARGIN, FIRST_LINE + NEXT_LINE * number as f64), Anchor::Start, line);
    }
    if let Some(footer) = &report.footer {
        svg.text("small muted", (MARGIN, height - 14.0), Anchor::Start, footer);
    }
    let around = svg.finish(title)?;
    let css = theme::standalone_css();
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         width=\"{PNG_WIDTH_PX}\" height=\"{}\"><style>{css}</style>{}<g transform=\"translate({MARGIN} {top})\">{}</g></svg>",
        (height * PNG_WIDTH_PX / width).round(),
        around.body,
        drawing.body
    ))
}

/// Text in lines that fit the width; a word that is longer than a line is not cut either.
fn lines(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let last = lines.len() - 1;
        let line = &mut lines[last];
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + word.chars().count() >= LINE_CHARS {
            lines.push(word.to_owned());
        } else {
            line.push(' ');
            line.push_str(word);
        }
    }
    lines
}

fn rasterise(svg: &str) -> Result<Vec<u8>, ReportError> {
    let failed = |what: String| ReportError::Raster { what };
    let mut fonts = fontdb::Database::new();
    for font in FONTS {
        fonts.load_font_data(font.to_vec());
    }
    fonts.set_sans_serif_family("Inter");
    let options = Options { font_family: "Inter".to_owned(), fontdb: Arc::new(fonts), ..Options::default() };
    let tree = Tree::from_str(svg, &options).map_err(|e| failed(e.to_string()))?;
    let size = tree.size().to_int_size();
    let mut pixmap =
        Pixmap::new(size.width(), size.height()).ok_or_else(|| failed("no memory for the picture".to_owned()))?;
    resvg::render(&tree, Transform::identity(), &mut pixmap.as_mut());
    pixmap.encode_png().map_err(|e| failed(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_text_takes_as_many_lines_as_it_needs_and_none_is_cut() {
        assert_eq!(lines("short one"), ["short one"]);
        for (words, count) in [(40, 2), (100, 4)] {
            let lines = lines(&"word ".repeat(words));
            assert_eq!((lines.len(), lines.concat().matches("word").count()), (count, words));
            assert!(lines.iter().all(|line| line.chars().count() <= LINE_CHARS));
        }
    }
}
