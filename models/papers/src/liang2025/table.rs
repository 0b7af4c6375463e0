//! Liang 2025, section 4.3: the three-dimensional compensation table of the geometric part.
//!
//! Place in the flow: called by [`super::figures`].

use crate::figure::{Figure, PaperError, Settings};

/// The figures of the compensation table.
pub(super) fn figures(_settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    Ok(Vec::new())
}
