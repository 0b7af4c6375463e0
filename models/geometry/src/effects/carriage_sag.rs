//! Sag and twist under a travelling carriage: a joint turns and gives way with the position of another axis too.
//!
//! Formula, with u the axis of the joint and v the other one, each −1 … 1 over its stroke, and Legendre polynomials that are zero at the
//! lower end, Q_i = P_i − P_i(−1) and Q_0 = 1: angle of the joint about one machine axis = Σ turn_ij Q_i(v)·Q_j(u), i ≥ 1,
//! i + j ≤ 3; across that axis the joint moves by Σ Q_i(v)·Q_j(u), i and j ≥ 1, i + j ≤ 3, upwards with one order more, as a roll
//! lifts by its lever: the turn's pivot lies where no drawing tells. In form `lean` a column leans by that angle, lean_ij in its place
//! (the tip moves with the height z − z₀), without turning what it guides. Inputs: readings (m). Typical 0.5–5 µm, some µrad.
//! Left out is what a rigid-body machine has already: terms of u alone, and motions by v alone, which are the errors of
//! v. An angle by v alone is that axis' own where the two are neighbours in the chain, and is left out there; it is none where the third
//! hangs between them. What a sag does is counted from the lower ends, as all errors are: elsewhere it would turn the frame, which no
//! reading tells, and every coordinate would be uncertain by that.

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
    formula: "angle of u = sum turn_ij Q_i(v) Q_j(u), Q zero at the lower ends, motions across it likewise, v the other axis",
    typical: "0.5-5 µm, some µrad",
    source: "Schwenke et al. 2008 (load-induced errors); beam on two supports under a moving load",
    needs: "lines that vary both axes, with some lever below the carriage",
    decided_by: "measure lines along the carriage at three positions of the axis that carries it, with two offsets",
    construct,
    propose,
    refine: None,
};
/// Names of the angle: of what turns, and of what leans.
const TURN: &str = "turn";
const LEAN: &str = "lean";
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
    let is_own = !leans && are_neighbours(machine, carrying, carriage);
    let terms = terms((carrying, about), if leans { LEAN } else { TURN }, is_own);
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

/// Whether one of two axes carries the other, or a bed carries both.
fn are_neighbours(machine: &Machine, one: Axis, other: Axis) -> bool {
    machine.joints.windows(2).any(|pair| pair.iter().all(|joint| joint.axis == one || joint.axis == other))
}

/// Angle of the joint by this name, without what follows the other axis alone where that is the other axis' own, and motions across the
/// axis it turns about.
fn terms((carrying, about): (Axis, Axis), angle: &'static str, is_own: bool) -> Vec<Term> {
    let turn = Acts::Error(ErrorId::angular(about, carrying));
    let angles = ANGLE.into_iter().filter(|(_, own)| !is_own || *own > 0);
    let mut terms: Vec<_> = angles.map(|orders| (angle, turn, orders)).collect();
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
    /// 1, and polynomials that are zero at the lower end.
    fn orders(&self, axis: Axis, state: &State) -> Values {
        let (lower_m, upper_m) = self.stroke_m[axis.index()];
        let mut orders =
            legendre((2.0 * state.reading_m[axis.index()] - lower_m - upper_m) / (upper_m - lower_m), ORDER);
        orders.iter_mut().enumerate().skip(1).for_each(|(k, value)| *value -= if k % 2 == 0 { 1.0 } else { -1.0 });
        orders
    }
}

