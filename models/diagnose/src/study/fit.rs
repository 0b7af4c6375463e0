//! Fits the base model and a set of candidates to a study, iterating where the study is not linear.
//!
//! Place in the flow: the search fits through here, again and again. Directions of a candidate that the columns before
//! it already contain are left out and counted, never inverted. Gauss-Newton: the steps become small against the
//! parameters' uncertainty, or the fit is refused. Whitened rows; parameters in SI.

use super::candidate::Study;
use crate::error::DiagnoseError;
use crate::linear::{Linear, column};
use crate::score::{Score, score};
use abbe_identify::symmetric_eigen;
use faer::{Mat, MatRef};

/// Share of a direction's information that must be left beside the columns before it.
const LEFT: f64 = 1e-6;
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
}

/// A settled fit.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub(super) linear: Linear,
    pub(super) added: Vec<Fitted>,
    /// Where columns of further candidates are taken.
    pub(super) point: Vec<f64>,
}

impl Fit {
    /// Base model and these candidates, in this order.
    pub(super) fn settle(study: &dyn Study, set: &[usize]) -> Result<Fit, DiagnoseError> {
        let zero = |k: &usize| (*k, vec![0.0; study.candidates()[*k].parameters.len()]);
        let mut at: Vec<(usize, Vec<f64>)> = set.iter().map(zero).collect();
        for _ in 0..MOST_PASSES {
            let (fit, steps, largest) = Fit::pass(study, &at)?;
            for ((_, values), step) in at.iter_mut().zip(&steps) {
                values.iter_mut().zip(step).for_each(|(value, step)| *value += step);
            }
            if study.is_linear() || largest < SETTLED {
                let added = fit.added.into_iter().zip(at).map(|(f, (_, values))| Fitted { values, ..f }).collect();
                return Ok(Fit { added, ..fit });
            }
        }
        Err(DiagnoseError::Data {
            problem: format!("the fit with {} did not settle in {MOST_PASSES} passes", names(study, set)),
            remedy: "check angles and lengths for rows in a wrong unit".to_owned(),
        })
    }

    /// One linear fit: with steps of the parameters, and the largest step against its uncertainty.
    fn pass(study: &dyn Study, at: &[(usize, Vec<f64>)]) -> Result<(Fit, Vec<Vec<f64>>, f64), DiagnoseError> {
        let local = study.local(at)?;
        let base = independent(&local.base);
        let (mut linear, _) = Linear::least_squares(base, &local.residual)?;
        let mut maps = Vec::with_capacity(at.len());
        for (candidate, _) in at {
            let columns = study.columns(&local.point, *candidate);
            let map = new_directions(&linear, columns.as_ref());
            let first = linear.jacobian().ncols();
            if map.ncols() > 0 {
                linear = linear.with((&columns * &map).as_ref())?;
            }
            maps.push((first, map));
        }
        let solution = linear.covariance() * (linear.jacobian().transpose() * column(&local.residual));
        let noise = linear.noise_factor();
        let (mut added, mut steps, mut largest) = (Vec::new(), Vec::new(), 0.0_f64);
        for ((candidate, values), (first, map)) in at.iter().zip(&maps) {
            let u = uncertainties(&linear, *first, map, noise);
            let step: Vec<f64> = (0..values.len())
                .map(|i| (0..map.ncols()).map(|j| map[(i, j)] * solution[(first + j, 0)]).sum())
                .collect();
            let ratio = step.iter().zip(&u).map(|(s, u)| if *u > 0.0 { (s / u).abs() } else { 0.0 });
            largest = ratio.fold(largest, f64::max);
            added.push(Fitted { candidate: *candidate, values: values.clone(), u });
            steps.push(step);
        }
        Ok((Fit { linear, added, point: local.point }, steps, largest))
    }

    /// Tests a candidate on what this fit leaves.
    pub(super) fn score(&self, study: &dyn Study, candidate: usize) -> Score {
        self.score_columns(study.columns(&self.point, candidate).as_ref())
    }

    /// Tests any columns on what this fit leaves.
    pub(super) fn score_columns(&self, columns: MatRef<f64>) -> Score {
        score(&self.linear.project(columns), self.linear.chi2(), self.linear.degrees())
    }

    /// This fit with columns added, linearly; itself where they add nothing.
    pub(super) fn with_columns(&self, columns: MatRef<f64>) -> Result<Linear, DiagnoseError> {
        let map = new_directions(&self.linear, columns);
        if map.ncols() == 0 { Ok(self.linear.clone()) } else { self.linear.with((columns * &map).as_ref()) }
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
fn independent(columns: &Mat<f64>) -> Mat<f64> {
    let gram = columns.transpose() * columns;
    columns * combinations(&gram, &gram, BASE_LEFT)
}

fn combinations(left: &Mat<f64>, alone: &Mat<f64>, share: f64) -> Mat<f64> {
    let count = alone.nrows();
    let scale: Vec<f64> =
        (0..count).map(|k| if alone[(k, k)] > 0.0 { alone[(k, k)].sqrt().recip() } else { 0.0 }).collect();
    let equal = Mat::from_fn(count, count, |i, j| 0.5 * (left[(i, j)] + left[(j, i)]) * scale[i] * scale[j]);
    let Some((values, vectors)) = symmetric_eigen(&equal) else { return Mat::zeros(count, 0) };
    let kept: Vec<usize> = (0..count).filter(|k| values[*k] > share).collect();
    Mat::from_fn(count, kept.len(), |i, j| vectors[(i, kept[j])] * scale[i])
}
