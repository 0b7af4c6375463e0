//! Sag and twist under a travelling carriage: a joint turns and gives way with the position of another axis too.
//!
//! Formula, with u the axis of the joint and v the other one, each −1 … 1 over its stroke, and Legendre polynomials P:
//! angle of the joint about one machine axis = Σ angle_ij P_i(v)·P_j(u), i ≥ 1, i + j ≤ 3; across that axis the joint
//! moves by Σ P_i(v)·P_j(u), i and j ≥ 1, i + j ≤ 3, upwards with one order more, as a roll lifts by its lever: the
//! turn's pivot lies where no drawing tells. In form `lean` a column leans by that angle (the tip moves with the height
//! z − z₀) without turning what it guides. Inputs: readings (m). Typical 0.5–5 µm, some µrad.
//! Left out is what a rigid-body machine has already: terms of u alone, and motions by v alone, which are the errors of
//! v. An angle by v alone is that axis' own where the two are neighbours in the chain, and no such angle where the third
//! hangs between them.

use super::empirical::legendre;
use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State, Values};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "carriage_sag",
    title: "sag or twist under a travelling carriage",
    formula: "angle of u = sum angle_ij P_i(v) P_j(u), motions across it likewise, v the other axis",
    typical: "0.5-5 um, some urad",
    source: "Schwenke et al. 2008 (load-induced errors); beam on two supports under a moving load",
    needs: "lines that vary both axes, with some lever below the carriage",
    decided_by: "measure lines along the carriage at three positions of the axis that carries it, with two offsets",
    construct,
    propose,
    refine: None,
};
/// Orders (of the other axis, of the joint's own) of the angle.
const ANGLE: [(usize, usize); 6] = [(1, 0), (2, 0), (3, 0), (1, 1), (2, 1), (1, 2)];
/// Orders of level motions.
const LEVEL: [(usize, usize); 3] = [(1, 1), (2, 1), (1, 2)];
/// Orders of the height.
const HEIGHT: [(usize, usize); 5] = [(1, 1), (2, 1), (1, 2), (3, 1), (2, 2)];
/// Highest order of any.
const ORDER: usize = 3;

#[derive(Debug)]
struct CarriageSag {
    carrying: Axis,
    carriage: Axis,
    stroke_m: [(f64, f64); 3],
    /// Name, what it moves and orders of each parameter.
    terms: Vec<Term>,
    /// The axis about which a column leans without turning what it guides, in place of a turn of the joint.
    leans: Option<Axis>,
}

