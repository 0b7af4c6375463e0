//! Zhang, Hu and Liu 2011: its published figure, judged on a simulation, and what the arrangement of targets decides.
//!
//! Place in the flow: called through [`crate::PAPERS`]. The paper prints one number, 0.74″ as the largest difference of yaw
//! between three targets on a laser tracker and the nine-line method, without the arrangement, the distance, the tracker's
//! uncertainty or the readings. So the question turned round is answered too: how certain points must be for it.

mod arrangement;
mod yaw;

use crate::figure::{Figure, PaperError, Settings};

const PAPER: &str = "Zhang 2011";

/// All figures of the paper.
pub(crate) fn figures(settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    let mut figures = arrangement::figures()?;
    figures.extend(yaw::figures(settings)?.into_iter().map(|figure| settings.of_runs(figure)));
    Ok(figures)
}
