//! Whether an effect is the cause, or only looks like it.
//!
//! Place in the flow: the end of [`crate::diagnose()`], for each effect with a name that was found. Rows of fits, no units.

use crate::candidates::{Candidate, Round, score_all};
use crate::error::DiagnoseError;
use crate::search::{Search, State};
use std::sync::Arc;

impl Search<'_> {
    /// Whether a free description explains what this effect does, and clearly more: then the data depend on something as the
    /// effect does, and it is not the cause. `without` are the rows of the fit that lacks only this effect. So many of its parameters are
    /// nothing beside the one that explains it: a form that is made for these data has none of these, and is not ahead by their price.
    pub(crate) fn is_outdone(
        &self,
        state: &State,
        without: &Round,
        (effect, untold): (&Candidate, usize),
    ) -> Result<bool, DiagnoseError> {
        let spared = untold as f64 * (without.used.max(2) as f64).ln();
        let looked = self.look(without, &state.machine)?;
        let Some(free) = self.empirical(without, state, &looked)? else { return Ok(false) };
        let of_effect = |round: &Round| -> Result<f64, DiagnoseError> {
            let scored = score_all(round, vec![(effect.known, effect.term.clone(), effect.trials)])?;
            Ok(scored.first().map_or(f64::NEG_INFINITY, |scored| scored.evidence(round.used)))
        };
        if free.evidence(without.used) < of_effect(without)? + spared + self.options.rival_margin {
            return Ok(false);
        }
        let columns = without.rows.columns(free.term.effect.as_ref())?;
        let widened = Arc::new(without.linear.widened(&[columns], without.used)?);
        let beside = Round { free: widened, ..without.clone() };
        Ok(of_effect(&beside)? < self.options.least_evidence)
    }
}
