//! The report as PDF: A4 pages with vector drawings and selectable text, the same bytes from the same data.
//!
//! In: a checked report. Out: bytes. [`layout`] sets the sections on pages as SVG, in the drawings' own style; [`draw`] turns each
//! page into PDF by `usvg` (which the PNG uses, too) and `pdf-writer`. No clock: a PDF carries no date but those in its text.

mod draw;
mod font;
mod layout;
mod packed;
mod pages;
mod table;

use crate::error::ReportError;
use crate::report::Report;

impl Report {
    /// The report as PDF: A4, vector drawings, text that can be selected and searched, no date of its own.
    ///
    /// # Errors
    /// As [`Report::check`]; [`ReportError::Pdf`] where a character is in none of the embedded fonts.
    pub fn pdf(&self) -> Result<Vec<u8>, ReportError> {
        self.check()?;
        draw::document(self, &layout::pages(self)?)
    }
}
