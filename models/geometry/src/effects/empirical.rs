//! An empirical term: the tip, an error of the chain or the range follows a smooth or periodic function of one or two logged quantities.
//!
//! Formula: e = Σ c_ij P_i(p) P_j(q) with Legendre polynomials of the quantities scaled to −1 … 1 and 1 ≤ i + j ≤
//! degree; what scales alone would move on the tip is left out, since the machine's errors do that, unless `whole` says that no
//! error function does; with `mixed` only products of both quantities remain. With `cycles`, sine and cosine of 2π·cycles·(p's share of its range) instead. It says what the residual
//! depends on, not why: diagnosis offers it only where no other effect explains what it finds. A quantity beyond the
//! range that the term was fitted in is evaluated at the end of that range, and correction reports the sample as
//! extrapolated. Quantities are covariates, `time_s`, scales (`x_m`) and offsets (`offset_x_m`).

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape, ShapeValue};
use super::source::{is_scale, position};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, Sight, State, Values};
use crate::axis::ErrorId;
use crate::machine::Machine;
use smallvec::SmallVec;
use std::f64::consts::TAU;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "empirical",
    title: "empirical term",
    formula: "e = sum c_ij P_i(p) P_j(q), Legendre polynomials of one or two logged quantities; or a sine of one",
    typical: "whatever the data show",
    source: "none: it describes, it does not explain",
    needs: "the quantities it depends on",
    decided_by: "vary the named quantities independently of each other and of position",
    construct,
    propose,
    refine: None,
};
/// Highest degree and number of cycles.
const MOST: usize = 64;
/// Largest motion believed (m).
const PLAUSIBLE_M: f64 = 100e-6;
/// Largest turn believed (rad).
const PLAUSIBLE_RAD: f64 = 500e-6;

/// Legendre polynomials P_0 … P_degree at `x`.
pub fn legendre(x: f64, degree: usize) -> Values {
    let mut values = Values::from_slice(&[1.0, x]);
    for k in 1..degree {
        let n = k as f64;
        values.push(((2.0 * n + 1.0) * x * values[k] - n * values[k - 1]) / (n + 1.0));
    }
    values.truncate(degree + 1);
    values
}

/// A quantity and the range in which it was seen.
#[derive(Debug)]
struct Quantity {
    name: String,
    low: f64,
    high: f64,
}

impl Quantity {
    /// Share of the range, held at its ends.
    fn share(&self, state: &State) -> Result<f64, CovariateProblem> {
        Ok(((state.quantity(&self.name)? - self.low) / (self.high - self.low)).clamp(0.0, 1.0))
    }
}

#[derive(Debug)]
enum Form {
    Polynomial { degree: usize },
    Periodic { cycles: f64 },
}

#[derive(Debug)]
struct Empirical {
    /// `None` acts on the range.
    acts: Option<Acts>,
    mixed: bool,
    whole: bool,
    quantities: Vec<Quantity>,
    form: Form,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let acts = match reader.text("acts")? {
        "range" => None,
        name => match ErrorId::from_name(name) {
            Some(id) => Some(Acts::Error(id)),
            None => Some(Acts::Tip(reader.axis("acts")?)),
        },
    };
    let mut quantities = vec![quantity(&mut reader, ["p", "p_low", "p_high"])?];
    if shape.0.contains_key("q") {
        quantities.push(quantity(&mut reader, ["q", "q_low", "q_high"])?);
    }
    let form = match shape.0.get("cycles") {
        Some(ShapeValue::Number(_)) => Form::Periodic { cycles: reader.positive("cycles")? },
        _ => Form::Polynomial { degree: reader.count("degree", MOST)? },
    };
    let mixed = shape.0.contains_key("mixed") && reader.count("mixed", 1)? == 1;
    let whole = shape.0.contains_key("whole") && reader.count("whole", 1)? == 1;
    reader.finish()?;
    let effect = Empirical { acts, mixed, whole, quantities, form };
    if matches!(effect.form, Form::Polynomial { degree } if effect.terms(degree).next().is_none()) {
        return Err(EffectError::Shape {
            effect: KNOWN.name,
            key: "degree".to_owned(),
            problem: "leaves no term; raise it, or name a quantity that is not a scale",
        });
    }
    Ok(Box::new(effect))
}

