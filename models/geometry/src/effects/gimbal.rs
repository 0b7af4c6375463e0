//! Gimbal of the tracer: the length changes with the direction of the sight, as its axes do not meet in one point.
//!
//! Formula: range += Σ over sin az, cos az, sin 2az, cos 2az, sin 2el, cos 2el, azimuth and elevation of the sight
//! about the machine's z axis, the same at every station. Inputs: direction of the sight. Typical 0.1–0.3 µm.
//! Straight up there is no azimuth, and its harmonics add nothing. The first harmonics look like a station that
//! stands elsewhere: only many stations tell them apart, if each is set up turned the same way.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "gimbal",
    title: "gimbal of the tracer",
    formula: "range += s1 sin az + c1 cos az + s2 sin 2az + c2 cos 2az + s3 sin 2el + c3 cos 2el",
    typical: "0.1-0.3 um",
    source: "geometry of two turning axes that do not meet, to the second harmonic",
    needs: "sights in many directions from each station",
    decided_by: "measure the same points again with the tracer turned by 90 degrees at the same place",
    construct,
    propose,
    refine: None,
};
const HARMONICS: [&str; 6] = ["sin_az", "cos_az", "sin_2az", "cos_2az", "sin_2el", "cos_2el"];

#[derive(Debug)]
struct Gimbal;

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    Reader::new(KNOWN.name, shape).finish()?;
    Ok(Box::new(Gimbal))
}

fn propose(_observed: &Observed) -> Vec<Shape> {
    vec![Shape::new()]
}

impl Effect for Gimbal {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        HARMONICS.map(|name| ParameterSpec::new(name, "m", 10e-6)).to_vec()
    }

    fn range(&self, _state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        let direction = sight.ray.direction;
        let level = direction.xy().norm();
        if level > 0.0 {
            let (sine, cosine) = (direction.y / level, direction.x / level);
            let azimuth = [sine, cosine, 2.0 * sine * cosine, cosine * cosine - sine * sine];
            azimuth.into_iter().enumerate().for_each(|(k, value)| part(k, value));
        }
        part(4, 2.0 * direction.z * level);
        part(5, level * level - direction.z * direction.z);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Ray;
    use super::super::tests::{One, machine, range_m};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn harmonics_are_those_of_azimuth_and_elevation() {
        let effect = construct(&Shape::new(), &machine()).unwrap();
        let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(0.0) };
        let (az, el) = (200_f64.to_radians(), 35_f64.to_radians());
        let read = |direction: Vector3<f64>, k: usize| {
            let sight = Sight { station: "S1", line: "L", ray: Ray { direction, range_m: 1.0 } };
            range_m(effect.as_ref(), &state, &sight, &std::array::from_fn::<f64, 6, _>(|i| f64::from(u8::from(i == k))))
        };
        let direction = Vector3::new(el.cos() * az.cos(), el.cos() * az.sin(), el.sin());
        let (double, high) = (2.0 * az, 2.0 * el);
        let expected = [az.sin(), az.cos(), double.sin(), double.cos(), high.sin(), high.cos()];
        (0..6).for_each(|k| assert!((read(direction, k) - expected[k]).abs() < 1e-15, "{k}"));
        let up = (0..6).map(|k| read(Vector3::z(), k)).collect::<Vec<_>>();
        assert_eq!(up, [0.0, 0.0, 0.0, 0.0, 0.0, -1.0]);
    }
}
