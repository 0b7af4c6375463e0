//! Hysteresis over travel: after a reversal the axis takes some way until it lags behind on the other side.
//!
//! Formula: e = ½·H·z along the axis, z the side of approach that follows over a travel λ: λ dz/ds = sign(dx) − z
//! ([`crate::travelled`]). Far beyond λ it is backlash, with H the reversal value of ISO 230-2; unlike the logged sign of approach it
//! knows half a reversal, and an axis that stands still while others move. Input: the sequence of readings. Typical 0.1–2 µm over
//! 1–50 mm: friction that bends a drive, a guide or its seals.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State, of_travelled};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "hysteresis",
    title: "hysteresis over travel",
    formula: "e = H z / 2 along the axis, lambda dz/ds = sign(dx) - z over the travel s",
    typical: "0.1-2 µm over 1-50 mm",
    source: "Dahl 1968 (solid friction); ISO 230-2 (reversal value)",
    needs: "readings in the order of measurement, with reversals of the axis",
    decided_by: "measure points of a line along the axis at several distances after a reversal",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct Hysteresis {
    axis: Axis,
    side: String,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let (axis, side) = (reader.axis("axis")?, reader.text("side")?.to_owned());
    if of_travelled(&side).is_none_or(|(of, _)| of != axis) {
        return Err(reader.wrong("side", "must be the side of the axis over its travel, such as dir_x_over_5000um"));
    }
    reader.finish()?;
    Ok(Box::new(Hysteresis { axis, side }))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let shape = |name: &str| {
        let (axis, _) = of_travelled(name)?;
        Some(Shape::new().text("axis", axis.lower()).text("side", name))
    };
    observed.named("dir_", "um").filter_map(shape).collect()
}

impl Effect for Hysteresis {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![self.side.clone()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        vec![ParameterSpec::new("h", "m", 50e-6)]
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        part(0, Acts::Error(ErrorId::linear(self.axis, self.axis)), 0.5 * state.covariate(&self.side)?);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{One, machine, tip_m};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn both_ends_differ_by_the_reversal_value_and_half_way_there_is_none() {
        let shape = Shape::new().text("axis", "x").text("side", "dir_x_over_5000um");
        let effect = construct(&shape, &machine()).unwrap();
        let at = |side: f64| {
            let state = State { reading_m: [0.5; 3], offset_m: [0.0; 3], covariates: &One(side) };
            tip_m(effect.as_ref(), &state, &[1.2e-6])
        };
        assert!((at(1.0) - at(-1.0) - Vector3::new(1.2e-6, 0.0, 0.0)).norm() < 1e-18);
        assert_eq!(at(0.0), Vector3::zeros());
        for side in ["dir_y_over_5000um", "dir_x"] {
            let wrong = construct(&shape.clone().text("side", side), &machine()).unwrap_err().to_string();
            assert!(wrong.contains("dir_x_over_5000um"), "{wrong}");
        }
    }
}
