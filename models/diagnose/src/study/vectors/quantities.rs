//! What varies and stands beside every vector: position, time and what was logged.
//!
//! Place in the flow: the study of vectors makes its shapes of these quantities.

use super::ResidualVector;
use super::shape::Quantity;
use crate::study::outcome::Untestable;
use crate::study::smooth::range;
use abbe_geometry::Axis;
use std::collections::BTreeSet;

/// Largest empirical motion believed (m).
pub(super) const PLAUSIBLE_M: f64 = 1e-3;
pub(super) const POSITION: [&str; 3] = ["x_m", "y_m", "z_m"];
pub(super) const TIME: &str = "time_s";

/// Whether a quantity is a position or the time: what a machine does with a temperature goes with where it stands.
pub(super) fn leads(name: &str) -> bool {
    POSITION.contains(&name) || name == TIME
}

/// Quantities that vary and stand beside every vector; the others with what they lack.
pub(super) fn quantities(vectors: &[ResidualVector]) -> (Vec<Quantity>, Vec<Untestable>) {
    let (mut quantities, mut untestable) = (Vec::new(), Vec::new());
    let mut add = |name: &str, values: Vec<Option<f64>>| {
        let logged = values.iter().flatten().count();
        if logged == 0 {
            return;
        }
        let whole: Option<Vec<f64>> = values.into_iter().collect();
        let needs = match whole.map(|values| (range(&values), values)) {
            Some((Some(range), values)) => {
                quantities.push(Quantity::new(name, values, range));
                return;
            }
            Some((None, _)) => format!("vary {name}: it is the same at all vectors"),
            None => format!("log {name} at every vector: it stands at {logged} of {}", vectors.len()),
        };
        untestable.push(Untestable { name: format!("dependence on {name}"), needs });
    };
    for axis in Axis::ALL.into_iter().filter(|axis| !vectors[0].position_lacks[axis.index()]) {
        add(POSITION[axis.index()], vectors.iter().map(|v| Some(v.position_m[axis.index()])).collect());
    }
    add(TIME, vectors.iter().map(|vector| vector.time_s).collect());
    let names: BTreeSet<&String> = vectors.iter().flat_map(|vector| vector.covariates.keys()).collect();
    // The first of many are tried in pairs: signs of direction tell the least there.
    let (signs, others): (Vec<&String>, Vec<&String>) = names.into_iter().partition(|name| name.starts_with("dir_"));
    for name in others.into_iter().chain(signs) {
        add(name, vectors.iter().map(|vector| vector.covariates.get(name).copied()).collect());
    }
    (quantities, untestable)
}
