//! Whether a wave stands out from what simpler terms, or no term at all, do at the places where it was measured.
//!
//! Place in the flow: beside the F test of the search, for candidates that must stand apart. Many waves are tried, and one
//! of them always goes through much of what a smooth error left or what a scale graduated by chance does. Repeats tell
//! such errors from noise and not from a wave. So a wave is tested beside the simpler terms, and against what the places
//! (rows at which the wave is the same) do beside both: the test of a straight line against lack of fit (Draper & Smith,
//! Applied Regression Analysis, 2.1), with the wave in the place of the line. At few places it never passes.

use super::fit::Fit;
use super::placing::tried;
use super::view::View;
use crate::error::DiagnoseError;
use crate::score::score_of;
use abbe_measurement::chance::beyond;
use faer::Mat;
use statrs::distribution::FisherSnedecor;
use std::collections::BTreeMap;

/// Columns, not whitened, of what is simpler than a candidate.
pub(super) fn simpler(view: &View, candidate: usize) -> Mat<f64> {
    let simpler = view.study.simpler(candidate);
    if simpler.nrows() == 0 { Mat::zeros(view.len(), 0) } else { view.picked(&simpler) }
}

/// Whether a wave goes through more of what the places do than one of as many waves would by chance; where there are less than two
/// rows a place the test of the rows has said it.
pub(super) fn goes_through_places(
    view: &View,
    fit: &Fit,
    candidate: usize,
    significance: f64,
) -> Result<bool, DiagnoseError> {
    let columns = view.columns(&fit.point, candidate);
    let (rows, of_row) = places(&columns);
    let count = of_row.iter().max().map_or(0, |last| last + 1);
    if 2 * count > rows.len() {
        return Ok(true);
    }
    let mut places = Mat::zeros(columns.nrows(), count);
    rows.iter().zip(&of_row).for_each(|(row, place)| places[(*row, *place)] = 1.0);
    let linear = fit.with_columns(view.whitened(&simpler(view, candidate)).as_ref())?;
    let tested = |columns: &Mat<f64>| {
        let found = score_of(&linear, view.whitened(columns).as_ref());
        (found.reduction, found.degrees)
    };
    let (wave, own) = tested(&columns);
    if own == 0 {
        return Ok(false);
    }
    let (all, degrees) = tested(&places);
    let rest = degrees.saturating_sub(own) as f64;
    let f = (wave / own as f64) / ((all - wave).max(f64::MIN_POSITIVE) / rest);
    let candidates = view.study.candidates();
    let waves = candidates.iter().filter(|other| other.family == candidates[candidate].family).count();
    let waves = waves.saturating_mul(tried(&*view.study, candidate));
    let p_value = FisherSnedecor::new(own as f64, rest).map_or(1.0, |distribution| beyond(&distribution, f));
    Ok(p_value * waves as f64 <= significance)
}

/// Rows at which the candidate is not nothing, and the number of the place of each: where the candidate is the same.
fn places(columns: &Mat<f64>) -> (Vec<usize>, Vec<usize>) {
    let acts = |i: &usize| (0..columns.ncols()).any(|j| columns[(*i, j)] != 0.0);
    let rows: Vec<usize> = (0..columns.nrows()).filter(acts).collect();
    let mut numbers = BTreeMap::new();
    let mut number = |i: &usize| {
        let key: Vec<u64> = (0..columns.ncols()).map(|j| columns[(*i, j)].to_bits()).collect();
        let next = numbers.len();
        *numbers.entry(key).or_insert(next)
    };
    let of_row = rows.iter().map(&mut number).collect();
    (rows, of_row)
}
