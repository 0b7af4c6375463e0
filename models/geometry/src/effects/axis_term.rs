//! A term of one axis as positioning runs give it: an error along the axis that follows its reading, alone or times what was
//! logged beside.
//!
//! Formula: e = g · Σ c_k f_k(x) along the axis, x its reading (m). With `terms` f_k are Legendre polynomials 0 … terms − 1 of x
//! scaled to −1 … 1 over `low_m` … `high_m`; with `places_m` the error is linear between places and held beyond the first and the
//! last, c_k its values there. What is not known between two places is one more parameter each, zero in value, so that it widens the
//! uncertainty between places and nothing else: times (4 s (1 − s))^(q/2), s the share of the way from one to the other, 1 halfway.
//! q, `between_order` (2 without it), is the order of interpolation that the table has been seen to have; with 0 a place says
//! nothing of what is next to it. With `beyond_m`, the mean distance of places, what is not known before the first and behind the last
//! is one parameter each in the same way: times (d/`beyond_m`)^(q/2) at the distance d. g is the product of what
//! is named: `sign`, half the sign of approach, which makes the sum the reversal value B; `by`, (value − `by_zero`)/`by_unit` of a
//! logged quantity, or with `tau` 1 − e^(−(value − `by_zero`)/tau), a growth that comes to rest.
//! Source: ISO 230-2 (position and reversal tables), ISO 230-3 (drift). It is given by what was measured, not proposed.

use super::empirical::legendre;
use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;
use smallvec::SmallVec;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "axis_term",
    title: "error of an axis as measured in positioning runs",
    formula: "e = g sum c_k f_k(x) along the axis: a table or Legendre polynomials, times sign of approach or a logged quantity",
    typical: "0.5-100 µm",
    source: "ISO 230-2 (position and reversal), ISO 230-3 (drift)",
    needs: "positioning runs",
    decided_by: "measure runs at further targets",
    construct,
    propose,
    refine: None,
};
/// Most polynomials.
const MOST_TERMS: usize = 16;
/// Largest error believed (m).
const PLAUSIBLE_M: f64 = 500e-6;
/// Distance within which a reading is at a place (m).
const AT_PLACE_M: f64 = 1e-6;
/// Order to which a straight line goes through a smooth error.
const SMOOTH_ORDER: f64 = 2.0;

#[derive(Debug)]
enum Form {
    Terms { count: usize, low_m: f64, high_m: f64 },
    Table { places_m: Vec<f64>, between_order: f64, beyond_m: Option<f64> },
}

#[derive(Debug)]
struct By {
    name: String,
    zero: f64,
    course: Course,
}

#[derive(Debug)]
enum Course {
    Linear { unit: f64 },
    Growth { tau: f64 },
}

#[derive(Debug)]
struct AxisTerm {
    axis: Axis,
    form: Form,
    sign: Option<String>,
    by: Option<By>,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let axis = reader.axis("axis")?;
    let has = |key: &str| shape.0.contains_key(key);
    let form = if has("places_m") {
        let places_m = reader.numbers("places_m")?.to_vec();
        if places_m.len() < 2 || places_m.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(reader.wrong("places_m", "must be two readings or more, each above the one before"));
        }
        let between_order = if has("between_order") { reader.number("between_order")? } else { SMOOTH_ORDER };
        if !(0.0..=SMOOTH_ORDER).contains(&between_order) {
            return Err(reader.wrong("between_order", "must lie between 0 and 2"));
        }
        let beyond_m = if has("beyond_m") { Some(reader.positive("beyond_m")?) } else { None };
        Form::Table { places_m, between_order, beyond_m }
    } else {
        let (low_m, high_m) = (reader.number("low_m")?, reader.number("high_m")?);
        if low_m >= high_m {
            return Err(reader.wrong("high_m", "must lie above the lower end"));
        }
        Form::Terms { count: reader.count("terms", MOST_TERMS)?, low_m, high_m }
    };
    let sign = if has("sign") { Some(reader.text("sign")?.to_owned()) } else { None };
    let by = if has("by") { Some(by(&mut reader, has("tau"))?) } else { None };
    reader.finish()?;
    Ok(Box::new(AxisTerm { axis, form, sign, by }))
}

