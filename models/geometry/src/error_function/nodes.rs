//! Piecewise linear error function between equidistant nodes (FYXZ paper, section 1).
//!
//! Place in the flow: one kind of [`super::Basis`]; its coefficients are the error values at the nodes.

use super::{Closure, LocalBasis, without_fixed};

/// Hat functions (or derivatives) at `t` in 0 … 1.
pub(super) fn local(count: usize, closure: Closure, t: f64, derivative: bool) -> LocalBasis {
    let pieces = (count - 1) as f64;
    let piece = ((t * pieces).floor() as usize).min(count - 2);
    let u = t * pieces - piece as f64;
    let values = if derivative { [-pieces, pieces] } else { [1.0 - u, u] };
    without_fixed(piece, &values, count, closure)
}
