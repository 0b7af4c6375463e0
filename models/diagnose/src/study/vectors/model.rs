//! Shapes of residual vectors as effects of a machine model.
//!
//! Place in the flow: the study of vectors says here what its candidates are in a model. Positions become readings of the axes
//! (position less the offset of the tip), times count from the first vector.

use super::shape::{Quantity, Shape};
use crate::study::candidate::{Between, ModelTerm, Table};
use crate::study::grid::common_step_m;
use abbe_geometry::Axis;
use abbe_geometry::effects::Shape as ModelShape;
use faer::Mat;
use std::collections::BTreeSet;
use std::f64::consts::TAU;

/// Names in the registry of effects.
const SMOOTH: &str = "empirical";
const TERM: &str = "axis_term";
/// Readings within this are one (m): those of a grid are counted in nanometres.
const SAME_M: f64 = 1e-9;

/// A shape that moves one component; `less` is what a quantity of the model is smaller by.
pub(super) fn term(axis: Axis, shape: Shape, quantities: &[Quantity], less: impl Fn(&Quantity) -> f64) -> ModelTerm {
    let range = |k: usize| {
        let (low, high) = quantities[k].range;
        (low - less(&quantities[k]), high - less(&quantities[k]))
    };
    let with = |to: ModelShape, [name, low, high]: [&str; 3], k: usize, range: (f64, f64)| {
        to.text(name, &quantities[k].name).number(low, range.0).number(high, range.1)
    };
    let acts = ModelShape::new().text("acts", axis.lower());
    let first = |k: usize, range: (f64, f64)| with(acts.clone(), ["p", "p_low", "p_high"], k, range);
    let second = |to: ModelShape, k: usize| with(to, ["q", "q_low", "q_high"], k, range(k));
    let whole = |to: ModelShape, degree: usize| to.number("degree", degree as f64).number("whole", 1.0);
    let own = match shape {
        Shape::One { quantity, degree } => whole(first(quantity, range(quantity)), degree),
        Shape::Two { first: p, second: q, degree } => whole(second(first(p, range(p)), q), degree),
        Shape::Product { first: p, second: q } => {
            second(first(p, range(p)), q).number("degree", 2.0).number("mixed", 1.0)
        }
        Shape::Turn { quantity, times } => {
            // From a whole turn to a whole turn, so that the phase is that of the angle itself.
            let turn = TAU / quantities[quantity].rad_per_unit().unwrap_or(1.0);
            let (low, high) = quantities[quantity].range;
            let (from, to) = ((low / turn).floor(), (high / turn).ceil());
            first(quantity, (from * turn, to * turn)).number("cycles", f64::from(times) * (to - from))
        }
    };
    let count = shape.parameters().len();
    ModelTerm { effect: SMOOTH, shape: own, map: Mat::identity(count, count), table: None }
}

/// What a wave may be between these readings of its axis (m) where a shorter or longer one is the same at all of them: zero in value, known
/// to its size. `None` where they are no grid.
pub(super) fn alias(axis: Axis, readings_m: &[f64]) -> Option<ModelTerm> {
    let places: BTreeSet<i64> = readings_m.iter().map(|reading_m| (reading_m / SAME_M).round() as i64).collect();
    let places: Vec<i64> = places.into_iter().collect();
    common_step_m(&places)?;
    let places_m: Vec<f64> = places.iter().map(|place| *place as f64 * SAME_M).collect();
    let shape = ModelShape::new().text("axis", axis.lower()).numbers("places_m", &places_m);
    let table = Some(Table { places_m, between: Between::Alias });
    Some(ModelTerm { effect: TERM, shape, map: Mat::zeros(places.len(), 2), table })
}
