//! The error before and after on blocks that no step of the search saw.
//!
//! Place in the flow: before the search on all data. The blocks are dealt into folds; without each fold outliers are
//! looked for, the noise estimated and the whole search made anew, and the fold's rows predicted with and without what
//! that search found. Gross rows of the fold itself are not predicted: they are named elsewhere.
//!
//! The errors are given as they are, in µm. Whether they come down is judged in units of the noise of each axis or
//! component: what one of them shows beyond doubt must not drown in the noise of another.

use super::candidate::Study;
use super::diagnosis::Unseen;
use super::fit::{Fit, side_by_side};
use super::judge::{comes_down, rms_of, without};
use super::outliers::outliers;
use super::placing::undecided;
use super::search::{Observe, Options, search};
use super::series::independent;
use super::view::View;
use crate::error::DiagnoseError;
use crate::held_out::HeldOut;
use crate::linear::{column, weighted};
use abbe_identify::symmetric_eigen;
use faer::Mat;
use std::collections::{BTreeMap, BTreeSet};

/// Most folds, and of large data, where each search takes its time.
const FOLDS: (usize, usize) = (10, 5);
/// Rows from which data are large.
const LARGE: usize = 2000;
/// Fewest blocks: with two left out of three, one remains to be its own judge.
const FEWEST: usize = 3;
/// Share of its information that a direction must have in the rows that are left.
const DETERMINED: f64 = 1e-6;

/// Judges the search itself; `gross` are rows that nobody should predict.
pub(super) fn unseen(
    study: &mut dyn Study,
    rows: usize,
    gross: &BTreeSet<usize>,
    options: &Options,
    observe: &mut Observe,
) -> Result<Unseen, DiagnoseError> {
    let blocks = study.blocks().to_vec();
    if blocks.len() < FEWEST {
        let what = study.block_word().to_owned();
        let because = format!("there are {} blocks ({what}), and at least {FEWEST} are needed", blocks.len());
        return Ok(Unseen { missing_because: Some(because), ..Unseen::default() });
    }
    let folds = deal(&blocks, if rows > LARGE { FOLDS.1 } else { FOLDS.0 });
    let (mut before, mut after, mut unseen) = (Vec::new(), Vec::new(), Unseen::default());
    let mut weighed = (Vec::new(), Vec::new());
    for (k, fold) in folds.iter().enumerate() {
        let left_out: BTreeSet<usize> = fold.iter().flat_map(|block| blocks[*block].iter().copied()).collect();
        match one(study, rows, &left_out, gross, options, (k + 1, folds.len()), observe) {
            Ok(judged) => {
                before.push(judged.errors.0);
                after.push(judged.errors.1);
                weighed.0.push(judged.weighed.0);
                weighed.1.push(judged.weighed.1);
                unseen.found.push(judged.found);
            }
            Err(DiagnoseError::Stopped) => return Err(DiagnoseError::Stopped),
            Err(error) => unseen.not_judged.push(format!("part {} of {}: {error}", k + 1, folds.len())),
        }
    }
    let view = View::new(study, rows, |row| !gross.contains(&row));
    if before.len() < FEWEST {
        unseen.missing_because = Some("too few parts could be left out".to_owned());
    } else {
        unseen.before = Some(rms_of(&view, &before));
        unseen.after = Some(rms_of(&view, &after));
        unseen.is_sure = Some(comes_down(&weighed.0, &weighed.1));
    }
    unseen.folds = folds.len();
    Ok(unseen)
}

/// Deals blocks into folds, neighbours apart.
fn deal(blocks: &[Vec<usize>], most: usize) -> Vec<Vec<usize>> {
    let count = blocks.len().min(most);
    let mut folds = vec![Vec::new(); count];
    (0..blocks.len()).for_each(|k| folds[k % count].push(k));
    folds
}

/// One fold, predicted without and with what the search without it found.
struct Judged {
    errors: (HeldOut, HeldOut),
    /// In units of the noise.
    weighed: (HeldOut, HeldOut),
    found: Vec<String>,
}

