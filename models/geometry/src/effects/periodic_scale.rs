//! Periodic error of a scale: interpolation within a grating pitch, or mounting screws every few centimetres.
//!
//! Formula: e = s·sin(2πr/p) + c·cos(2πr/p) along the axis, r the reading (m), p the period (m). Typical 0.05–0.5 µm
//! at 20 µm, more at the longer periods of mounting. The period is found by a periodogram of the residuals.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;
use std::f64::consts::TAU;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "periodic_scale",
    title: "periodic scale error",
    formula: "e = s sin(2 pi r / p) + c cos(2 pi r / p) along the axis, p the period",
    typical: "0.05-0.5 µm at p = 20 µm; longer p from mounting",
    source: "ISO 230-2 (periodic error); Schwenke et al. 2008",
    needs: "positions that do not repeat with the period",
    decided_by: "measure a line along the axis with a step of a tenth of the period, or at irregular steps",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct PeriodicScale {
    axis: Axis,
    period_m: f64,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = PeriodicScale { axis: reader.axis("axis")?, period_m: reader.positive("period_m")? };
    reader.finish()?;
    Ok(Box::new(effect))
}

/// None: periods are too many to list; a periodogram proposes them.
fn propose(_observed: &Observed) -> Vec<Shape> {
    Vec::new()
}

impl Effect for PeriodicScale {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        ["sine", "cosine"].map(|name| ParameterSpec::new(name, "m", 20e-6)).to_vec()
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let (sine, cosine) = (TAU * state.reading_m[self.axis.index()] / self.period_m).sin_cos();
        let along = Acts::Error(ErrorId::linear(self.axis, self.axis));
        part(0, along, sine);
        part(1, along, cosine);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{One, machine, tip_m};
    use super::*;

    #[test]
    fn it_repeats_after_a_period_and_turns_its_sign_after_half_of_it() {
        let shape = Shape::new().text("axis", "z").number("period_m", 20e-6);
        let effect = construct(&shape, &machine()).unwrap();
        let at = |z_m: f64| {
            let state = State { reading_m: [0.1, 0.2, z_m], offset_m: [0.0; 3], covariates: &One(0.0) };
            tip_m(effect.as_ref(), &state, &[0.3e-6, -0.1e-6]).z
        };
        assert!((at(0.1) - at(0.1 + 20e-6)).abs() < 1e-16);
        assert!((at(0.1) + at(0.1 + 10e-6)).abs() < 1e-16);
        assert!((at(0.1 + 5e-6).hypot(at(0.1)) - 0.1e-6_f64.hypot(0.3e-6)).abs() < 1e-16);
    }
}
