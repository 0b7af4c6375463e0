//! Fits the base model and a set of candidates to a study, iterating where the study is not linear.
//!
//! Place in the flow: the search fits through here, again and again. Directions of a candidate that the columns before
//! it already contain are left out and counted, never inverted. Gauss-Newton: the steps become small against the
//! parameters' uncertainty, or the fit is refused. Whitened rows; parameters in SI.

use super::candidate::Study;
use super::combinations::{combinations, independent_of};
use super::together::score_together;
use super::view::View;
use crate::error::DiagnoseError;
use crate::linear::{Linear, Projected, joined, picked};
use crate::score::{Score, score};
use faer::{Mat, MatRef};

/// Share of a direction's information that must be left beside the columns before it. What is left of less stands a tenth of its
/// size apart from what is there already: two forms that hold the same term would share it between them, each with a size of its own.
pub(super) const LEFT: f64 = 1e-2;
/// Share below which two columns of the base model are one.
const BASE_LEFT: f64 = 1e-10;
const MOST_PASSES: usize = 40;
/// Step, in standard uncertainties, from which a fit counts as settled.
const SETTLED: f64 = 1e-6;

/// A candidate in a fit.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fitted {
    pub(super) candidate: usize,
    /// SI.
    pub(super) values: Vec<f64>,
    /// Standard uncertainties with the noise estimated, SI.
    pub(super) u: Vec<f64>,
    /// First column of the fit that is its own, and its parameters as combinations of these columns.
    pub(super) first: usize,
    pub(super) map: Mat<f64>,
}

/// A settled fit.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    /// Whitened.
    pub(super) linear: Linear,
    /// The same columns and residuals before they were whitened.
    pub(super) raw_columns: Mat<f64>,
    pub(super) raw_residuals: Vec<f64>,
    pub(super) added: Vec<Fitted>,
    /// Where columns of further candidates are taken.
    pub(super) point: Vec<f64>,
}

/// A fit as some of its rows see it.
pub(super) struct Part {
    /// J L, which the model's columns take away.
    spread: Mat<f64>,
    residuals: Mat<f64>,
    pub(super) chi2: f64,
    /// Degrees of freedom of these rows.
    pub(super) degrees: f64,
}

impl Part {
    /// What whitened columns of these rows would tell.
    pub(super) fn project(&self, columns: MatRef<f64>) -> Projected {
        let (taken, gradient) = (self.spread.transpose() * columns, columns.transpose() * &self.residuals);
        Part::projected(columns, taken.as_ref(), gradient.col_as_slice(0))
    }

    /// The same of groups of so many columns each.
    pub(super) fn project_all(&self, columns: MatRef<f64>, counts: &[usize]) -> Vec<Projected> {
        let (taken, gradient) = (self.spread.transpose() * columns, columns.transpose() * &self.residuals);
        let mut first = 0;
        let one = |count: &usize| {
            let own = first..first + count;
            first += count;
            let (columns, taken) = (columns.subcols(own.start, *count), taken.as_ref().subcols(own.start, *count));
            Part::projected(columns, taken, &gradient.col_as_slice(0)[own])
        };
        counts.iter().map(one).collect()
    }

    fn projected(columns: MatRef<f64>, taken: MatRef<f64>, gradient: &[f64]) -> Projected {
        let alone = columns.transpose() * columns;
        let left = &alone - taken.transpose() * taken;
        Projected { gradient: gradient.to_vec(), alone, left }
    }

    pub(super) fn rows(&self) -> usize {
        self.residuals.nrows()
    }
}

impl Fit {
    /// Base model and these candidates, in this order.
    pub(super) fn settle(view: &View, set: &[usize]) -> Result<Fit, DiagnoseError> {
        let zero = |k: &usize| (*k, vec![0.0; view.study.candidates()[*k].parameters.len()]);
        let mut at: Vec<(usize, Vec<f64>)> = set.iter().map(zero).collect();
        for _ in 0..MOST_PASSES {
            let (fit, steps, largest) = Fit::pass(view, &at)?;
            for ((_, values), step) in at.iter_mut().zip(&steps) {
                values.iter_mut().zip(step).for_each(|(value, step)| *value += step);
            }
            if view.study.is_linear() || largest < SETTLED {
                let added = fit.added.into_iter().zip(at).map(|(f, (_, values))| Fitted { values, ..f }).collect();
                return Ok(Fit { added, ..fit });
            }
        }
        Err(DiagnoseError::Data {
            problem: format!("the fit with {} did not settle in {MOST_PASSES} passes", names(&*view.study, set)),
            remedy: "check angles and lengths for rows in a wrong unit".to_owned(),
        })
    }

    /// Base model and all of a set but one.
    pub(super) fn without(view: &View, set: &[usize], candidate: usize) -> Result<Fit, DiagnoseError> {
        let rest: Vec<usize> = set.iter().copied().filter(|other| *other != candidate).collect();
        Fit::settle(view, &rest)
    }

