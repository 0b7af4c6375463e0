//! The volume that a model was identified in, as far as the machine reaches, and places spread over it.
//!
//! Place in the flow: under formats that say what is left of the error of a tip ([`super::skew`], [`super::tip`]). Readings in m.

use super::About;
use abbe_geometry::Vector3;
use abbe_geometry::axis::Axis;

/// The part of the stroke of an axis that was measured (m); the whole stroke where it was measured nowhere in it.
pub(super) fn seen_m(about: &About, axis: Axis) -> (f64, f64) {
    let (stroke_m, seen_m) =
        (about.machine.stroke_m[axis.index()], about.model.parts().identified.reading_m[axis.index()]);
    let both_m = (stroke_m.0.max(seen_m.0), stroke_m.1.min(seen_m.1));
    if both_m.0 <= both_m.1 { both_m } else { stroke_m }
}

/// The nodes of a regular grid over a volume, so many along each axis (m).
pub(super) fn grid_m(volume_m: &[(f64, f64); 3], nodes: usize) -> Vec<Vector3<f64>> {
    let at = |axis: usize, k: usize| {
        let (lower_m, upper_m) = volume_m[axis];
        lower_m + (upper_m - lower_m) * k as f64 / (nodes - 1) as f64
    };
    let place = |k: usize| Vector3::new(at(0, k % nodes), at(1, k / nodes % nodes), at(2, k / nodes / nodes));
    (0..nodes.pow(3)).map(place).collect()
}
