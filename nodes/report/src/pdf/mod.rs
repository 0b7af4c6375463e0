//! The report as PDF: A4 pages with vector drawings and selectable text, the same bytes from the same data.
//!
//! In: a checked report. Out: bytes. [`layout`] sets the sections on pages as SVG, in the drawings' own style; [`draw`] turns each
//! page into PDF by `usvg` (which the PNG uses, too) and `pdf-writer`. No clock: a PDF carries no date but those in its text.

mod draw;
mod font;
mod layout;
mod table;

use crate::error::ReportError;
use crate::report::Report;

/// The PDF of a checked report.
pub(crate) fn document(report: &Report) -> Result<Vec<u8>, ReportError> {
    let pages = layout::pages(report)?;
    draw::document(report, &pages)
}
