//! Liang 2025, section 4.3: the acceptance test after ISO 10360.
//!
//! Place in the flow: called by [`super::figures`].

use crate::figure::{Figure, PaperError, Settings};

/// The figures of the acceptance test.
pub(super) fn figures(_settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    Ok(Vec::new())
}
