//! Liang 2025: its published figures, computed again.
//!
//! Place in the flow: called through [`crate::PAPERS`]. Three parts of one paper: identification of the errors
//! ([`identification`]), the compensation table ([`table`]), and the acceptance test ([`conformity`]).

mod conformity;
mod identification;
mod simulated;
mod table;

use crate::figure::{Figure, PaperError, Settings};

/// All figures of the paper.
pub(crate) fn figures(settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    let mut figures = identification::figures(settings)?;
    figures.extend(table::figures(settings)?.into_iter().map(|figure| settings.of_runs(figure)));
    figures.extend(conformity::figures(settings)?);
    Ok(figures)
}
