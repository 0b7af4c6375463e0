//! Piecewise linear error function between equidistant nodes (FYXZ paper, section 1).
//!
//! Place in the flow: one kind of [`super::Basis`]; its coefficients are the error values at the nodes.

use super::{Closure, LocalBasis, without_fixed};

/// Interval that `t` in 0 … 1 lies in, and how far through it, 0 … 1.
pub(super) fn interval(count: usize, t: f64) -> (usize, f64) {
    let pieces = (count - 1) as f64;
    let piece = ((t * pieces).floor() as usize).min(count - 2);
    (piece, t * pieces - piece as f64)
}

/// Hat functions (or derivatives) at `t` in 0 … 1.
pub(super) fn local(count: usize, closure: Closure, t: f64, derivative: bool) -> LocalBasis {
    let (pieces, (piece, u)) = ((count - 1) as f64, interval(count, t));
    let values = if derivative { [-pieces, pieces] } else { [1.0 - u, u] };
    without_fixed(piece, &values, count, closure)
}