impl Effect for CarriageSag {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let spec = |(name, _, (i, j)): (&str, Acts, (usize, usize))| match name {
            TURN | LEAN => ParameterSpec::new(format!("{name}_{i}_{j}"), "rad", 200e-6),
            _ => ParameterSpec::new(format!("{name}_{i}_{j}"), "m", 100e-6),
        };
        self.terms.iter().copied().map(spec).collect()
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let (u, v) = (self.orders(self.carrying, state), self.orders(self.carriage, state));
        for (k, (name, acts, (i, j))) in self.terms.iter().enumerate() {
            let amount = v[*i] * u[*j];
            match self.leans.filter(|_| *name == LEAN) {
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

    fn tip_at(reading_m: [f64; 3], parameters: [f64; 11]) -> nalgebra::Vector3<f64> {
        let shape = Shape::new().text("carrying", "x").text("carriage", "y").text("about", "x").text("form", "turn");
        let effect = construct(&shape, &machine()).unwrap();
        let state = State { reading_m, offset_m: [0.0, 0.0, -0.5], covariates: &One(0.0) };
        tip_m(effect.as_ref(), &state, &parameters)
    }

    /// A twist EAX = 8 µrad·(share of x)·(share of y) is 2 µrad·Q1(u)·Q1(v), each Q1 twice the share.
    #[test]
    fn a_twist_by_the_product_of_two_positions_moves_half_a_metre_of_lever_by_two_micrometres() {
        let mut parameters = [0.0; 11];
        parameters[0] = 2e-6;
        let y_m = |x_m: f64, y_m: f64| tip_at([x_m, y_m, 0.0], parameters).y;
        let mixed = y_m(0.8, 0.6) - y_m(0.8, 0.0) - y_m(0.0, 0.6) + y_m(0.0, 0.0);
        assert!((mixed - 8e-6 * 0.5).abs() < 1e-17, "{mixed}");
    }

    /// A height without mixed terms would be a straightness: its double difference is zero, that of these is not.
    #[test]
    fn no_height_is_the_straightness_of_one_axis() {
        for k in 6..11 {
            let mut parameters = [0.0; 11];
            parameters[k] = 1e-6;
            let z_m = |x_m: f64, y_m: f64| tip_at([x_m, y_m, 0.1], parameters).z;
            let mixed = z_m(0.7, 0.45) - z_m(0.7, 0.1) - z_m(0.3, 0.45) + z_m(0.3, 0.1);
            assert!(mixed.abs() > 0.05e-6, "{k}");
        }
    }

    /// Where the carriage stands at its lower end nothing moves, whatever the parameters are. Terms that did turned the frame of all
    /// coordinates by what nobody knows, and U was up to 47 times the error.
    #[test]
    fn regress_no_sag_turns_the_frame_of_the_machine() {
        let machine = machine();
        for form in ["turn", "lean"] {
            for (carrying, carriage) in [("x", "y"), ("y", "x"), ("x", "z"), ("z", "x"), ("y", "z"), ("z", "y")] {
                let shape = Shape::new().text("carrying", carrying).text("carriage", carriage);
                let effect = construct(&shape.text("about", "x").text("form", form), &machine).unwrap();
                let mut reading_m = [0.7, 0.45, 0.5];
                let axis = Axis::ALL.into_iter().find(|axis| axis.lower() == carriage).unwrap().index();
                reading_m[axis] = machine.stroke_m[axis].0;
                let state = State { reading_m, offset_m: [0.1, 0.2, -0.5], covariates: &One(0.0) };
                let ones = vec![1e-6; effect.parameters().len()];
                let moved_m = tip_m(effect.as_ref(), &state, &ones).norm();
                assert!(moved_m < 1e-18, "{form} {carriage} on {carrying}: {moved_m:e}");
            }
        }
    }

    /// X carries Y carries Z: an angle that follows one position alone is that axis' own, but for the axes at both ends.
    #[test]
    fn an_angle_by_one_position_alone_is_left_to_the_axis_whose_own_it_is() {
        let alone = |carrying: &str, carriage: &str, form: &str| {
            let shape = Shape::new().text("carrying", carrying).text("carriage", carriage);
            let effect = construct(&shape.text("about", "x").text("form", form), &machine()).unwrap();
            let is_alone = |name: &str| name.starts_with(form) && name.ends_with("_0");
            effect.parameters().iter().filter(|spec| is_alone(&spec.name)).count()
        };
        assert_eq!([("x", "y"), ("y", "x"), ("y", "z"), ("z", "y")].map(|(u, v)| alone(u, v, "turn")), [0; 4]);
        assert_eq!([alone("x", "z", "turn"), alone("z", "x", "turn"), alone("x", "y", "lean")], [3; 3]);
    }

    #[test]
    fn an_axis_does_not_carry_itself() {
        let shape = Shape::new().text("carrying", "x").text("carriage", "x").text("about", "x").text("form", "turn");
        assert!(construct(&shape, &machine()).is_err());
    }
}
