//! Too few coefficients look like a missing effect: would a finer error function explain the residual?
//!
//! Place in the flow: competes with the effects in every round of [`crate::search`]; where it wins, the machine gets
//! splines (or more of them) instead of an effect. Each of the 18 errors is tested with the shapes that splines twice
//! as fine add, as columns of the same linear fit.

use crate::candidates::Round;
use crate::error::DiagnoseError;
use crate::score::Score;
use abbe_geometry::ErrorId;
use abbe_geometry::effects::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State};
use abbe_geometry::error_function::{Basis, FunctionKind};
use abbe_geometry::machine::Machine;
use faer::Mat;

/// Intervals of the splines that replace polynomials and nodes: what the shipped machines have.
const FIRST_INTERVALS: usize = 9;
/// Intervals beyond which lines of usual plans have no points between the knots.
const MOST_INTERVALS: usize = 40;

/// An error function with more coefficients than the machine has.
#[derive(Debug)]
struct Finer {
    id: ErrorId,
    basis: Basis,
}

impl Effect for Finer {
    fn name(&self) -> &'static str {
        "finer error function"
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let unit = if self.id.is_angular() { "rad" } else { "m" };
        (0..self.basis.len()).map(|k| ParameterSpec::new(format!("c_{k}"), unit, 1e-3)).collect()
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let local = self.basis.at(state.reading_m[self.id.axis().index()]);
        for (k, value) in local.values().iter().enumerate() {
            part(local.first + k, Acts::Error(self.id), *value);
        }
        Ok(())
    }
}

/// Intervals of a spline that is finer than this kind; `None` where no finer one makes sense.
fn finer(kind: FunctionKind) -> Option<usize> {
    let intervals = match kind {
        FunctionKind::BSpline { intervals } => 2 * intervals,
        FunctionKind::Polynomial { degree } => FIRST_INTERVALS.max(2 * degree),
        FunctionKind::Nodes { count } => FIRST_INTERVALS.max(2 * count),
    };
    (intervals <= MOST_INTERVALS).then_some(intervals)
}

/// How much a refinement of each error function explains, and the columns of that refinement.
pub(crate) fn refinements(round: &Round, machine: &Machine) -> Result<Vec<(ErrorId, Score, Mat<f64>)>, DiagnoseError> {
    let (mut ids, mut columns) = (Vec::new(), Vec::new());
    for id in ErrorId::all() {
        let (Some(kind), Ok(Some(own))) = (machine.kinds[id.index()], machine.basis(id)) else { continue };
        let Some(intervals) = finer(kind) else { continue };
        let (lower_m, upper_m) = own.stroke_m();
        let Ok(basis) = Basis::new(FunctionKind::BSpline { intervals }, own.closure(), lower_m, upper_m) else {
            continue;
        };
        columns.push(round.rows.columns(&Finer { id, basis })?);
        ids.push(id);
    }
    let scores: Vec<Score> = round.free.project_all(&columns).iter().map(|group| round.score(group)).collect();
    Ok(ids.into_iter().zip(scores).zip(columns).map(|((id, score), columns)| (id, score, columns)).collect())
}

/// The machine with finer splines for all its error functions: their penalties settle what each needs.
pub(crate) fn enriched(machine: &Machine) -> Machine {
    let mut richer = machine.clone();
    for kind in richer.kinds.iter_mut().flatten() {
        if let Some(intervals) = finer(*kind) {
            *kind = FunctionKind::BSpline { intervals };
        }
    }
    richer
}
