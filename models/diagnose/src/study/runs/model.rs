//! Shapes of positioning runs as effects of a machine model.
//!
//! Place in the flow: the study of runs says here what its candidates are in a model. Position errors are counted from the
//! lowest target, as error functions are from the lower end of a stroke: where the instrument was set to zero says nothing of
//! the machine. Times count from the first run.

use super::shape::{Ranges, Shape, mean_grown};
use crate::study::candidate::{Between, ModelTerm, Table};
use crate::study::step::NO_PROPERTY;
use abbe_geometry::Axis;
use abbe_geometry::effects::{Shape as ModelShape, logged_side};
use faer::Mat;
use std::f64::consts::TAU;

/// Names in the registry of effects of what runs and other measured data give.
const TERM: &str = "axis_term";
const WAVE: &str = "periodic_scale";
const SMOOTH: &str = "empirical";
/// Covariates of a sample.
pub(super) const TIME: &str = "time_s";
pub(super) const CYCLE: &str = "cycle";
/// ISO 1 reference temperature (°C).
const REFERENCE_C: f64 = 20.0;

/// The linear axis of that name.
pub(super) fn axis_of(name: &str) -> Option<Axis> {
    Axis::ALL.into_iter().find(|axis| name.eq_ignore_ascii_case(axis.lower()))
}

/// Covariate that holds the sign of approach.
pub(super) fn sign_of(axis: Axis) -> String {
    logged_side(axis).to_owned()
}

/// A shape of an axis as effects of a model; times less `start_s`.
pub(super) fn terms(axis: Axis, ranges: &Ranges, shape: &Shape, start_s: f64) -> Result<Vec<ModelTerm>, String> {
    let (low_m, high_m) = ranges.target_m;
    let places_m = ranges.places_m();
    let of_axis = || ModelShape::new().text("axis", axis.lower());
    let polynomial =
        |count: usize| of_axis().number("terms", count as f64).number("low_m", low_m).number("high_m", high_m);
    let table = || of_axis().numbers("places_m", &places_m);
    let signed = |shape: ModelShape| shape.text("sign", sign_of(axis));
    let over = |shape: ModelShape, name: &str, (low, high): (f64, f64)| {
        shape.text("by", name).number("by_zero", 0.5 * (low + high)).number("by_unit", 0.5 * (high - low))
    };
    let growing = |shape: ModelShape, zero_s: f64, tau_s: f64| {
        shape.text("by", TIME).number("by_zero", zero_s).number("tau", tau_s)
    };
    let along = format!("E{0}{0}", axis.letter());
    let smooth = |name: &str, (low, high): (f64, f64), degree: usize| {
        let shape = ModelShape::new().text("acts", along.clone()).text("p", name);
        shape.number("p_low", low).number("p_high", high).number("degree", degree as f64)
    };
    let cycle = || ranges.cycle.ok_or_else(|| "the cycles have no numbers".to_owned());
    let time = || match ranges.time_s {
        Some((first, last)) if !ranges.is_order => Ok((first - start_s, last - start_s)),
        _ => Err("it follows the order of measurement, which no later sample can say; write time_s".to_owned()),
    };
    let quantity = |name: &str| ranges.quantity.ok_or_else(|| format!("{name} does not vary"));
    let plain = |effect, shape, count: usize| vec![term(effect, shape, Mat::identity(count, count))];
    let tabled = |shape, map| vec![tabled(&places_m, Between::Departures, shape, map)];
    let count = places_m.len();
    Ok(match shape {
        Shape::Position(degree) => {
            // P_k is (−1)^k at the lowest target.
            let map = Mat::from_fn(degree + 1, *degree, |i, j| match i {
                0 if j % 2 == 0 => 1.0,
                0 => -1.0,
                _ => f64::from(u8::from(i == j + 1)),
            });
            vec![term(TERM, polynomial(degree + 1), map)]
        }
        Shape::PositionTable => {
            let map = Mat::from_fn(count, count, |i, j| f64::from(u8::from(i == j)) - f64::from(u8::from(j == 0)));
            tabled(table(), map)
        }
        Shape::Lost(degree) => plain(TERM, signed(polynomial(degree + 1)), degree + 1),
        Shape::LostTable => tabled(signed(table()), Mat::identity(count, count)),
        Shape::Cycle(1) => plain(TERM, over(polynomial(1), CYCLE, cycle()?), 1),
        Shape::Cycle(_) => return Err("drift with the cycle is no straight line".to_owned()),
        Shape::DriftTable => tabled(over(table(), CYCLE, cycle()?), Mat::identity(count, count)),
        Shape::LostWithCycle => plain(TERM, over(signed(polynomial(1)), CYCLE, cycle()?), 1),
        Shape::Time(degree) => plain(SMOOTH, smooth(TIME, time()?, *degree), *degree),
        Shape::TimeAndTarget => plain(TERM, over(polynomial(2), TIME, time()?), 2),
        Shape::Step(_) => return Err(NO_PROPERTY.to_owned()),
        Shape::Creep(tau_s) => plain(TERM, growing(polynomial(1), time()?.0, *tau_s), 1),
        Shape::Growth(tau_s) => {
            let (first_s, last_s) = time()?;
            let mean = mean_grown(last_s - first_s, *tau_s);
            let less_mean = Mat::from_fn(2, 2, |i, j| if i == j { -mean } else { 0.0 });
            let growth = term(TERM, growing(polynomial(2), first_s, *tau_s), Mat::identity(2, 2));
            vec![growth, term(TERM, polynomial(2), less_mean)]
        }
        Shape::Expansion(sensor) => {
            let shape = polynomial(2).text("by", sensor).number("by_zero", REFERENCE_C).number("by_unit", 1.0);
            let (middle_m, half_m) = (0.5 * (low_m + high_m), 0.5 * (high_m - low_m));
            let map = Mat::from_fn(2, 2, |i, j| [[middle_m, 1.0], [half_m, 0.0]][i][j]);
            vec![term(TERM, shape, map)]
        }
        Shape::Periodic(period_m) => {
            let (sine, cosine) = (TAU * low_m / period_m).sin_cos();
            let own = of_axis().number("period_m", *period_m);
            let at_lowest = Mat::from_fn(1, 2, |_, j| [-sine, -cosine][j]);
            vec![term(WAVE, own, Mat::identity(2, 2)), term(TERM, polynomial(1), at_lowest)]
        }
        Shape::Smooth(name, degree) => plain(SMOOTH, smooth(name, quantity(name)?, *degree), *degree),
        Shape::LostBy(name) => plain(TERM, over(signed(polynomial(1)), name, quantity(name)?), 1),
        Shape::ScaleBy(name) => plain(TERM, over(polynomial(2), name, quantity(name)?), 2),
    })
}