/// Name, what it moves and orders of one parameter.
type Term = (&'static str, Acts, (usize, usize));

fn construct(shape: &Shape, machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let (carrying, carriage) = (reader.axis("carrying")?, reader.axis("carriage")?);
    let about = reader.axis("about")?;
    let leans = match reader.text("form")? {
        "turn" => false,
        "lean" if about != Axis::Z => true,
        "lean" => return Err(reader.wrong("form", "must be turn about z: nothing leans that way")),
        _ => return Err(reader.wrong("form", "must be turn or lean")),
    };
    if carrying == carriage {
        return Err(reader.wrong("carriage", "must be another axis than the carrying one"));
    }
    reader.finish()?;
    let terms = terms(carrying, about);
    let leans = leans.then_some(about);
    Ok(Box::new(CarriageSag { carrying, carriage, stroke_m: machine.stroke_m, terms, leans }))
}

/// All pairs about each axis, first those in which the joint nearer to the bed carries the other axis: where the data
/// cannot tell which of two turns, that one does. The other way round is possible: load paths are not in the chain alone.
fn propose(observed: &Observed) -> Vec<Shape> {
    let order = observed.machine.joints.map(|joint| joint.axis);
    let pairs = |near: bool| {
        let place = move |k: usize| if near { k } else { 2 - k };
        (0..3).flat_map(move |i| (i + 1..3).map(move |j| (order[place(i)], order[place(j)])))
    };
    let shape = |u: Axis, v: Axis, about: Axis, form: &str| {
        let shape = Shape::new().text("carrying", u.lower()).text("carriage", v.lower());
        shape.text("about", about.lower()).text("form", form)
    };
    let turns = |(u, v)| Axis::ALL.map(|about| shape(u, v, about, "turn"));
    let leans = |(u, v)| [Axis::X, Axis::Y].map(|about| shape(u, v, about, "lean"));
    pairs(true).chain(pairs(false)).flat_map(|pair| turns(pair).into_iter().chain(leans(pair))).collect()
}

/// Angle of the joint, and motions across the axis it turns about.
fn terms(carrying: Axis, about: Axis) -> Vec<Term> {
    let turn = Acts::Error(ErrorId::angular(about, carrying));
    let mut terms: Vec<_> = ANGLE.map(|orders| ("angle", turn, orders)).to_vec();
    for direction in Axis::ALL.into_iter().filter(|axis| *axis != about) {
        let motion = Acts::Error(ErrorId::linear(direction, carrying));
        let (name, orders): (_, &[(usize, usize)]) = match direction {
            Axis::X => ("x", &LEVEL),
            Axis::Y => ("y", &LEVEL),
            Axis::Z => ("height", &HEIGHT),
        };
        terms.extend(orders.iter().map(|orders| (name, motion, *orders)));
    }
    terms
}

impl CarriageSag {
    fn orders(&self, axis: Axis, state: &State) -> Values {
        let (lower_m, upper_m) = self.stroke_m[axis.index()];
        legendre((2.0 * state.reading_m[axis.index()] - lower_m - upper_m) / (upper_m - lower_m), ORDER)
    }
}

impl Effect for CarriageSag {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let spec = |(name, _, (i, j)): (&str, Acts, (usize, usize))| match name {
            "angle" => ParameterSpec::new(format!("angle_{i}_{j}"), "rad", 200e-6),
            _ => ParameterSpec::new(format!("{name}_{i}_{j}"), "m", 100e-6),
        };
        self.terms.iter().copied().map(spec).collect()
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let (u, v) = (self.orders(self.carrying, state), self.orders(self.carriage, state));
        for (k, (_, acts, (i, j))) in self.terms.iter().enumerate() {
            let amount = v[*i] * u[*j];
            match self.leans.filter(|_| k < ANGLE.len()) {
                Some(about) => {
                    let height_m = state.reading_m[Axis::Z.index()] - self.stroke_m[Axis::Z.index()].0;
                    // A turn about x takes what is above towards −y, one about y towards +x.
                    let (across, sign) = if about == Axis::X { (Axis::Y, -1.0) } else { (Axis::X, 1.0) };
                    part(k, Acts::Tip(across), sign * height_m * amount);
                }
                None => part(k, *acts, amount),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{One, machine, tip_m};
    use super::*;

    fn tip_at(reading_m: [f64; 3], parameters: [f64; 14]) -> nalgebra::Vector3<f64> {
        let shape = Shape::new().text("carrying", "x").text("carriage", "y").text("about", "x").text("form", "turn");
        let effect = construct(&shape, &machine()).unwrap();
        let state = State { reading_m, offset_m: [0.0, 0.0, -0.5], covariates: &One(0.0) };
        tip_m(effect.as_ref(), &state, &parameters)
    }

    /// A twist EAX = 8 µrad·(share of x)·(share of y) is 2 µrad·(1 + P1(u))(1 + P1(v)); what depends on both is here.
    #[test]
    fn a_twist_by_the_product_of_two_positions_moves_half_a_metre_of_lever_by_two_micrometres() {
        let mut parameters = [0.0; 14];
        (parameters[0], parameters[3]) = (2e-6, 2e-6);
        let y_m = |x_m: f64, y_m: f64| tip_at([x_m, y_m, 0.0], parameters).y;
        let mixed = y_m(0.8, 0.6) - y_m(0.8, 0.0) - y_m(0.0, 0.6) + y_m(0.0, 0.0);
        assert!((mixed - 8e-6 * 0.5).abs() < 1e-17, "{mixed}");
    }

    /// A height without mixed terms would be a straightness: its double difference is zero, that of these is not.
    #[test]
    fn no_height_is_the_straightness_of_one_axis() {
        for k in 9..14 {
            let mut parameters = [0.0; 14];
            parameters[k] = 1e-6;
            let z_m = |x_m: f64, y_m: f64| tip_at([x_m, y_m, 0.1], parameters).z;
            let mixed = z_m(0.7, 0.45) - z_m(0.7, 0.1) - z_m(0.3, 0.45) + z_m(0.3, 0.1);
            assert!(mixed.abs() > 0.05e-6, "{k}");
        }
    }

    #[test]
    fn an_axis_does_not_carry_itself() {
        let shape = Shape::new().text("carrying", "x").text("carriage", "x").text("about", "x").text("form", "turn");
        assert!(construct(&shape, &machine()).is_err());
    }
}
