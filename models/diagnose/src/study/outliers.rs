//! Single rows that stand apart from all that could be missing, before and after a search.
//!
//! Place in the flow: each chain is fitted with its rich columns (and with what was found) by least absolute deviations,
//! which gross errors do not bend; rows far off are suspects, and each stands trial against a least-squares fit without
//! any suspect: a deleted residual beyond six deviations, and improbable by chance among so many rows (Student's t; Cook &
//! Weisberg 1982, 2.2.2). Many such rows are no accident but something that the model lacks, and then none is rejected.

use super::candidate::{Chain, Study};
use super::series::independent;
use crate::error::DiagnoseError;
use crate::linear::{column, weighted};
use crate::linear::{joined, picked};
use abbe_identify::{in_parallel, symmetric_eigen};
use abbe_measurement::chance::beyond;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use statrs::distribution::StudentsT;
use std::collections::BTreeSet;

/// Deviations from which a row is rejected, as in the robust weights of identification.
const FAR: f64 = 6.0;
/// Probability, over all rows of a chain, that one is rejected that belongs there.
const BY_CHANCE: f64 = 0.01;
/// Share of rows up to which they are accidents, and a number that always may be.
const SHARE: f64 = 0.05;
const ALWAYS: usize = 1;
const PASSES: usize = 30;
/// Deviations (of the robust fit) from which a row is a suspect.
const SUSPECT: f64 = 4.5;
/// Share of the range below which two values are one, but for the rounding of numbers.
const SAME: f64 = 1e-6;
/// Information below which a direction hangs on suspects alone.
const DETERMINED: f64 = 1e-6;

/// A row that was rejected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rejected {
    /// Row of the study.
    pub(super) row: usize,
    /// Its residual against the fit without it, in units of the rows.
    pub(super) residual: f64,
    /// The same in deviations of a row.
    pub(super) deviations: f64,
}

/// Rows to leave out.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Outliers {
    pub(super) rejected: Vec<Rejected>,
    /// Chains in which too many rows stand apart to be accidents, with these rows of the study.
    pub(super) too_many: Vec<(String, Vec<usize>)>,
}

impl Outliers {
    /// Rows of the study that are left out, with all others of their point.
    pub(super) fn rows(&self, study: &dyn Study) -> BTreeSet<usize> {
        let per_point = study.rows_per_point();
        self.rejected.iter().flat_map(|r| (0..per_point).map(move |k| r.row / per_point * per_point + k)).collect()
    }
}

/// Looks for rows that stand apart from the rich columns and these candidates, among those for which `keep` holds.
pub(super) fn outliers(
    study: &dyn Study,
    set: &[usize],
    keep: impl Fn(usize) -> bool + Sync,
) -> Result<Outliers, DiagnoseError> {
    let mut found = Outliers::default();
    if study.chains().is_empty() {
        return Ok(found);
    }
    let zero: Vec<(usize, Vec<f64>)> = Vec::new();
    let local = study.local(&zero)?;
    let columns: Vec<Mat<f64>> = set.iter().map(|k| study.columns(&local.point, *k)).collect();
    let of_chain = |chain: &Chain| {
        let rows: Vec<usize> = (0..chain.rows.len()).filter(|i| keep(chain.rows[*i])).collect();
        let basis = independent(&beside(chain, &rows, &columns));
        let values: Vec<f64> = rows.iter().map(|i| local.residual[chain.rows[*i]]).collect();
        let apart = apart(&basis, &values);
        (rows, apart)
    };
    for (chain, (rows, apart)) in study.chains().iter().zip(in_parallel(study.chains(), of_chain)) {
        if apart.len() > ALWAYS.max((SHARE * rows.len() as f64) as usize) {
            found.too_many.push((chain.of.clone(), apart.iter().map(|(i, ..)| chain.rows[rows[*i]]).collect()));
            continue;
        }
        found.rejected.extend(apart.into_iter().map(|(i, residual, deviations)| Rejected {
            row: chain.rows[rows[i]],
            residual,
            deviations,
        }));
    }
    Ok(found)
}

