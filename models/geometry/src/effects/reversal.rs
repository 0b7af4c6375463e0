//! Reversal (backlash): where the axis stops depends on the side it comes from.
//!
//! Formula: e = ½·B(u)·sign(approach) along the axis, B(u) = Σ b_k P_k(2u − 1) with Legendre polynomials P_k of the
//! share u of a stroke, the axis' own or, with `over`, another's (play that differs from side to side of a wide
//! carriage); degree 0 is the constant form. Inputs: reading (m), logged sign of approach (−1, 0, +1).
//! B is the reversal value of ISO 230-2, mean deviation of approaches in + less that in −: play, by which the axis lags
//! behind, is negative. Typical 0.1–2 µm.

use super::empirical::legendre;
use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State, logged_side};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "reversal",
    title: "backlash",
    formula: "e = B(u) sign(approach) / 2 along the axis, B(u) = sum b_k P_k(2u - 1), u the share of the stroke",
    typical: "0.1-2 µm",
    source: "ISO 230-2 (reversal value B)",
    needs: "the sign of approach (dir_x, dir_y, dir_z) with approaches from both sides",
    decided_by: "measure some lines along the axis in both directions",
    construct,
    propose,
    refine: None,
};
/// Terms of play that varies: a slope, and as curved as a worn or sagging guideway makes it. The constant has one.
const TERMS: [f64; 3] = [2.0, 3.0, 5.0];
/// Highest degree that makes sense on a stroke.
const MAX_DEGREE: usize = 9;

#[derive(Debug)]
struct Reversal {
    axis: Axis,
    /// Axis whose position B depends on.
    over: Axis,
    stroke_m: (f64, f64),
    degree: usize,
}

fn construct(shape: &Shape, machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let axis = reader.axis("axis")?;
    // Stored as the number of terms, so that the constant form is a whole number above zero like all counts.
    let degree = reader.count("terms", MAX_DEGREE + 1)? - 1;
    let over = reader.axis("over")?;
    reader.finish()?;
    Ok(Box::new(Reversal { axis, over, stroke_m: machine.stroke_m[over.index()], degree }))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let logged = Axis::ALL.into_iter().filter(|axis| observed.varies(logged_side(*axis)));
    let shapes = |axis: Axis| {
        let shape = move |over: Axis, terms: f64| {
            Shape::new().text("axis", axis.lower()).text("over", over.lower()).number("terms", terms)
        };
        let varying = Axis::ALL.into_iter().flat_map(move |over| TERMS.map(|terms| shape(over, terms)));
        std::iter::once(shape(axis, 1.0)).chain(varying)
    };
    logged.flat_map(shapes).collect()
}

impl Effect for Reversal {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![logged_side(self.axis).to_owned()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        (0..=self.degree).map(|k| ParameterSpec::new(format!("b_{k}"), "m", 50e-6)).collect()
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let sign = state.covariate(logged_side(self.axis))?;
        let (lower_m, upper_m) = self.stroke_m;
        let share = (state.reading_m[self.over.index()] - lower_m) / (upper_m - lower_m);
        let along = Acts::Error(ErrorId::linear(self.axis, self.axis));
        for (k, value) in legendre(2.0 * share - 1.0, self.degree).into_iter().enumerate() {
            part(k, along, 0.5 * sign * value);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{One, machine, tip_m};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn two_approaches_differ_by_the_reversal_value() {
        let shape = Shape::new().text("axis", "y").text("over", "y").number("terms", 1.0);
        let effect = construct(&shape, &machine()).unwrap();
        let at = |sign: f64| {
            let state = State { reading_m: [0.5; 3], offset_m: [0.0; 3], covariates: &One(sign) };
            tip_m(effect.as_ref(), &state, &[1.2e-6])
        };
        assert!((at(1.0) - at(-1.0) - Vector3::new(0.0, 1.2e-6, 0.0)).norm() < 1e-18);
        assert_eq!(at(0.0), Vector3::zeros());
    }
}