fn quantity(reader: &mut Reader, [name, low, high]: [&'static str; 3]) -> Result<Quantity, EffectError> {
    let quantity =
        Quantity { name: reader.text(name)?.to_owned(), low: reader.number(low)?, high: reader.number(high)? };
    if quantity.low >= quantity.high {
        return Err(reader.wrong(high, "must lie above the lower end"));
    }
    Ok(quantity)
}

/// None: the look without candidates proposes them.
fn propose(_observed: &Observed) -> Vec<Shape> {
    Vec::new()
}

impl Empirical {
    /// Exponents of the terms, by total degree.
    fn terms(&self, degree: usize) -> impl Iterator<Item = (usize, usize)> {
        let two = self.quantities.len() == 2;
        // The error functions move the tip by each scale alone already; on the range they do not.
        let own =
            |k: usize| !self.whole && self.acts.is_some() && self.quantities.get(k).is_some_and(|q| is_scale(&q.name));
        let kept = move |(i, j): &(usize, usize)| match (*i, *j) {
            (_, 0) => !(own(0) || two && self.mixed),
            (0, _) => two && !self.mixed && !own(1),
            _ => two,
        };
        (1..=degree).flat_map(|total| (0..=total).map(move |j| (total - j, j))).filter(kept)
    }

    fn values(&self, state: &State) -> Result<Values, CovariateProblem> {
        let shares = self.quantities.iter().map(|q| q.share(state)).collect::<Result<Values, _>>()?;
        Ok(match self.form {
            Form::Periodic { cycles } => {
                let (sine, cosine) = (TAU * cycles * shares[0]).sin_cos();
                Values::from_slice(&[sine, cosine])
            }
            Form::Polynomial { degree } => {
                let powers: SmallVec<[Values; 2]> =
                    shares.iter().map(|share| legendre(2.0 * share - 1.0, degree)).collect();
                let second = |j: usize| powers.get(1).map_or(1.0, |values| values[j]);
                self.terms(degree).map(|(i, j)| powers[0][i] * second(j)).collect()
            }
        })
    }

    fn logged(&self) -> Vec<String> {
        self.quantities.iter().map(|q| q.name.clone()).filter(|name| position(name).is_none()).collect()
    }
}

impl Effect for Empirical {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        if self.acts.is_some() { self.logged() } else { Vec::new() }
    }

    fn range_covariates(&self) -> Vec<String> {
        if self.acts.is_none() { self.logged() } else { Vec::new() }
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let (unit, plausible) = match self.acts {
            Some(Acts::Error(id)) if id.is_angular() => ("rad", PLAUSIBLE_RAD),
            _ => ("m", PLAUSIBLE_M),
        };
        let spec = |name: String| ParameterSpec::new(name, unit, plausible);
        match self.form {
            Form::Periodic { .. } => ["sine", "cosine"].map(|name| spec(name.to_owned())).to_vec(),
            Form::Polynomial { degree } => self.terms(degree).map(|(i, j)| spec(format!("c_{i}_{j}"))).collect(),
        }
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let Some(acts) = self.acts else { return Ok(()) };
        for (k, value) in self.values(state)?.into_iter().enumerate() {
            part(k, acts, value);
        }
        Ok(())
    }

    fn range(&self, state: &State, _sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        if self.acts.is_none() {
            self.values(state)?.into_iter().enumerate().for_each(|(k, value)| part(k, value));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{One, machine, tip_m};
    use super::*;

    #[test]
    fn legendre_polynomials_are_those_of_the_tables() {
        let x: f64 = 0.3;
        let expected = [1.0, x, 0.5 * (3.0 * x * x - 1.0), 0.5 * (5.0 * x.powi(3) - 3.0 * x)];
        assert!(legendre(x, 3).iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15));
        assert_eq!(legendre(x, 0).as_slice(), [1.0]);
    }

    #[test]
    fn it_follows_two_quantities_and_holds_at_the_ends_of_their_ranges() {
        let shape = Shape::new().text("acts", "y").number("degree", 2.0);
        let shape = shape.text("p", "temp_air_c").number("p_low", 19.0).number("p_high", 21.0);
        let shape = shape.text("q", "x_m").number("q_low", 0.0).number("q_high", 0.8);
        let effect = construct(&shape, &machine()).unwrap();
        let names: Vec<String> = effect.parameters().into_iter().map(|p| p.name).collect();
        assert_eq!(names, ["c_1_0", "c_2_0", "c_1_1"], "x alone is the machine's own error");
        let mixed = construct(&shape.clone().number("mixed", 1.0), &machine()).unwrap();
        assert_eq!(mixed.parameters().len(), 1);
        let at = |air_c: f64, x_m: f64| {
            let state = State { reading_m: [x_m, 0.1, 0.1], offset_m: [0.0; 3], covariates: &One(air_c) };
            tip_m(effect.as_ref(), &state, &[1e-6, 0.0, 2e-6]).y
        };
        let whole = construct(&shape.clone().number("whole", 1.0), &machine()).unwrap();
        let names: Vec<String> = whole.parameters().into_iter().map(|p| p.name).collect();
        assert_eq!(names, ["c_1_0", "c_0_1", "c_2_0", "c_1_1", "c_0_2"]);
        assert!((at(20.5, 0.6) - (0.5e-6 + 2e-6 * 0.5 * 0.5)).abs() < 1e-18);
        assert_eq!(at(25.0, 0.6), at(21.0, 0.6));
    }
}
