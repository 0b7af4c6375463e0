//! What the plan cannot tell: effects that the model's own parameters absorb, and by which.
//!
//! Place in the flow: after the search, on the final fit. Share absorbed = 1 − information left / information alone.

use crate::candidates::{Candidate, Round};
use crate::context::Context;
use crate::diagnosis::{NotIdentifiable, Untestable};
use crate::error::DiagnoseError;
use crate::lags;
use abbe_geometry::ErrorId;
use abbe_geometry::effects::{REGISTRY, ShapeValue};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::MachineModel;
use faer::Mat;

/// Share absorbed from which an effect counts as not identifiable: a fifth of its amplitude is left.
const ABSORBED: f64 = 0.95;
/// Parameters named at most.
const NAMED: usize = 3;
/// Effects whose shapes a search finds.
const SEARCHED: [&str; 7] =
    ["axis_term", "empirical", "periodic_scale", "outlying_run", "scale_step", "stand_jump", "zero_jump"];

/// Named effects of which more than the limit is absorbed, the best shape of each.
pub(crate) fn not_identifiable(
    round: &Round,
    model: &MachineModel,
    named: &[Candidate],
) -> Result<Vec<NotIdentifiable>, DiagnoseError> {
    // What is logged stands for what follows it.
    let named: Vec<&Candidate> = named.iter().filter(|c| !lags::is_lagged(c)).collect();
    let mut least: Vec<&Candidate> = Vec::new();
    for candidate in named.iter().copied().filter(|c| !SEARCHED.contains(&c.known.name)) {
        match least.iter_mut().find(|known| key(known) == key(candidate)) {
            Some(known) if known.absorbed > candidate.absorbed => *known = candidate,
            Some(_) => {}
            None => least.push(candidate),
        }
    }
    // An effect with one shape that can be judged is judged.
    let axis = |c: &Candidate| c.term.shape.0.get("axis").cloned();
    let is_judged = |hidden: &Candidate| {
        let same = |c: &Candidate| c.known.name == hidden.known.name && axis(c) == axis(hidden);
        named.iter().any(|c| same(c) && c.absorbed <= ABSORBED)
    };
    let hidden = least.into_iter().filter(|c| c.absorbed > ABSORBED && !is_judged(c));
    hidden
        .map(|candidate| -> Result<NotIdentifiable, DiagnoseError> {
            let columns = round.rows.columns(candidate.term.effect.as_ref())?;
            Ok(NotIdentifiable {
                name: candidate.known.name,
                shape: candidate.term.shape.clone(),
                alias_share: candidate.absorbed,
                aliased_with: absorbing(round, model, &columns),
                decided_by: candidate.known.decided_by,
            })
        })
        .collect()
}

/// Named effects that can be told: of each claim the shape that was proposed first, which is the simplest, of those that the
/// model does not absorb.
pub(crate) fn told(named: &[Candidate]) -> Vec<&Candidate> {
    let mut told: Vec<&Candidate> = Vec::new();
    for candidate in named.iter().filter(|c| !SEARCHED.contains(&c.known.name) && c.absorbed <= ABSORBED) {
        if !told.iter().any(|known| key(known) == key(candidate)) {
            told.push(candidate);
        }
    }
    told
}

/// Shapes of one effect on one axis, or carrying one axis, are one claim.
fn key(candidate: &Candidate) -> (&str, Option<&ShapeValue>) {
    let shape = &candidate.term.shape.0;
    (candidate.known.name, shape.get("axis").or_else(|| shape.get("carrying")))
}

/// The parameters that absorb most of an effect's first column.
fn absorbing(round: &Round, model: &MachineModel, columns: &Mat<f64>) -> Vec<String> {
    let shared = round.free.jacobian().transpose() * columns;
    let reach = round.free.covariance() * &shared;
    let mut blocks: Vec<(String, Vec<f64>)> = Vec::new();
    for (column, index) in round.rows.parameters.iter().enumerate() {
        let name = parameter_block(model, *index);
        let part: Vec<f64> =
            (0..round.rows.len()).map(|k| round.free.jacobian()[(k, column)] * reach[(column, 0)]).collect();
        match blocks.iter_mut().find(|(known, _)| *known == name) {
            Some((_, sum)) => sum.iter_mut().zip(&part).for_each(|(s, p)| *s += p),
            None => blocks.push((name, part)),
        }
    }
    let size = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>();
    blocks.sort_by(|a, b| size(&b.1).total_cmp(&size(&a.1)));
    blocks.into_iter().take(NAMED).map(|(name, _)| name).collect()
}

/// Name of the error, angle, effect or station that a parameter belongs to.
fn parameter_block(model: &MachineModel, index: usize) -> String {
    let layout = model.layout();
    if let Some(id) = ErrorId::all().find(|id| layout.range(*id).contains(&index)) {
        return id.name();
    }
    if layout.squareness().contains(&index) {
        return model.parts().machine.squareness[index - layout.squareness().start].name.clone();
    }
    let mut first = layout.len();
    for fitted in &model.parts().effects {
        if (first..first + fitted.parameters.len()).contains(&index) {
            return fitted.effect.name().to_owned();
        }
        first += fitted.parameters.len();
    }
    "station positions and dead paths".to_owned()
}

/// Quantities with gaps, and effects that propose no shape for this campaign.
pub(crate) fn untestable(machine: &Machine, context: &Context) -> Vec<Untestable> {
    let observed = context.observed(machine);
    let gaps = context.with_gaps.iter().map(|gaps| Untestable {
        name: format!("dependence on {}", gaps.name),
        title: format!("dependence on {}", gaps.name),
        needs: format!("{} at every reading: it stands at {} of {}", gaps.name, gaps.logged, gaps.readings),
    });
    let effects = REGISTRY
        .iter()
        .filter(|known| !SEARCHED.contains(&known.name) && (known.propose)(&observed).is_empty())
        .map(|known| Untestable {
            name: known.name.to_owned(),
            title: known.title.to_owned(),
            needs: known.needs.to_owned(),
        });
    gaps.chain(effects).collect()
}
