//! Reflector centre that seems to move with the angle of incidence: glass, coating and centring of a retroreflector.
//!
//! Formula: range += Σ c·h(n), n the unit direction of the sight in the ram frame, h the polynomials x, y, z,
//! xy, yz, zx, x² − y², 3z² − 1: every smooth function of the direction to second order, without its mean, which is
//! part of the zero of length. The turns of the ram, some µrad, do not matter here. Inputs: direction of the sight.
//! Typical 0.1–5 µm. The first three are exactly what a reflector mounted somewhere else does.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "reflector_incidence",
    title: "incidence on the reflector",
    formula: "range += sum c h(n), n the sight in the ram frame, h its polynomials x y z xy yz zx x2-y2 3z2-1",
    typical: "0.1-5 µm",
    source: "a smooth function of the direction, expanded to second order",
    needs: "sights from many sides of the reflector",
    decided_by: "turn the reflector in its holder by 90 degrees and repeat some lines",
    construct,
    propose,
    refine: None,
};
const NAMES: [&str; 8] = ["x", "y", "z", "xy", "yz", "zx", "x2_y2", "3z2_1"];

#[derive(Debug)]
struct ReflectorIncidence;

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    Reader::new(KNOWN.name, shape).finish()?;
    Ok(Box::new(ReflectorIncidence))
}

fn propose(_observed: &Observed) -> Vec<Shape> {
    vec![Shape::new()]
}

impl Effect for ReflectorIncidence {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        NAMES.map(|name| ParameterSpec::new(name, "m", 50e-6)).to_vec()
    }

    fn range(&self, _state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        let [x, y, z]: [f64; 3] = sight.ray.direction.into();
        let values = [x, y, z, x * y, y * z, z * x, x * x - y * y, 3.0 * z * z - 1.0];
        values.into_iter().enumerate().for_each(|(k, value)| part(k, value));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Ray;
    use super::super::tests::{One, machine, range_m};
    use super::*;
    use nalgebra::Vector3;

    /// (a·n)² about the tilted axis a = (0.6, 0, 0.8), 3 µm on the axis: no direction is special to the polynomials.
    #[test]
    fn a_square_law_about_any_axis_is_described_exactly() {
        let effect = construct(&Shape::new(), &machine()).unwrap();
        let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(0.0) };
        // 0.36x² + 0.64z² + 0.96zx, with x² = (1 − z² + (x² − y²))/2 and z² = ((3z² − 1) + 1)/3.
        let (mean, zx, x2_y2, z2) = (1.0 / 3.0, 0.96, 0.18, (0.64 - 0.18) / 3.0);
        let parameters = [0.0, 0.0, 0.0, 0.0, 0.0, zx, x2_y2, z2].map(|c| 3e-6 * c);
        for direction in [Vector3::new(0.6, 0.0, 0.8), Vector3::y(), Vector3::new(1.0, -2.0, 0.4).normalize()] {
            let sight = Sight { station: "S1", line: "L", ray: Ray { direction, range_m: 1.0 } };
            let read_m = range_m(effect.as_ref(), &state, &sight, &parameters) + 3e-6 * mean;
            let expected_m = 3e-6 * direction.dot(&Vector3::new(0.6, 0.0, 0.8)).powi(2);
            assert!((read_m - expected_m).abs() < 1e-18, "{direction}");
        }
    }
}
