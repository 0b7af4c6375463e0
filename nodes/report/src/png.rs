//! The main plot as PNG: title and sentence, the figure, a footer; rasterised with the embedded font only.

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
/// Space above the drawing.
const TOP: f64 = 88.0;
/// Space below the drawing.
const BOTTOM: f64 = 34.0;
/// Characters of the sentence under the title that fit a line.
const LINE_CHARS: usize = 145;
/// Height of a comparison's plotting areas, so that its PNG is 1600 x 900.
const COMPARISON_HEIGHT: f64 = 422.0;

/// The fonts of the rasteriser; the fonts of the machine are never looked at.
const FONTS: [&[u8]; 2] = [include_bytes!("../fonts/Inter-Regular.otf"), include_bytes!("../fonts/Inter-SemiBold.otf")];

/// The PNG of a checked report's main plot.
pub(crate) fn main_plot(report: &Report) -> Result<Vec<u8>, ReportError> {
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
    let height = TOP + drawing.height + BOTTOM;
    let mut svg = Svg::new(width, height);
    svg.rect("paper", (0.0, 0.0), (width, height), None);
    svg.text("headline", (MARGIN, 40.0), Anchor::Start, title);
    let lead = report.lead.as_deref().unwrap_or(&report.title);
    for (line, y) in two_lines(lead).iter().zip([63.0, 80.0]) {
        svg.text("subline", (MARGIN, y), Anchor::Start, line);
    }
    if let Some(footer) = &report.footer {
        svg.text("small muted", (MARGIN, height - 14.0), Anchor::Start, footer);
    }
    let around = svg.finish(title)?;
    let css = theme::standalone_css();
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         width=\"{PNG_WIDTH_PX}\" height=\"{}\"><style>{css}</style>{}<g transform=\"translate({MARGIN} {TOP})\">{}</g></svg>",
        (height * PNG_WIDTH_PX / width).round(),
        around.body,
        drawing.body
    ))
}

/// A sentence in one or two lines that fit the width; an ellipsis marks what does not.
fn two_lines(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let last = lines.len() - 1;
        let line = &mut lines[last];
        if !line.is_empty() && line.chars().count() + word.chars().count() >= LINE_CHARS {
            if last == 1 {
                line.push_str(" …");
                return lines;
            }
            lines.push(word.to_owned());
            continue;
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
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
    fn a_long_sentence_takes_two_lines_and_says_when_it_goes_on() {
        assert_eq!(two_lines("short one"), ["short one"]);
        let lines = two_lines(&"word ".repeat(40));
        assert_eq!((lines.len(), lines.concat().matches("word").count()), (2, 40));
        let lines = two_lines(&"word ".repeat(100));
        assert!(lines.len() == 2 && lines[1].ends_with(" …"));
    }
}