fn beside(chain: &Chain, rows: &[usize], columns: &[Mat<f64>]) -> Mat<f64> {
    let of_study: Vec<usize> = rows.iter().map(|row| chain.rows[*row]).collect();
    let mut all = vec![picked(chain.rich.as_ref(), rows)];
    all.extend(columns.iter().map(|columns| picked(columns.as_ref(), &of_study)));
    joined(&all)
}

/// Rows far off, with residual and deviations.
fn apart(basis: &Mat<f64>, values: &[f64]) -> Vec<(usize, f64, f64)> {
    let count = values.len();
    if count < basis.ncols() + 4 {
        return Vec::new();
    }
    let robust = robust_residuals(basis, values);
    let mut sizes: Vec<f64> = robust.iter().map(|r| r.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    // As many residuals as there are columns are nearly zero whatever the scatter.
    let sizes = &sizes[basis.ncols()..];
    let digits = rounding(values);
    let scale = (sizes[sizes.len() / 2] / 0.6745).max(digits);
    let mut suspects: BTreeSet<usize> = (0..count).filter(|k| robust[*k].abs() > SUSPECT * scale).collect();
    if scale <= 0.0 || 4 * suspects.len() > count {
        return Vec::new();
    }
    for _ in 0..count {
        let trial = trial(basis, values, digits, &suspects);
        let guilty = |k: &usize| trial[*k].is_some_and(|(_, _, guilty)| guilty);
        let innocent: Vec<usize> = suspects.iter().copied().filter(|k| !guilty(k)).collect();
        let worst = (0..count).filter(|k| !suspects.contains(k) && guilty(k));
        let size = |k: &usize| trial[*k].map_or(0.0, |(_, deviations, _)| deviations.abs());
        let worst = worst.max_by(|a, b| size(a).total_cmp(&size(b)));
        match (innocent.iter().min_by(|a, b| size(a).total_cmp(&size(b))), worst) {
            (Some(least), _) => drop(suspects.remove(least)),
            (None, Some(worst)) => drop(suspects.insert(worst)),
            (None, None) => {
                return suspects.iter().filter_map(|k| trial[*k].map(|(r, d, _)| (*k, r, d))).collect();
            }
        }
    }
    Vec::new()
}

/// Standard deviation of the rounding of a display: of its step, the least by which two values differ. Of values that were
/// not rounded it is next to nothing.
fn rounding(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let range = sorted.last().zip(sorted.first()).map_or(0.0, |(high, low)| high - low);
    let steps = sorted.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > SAME * range);
    steps.reduce(f64::min).unwrap_or(0.0) / 12f64.sqrt()
}

/// For each row its residual against the fit of the rows that are no suspects, that in deviations, and whether it is
/// rejected; `None` where those rows do not tell.
fn trial(basis: &Mat<f64>, values: &[f64], digits: f64, suspects: &BTreeSet<usize>) -> Vec<Option<(f64, f64, bool)>> {
    let count = basis.ncols();
    let kept: Vec<usize> = (0..values.len()).filter(|k| !suspects.contains(k)).collect();
    let own = picked(basis.as_ref(), &kept);
    let observed: Vec<f64> = kept.iter().map(|k| values[*k]).collect();
    let Some((eigen, vectors)) = symmetric_eigen(&(own.transpose() * &own)) else { return vec![None; values.len()] };
    let right = vectors.transpose() * (own.transpose() * column(&observed));
    let known = |k: usize| eigen[k] > DETERMINED;
    let rank = (0..count).filter(|k| known(*k)).count();
    let degrees = kept.len() as f64 - rank as f64;
    let along = basis * &vectors;
    let residual = |k: usize| {
        values[k] - (0..count).filter(|j| known(*j)).map(|j| along[(k, j)] * right[(j, 0)] / eigen[j]).sum::<f64>()
    };
    let chi2: f64 = kept.iter().map(|k| residual(*k).powi(2)).sum();
    let limit = BY_CHANCE / values.len() as f64;
    (0..values.len())
        .map(|k| {
            let unknown: f64 = (0..count).filter(|j| !known(*j)).map(|j| along[(k, j)].powi(2)).sum();
            if unknown > DETERMINED || degrees < 3.0 {
                return None;
            }
            let leverage: f64 = (0..count).filter(|j| known(*j)).map(|j| along[(k, j)].powi(2) / eigen[j]).sum();
            let (residual, is_out) = (residual(k), suspects.contains(&k));
            let (error, rest, degrees) = if is_out {
                (residual, chi2, degrees)
            } else if leverage < 1.0 - DETERMINED {
                (residual / (1.0 - leverage), chi2 - residual * residual / (1.0 - leverage), degrees - 1.0)
            } else {
                return None;
            };
            let sigma = (rest.max(0.0) / degrees).sqrt().max(digits);
            if sigma <= 0.0 {
                return None;
            }
            // A row left out has the variance 1 + leverage of the rest; written with its own leverage that is 1/(1 − h).
            let spread = if is_out { (1.0 + leverage).sqrt() } else { (1.0 - leverage).recip().sqrt() };
            let deviations = error / (sigma * spread);
            let p = StudentsT::new(0.0, 1.0, degrees).map_or(1.0, |t| 2.0 * beyond(&t, deviations.abs()));
            Some((error, deviations, deviations.abs() > FAR && p < limit))
        })
        .collect()
}

