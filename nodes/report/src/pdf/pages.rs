//! Pages as they are filled: their measures, lines of text, where the next one begins.
//!
//! In: texts and drawings, one after the other, from [`super::layout`] and [`super::table`]. Out: the body of each page as SVG. px of
//! a page that is 1200 px wide. Text is broken by the mean width of a letter, on the safe side.

use crate::error::ReportError;
use crate::svg::{Anchor, Svg};
use crate::text::prose;

/// A4 in px.
pub(super) const PAGE_PX: [f64; 2] = [1200.0, 1697.0];
/// A4 is 595.28 pt wide.
pub(super) const PT_PER_PX: f64 = 595.28 / PAGE_PX[0];
/// Margin on all sides, 10.5 mm.
pub(super) const MARGIN: f64 = 60.0;
/// Width of what is set.
pub(super) const WIDTH: f64 = PAGE_PX[0] - 2.0 * MARGIN;
/// Where the footer begins.
pub(super) const BOTTOM: f64 = PAGE_PX[1] - MARGIN - 30.0;
/// Mean width of a letter over the size of the font, on the safe side.
const LETTER: f64 = 0.56;

/// Pages as they are filled.
pub(super) struct Pages {
    pub(super) done: Vec<String>,
    page: Svg,
    /// Where the next line may begin.
    pub(super) y: f64,
}

pub(super) fn empty() -> Svg {
    Svg::new(PAGE_PX[0], PAGE_PX[1])
}

/// Letters of a size that fit a width.
pub(super) fn letters(width: f64, size: f64) -> usize {
    ((width / (LETTER * size)) as usize).max(1)
}

/// Text in lines of so many letters; a word that is longer is cut into pieces, and nothing is lost.
pub(super) fn lines(text: &str, letters: usize) -> Vec<String> {
    let mut lines: Vec<String> = vec![String::new()];
    for word in text.split_whitespace() {
        let characters: Vec<char> = word.chars().collect();
        for piece in characters.chunks(letters.max(1)) {
            let piece: String = piece.iter().collect();
            let last = lines.len() - 1;
            let used = lines[last].chars().count();
            if used == 0 {
                lines[last] = piece;
            } else if used + 1 + piece.chars().count() <= letters {
                lines[last].push(' ');
                lines[last].push_str(&piece);
            } else {
                lines.push(piece);
            }
        }
    }
    lines
}

impl Pages {
    pub(super) fn new() -> Pages {
        Pages { done: Vec::new(), page: empty(), y: MARGIN }
    }

    /// Begins another page where `height` does not fit any more.
    pub(super) fn need(&mut self, height: f64) -> Result<(), ReportError> {
        if self.y + height > BOTTOM && self.y > MARGIN {
            self.end()?;
        }
        Ok(())
    }

    pub(super) fn end(&mut self) -> Result<(), ReportError> {
        self.done.push(std::mem::replace(&mut self.page, empty()).finish("PDF")?.body);
        self.y = MARGIN;
        Ok(())
    }

    pub(super) fn svg(&mut self) -> &mut Svg {
        &mut self.page
    }

    /// Lines of text, each with its class, from the left margin.
    pub(super) fn text(&mut self, class: &str, size: f64, text: &str) -> Result<(), ReportError> {
        for line in lines(text, letters(WIDTH, size)) {
            self.need(1.4 * size)?;
            self.y += 1.4 * size;
            let at = (MARGIN, self.y - 0.35 * size);
            self.page.text(class, at, Anchor::Start, &line);
        }
        Ok(())
    }

    pub(super) fn rule(&mut self, class: &str) {
        let y = self.y;
        self.page.line(class, (MARGIN, y), (MARGIN + WIDTH, y));
    }
}

/// Title and note of a table or a figure.
pub(super) fn title(pages: &mut Pages, title: &str, note: Option<&str>) -> Result<(), ReportError> {
    pages.y += 22.0;
    if !title.is_empty() {
        pages.text("h3", 20.0, title)?;
    }
    note.map_or(Ok(()), |note| pages.text("mutedb", 16.0, &prose(note)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_fit_and_nothing_is_lost() {
        let text = "one two three 0123456789abcdef0123456789abcdef four";
        let found = lines(text, 10);
        assert!(found.iter().all(|line| line.chars().count() <= 10), "{found:?}");
        assert_eq!(found.concat().replace(' ', ""), text.replace(' ', ""));
    }
}