fn by(reader: &mut Reader, grows: bool) -> Result<By, EffectError> {
    let (name, zero) = (reader.text("by")?.to_owned(), reader.number("by_zero")?);
    let course = match grows {
        true => Course::Growth { tau: reader.positive("tau")? },
        false => Course::Linear { unit: reader.positive("by_unit")? },
    };
    Ok(By { name, zero, course })
}

/// None: positioning runs give it.
fn propose(_observed: &Observed) -> Vec<Shape> {
    Vec::new()
}

impl AxisTerm {
    fn factor(&self, state: &State) -> Result<f64, CovariateProblem> {
        let sign = self.sign.as_ref().map(|name| state.covariate(name)).transpose()?;
        let by = self.by.as_ref().map(|by| Ok(by.factor(state.covariate(&by.name)?))).transpose()?;
        Ok(sign.map_or(1.0, |sign| 0.5 * sign) * by.unwrap_or(1.0))
    }
}

impl By {
    fn factor(&self, value: f64) -> f64 {
        match self.course {
            Course::Linear { unit } => (value - self.zero) / unit,
            // −expm1 keeps the digits of the beginning.
            Course::Growth { tau } => -(-(value - self.zero) / tau).exp_m1(),
        }
    }
}

/// Index and weight, of three at most.
type Weights = SmallVec<[(usize, f64); 3]>;

/// Weights of a table's values and of what may lie between its places: index and weight.
fn table(places_m: &[f64], between_order: f64, beyond_m: Option<f64>, reading_m: f64) -> Weights {
    let last = places_m.len() - 1;
    let above = places_m.partition_point(|place| *place <= reading_m);
    if above == 0 || above > last {
        let held = (above.min(last), 1.0);
        let distance_m = (places_m[0] - reading_m).max(reading_m - places_m[last]);
        return match beyond_m {
            Some(beyond_m) if distance_m > 0.0 => {
                let open = (distance_m / beyond_m).powf(0.5 * between_order);
                Weights::from_slice(&[held, (2 * last + 1 + usize::from(above > last), open)])
            }
            _ => Weights::from_slice(&[held]),
        };
    }
    let (low_m, high_m) = (places_m[above - 1], places_m[above]);
    let share = (reading_m - low_m) / (high_m - low_m);
    // At the place itself it is known, of whatever order the table is: 0 to the power of 0 is 1. No scale stands on a place to the last bit.
    if (reading_m - low_m).min(high_m - reading_m) < AT_PLACE_M {
        return Weights::from_slice(&[(above - 1, 1.0 - share), (above, share)]);
    }
    let open = (4.0 * share * (1.0 - share)).powf(0.5 * between_order);
    Weights::from_slice(&[(above - 1, 1.0 - share), (above, share), (last + above, open)])
}

