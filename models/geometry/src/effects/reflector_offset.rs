//! Reflector holders of another length than entered: each offset of a campaign has a constant error of its own.
//!
//! Formula: range += v(offset)·direction, v a vector (m) for each offset listed but the first, against which the
//! others are measured: an error common to all moves the whole measurement and no reading knows it. It is a fault of
//! the measuring set-up, so no corrected coordinate is touched; the turns of the ram, some µrad, do not matter to some
//! µm. Inputs: offset (m, ram frame), told apart to 1 µm; one that is not listed is left alone. Typical 0.5–5 µm.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State};
use crate::axis::Axis;
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "reflector_offset",
    title: "wrong reflector offset",
    formula: "range += v(offset) . direction, v for each offset but the first",
    typical: "0.5-5 µm",
    source: "geometry of the set-up",
    needs: "two reflector offsets or more",
    decided_by: "measure the holders on another machine, or swap them and repeat some lines",
    construct,
    propose,
    refine: None,
};
/// Offsets closer than this are the same (m).
const SAME_M: f64 = 1e-6;
/// More offsets than holders anybody has are positions of a rotary head, with another law.
const MOST: usize = 8;

#[derive(Debug)]
struct ReflectorOffset {
    offsets_m: Vec<[f64; 3]>,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let (offsets_m, rest) = reader.numbers("offsets_m")?.as_chunks::<3>();
    if !rest.is_empty() || offsets_m.len() < 2 {
        return Err(reader.wrong("offsets_m", "must be x, y and z of two offsets or more"));
    }
    if distinct(offsets_m).len() < offsets_m.len() {
        return Err(reader.wrong("offsets_m", "must differ by more than 1 µm from each other"));
    }
    reader.finish()?;
    Ok(Box::new(ReflectorOffset { offsets_m: offsets_m.to_vec() }))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let offsets_m = distinct(observed.offsets_m);
    if !(2..=MOST).contains(&offsets_m.len()) {
        return Vec::new();
    }
    vec![Shape::new().numbers("offsets_m", offsets_m.as_flattened())]
}

fn same(a: &[f64; 3], b: &[f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= SAME_M)
}

/// The first of each group of offsets that are the same.
fn distinct(offsets_m: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut kept: Vec<[f64; 3]> = Vec::new();
    for offset_m in offsets_m {
        if !kept.iter().any(|known| same(known, offset_m)) {
            kept.push(*offset_m);
        }
    }
    kept
}

impl Effect for ReflectorOffset {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let of = |k: usize| Axis::ALL.map(|axis| ParameterSpec::new(format!("{}_{k}", axis.lower()), "m", 200e-6));
        (2..=self.offsets_m.len()).flat_map(of).collect()
    }

    fn range(&self, state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        let others = &self.offsets_m[1..];
        if let Some(k) = others.iter().position(|offset_m| same(offset_m, &state.offset_m)) {
            (0..3).for_each(|d| part(3 * k + d, sight.ray.direction[d]));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Ray;
    use super::super::tests::{One, machine, range_m, tip_m};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn a_holder_too_long_by_three_micrometres_shows_along_the_sight_and_leaves_the_tip_alone() {
        let shape = Shape::new().numbers("offsets_m", &[0.0, 0.0, -0.06, 0.1, 0.0, -0.06]);
        let effect = construct(&shape, &machine()).unwrap();
        let ray = Ray { direction: Vector3::new(0.6, 0.0, 0.8), range_m: 1.0 };
        let read = |offset_m: [f64; 3]| {
            let state = State { reading_m: [0.3; 3], offset_m, covariates: &One(0.0) };
            assert_eq!(tip_m(effect.as_ref(), &state, &[3e-6, 0.0, 0.0]), Vector3::zeros());
            range_m(effect.as_ref(), &state, &Sight { station: "S1", line: "L", ray }, &[3e-6, 0.0, 0.0])
        };
        assert!((read([0.1, 0.0, -0.060_000_4]) - 1.8e-6).abs() < 1e-18, "the same to a micrometre");
        assert_eq!((read([0.0, 0.0, -0.06]), read([0.1, 0.0, -0.061])), (0.0, 0.0));
    }

    #[test]
    fn two_to_eight_holders_are_worth_testing() {
        let machine = machine();
        let proposed = |offsets_m: &[[f64; 3]]| {
            propose(&Observed { machine: &machine, varying: &[], stations: &[], offsets_m, time_s: (0.0, 1.0) }).len()
        };
        let offsets_m: Vec<[f64; 3]> = (0..9).map(|k| [0.01 * f64::from(k), 0.0, 0.0]).collect();
        assert_eq!([1, 2, 8, 9].map(|n| proposed(&offsets_m[..n])), [0, 1, 1, 0]);
        assert_eq!(proposed(&[[0.0; 3], [1e-7, 0.0, 0.0]]), 0, "one holder, entered twice");
        let once = Shape::new().numbers("offsets_m", &[0.0, 0.0, -0.06, 0.1]);
        assert!(construct(&once, &machine).is_err());
    }
}
