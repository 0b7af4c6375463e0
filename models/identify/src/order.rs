//! How many coefficients polynomials get: backward elimination by BIC.
//!
//! Place in the flow: after the first passes, on the normal equations alone. The integrated Legendre basis is
//! nested, so leaving out the last free coefficient of a function lowers its degree by one. A coefficient goes
//! when χ² rises by less than φ·ln n (Schwarz 1978), smallest rise first.

use crate::linear::NotPositiveDefinite;
use crate::normal::NormalEquations;
use crate::smoothing::{Smoothness, solve};
use abbe_geometry::ErrorId;
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::layout::Layout;

/// Drops superfluous polynomial coefficients from `free`, given the normal equations of `used` readings.
pub(crate) fn eliminate(
    layout: &Layout,
    (normal, used): (&NormalEquations, usize),
    at: &[f64],
    free: &mut Vec<usize>,
    smoothness: &mut Smoothness,
) -> Result<(), NotPositiveDefinite> {
    loop {
        let solution = solve(normal, at, free, smoothness, 1.0, false)?;
        let limit = (used.max(2) as f64).ln();
        let rise = |k: usize| solution.parameters[free[k]].powi(2) / solution.covariance[(k, k)];
        let weakest = last_coefficients(layout, free).into_iter().min_by(|a, b| rise(*a).total_cmp(&rise(*b)));
        match weakest {
            Some(k) if rise(k) < limit => {
                free.remove(k);
            }
            _ => return Ok(()),
        }
    }
}

/// Places in `free` of the highest coefficient that each polynomial still has.
fn last_coefficients(layout: &Layout, free: &[usize]) -> Vec<usize> {
    ErrorId::all()
        .filter(|id| matches!(layout.basis(*id).map(|b| b.kind()), Some(FunctionKind::Polynomial { .. })))
        .filter_map(|id| free.iter().rposition(|index| layout.range(id).contains(index)))
        .collect()
}