impl Effect for AxisTerm {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        self.sign.iter().cloned().chain(self.by.iter().map(|by| by.name.clone())).collect()
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let spec = |name: String| ParameterSpec::new(name, "m", PLAUSIBLE_M);
        match &self.form {
            Form::Terms { count, .. } => (0..*count).map(|k| spec(format!("c_{k}"))).collect(),
            Form::Table { places_m, beyond_m, .. } => {
                let at = (1..=places_m.len()).map(|k| spec(format!("at_{k}")));
                let between = (1..places_m.len()).map(|k| spec(format!("between_{k}_{}", k + 1)));
                let beyond = ["below", "above"].into_iter().filter(|_| beyond_m.is_some());
                at.chain(between).chain(beyond.map(|side| spec(side.to_owned()))).collect()
            }
        }
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let factor = self.factor(state)?;
        let along = Acts::Error(ErrorId::linear(self.axis, self.axis));
        let reading_m = state.reading_m[self.axis.index()];
        match &self.form {
            Form::Terms { count, low_m, high_m } => {
                let scaled = 2.0 * (reading_m - low_m) / (high_m - low_m) - 1.0;
                let values = legendre(scaled, count - 1);
                values.into_iter().enumerate().for_each(|(k, value)| part(k, along, factor * value));
            }
            Form::Table { places_m, between_order, beyond_m } => {
                let weights = table(places_m, *between_order, *beyond_m, reading_m);
                weights.into_iter().for_each(|(k, weight)| part(k, along, factor * weight));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Each, NONE, machine, tip_m};
    use super::*;

    fn along_m(shape: &Shape, x_m: f64, logged: &[(&str, f64)], parameters: &[f64]) -> f64 {
        let effect = construct(shape, &machine()).unwrap();
        assert_eq!(effect.parameters().len(), parameters.len());
        let state = State { reading_m: [x_m, 0.2, 0.1], offset_m: [0.0; 3], covariates: &Each(logged) };
        tip_m(effect.as_ref(), &state, parameters).x
    }

    #[test]
    fn a_table_is_linear_between_its_places_held_beyond_them_and_uncertain_only_between() {
        let shape = Shape::new().text("axis", "x").numbers("places_m", &[0.1, 0.3, 0.4]);
        let at = |x_m: f64| along_m(&shape, x_m, NONE, &[1e-6, 3e-6, -2e-6, 0.0, 0.0]);
        for (x_m, um) in [(0.1, 1.0), (0.2, 2.0), (0.3, 3.0), (0.38, -1.0), (0.4, -2.0), (0.0, 1.0), (0.7, -2.0)] {
            assert!((at(x_m) - um * 1e-6).abs() < 1e-18, "{x_m}: {}", at(x_m));
        }
        let between = |x_m: f64| along_m(&shape, x_m, NONE, &[0.0, 0.0, 0.0, 4e-6, 8e-6]);
        for (x_m, um) in [(0.1, 0.0), (0.15, 3.0), (0.2, 4.0), (0.3, 0.0), (0.35, 8.0), (0.4, 0.0), (0.5, 0.0)] {
            assert!((between(x_m) - um * 1e-6).abs() < 1e-18, "{x_m}: {}", between(x_m));
        }
        let rough = shape.clone().number("between_order", 0.0);
        let between = |x_m: f64| along_m(&rough, x_m, NONE, &[0.0, 0.0, 0.0, 4e-6, 8e-6]);
        for (x_m, um) in [
            (0.1, 0.0),
            (0.100_000_5, 0.0),
            (0.1001, 4.0),
            (0.2, 4.0),
            (0.299_999_5, 0.0),
            (0.3, 0.0),
            (0.3001, 8.0),
            (0.4, 0.0),
            (0.5, 0.0),
        ] {
            assert!((between(x_m) - um * 1e-6).abs() < 1e-18, "{x_m}: {}", between(x_m));
        }
        let open = shape.clone().number("between_order", 1.0).number("beyond_m", 0.1);
        let beyond = |x_m: f64| along_m(&open, x_m, NONE, &[0.0, 0.0, 0.0, 0.0, 0.0, 2e-6, 4e-6]);
        for (x_m, um) in [(0.1, 0.0), (0.25, 0.0), (0.4, 0.0), (0.0, 2.0), (0.5, 4.0), (0.8, 8.0)] {
            assert!((beyond(x_m) - um * 1e-6).abs() < 1e-15, "{x_m}: {}", beyond(x_m));
        }
        let wrong = construct(&shape.number("between_order", 3.0), &machine()).unwrap_err();
        assert!(wrong.to_string().contains("between_order"), "{wrong}");
    }

    #[test]
    fn terms_follow_the_sign_of_approach_and_what_was_logged() {
        let constant = Shape::new().text("axis", "x").number("terms", 1.0).number("low_m", 0.0).number("high_m", 0.8);
        let reversal = constant.clone().text("sign", "dir_x");
        let of = |sign: f64| along_m(&reversal, 0.5, &[("dir_x", sign)], &[2e-6]);
        assert!((of(1.0) - of(-1.0) - 2e-6).abs() < 1e-18);
        let line = constant.clone().number("terms", 2.0);
        let drift = line.clone().text("by", "time_s").number("by_zero", 100.0).number("by_unit", 100.0);
        assert!((along_m(&drift, 0.8, &[("time_s", 150.0)], &[1e-6, 2e-6]) - 1.5e-6).abs() < 1e-18);
        let growth = constant.text("by", "time_s").number("by_zero", 0.0).number("tau", 50.0);
        assert!((along_m(&growth, 0.1, &[("time_s", 50.0)], &[1e-6]) - 0.632_120_558_8e-6).abs() < 1e-15);
    }

    #[test]
    fn places_out_of_order_are_refused() {
        let shape = Shape::new().text("axis", "x").numbers("places_m", &[0.1, 0.1]);
        assert!(construct(&shape, &machine()).unwrap_err().to_string().contains("each above the one before"));
    }
}
