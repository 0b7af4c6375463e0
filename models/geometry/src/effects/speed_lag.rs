//! Speed lag: an axis stops short of its target, the more so the faster it came.
//!
//! Formula: e = −lag·v·sign(approach) along the axis, v the feed of the last move (m/s). Inputs: `speed_mm_s` and the
//! sign of approach (−1, 0, +1). Typical lag 10–100 µs, so 1–10 µm at 100 mm/s: a scale
//! read late, or a target reached short. Unlike reversal it vanishes with the speed.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State, logged_side};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "speed_lag",
    title: "lag with speed",
    formula: "e = -lag v sign(approach) along the axis, v the feed",
    typical: "10-100 µs, so 1-10 µm at 100 mm/s",
    source: "delay between scale and trigger, following error of a control loop",
    needs: "the feed (speed_mm_s) and the sign of approach (dir_x, dir_y, dir_z), at two feeds or more",
    decided_by: "measure some lines along the axis in both directions at a low and a high feed",
    construct,
    propose,
    refine: None,
};
const SPEED: &str = "speed_mm_s";
const M_PER_MM: f64 = 1e-3;

#[derive(Debug)]
struct SpeedLag {
    axis: Axis,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = SpeedLag { axis: reader.axis("axis")? };
    reader.finish()?;
    Ok(Box::new(effect))
}

/// Only where the feed varies: at one feed it is a reversal.
fn propose(observed: &Observed) -> Vec<Shape> {
    let approached = |axis: &Axis| observed.varies(SPEED) && observed.varies(logged_side(*axis));
    Axis::ALL.into_iter().filter(approached).map(|axis| Shape::new().text("axis", axis.lower())).collect()
}

impl Effect for SpeedLag {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![SPEED.to_owned(), logged_side(self.axis).to_owned()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        vec![ParameterSpec::new("lag", "s", 2e-3)]
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let speed_m_s = state.covariate(SPEED)? * M_PER_MM;
        let sign = state.covariate(logged_side(self.axis))?;
        part(0, Acts::Error(ErrorId::linear(self.axis, self.axis)), -speed_m_s * sign);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Each, machine, tip_m};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn fifty_microseconds_at_a_hundred_millimetres_a_second_are_five_micrometres_short() {
        let effect = construct(&Shape::new().text("axis", "x"), &machine()).unwrap();
        for sign in [1.0, -1.0] {
            let source = Each(&[("speed_mm_s", 100.0), ("dir_x", sign)]);
            let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &source };
            let expected_m = Vector3::new(-5e-6 * sign, 0.0, 0.0);
            assert!((tip_m(effect.as_ref(), &state, &[50e-6]) - expected_m).norm() < 1e-18);
        }
    }
}
