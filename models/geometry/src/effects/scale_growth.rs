//! Growth of a scale with time: a ball screw that its own friction warms, or a scale that follows what nobody logged.
//!
//! Formula: e = (g·r + s)·(1 − e^(−t/τ)) along the axis, r the reading (m), t the time since the campaign began (s), τ the time constant
//! (s). g is the growth in the end, −s/g where the scale is fixed. Input: `time_s`. Screws grow by 20–100 µm a metre within one
//! to two hours (Bryan 1990; Mayr et al. 2012); of a time constant as long as the campaign little but a straight line is seen.

use super::growth::{REFINE, grown, time_constants_s};
use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State, TIME};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "scale_growth",
    title: "growth of a scale with time",
    formula: "e = (growth r + shift) (1 - exp(-t / tau)) along the axis, t since the campaign began",
    typical: "20-100 µm/m of a ball screw within hours",
    source: "Bryan 1990, International status of thermal error research; Mayr et al. 2012, Thermal issues in machine tools",
    needs: "time_s, and positions that do not follow the time",
    decided_by: "repeat some lines along the axis throughout the campaign, start once more from cold, or log the temperature of the screw",
    construct,
    propose,
    refine: Some(REFINE),
};
/// Time constants tested, from the whole campaign downwards.
const TESTED: i32 = 4;

#[derive(Debug)]
struct ScaleGrowth {
    axis: Axis,
    tau_s: f64,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = ScaleGrowth { axis: reader.axis("axis")?, tau_s: reader.positive("tau_s")? };
    reader.finish()?;
    Ok(Box::new(effect))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let taus_s = time_constants_s(observed, TESTED);
    let shape = |axis: Axis, tau_s: f64| Shape::new().text("axis", axis.lower()).number("tau_s", tau_s);
    let of_axis = |axis: Axis| taus_s.iter().map(move |tau_s| shape(axis, *tau_s));
    Axis::ALL.into_iter().flat_map(of_axis).collect()
}

impl Effect for ScaleGrowth {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![TIME.to_owned()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        vec![ParameterSpec::new("growth", "1", 300e-6), ParameterSpec::new("shift", "m", 300e-6)]
    }

    /// Without a growth it is the tip that creeps.
    fn essential(&self) -> &'static [usize] {
        &[0]
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let grown = grown(state.covariate(TIME)?, self.tau_s);
        let along = Acts::Error(ErrorId::linear(self.axis, self.axis));
        part(0, along, state.reading_m[self.axis.index()] * grown);
        part(1, along, grown);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{One, machine, tip_m};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn a_screw_fixed_in_the_middle_pushes_both_ends_away() {
        let shape = Shape::new().text("axis", "y").number("tau_s", 3600.0);
        let effect = construct(&shape, &machine()).unwrap();
        let at = |y_m: f64, time_s: f64| {
            let state = State { reading_m: [0.2, y_m, 0.1], offset_m: [0.0; 3], covariates: &One(time_s) };
            tip_m(effect.as_ref(), &state, &[50e-6, -20e-6])
        };
        assert_eq!(at(0.7, 0.0), Vector3::zeros());
        assert!((at(0.8, 1e6) - Vector3::new(0.0, 20e-6, 0.0)).norm() < 1e-15);
        assert!((at(0.0, 3600.0) - Vector3::new(0.0, -20e-6 * 0.632_120_558_8, 0.0)).norm() < 1e-14);
    }
}