/// What approaches from the other side do differently, where all were from this one: nothing in these.
pub(super) fn approached_otherwise(axis: Axis, ranges: &Ranges, side: f64) -> ModelTerm {
    let (low_m, high_m) = ranges.target_m;
    let constant = ModelShape::new().text("axis", axis.lower()).number("terms", 1.0);
    let constant = constant.number("low_m", low_m).number("high_m", high_m);
    term(TERM, constant.text("by", sign_of(axis)).number("by_zero", side).number("by_unit", 2.0), Mat::zeros(1, 0))
}

/// Growth of offset and scale by a temperature above this one: zero in value.
pub(super) fn untold_growth(axis: Axis, ranges: &Ranges, name: &str, zero_c: f64) -> ModelTerm {
    let (low_m, high_m) = ranges.target_m;
    let shape = ModelShape::new().text("axis", axis.lower()).number("terms", 2.0);
    let shape = shape.number("low_m", low_m).number("high_m", high_m);
    term(TERM, shape.text("by", name).number("by_zero", zero_c).number("by_unit", 1.0), Mat::zeros(2, 0))
}

/// An offset, a slope and a bow over the targets: zero in value.
pub(super) fn untold_bow(axis: Axis, ranges: &Ranges) -> ModelTerm {
    let (low_m, high_m) = ranges.target_m;
    let shape = ModelShape::new().text("axis", axis.lower()).number("terms", 3.0);
    term(TERM, shape.number("low_m", low_m).number("high_m", high_m), Mat::zeros(3, 0))
}

/// What may lie at the targets and between them beyond what was found: zero in value.
pub(super) fn lack(axis: Axis, ranges: &Ranges) -> ModelTerm {
    let places_m = ranges.places_m();
    let count = places_m.len();
    let mean_m = (places_m[count - 1] - places_m[0]) / (count as f64 - 1.0);
    let shape = ModelShape::new().text("axis", axis.lower()).numbers("places_m", &places_m);
    term(TERM, shape.number("between_order", 1.0).number("beyond_m", mean_m), Mat::zeros(2 * count + 1, 0))
}

fn term(effect: &'static str, shape: ModelShape, map: Mat<f64>) -> ModelTerm {
    ModelTerm { effect, shape, map, table: None }
}

fn tabled(places_m: &[f64], between: Between, shape: ModelShape, map: Mat<f64>) -> ModelTerm {
    ModelTerm { table: Some(Table { places_m: places_m.to_vec(), between }), ..term(TERM, shape, map) }
}

/// What a wave may be between the targets where a shorter one is the same at all of them: zero in value, known to its size.
pub(super) fn alias(axis: Axis, ranges: &Ranges) -> ModelTerm {
    let places_m = ranges.places_m();
    let shape = ModelShape::new().text("axis", axis.lower()).numbers("places_m", &places_m);
    tabled(&places_m, Between::Alias, shape, Mat::zeros(places_m.len(), 2))
}

/// Covariates that a shape reads in a model.
pub(super) fn covariates(axis: Axis, shape: &Shape) -> Vec<String> {
    match shape {
        Shape::Position(_) | Shape::PositionTable | Shape::Periodic(_) => Vec::new(),
        Shape::Lost(_) | Shape::LostTable => vec![sign_of(axis)],
        Shape::LostWithCycle => vec![sign_of(axis), CYCLE.to_owned()],
        Shape::Cycle(_) | Shape::DriftTable => vec![CYCLE.to_owned()],
        Shape::LostBy(name) => vec![sign_of(axis), name.clone()],
        Shape::Time(_) | Shape::TimeAndTarget | Shape::Creep(_) | Shape::Growth(_) | Shape::Step(_) => {
            vec![TIME.to_owned()]
        }
        Shape::Expansion(name) | Shape::Smooth(name, _) | Shape::ScaleBy(name) => vec![name.clone()],
    }
}
