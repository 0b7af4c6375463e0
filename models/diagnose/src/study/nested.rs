//! The error before and after on blocks that no step of the search saw.
//!
//! Place in the flow: after the search on all data. The blocks are dealt into folds; without each fold outliers are
//! looked for, the noise estimated and the whole search made anew, and the fold's rows predicted with and without what
//! that search found. Gross rows of the fold itself are not predicted: they are named elsewhere.
//!
//! What each search found is remembered, so that less of it can be judged as well ([`Parts::of`]).
//!
//! The errors are given as they are, in µm. Whether they come down is judged in units of the noise of each axis or
//! component: what one of them shows beyond doubt must not drown in the noise of another.

use super::candidate::Study;
use super::fit::Fit;
use super::judge::{comes_down, rms_of, without};
use super::outcome::{HeldOutRms, Unseen};
use super::outliers::outliers;
use super::placing::{Placed, undecided};
use super::search::{Observe, StudyOptions, search};
use super::series::independent;
use super::view::View;
use crate::error::DiagnoseError;
use crate::held_out::HeldOut;
use crate::linear::{column, joined, weighted};
use abbe_identify::symmetric_eigen;
use faer::Mat;
use std::collections::{BTreeMap, BTreeSet};

/// Most folds, and of large data, where each search takes its time.
const FOLDS: (usize, usize) = (10, 5);
/// Measured rows from which data are large.
const LARGE: usize = 2000;
/// Fewest blocks: with two left out of three, one remains to be its own judge.
const FEWEST: usize = 3;
/// Probability with which the error comes down (one-sided).
pub(super) const SURE: f64 = 0.95;
/// Share of its information that a direction must have in the rows that are left.
const DETERMINED: f64 = 1e-6;

/// Judges the search itself; `gross` are rows that nobody should predict.
pub(super) fn unseen(
    study: &mut dyn Study,
    rows: usize,
    gross: &BTreeSet<usize>,
    options: &StudyOptions,
    observe: &mut Observe,
) -> Result<(Unseen, Parts), DiagnoseError> {
    let blocks = study.blocks().to_vec();
    let mut parts = Parts { rows, gross: gross.clone(), all: Vec::new() };
    if blocks.len() < FEWEST {
        let what = study.block_word().to_owned();
        let because = format!("there are {} blocks ({what}), and at least {FEWEST} are needed", blocks.len());
        return Ok((Unseen { missing_because: Some(because), ..Unseen::default() }, parts));
    }
    let measured = (0..rows).filter(|row| study.is_measured(*row)).count();
    let folds = deal(&blocks, if measured > LARGE { FOLDS.1 } else { FOLDS.0 });
    let (mut judged, mut unseen) = (Vec::new(), Unseen::default());
    for (k, fold) in folds.iter().enumerate() {
        let left_out: BTreeSet<usize> = fold.iter().flat_map(|block| blocks[*block].iter().copied()).collect();
        match one(study, &parts, left_out, options, (k + 1, folds.len()), observe) {
            Ok((part, own)) => {
                unseen.found.push(part.names(study));
                parts.all.push(part);
                judged.push(own);
            }
            Err(DiagnoseError::Stopped) => return Err(DiagnoseError::Stopped),
            Err(error) => unseen.not_judged.push(format!("part {} of {}: {error}", k + 1, folds.len())),
        }
    }
    unseen.folds = folds.len();
    if judged.len() < FEWEST {
        unseen.missing_because = Some("too few parts could be left out".to_owned());
        return Ok((unseen, parts));
    }
    let (before, after, is_sure) = parts.figures(study, &judged, SURE);
    Ok((Unseen { before: Some(before), after: Some(after), is_sure: Some(is_sure), ..unseen }, parts))
}

/// What was found without each part of the data.
pub(super) struct Parts {
    rows: usize,
    gross: BTreeSet<usize>,
    all: Vec<Part>,
}

/// What a search found that did not see the rows of one part.
struct Part {
    left_out: BTreeSet<usize>,
    rejected: BTreeSet<usize>,
    placed: Placed,
}

impl Part {
    fn names(&self, study: &dyn Study) -> Vec<String> {
        self.placed.set().map(|k| study.candidates()[k].name.clone()).collect()
    }
}

impl Parts {
    /// Where no part was left out.
    pub(super) fn none(rows: usize, gross: BTreeSet<usize>) -> Parts {
        Parts { rows, gross, all: Vec::new() }
    }

    /// Error before and after with only what is of the families of a set, and whether it comes down with this probability; `None` where
    /// a part cannot be judged so.
    pub(super) fn of(
        &self,
        study: &mut dyn Study,
        set: &[usize],
        probability: f64,
    ) -> Option<(HeldOutRms, HeldOutRms, bool)> {
        let own = of_families(study, set);
        let judged = self.each(study, own)?;
        Some(self.figures(study, &judged, probability))
    }