    /// One linear fit: with steps of the parameters, and the largest step against its uncertainty.
    fn pass(view: &View, at: &[(usize, Vec<f64>)]) -> Result<(Fit, Vec<Vec<f64>>, f64), DiagnoseError> {
        let start = view.start(at)?;
        let based = view.based(&start)?;
        let mut linear = based.linear.clone();
        let mut raw = vec![start.base.clone()];
        let mut maps = Vec::with_capacity(at.len());
        for (candidate, _) in at {
            let columns = view.columns(&start.point, *candidate);
            let whitened = view.whitened(&columns);
            let map = new_directions(&linear, whitened.as_ref());
            let first = linear.jacobian().ncols();
            if map.ncols() > 0 {
                linear = linear.with((&whitened * &map).as_ref())?;
                raw.push(&*columns * &map);
            }
            maps.push((first, map));
        }
        let solution = linear.covariance() * (linear.jacobian().transpose() * &based.observed);
        let raw_columns = joined(&raw);
        let left = &start.rows - &raw_columns * &solution;
        let raw_residuals = left.col_as_slice(0).to_vec();
        let noise = linear.noise_factor();
        let (mut added, mut steps, mut largest) = (Vec::new(), Vec::new(), 0.0_f64);
        for ((candidate, values), (first, map)) in at.iter().zip(&maps) {
            let u = uncertainties(&linear, *first, map, noise);
            let step: Vec<f64> = (0..values.len())
                .map(|i| (0..map.ncols()).map(|j| map[(i, j)] * solution[(first + j, 0)]).sum())
                .collect();
            let ratio = step.iter().zip(&u).map(|(s, u)| if *u > 0.0 { (s / u).abs() } else { 0.0 });
            largest = ratio.fold(largest, f64::max);
            added.push(Fitted { candidate: *candidate, values: values.clone(), u, first: *first, map: map.clone() });
            steps.push(step);
        }
        Ok((Fit { linear, raw_columns, raw_residuals, added, point: start.point.clone() }, steps, largest))
    }

    /// The fit as the rows of these chains see it.
    pub(super) fn part(&self, view: &View, chains: &[usize]) -> Part {
        let rows = view.rows_of(chains);
        let spread = picked(self.linear.spread(), &rows);
        let residuals = Mat::from_fn(rows.len(), 1, |i, _| self.linear.residuals()[rows[i]]);
        let degrees = (rows.len() as f64 - spread.squared_norm_l2()).max(1.0);
        Part { chi2: residuals.squared_norm_l2(), spread, residuals, degrees }
    }

    /// Tests a candidate on what this fit leaves, among the rows that it acts on: the test and the number of those rows.
    pub(super) fn score(&self, view: &View, candidate: usize) -> (Score, usize) {
        if let Some(chain) = view.chain_of(candidate) {
            let (columns, _) = view.chain_columns(chain, &[candidate]);
            let part = self.part(view, &[chain]);
            return (score(&part.project(columns.as_ref()), part.chi2, part.degrees), part.rows());
        }
        self.score_columns(view, &view.columns(&self.point, candidate))
    }

    /// Tests any columns, not whitened, among the rows of the chains that they act on.
    pub(super) fn score_columns(&self, view: &View, columns: &Mat<f64>) -> (Score, usize) {
        let chains = view.touched(columns);
        let whitened = view.whitened(columns);
        let rows = view.rows_of(&chains);
        if chains.len() > 1 {
            let each: Vec<Vec<usize>> = chains.iter().map(|k| view.rows_of(&[*k])).collect();
            return (score_together(&self.linear, &each, &whitened), rows.len());
        }
        let part = self.part(view, &chains);
        let own = picked(whitened.as_ref(), &rows);
        (score(&part.project(own.as_ref()), part.chi2, part.degrees), part.rows())
    }

    /// This fit with whitened columns added, linearly; itself where they add nothing.
    pub(super) fn with_columns(&self, columns: MatRef<f64>) -> Result<Linear, DiagnoseError> {
        let map = new_directions(&self.linear, columns);
        if map.ncols() == 0 { Ok(self.linear.clone()) } else { self.linear.with((columns * &map).as_ref()) }
    }

    /// Covariance of two parameters of candidates (place in [`Fit::added`], number), with the noise that the fit found, SI.
    pub(super) fn covariance(&self, (a, i): (usize, usize), (b, j): (usize, usize)) -> f64 {
        let (one, other) = (&self.added[a], &self.added[b]);
        let covariance = self.linear.covariance();
        let along = |k: usize| {
            let row = |l: usize| covariance[(one.first + k, other.first + l)] * other.map[(j, l)];
            (0..other.map.ncols()).map(row).sum::<f64>()
        };
        let sum = (0..one.map.ncols()).map(|k| one.map[(i, k)] * along(k)).sum::<f64>();
        sum * self.linear.noise_factor()
    }

    /// Candidates and their parameters, as [`Study::local`] wants them.
    pub(super) fn values(&self) -> Vec<(usize, Vec<f64>)> {
        self.added.iter().map(|fitted| (fitted.candidate, fitted.values.clone())).collect()
    }

    /// Candidates in it.
    pub(super) fn set(&self) -> Vec<usize> {
        self.added.iter().map(|fitted| fitted.candidate).collect()
    }
}

/// Names of candidates for messages.
pub(super) fn names(study: &dyn Study, set: &[usize]) -> String {
    if set.is_empty() {
        return study.base_word().to_owned();
    }
    set.iter().map(|k| study.candidates()[*k].name.as_str()).collect::<Vec<_>>().join(" and ")
}

fn uncertainties(linear: &Linear, first: usize, map: &Mat<f64>, noise: f64) -> Vec<f64> {
    let covariance = linear.covariance();
    let variance = |i: usize| -> f64 {
        let along = |j: usize| (0..map.ncols()).map(|k| map[(i, k)] * covariance[(first + k, first + j)]).sum::<f64>();
        (0..map.ncols()).map(|j| along(j) * map[(i, j)]).sum()
    };
    (0..map.nrows()).map(|i| (variance(i).max(0.0) * noise).sqrt()).collect()
}

/// Combinations of columns (their coefficients in columns) that the fit does not already contain.
fn new_directions(linear: &Linear, columns: MatRef<f64>) -> Mat<f64> {
    let group = linear.project(columns);
    combinations(&group.left, &group.alone, LEFT)
}

/// The columns without what depends on the others.
pub(super) fn independent(columns: &Mat<f64>) -> Mat<f64> {
    let gram = columns.transpose() * columns;
    columns * independent_of(&gram, BASE_LEFT)
}
