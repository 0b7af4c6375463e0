//! What the plan cannot tell: effects that the model's own parameters absorb, and by which.
//!
//! Place in the flow: after the search, on the final fit. Share absorbed = 1 − information left / information alone.

use crate::candidates::{Candidate, Round};
use crate::context::Context;
use crate::diagnosis::{NotIdentifiable, Untestable};
use crate::error::DiagnoseError;
use abbe_geometry::ErrorId;
use abbe_geometry::effects::{Effect, REGISTRY};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::MachineModel;
use faer::Mat;

/// Share absorbed from which an effect counts as not identifiable: a fifth of its amplitude is left.
const ABSORBED: f64 = 0.95;
/// Parameters named at most.
const NAMED: usize = 3;
/// Effects whose shapes a search finds.
const SEARCHED: [&str; 3] = ["empirical", "periodic_scale", "outlying_run"];

/// Named effects of which more than the limit is absorbed, the best shape of each.
pub(crate) fn not_identifiable(
    round: &Round,
    model: &MachineModel,
    named: &[Candidate],
) -> Result<Vec<NotIdentifiable>, DiagnoseError> {
    let mut all: Vec<NotIdentifiable> = Vec::new();
    for candidate in named.iter().filter(|c| !SEARCHED.contains(&c.known.name)) {
        let columns = round.rows.columns(candidate.term.effect.as_ref())?;
        let (share, by) = absorbed(round, model, &columns);
        if share <= ABSORBED {
            continue;
        }
        let entry = NotIdentifiable {
            name: candidate.known.name,
            shape: candidate.term.shape.clone(),
            alias_share: share,
            aliased_with: by,
            decided_by: candidate.known.decided_by,
        };
        let key = |n: &NotIdentifiable| (n.name, axis_of(n));
        match all.iter_mut().find(|known| key(known) == key(&entry)) {
            Some(known) if known.alias_share > entry.alias_share => *known = entry,
            Some(_) => {}
            None => all.push(entry),
        }
    }
    // An effect with one shape that can be judged is judged.
    let judged = |n: &NotIdentifiable| {
        named.iter().any(|c| {
            c.known.name == n.name
                && c.term.shape.0.get("axis") == n.shape.0.get("axis")
                && all_share(round, c.term.effect.as_ref()) <= ABSORBED
        })
    };
    let kept = all.iter().filter(|n| !judged(n)).cloned().collect();
    Ok(kept)
}

fn axis_of(entry: &NotIdentifiable) -> String {
    format!("{:?}", entry.shape.0.get("axis").or_else(|| entry.shape.0.get("carrying")))
}

fn all_share(round: &Round, effect: &dyn Effect) -> f64 {
    round.rows.columns(effect).map_or(1.0, |columns| share(round, &columns))
}

/// Share that is absorbed of the effect's information, each parameter counting the same.
fn share(round: &Round, columns: &Mat<f64>) -> f64 {
    let projected = round.free.project(columns.as_ref());
    let one = |k: usize| {
        let alone = projected.alone[(k, k)];
        if alone > 0.0 { 1.0 - projected.left[(k, k)] / alone } else { 1.0 }
    };
    (0..columns.ncols()).map(one).sum::<f64>() / columns.ncols().max(1) as f64
}

/// Share absorbed and the parameters that absorb the effect's first column.
fn absorbed(round: &Round, model: &MachineModel, columns: &Mat<f64>) -> (f64, Vec<String>) {
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
    (share(round, columns), blocks.into_iter().take(NAMED).map(|(name, _)| name).collect())
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

/// Effects that propose no shape for this campaign.
pub(crate) fn untestable(machine: &Machine, context: &Context) -> Vec<Untestable> {
    let observed = context.observed(machine);
    REGISTRY
        .iter()
        .filter(|known| !SEARCHED.contains(&known.name) && (known.propose)(&observed).is_empty())
        .map(|known| Untestable { name: known.name, title: known.title, needs: known.needs })
        .collect()
}