fn one(
    study: &mut dyn Study,
    rows: usize,
    left_out: &BTreeSet<usize>,
    gross: &BTreeSet<usize>,
    options: &Options,
    part: (usize, usize),
    observe: &mut Observe,
) -> Result<Judged, DiagnoseError> {
    study.reset();
    let rejected = outliers(study, &[], |row| !left_out.contains(&row))?.rows(study);
    let mut view = View::new(study, rows, |row| !left_out.contains(&row) && !rejected.contains(&row));
    let found = search(&mut view, options, Some(part), observe)?;
    let last = view.adapt(&found.set)?;
    // In the noise that is left when all is found, as the errors on all data are.
    let base = Fit::settle(&view, &[])?;
    let found = found.set.iter().map(|k| view.study.candidates()[*k].name.clone()).collect();
    let rows: Vec<usize> = left_out.iter().copied().filter(|row| !gross.contains(row)).collect();
    let (with, own) = predicted(&view, &last, &rows)?;
    let (base, _) = predicted(&view, &base, &rows)?;
    // Both over the same directions.
    let errors = (without(&base, &own), without(&with, &own));
    let weights = weights(&view, &rows);
    let [base, with, own] = [base, with, own].map(|rows| weighted(&rows, &weights));
    Ok(Judged { errors, weighed: (without(&base, &own), without(&with, &own)), found })
}

/// One over the deviation of the noise in each of these rows of the study, as the view has it.
fn weights(view: &View, rows: &[usize]) -> Vec<f64> {
    let mut of_row = BTreeMap::new();
    for chain in view.study.chains() {
        let own = view.chains().iter().find(|kept| kept.of == chain.of);
        let weight = own.map_or(1.0, |kept| kept.noise.sigma.recip());
        of_row.extend(chain.rows.iter().map(|row| (*row, weight)));
    }
    rows.iter().map(|row| of_row.get(row).copied().unwrap_or(1.0)).collect()
}

/// Errors of rows of the study that the view does not hold, and the directions in them that the view does not determine.
fn predicted(view: &View, fit: &Fit, rows: &[usize]) -> Result<(Mat<f64>, Mat<f64>), DiagnoseError> {
    let local = view.study.local(&fit.values())?;
    let set = fit.set();
    let pick = |matrix: &Mat<f64>| Mat::from_fn(rows.len(), matrix.ncols(), |i, j| matrix[(rows[i], j)]);
    // At the fit's own parameters what remains is for the base to explain; its columns and the candidates' together say
    // what the rows kept leave open.
    let mut seen = vec![view.picked(&local.base)];
    let mut new = vec![pick(&local.base)];
    for candidate in &set {
        let columns = view.study.columns(&local.point, *candidate);
        seen.push(view.picked(&columns));
        new.push(pick(&columns));
    }
    let (seen, new) = (side_by_side(&seen), side_by_side(&new));
    let count = seen.ncols();
    let square = |matrix: &Mat<f64>, k: usize| (0..matrix.nrows()).map(|i| matrix[(i, k)].powi(2)).sum::<f64>();
    let scale: Vec<f64> =
        (0..count).map(|k| (square(&seen, k) + square(&new, k)).sqrt().max(f64::MIN_POSITIVE).recip()).collect();
    let scaled = |matrix: &Mat<f64>| Mat::from_fn(matrix.nrows(), count, |i, j| matrix[(i, j)] * scale[j]);
    let (seen, new) = (view.whitened(&scaled(&seen)), scaled(&new));
    let Some((values, vectors)) = symmetric_eigen(&(seen.transpose() * &seen)) else {
        return Err(DiagnoseError::Singular);
    };
    let most = values.last().copied().unwrap_or(1.0).max(f64::MIN_POSITIVE);
    let open: Vec<usize> = (0..count).filter(|k| values[*k] <= DETERMINED * most).collect();
    let known: Vec<usize> = (0..count).filter(|k| values[*k] > DETERMINED * most).collect();
    let directions = |which: &[usize]| Mat::from_fn(count, which.len(), |i, j| vectors[(i, which[j])]);
    let rows_seen = view.whitened(&view.picked(&column(&local.residual)));
    let known = directions(&known);
    let own = &seen * &known;
    let gram = own.transpose() * &own;
    let right = own.transpose() * &rows_seen;
    let solved = Mat::from_fn(gram.nrows(), 1, |k, _| right[(k, 0)] / gram[(k, k)].max(f64::MIN_POSITIVE));
    let moved = &new * (&known * &solved);
    let error = Mat::from_fn(rows.len(), 1, |i, _| local.residual[rows[i]] - moved[(i, 0)]);
    let open_rows = side_by_side(&[&new * directions(&open), undecided(view, &set, rows)]);
    Ok((error, independent_of(&open_rows)))
}

/// Directions of rows that are more than rounding.
fn independent_of(columns: &Mat<f64>) -> Mat<f64> {
    let large: Vec<usize> = (0..columns.ncols())
        .filter(|k| (0..columns.nrows()).map(|i| columns[(i, *k)].powi(2)).sum::<f64>() > DETERMINED)
        .collect();
    independent(&Mat::from_fn(columns.nrows(), large.len(), |i, j| columns[(i, large[j])]))
}