    /// Error after with all that was found without each part; `None` where a part cannot be judged so.
    pub(super) fn of_searches(&self, study: &mut dyn Study) -> Option<HeldOutRms> {
        let judged = self.each(study, found)?;
        Some(self.figures(study, &judged, SURE).1)
    }

    /// Error before and after with a set that was chosen on all data, fitted without each part, and whether it comes down with this
    /// probability; `None` where a part cannot be judged so.
    pub(super) fn of_chosen(
        &self,
        study: &mut dyn Study,
        set: &[usize],
        probability: f64,
    ) -> Option<(HeldOutRms, HeldOutRms, bool)> {
        let judged = self.each(study, |_, _| set.to_vec())?;
        Some(self.figures(study, &judged, probability))
    }

    /// Each part, predicted with a set of its own.
    fn each(&self, study: &mut dyn Study, set: impl Fn(&mut dyn Study, &Part) -> Vec<usize>) -> Option<Vec<Judged>> {
        let one = |part: &Part| {
            let set = set(study, part);
            self.judged(&mut self.view(study, part), &set, &part.left_out).ok()
        };
        let judged: Vec<Judged> = self.all.iter().map(one).collect::<Option<_>>()?;
        (!judged.is_empty()).then_some(judged)
    }

    /// Parts that were left out in turn.
    pub(super) fn count(&self) -> usize {
        self.all.len()
    }

    fn view<'a>(&self, study: &'a mut dyn Study, part: &Part) -> View<'a> {
        View::new(study, self.rows, |row| !part.left_out.contains(&row) && !part.rejected.contains(&row))
    }

    /// One part predicted without and with a set.
    fn judged(&self, view: &mut View, set: &[usize], left_out: &BTreeSet<usize>) -> Result<Judged, DiagnoseError> {
        let last = view.adapt(set)?;
        // In the noise that is left when all is found, as the errors on all data are.
        let base = Fit::settle(view, &[])?;
        let rows: Vec<usize> = left_out.iter().copied().filter(|row| !self.gross.contains(row)).collect();
        let (with, own) = predicted(view, &last, &rows)?;
        let (base, _) = predicted(view, &base, &rows)?;
        // Both over the same directions.
        let errors = (without(&base, &own), without(&with, &own));
        let weights = weights(view, &rows);
        let [base, with, own] = [base, with, own].map(|rows| weighted(&rows, &weights));
        Ok(Judged { errors, weighed: (without(&base, &own), without(&with, &own)) })
    }

    fn figures(&self, study: &mut dyn Study, judged: &[Judged], probability: f64) -> (HeldOutRms, HeldOutRms, bool) {
        let view = View::new(study, self.rows, |row| !self.gross.contains(&row));
        let (before, after): (Vec<HeldOut>, Vec<HeldOut>) = judged.iter().map(|own| own.errors).unzip();
        let weighed: (Vec<HeldOut>, Vec<HeldOut>) = judged.iter().map(|own| own.weighed).unzip();
        (rms_of(&view, &before), rms_of(&view, &after), comes_down(&weighed.0, &weighed.1, probability))
    }
}

/// What was found without a part, where it was found.
fn found(study: &mut dyn Study, part: &Part) -> Vec<usize> {
    part.placed.take(study);
    part.placed.set().collect()
}

/// Of that, what is of the families of a set.
fn of_families(study: &dyn Study, set: &[usize]) -> impl Fn(&mut dyn Study, &Part) -> Vec<usize> + use<> {
    let families: BTreeSet<String> = set.iter().map(|k| study.candidates()[*k].family.clone()).collect();
    move |study, part| {
        let mut own = found(study, part);
        own.retain(|k| families.contains(&study.candidates()[*k].family));
        own
    }
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
}

fn one(
    study: &mut dyn Study,
    parts: &Parts,
    left_out: BTreeSet<usize>,
    options: &StudyOptions,
    part: (usize, usize),
    observe: &mut Observe,
) -> Result<(Part, Judged), DiagnoseError> {
    study.reset();
    let rejected = outliers(study, &[], |row| !left_out.contains(&row))?.rows(study);
    let mut own = Part { left_out, rejected, placed: Placed::default() };
    let mut view = parts.view(study, &own);
    let found = search(&mut view, options, Some(part), observe)?;
    let judged = parts.judged(&mut view, &found.set, &own.left_out)?;
    own.placed = Placed::of(&*view.study, &found.set);
    Ok((own, judged))
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
    let (seen, new) = (joined(&seen), joined(&new));
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
    let open_rows = joined(&[&new * directions(&open), undecided(view, &set, rows)]);
    Ok((error, independent_of(&open_rows)))
}

/// Directions of rows that are more than rounding.
fn independent_of(columns: &Mat<f64>) -> Mat<f64> {
    let large: Vec<usize> = (0..columns.ncols())
        .filter(|k| (0..columns.nrows()).map(|i| columns[(i, *k)].powi(2)).sum::<f64>() > DETERMINED)
        .collect();
    independent(&Mat::from_fn(columns.nrows(), large.len(), |i, j| columns[(i, large[j])]))
}
