//! Which of the effects found are causes, and which only describe.
//!
//! Place in the flow: near the end of [`crate::diagnose()`], before what is found enters the uncertainty, where a description counts for more. A
//! cause has a name and a size of its own, no free dependence takes its place, and what happens once is one instant ([`crate::instant`]).

use crate::competing::Without;
use crate::diagnosis::FoundParameter;
use crate::error::DiagnoseError;
use crate::explanation::Explanation;
use crate::instant::{self, Moves};
use crate::noise::Detection;
use crate::same_claim::DESCRIPTION;
use crate::search::{Search, State};
use crate::step::added;
use crate::{sizes, tomorrow};
use abbe_geometry::model::{FittedEffect, MachineModel};
use abbe_identify::EffectTerm;

/// Standard uncertainties from which a parameter is told from nothing.
const TOLD: f64 = 3.0;
/// Share of the largest motion that another axis has at least where two axes moved.
const SECOND: f64 = 0.2;

/// An effect that was found, its kind and its size.
pub(crate) struct Judged {
    pub(crate) fitted: FittedEffect,
    pub(crate) kind: Explanation,
    pub(crate) parameters: Vec<FoundParameter>,
}

/// Judges the effects of a model that the search found, in their order; `left` is what the residual says beside all of them.
pub(crate) fn judged(
    search: &Search,
    state: &State,
    (model, is_found): (&MachineModel, &dyn Fn(&FittedEffect) -> bool),
    without: &[Option<Without>],
    left: &Detection,
) -> Result<Vec<Judged>, DiagnoseError> {
    let (mut all, mut rivals) = (Vec::new(), Vec::new());
    let mut first = model.layout().len();
    for (fitted, without) in model.parts().effects.iter().zip(without) {
        if is_found(fitted) {
            let parameters = sizes::of(model, fitted, first);
            let kind = alone(search, state, (fitted, &parameters), without.as_ref())?;
            rivals.push(added(state, &EffectTerm::of(fitted)).map_or(&[][..], |added| added.rivals));
            all.push(Judged { fitted: fitted.clone(), kind, parameters });
        }
        first += fitted.parameters.len();
    }
    let both = all.iter_mut().zip(rivals);
    let moves = both.map(|(own, rivals)| (&mut own.kind, Moves { effect: own.fitted.effect.as_ref(), rivals }));
    instant::hold(&mut moves.collect::<Vec<_>>(), left.between_lines.p_value < search.options.significance);
    Ok(all)
}

/// What an effect is, whatever else was found.
fn alone(
    search: &Search,
    state: &State,
    (fitted, parameters): (&FittedEffect, &[FoundParameter]),
    without: Option<&Without>,
) -> Result<Explanation, DiagnoseError> {
    let candidate = added(state, &EffectTerm::of(fitted)).ok_or(DiagnoseError::Singular)?.candidate;
    let tests = candidate.trials * parameters.len();
    let is_named = candidate.known.name != DESCRIPTION
        && sizes::is_told(parameters, tests, search.options.significance)
        && !tomorrow::happened_in_a_pause(fitted, search.campaign);
    // Where one figure alone explains it, the others are nothing; a form of many figures imitates much.
    let told = parameters.iter().filter(is_told).count();
    let untold = if told == 1 { parameters.len() - 1 } else { 0 };
    let is_outdone =
        || without.map_or(Ok(false), |(_, without)| search.is_outdone(state, without, (candidate, untold)));
    Ok(if is_named && !is_outdone()? { Explanation::Attributed } else { Explanation::Empirical })
}

/// Whether a parameter is told from nothing.
fn is_told(parameter: &&FoundParameter) -> bool {
    parameter.value.abs() > TOLD * parameter.u
}

impl Judged {
    /// Whether somebody bumped a stand, and no scale lost counts: that would be one axis. What bumps the whole machine takes the part on its
    /// table along.
    pub(crate) fn is_bump(&self) -> bool {
        let mut sizes: Vec<f64> = self.parameters.iter().filter(is_told).map(|p| p.value.abs()).collect();
        sizes.sort_by(|a, b| b.total_cmp(a));
        let is_of_two_axes = sizes.get(1).is_some_and(|second| *second > SECOND * sizes[0]);
        let effect = self.fitted.effect.as_ref();
        is_of_two_axes && effect.happens_once() && effect.moves_stand() && self.kind == Explanation::Attributed
    }
}
