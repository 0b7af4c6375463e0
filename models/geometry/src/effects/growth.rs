//! What effects that grow and come to rest have in common: their course in time, and the time constants worth testing.
//!
//! Place in the flow: used by the effects that warm up. Times since the campaign began (s).

use super::TIME;
use super::known::{Observed, Refine};

/// Ratio of neighbouring time constants: their curves still overlap enough for refinement to find what lies between.
pub(super) const RATIO: f64 = 2.1;
/// The figure of the shape that is refined between them.
pub(super) const REFINE: Refine = Refine { key: "tau_s", ratio: RATIO };

/// Share of the growth that is there at a time.
pub(super) fn grown(time_s: f64, tau_s: f64) -> f64 {
    // −expm1 keeps the digits of the first seconds.
    -(-time_s / tau_s).exp_m1()
}

/// So many time constants (s), from the whole campaign downwards; none where the time does not vary.
pub(super) fn time_constants_s(observed: &Observed, count: i32) -> Vec<f64> {
    let duration_s = observed.time_s.1 - observed.time_s.0;
    if !observed.varies(TIME) || duration_s.is_nan() || duration_s <= 0.0 {
        return Vec::new();
    }
    (0..count).map(|k| duration_s / RATIO.powi(k)).collect()
}
