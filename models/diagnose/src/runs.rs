//! Lines whose readings are all off by the same amount.
//!
//! Place in the flow: proposes shapes of the outlying run to [`crate::search`]; a run that is found is taken out of the
//! geometry's way by a constant of its own and named in the report.

use crate::candidates::{Candidate, Round, score_all};
use crate::error::DiagnoseError;
use abbe_geometry::effects::{Shape, known};
use abbe_geometry::machine::Machine;
use abbe_identify::EffectTerm;
use abbe_measurement::campaign::Campaign;

/// The line that stands out most.
pub(crate) fn candidate(
    round: &Round,
    machine: &Machine,
    campaign: &Campaign,
) -> Result<Option<Candidate>, DiagnoseError> {
    let Some(known) = known("outlying_run") else { return Ok(None) };
    let mut terms = Vec::new();
    for line in &campaign.lines {
        terms.push((
            known,
            EffectTerm::new(known.name, Shape::new().text("line", line), machine)?,
            campaign.lines.len(),
        ));
    }
    let scored = score_all(round, terms)?;
    Ok(scored.into_iter().max_by(|a, b| a.score.reduction.total_cmp(&b.score.reduction)))
}
