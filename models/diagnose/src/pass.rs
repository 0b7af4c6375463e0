//! One score pass: every named candidate against one fit.
//!
//! Place in the flow: what each round of the search does first, for callers who want the table itself and for the
//! benchmark against refitting.

use crate::candidates::Candidate;
use crate::error::DiagnoseError;
use crate::options::DiagnoseOptions;
use crate::score::Score;
use crate::search::Search;
use abbe_geometry::effects::Shape;
use abbe_identify::Identified;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;

/// A candidate and its score.
#[derive(Debug, Clone)]
pub struct Scored {
    /// Name of the effect.
    pub name: &'static str,
    /// Its shape.
    pub shape: Shape,
    /// What the data say of it.
    pub score: Score,
    /// Shapes among which it was tried, or chosen where a search proposed it.
    pub trials: usize,
}

/// Scores all named candidates (periods and runs included) of a fitted campaign, with the model's columns projected out.
///
/// # Errors
/// Covariates that the campaign lacks for an effect of the model.
pub fn score_pass(
    fit: &Identified,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    options: &DiagnoseOptions,
) -> Result<Vec<Scored>, DiagnoseError> {
    let search = Search::new(instrument, campaign, options);
    let round = search.round(fit)?;
    let scored = |c: Candidate| Scored { name: c.known.name, shape: c.term.shape, score: c.score, trials: c.trials };
    Ok(search.named(&round, &fit.model.parts().machine)?.into_iter().map(scored).collect())
}
