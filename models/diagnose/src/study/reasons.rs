//! Why a candidate is not taken, although chance alone does not explain what it does.
//!
//! Place in the flow: the judges of the search, for one candidate or several at a time. A wave must stand apart from what is simpler, what passes with
//! the time from what position does, an effect from what lacks its essence; all must beat slow noise and the scatter of blocks, and predict
//! blocks left out.

use super::between::stands_out;
use super::fit::{Fit, Fitted};
use super::judge::{held_out_alike, held_out_rms};
use super::places::{goes_through_places, simpler};
use super::placing::{between, is_step, tried};
use super::significance::{probability, probability_beside};
use super::view::View;
use crate::error::DiagnoseError;
use crate::explanation::Explanation;
use crate::linear::{Linear, joined};
use faer::Mat;

/// Share of what a drift does that position does as well from which the two must be told apart: where they come in no order, few rows would
/// hide a drift behind all the forms that position may have.
const IMITATED: f64 = 0.5;
/// Blocks of an axis from which one can be left out and the others still show what goes on between them.
const FEWEST_BLOCKS: usize = 3;
/// Gain that no instrument shows (µm): rounding of numbers, where a display of few digits leaves no scatter.
const NOTHING_UM: f64 = 1e-6;

/// Why a candidate is not taken beside a fit, before blocks are asked.
pub(super) fn reason_against(
    view: &View,
    fit: &Fit,
    candidate: usize,
    tested: usize,
    significance: f64,
) -> Result<Option<&'static str>, DiagnoseError> {
    let columns = view.columns(&fit.point, candidate);
    let tested = tested.saturating_mul(tried(&*view.study, candidate));
    if !stands_apart(view, fit, candidate, tested, significance)? {
        return Ok(Some("at these targets something smoother, or errors target by target, go as well"));
    }
    if !is_told_from_position(view, fit, candidate, tested, significance)? {
        return Ok(Some(
            "the positions were gone through in an order that goes with it: an error of position looks the same",
        ));
    }
    if !is_itself(view, fit, candidate, significance)? {
        return Ok(Some("without what makes it this effect it goes as well"));
    }
    if probability(view, fit, &columns)? * tested as f64 > significance {
        return Ok(Some("the noise may be correlated over so long that this is chance"));
    }
    // A step between blocks was chosen among as many places.
    let places = between(&*view.study, candidate);
    Ok((!stands_out(view, fit, &columns, places))
        .then_some("it acts between blocks, and does not stand out from their scatter"))
}

/// Whether the parameters that make it this effect are seen beside its others, among all of which that can be asked.
fn is_itself(view: &View, fit: &Fit, candidate: usize, significance: f64) -> Result<bool, DiagnoseError> {
    let candidates = view.study.candidates();
    let essential = &candidates[candidate].essential;
    if essential.is_empty() {
        return Ok(true);
    }
    let columns = view.columns(&fit.point, candidate);
    let (own, others): (Vec<usize>, Vec<usize>) = (0..columns.ncols()).partition(|k| essential.contains(k));
    let pick = |of: &[usize]| Mat::from_fn(columns.nrows(), of.len(), |row, k| columns[(row, of[k])]);
    let beside = probability_beside(view, fit, &pick(&others), &pick(&own))?;
    let asked = candidates.iter().filter(|candidate| !candidate.essential.is_empty()).count();
    Ok(beside * asked as f64 <= significance)
}

/// Whether a wave is seen beside all that is simpler: in what repeats of its places scatter, and in what the places do.
pub(super) fn stands_apart(
    view: &View,
    fit: &Fit,
    candidate: usize,
    tested: usize,
    significance: f64,
) -> Result<bool, DiagnoseError> {
    if !view.study.candidates()[candidate].stands_apart {
        return Ok(true);
    }
    let columns = view.columns(&fit.point, candidate);
    let beside = probability_beside(view, fit, &simpler(view, candidate), &columns)?;
    let is_seen = beside * tested as f64 <= significance;
    Ok(is_seen && goes_through_places(view, fit, candidate, significance)?)
}

