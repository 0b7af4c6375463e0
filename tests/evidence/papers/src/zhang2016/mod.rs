//! Zhang, Yi and Liu 2016: its published figures, computed again.
//!
//! Place in the flow: called through [`crate::PAPERS`]. Table 2 (ten measured centres) against eq. 14 and tables 3 and 4; what
//! the y components follow from; a simulated scan. Millimetres and degrees as printed; the library gets metres and radians.

mod head_error;
mod judged;
mod published;
mod scan;
mod search;
mod solution;

use crate::figure::{Figure, PaperError, Settings};
use abbe_measurement::probe_pose::ProbePoseError;

const PAPER: &str = "Zhang 2016";

/// All figures of the paper.
pub(crate) fn figures(settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    let mut figures = solution::figures()?;
    figures.push(search::figure()?);
    figures.extend(head_error::figures());
    figures.extend(judged::figures()?);
    figures.extend(scan::figures(settings)?.into_iter().map(|figure| settings.of_runs(figure)));
    Ok(figures)
}

/// A failed calibration as an error of that place.
fn failed(place: &'static str) -> impl Fn(ProbePoseError) -> PaperError {
    move |error| PaperError { paper: PAPER, place, problem: error.to_string() }
}
