//! Polynomial error function (Liang 2025, eq. 9), in integrated Legendre form.
//!
//! Place in the flow: one kind of [`super::Basis`]. The first function is t, the k-th is ∫₀ᵗ P̃ₖ₋₁ with the shifted
//! Legendre polynomials P̃: each is zero at the lower end, all but the first also at the upper end, and the
//! first k of them span the polynomials of degree k. So the closure drops the first, the order drops the last.

use super::{Closure, LocalBasis, MAX_LOCAL};

/// Functions (or derivatives) at `t` in 0 … 1.
pub(super) fn local(degree: usize, closure: Closure, t: f64, derivative: bool) -> LocalBasis {
    let legendre = shifted_legendre(t);
    let skip = usize::from(closure == Closure::BothEnds);
    let mut local = LocalBasis { first: 0, len: degree - skip, values: [0.0; MAX_LOCAL] };
    for k in skip..degree {
        local.values[k - skip] = if derivative { legendre[k] } else { integral(&legendre, k, t) };
    }
    local
}

/// P̃₀ … at `t`, by the three-term recurrence.
fn shifted_legendre(t: f64) -> [f64; MAX_LOCAL] {
    let x = 2.0 * t - 1.0;
    let mut p = [1.0; MAX_LOCAL];
    p[1] = x;
    for n in 1..MAX_LOCAL - 1 {
        let m = n as f64;
        p[n + 1] = ((2.0 * m + 1.0) * x * p[n] - m * p[n - 1]) / (m + 1.0);
    }
    p
}

/// ∫₀ᵗ P̃ₖ = (P̃ₖ₊₁ − P̃ₖ₋₁)/(2(2k + 1)) for k ≥ 1.
fn integral(p: &[f64; MAX_LOCAL], k: usize, t: f64) -> f64 {
    if k == 0 { t } else { (p[k + 1] - p[k - 1]) / (2.0 * (2.0 * k as f64 + 1.0)) }
}