/// Whether what passes while rows are taken is seen beside all that position alone may do.
pub(super) fn is_told_from_position(
    view: &View,
    fit: &Fit,
    candidate: usize,
    tested: usize,
    significance: f64,
) -> Result<bool, DiagnoseError> {
    let position = view.study.position_beside(candidate);
    if position.ncols() == 0 {
        return Ok(true);
    }
    let (position, columns) = (view.picked(&position), view.columns(&fit.point, candidate));
    if imitated(view, fit, &position, &columns)? < IMITATED {
        return Ok(true);
    }
    let beside = probability_beside(view, fit, &position, &columns)?;
    Ok(beside * tested as f64 <= significance)
}

/// Share of what columns do beyond a fit that others do as well, less what as many others do by chance (as in the adjusted coefficient of
/// determination). Not whitened.
fn imitated(view: &View, fit: &Fit, others: &Mat<f64>, columns: &Mat<f64>) -> Result<f64, DiagnoseError> {
    let whitened = view.whitened(columns);
    let left = |linear: &Linear| {
        let left = linear.project(whitened.as_ref()).left;
        (0..left.nrows()).map(|k| left[(k, k)]).sum::<f64>()
    };
    let beside = fit.with_columns(view.whitened(others).as_ref())?;
    let rows = view.rows_of(&view.touched(columns)).len() as f64;
    let chance = rows / (rows - others.ncols() as f64).max(1.0);
    let alone = left(&fit.linear);
    Ok(if alone > 0.0 { 1.0 - chance * left(&beside) / alone } else { 1.0 })
}

/// Why a fit with these candidates is none or predicts blocks left out no better than one of the first so many, both in the noise
/// that all of them leave: without the rest, what it explains would pass for slow noise. With two blocks an axis there is
/// none to spare. The view keeps its own noise.
pub(super) fn reason_of_blocks(view: &mut View, set: &[usize], first: usize) -> Option<&'static str> {
    let noises = view.noises();
    let both = view.adapt(set).and_then(|with| Ok((Fit::settle(view, &set[..first])?, with)));
    // One candidate that has no fit must not take the others with it.
    let reason = match both {
        Err(_) => Some("it cannot be fitted beside the rest"),
        Ok(_) if view.least_blocks() < FEWEST_BLOCKS => None,
        Ok((_, with)) if with.added.iter().skip(first).any(|added| is_no_material(view, added)) => {
            Some("its coefficient of expansion is that of no material")
        }
        Ok((without, with)) => {
            let (before, after) = match set[first..].iter().all(|k| is_step(&*view.study, *k)) {
                true => held_out_alike(view, &without, &with),
                false => (held_out_rms(view, &without), held_out_rms(view, &with)),
            };
            if after.judged < before.judged {
                Some("it rests on single blocks: with any one of them left out it is not determined")
            } else {
                (after.rms_um >= before.rms_um - NOTHING_UM)
                    .then_some("it fits, but does not predict blocks left out any better")
            }
        }
    };
    view.take_noises(noises);
    reason
}

/// The candidates of a fit with further ones, where these together are no chance among so many trials and predict blocks left out.
pub(super) fn with_together(
    view: &mut View,
    fit: &Fit,
    members: &[usize],
    trials: usize,
    significance: f64,
) -> Result<Option<Vec<usize>>, DiagnoseError> {
    let columns: Vec<_> = members.iter().map(|k| view.columns(&fit.point, *k)).collect();
    if probability(view, fit, &joined(&columns))? * trials as f64 > significance {
        return Ok(None);
    }
    let own = fit.set();
    let set = [&own, members].concat();
    Ok(reason_of_blocks(view, &set, own.len()).is_none().then_some(set))
}

/// Whether a coefficient of expansion is surely larger than any material has: lengths have no such bound, machines are as bad as they are.
fn is_no_material(view: &View, added: &Fitted) -> bool {
    let candidate = &view.study.candidates()[added.candidate];
    let figures = candidate.parameters.iter().zip(added.values.iter().zip(&added.u));
    candidate.kind == Explanation::Attributed
        && figures
            .filter(|(spec, _)| spec.unit == "1/K")
            .any(|(spec, (value, u))| value.abs() - 2.0 * u > spec.plausible)
}
