//! Whether what is left where nothing was found is as small as its rows scatter.
//!
//! Place in the flow: before anything is called noise. What no candidate describes is in the deviation that a fit leaves, and would pass for
//! noise. Rows are held against columns that leave little but scatter whatever is missing: each chain against its rich ones, and all chains
//! against a base of each by itself, which a plate that moves as one need not have. Whether these explain more than chance is tested in
//! whatever noise the rows leave possible ([`super::significance`]).

use super::fit::Fit;
use super::outcome::Look;
use super::series::{independent, left_by};
use super::significance::probability;
use super::view::View;
use crate::error::DiagnoseError;
use crate::linear::{column, joined};
use faer::Mat;
use std::collections::BTreeMap;

const UM: f64 = 1e6;

/// A test of it.
struct Held {
    of: String,
    columns: Mat<f64>,
    /// What it means where it explains more than chance.
    means: &'static str,
}

/// What it says; nothing where something was found, or where replicates tell it ([`super::candidate::Study::replicates`]).
pub(super) fn scatter_left(view: &View, fit: &Fit, significance: f64) -> Result<Option<Look>, DiagnoseError> {
    if !fit.added.is_empty() || view.study.replicates().is_some() {
        return Ok(None);
    }
    let mut tested = Vec::new();
    for held in held(view, fit) {
        if fit.score_columns(view, &held.columns).0.degrees > 0 {
            tested.push((probability(view, fit, &held.columns)?, held));
        }
    }
    let count = tested.len() as f64;
    let Some((p, held)) = tested.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { return Ok(None) };
    let p = (p * count).min(1.0);
    let is_noise = p > significance;
    let says = match is_noise {
        true => format!("no more than rows scatter (smallest p after Bonferroni {p:.2})"),
        false => {
            let (before_um, after_um) = sizes_um(view, fit, &held.columns);
            let Held { of, means, .. } = held;
            format!(
                "{of} keeps {before_um:.3} µm, of which {after_um:.3} µm are scatter (p = {p:.1e} by chance): {means}"
            )
        }
    };
    Ok(Some(Look { what: "size of what is left".to_owned(), says, is_noise: Some(is_noise) }))
}

fn held(view: &View, fit: &Fit) -> Vec<Held> {
    let mut all = Vec::with_capacity(view.chains().len() + 1);
    for (k, chain) in view.chains().iter().enumerate() {
        let Some(own) = view.study.chains().iter().find(|own| own.of == chain.of) else { continue };
        let mut columns = Mat::zeros(view.len(), own.rich.ncols());
        let places: BTreeMap<usize, usize> = own.rows.iter().enumerate().map(|(place, row)| (*row, place)).collect();
        for (row, of_study) in chain.rows.iter().zip(view.rows_of_study(k)) {
            // A chain lists the rows of a view in its own order.
            let Some(place) = places.get(of_study) else { continue };
            (0..columns.ncols()).for_each(|j| columns[(*row, j)] = own.rich[(*place, j)]);
        }
        all.push(Held { of: chain.of.clone(), columns, means: "a course that no candidate describes" });
    }
    if view.chains().len() > 1 {
        let base = &fit.raw_columns;
        let alone = |rows: &Vec<usize>| {
            let mut own = Mat::zeros(base.nrows(), base.ncols());
            rows.iter().for_each(|row| (0..base.ncols()).for_each(|j| own[(*row, j)] = base[(*row, j)]));
            independent(&own)
        };
        let columns: Vec<Mat<f64>> = view.chains().iter().map(|chain| alone(&chain.rows)).collect();
        let means = "each goes with a motion that the others do not have, and no candidate describes it";
        all.push(Held { of: "all together".to_owned(), columns: joined(&columns), means });
    }
    all
}

/// Root mean square of what is left of the rows on which columns act, and the deviation beside the columns (µm).
fn sizes_um(view: &View, fit: &Fit, columns: &Mat<f64>) -> (f64, f64) {
    let rows = view.rows_of(&view.touched(columns));
    let picked = |matrix: &Mat<f64>| Mat::from_fn(rows.len(), matrix.ncols(), |i, j| matrix[(rows[i], j)]);
    let residuals = picked(&column(&fit.raw_residuals));
    let beside = joined(&[picked(&fit.raw_columns), picked(columns)]);
    let degrees = rows.len().saturating_sub(independent(&beside).ncols()).max(1);
    let unit_um = view.study.unit_m() * UM;
    let left = left_by(&beside, &residuals);
    let rms = |square: f64, count: usize| (square / count as f64).sqrt() * unit_um;
    (rms(residuals.squared_norm_l2(), rows.len()), rms(left.squared_norm_l2(), degrees))
}
