//! Dynamic bending: the last acceleration of an axis twists its carriage and pushes it back along its way.
//!
//! Formula: EA, EB, EC of the axis = c·a and its three linear errors = d·a, a the last acceleration of that axis (m/s²).
//! Input: `acc_<axis>_mm_s2`. Some µrad at 1 m/s², so 1–20 µm at half a metre of lever when fast (Schwenke 2008).

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "acceleration",
    title: "dynamic bending",
    formula: "EA, EB, EC of the axis = c a and its linear errors = d a, a the last acceleration of the axis",
    typical: "1-20 µm when fast",
    source: "Schwenke et al. 2008 (dynamic errors of coordinate measuring machines)",
    needs: "the last acceleration of the axis (acc_x_mm_s2 ...) at two levels or more, at more than one lever",
    decided_by: "repeat some lines at the lowest acceleration, with a long and a short reflector holder",
    construct,
    propose,
    refine: None,
};
const ACCELERATIONS: [&str; 3] = ["acc_x_mm_s2", "acc_y_mm_s2", "acc_z_mm_s2"];
const M_PER_MM: f64 = 1e-3;

#[derive(Debug)]
struct Acceleration {
    axis: Axis,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = Acceleration { axis: reader.axis("axis")? };
    reader.finish()?;
    Ok(Box::new(effect))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let logged = Axis::ALL.into_iter().filter(|axis| observed.varies(ACCELERATIONS[axis.index()]));
    logged.map(|axis| Shape::new().text("axis", axis.lower())).collect()
}

impl Effect for Acceleration {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![ACCELERATIONS[self.axis.index()].to_owned()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let twist = |about: Axis| ParameterSpec::new(format!("twist_{}", about.lower()), "rad/(m/s2)", 500e-6);
        let mut specs = Axis::ALL.map(twist).to_vec();
        // The joint turns about a point that no drawing tells: a push of the whole moves the pivot.
        specs.extend(Axis::ALL.map(|axis| ParameterSpec::new(format!("push_{}", axis.lower()), "m/(m/s2)", 500e-6)));
        specs
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let acceleration_m_s2 = state.covariate(ACCELERATIONS[self.axis.index()])? * M_PER_MM;
        for about in Axis::ALL {
            part(about.index(), Acts::Error(ErrorId::angular(about, self.axis)), acceleration_m_s2);
        }
        for direction in Axis::ALL {
            part(3 + direction.index(), Acts::Error(ErrorId::linear(direction, self.axis)), acceleration_m_s2);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{One, machine, tip_m};
    use super::*;
    use nalgebra::Vector3;

    /// 4 µrad/(m/s²) at 0.5 m/s² about y, half a metre below the joint: 1 µm against x.
    #[test]
    fn a_twist_grows_with_acceleration_and_lever() {
        let effect = construct(&Shape::new().text("axis", "x"), &machine()).unwrap();
        let at = |acceleration_mm_s2: f64, offset_z_m: f64| {
            let offset_m = [0.0, 0.0, offset_z_m];
            let state = State { reading_m: [0.3, 0.0, 0.0], offset_m, covariates: &One(acceleration_mm_s2) };
            tip_m(effect.as_ref(), &state, &[0.0, 4e-6, 0.0, 0.0, 0.0, 0.0])
        };
        assert!((at(500.0, -0.5) - Vector3::new(-1e-6, 0.0, 0.0)).norm() < 1e-18);
        assert!((at(1000.0, -0.25) - at(500.0, -0.5)).norm() < 1e-18);
        assert_eq!(at(0.0, -0.5), Vector3::zeros());
    }
}