/// Residuals of the fit of least absolute deviations, by reweighting.
fn robust_residuals(basis: &Mat<f64>, values: &[f64]) -> Vec<f64> {
    let mut residuals = values.to_vec();
    let mut weights = vec![1.0; values.len()];
    for _ in 0..PASSES {
        let weighted = weighted(basis, &weights);
        let mut gram = basis.transpose() * &weighted;
        let trace: f64 = (0..gram.nrows()).map(|k| gram[(k, k)]).sum();
        (0..gram.nrows()).for_each(|k| gram[(k, k)] += 1e-12 * trace);
        let Ok(llt) = Llt::new(gram.as_ref(), Side::Lower) else { return residuals };
        let solved = llt.solve(&(weighted.transpose() * column(values)));
        let fitted = basis * &solved;
        residuals = values.iter().enumerate().map(|(k, value)| value - fitted[(k, 0)]).collect();
        let mean = residuals.iter().map(|r| r.abs()).sum::<f64>() / values.len() as f64;
        if mean <= 0.0 {
            return residuals;
        }
        weights = residuals.iter().map(|r| (r.abs() / mean).max(1e-4).recip()).collect();
    }
    residuals
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(count: usize) -> (Mat<f64>, Vec<f64>) {
        let basis = independent(&Mat::from_fn(count, 3, |k, j| (k as f64 / count as f64).powi(j as i32)));
        let values = (0..count).map(|k| 30.0 * (k as f64 / count as f64) + (7.7 * k as f64).sin()).collect();
        (basis, values)
    }

    /// A display of whole steps repeats itself to the last digit; a flip of one digit is no gross error, thirty are.
    #[test]
    fn regress_readings_of_a_coarse_display_have_a_scatter() {
        let basis = independent(&Mat::from_fn(60, 2, |k, j| (k as f64 / 60.0).powi(j as i32)));
        let mut values = vec![0.0; 60];
        assert_eq!(apart(&basis, &values), []);
        (values[11], values[40]) = (1.0, -1.0);
        assert_eq!(apart(&basis, &values), []);
        values[25] = 30.0;
        assert_eq!(apart(&basis, &values).iter().map(|f| f.0).collect::<Vec<_>>(), [25]);
    }

    #[test]
    fn gross_rows_are_named_with_their_size_and_nothing_else_is() {
        let (basis, mut values) = line(90);
        assert_eq!(apart(&basis, &values), []);
        values[17] += 90.0;
        values[60] -= 20.0;
        let found = apart(&basis, &values);
        assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), [17, 60]);
        assert!((found[0].1 - 90.0).abs() < 3.0 && found[0].2 > 50.0, "{found:?}");
    }
}
