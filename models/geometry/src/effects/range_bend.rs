//! Error of the instrument that grows with the square of the range, the same for all stations.
//!
//! Formula: range reads longer by per_metre · range². Inputs: range (m). Air whose index n changes steadily along the beam, while the
//! instrument takes it to be everywhere as at its own sensor, makes ½ dn/ds a metre: half a kelvin a metre −0.24e-6 (Edlén's formula near 20 °C
//! and 633 nm, as revised by Birch and Downs 1994). To a few stations it looks like scales that bend.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "range_bend",
    title: "error of the instrument by the square of the range",
    formula: "range += per_metre range^2",
    typical: "up to 0.5 µm/m²: -0.24 µm/m² where the air gets warmer by 0.5 K a metre along the beam",
    source: "Edlen 1966, revised by Birch and Downs 1994; Muralikrishnan, Phillips and Sawyer 2016 (laser trackers: a review)",
    needs: "stations near and far from the same places",
    decided_by: "measure the same lines from a stand at another distance, or a calibrated length near and far",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct RangeBend;

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    Reader::new(KNOWN.name, shape).finish()?;
    Ok(Box::new(RangeBend))
}

fn propose(_observed: &Observed) -> Vec<Shape> {
    vec![Shape::new()]
}

impl Effect for RangeBend {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        vec![ParameterSpec::new("per_metre", "1/m", 0.5e-6)]
    }

    fn range(&self, _state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        part(0, sight.ray.range_m * sight.ray.range_m);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Ray;
    use super::super::tests::{Each, machine, range_m};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn three_metres_read_nine_times_as_long_as_one() {
        let effect = construct(&Shape::new(), &machine()).unwrap();
        let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &Each(&[]) };
        let read = |range| {
            let ray = Ray { direction: Vector3::x(), range_m: range };
            range_m(effect.as_ref(), &state, &Sight { station: "S1", line: "S1-00", ray }, &[0.2e-6])
        };
        assert!((read(1.0) - 0.2e-6).abs() < 1e-18 && (read(3.0) - 1.8e-6).abs() < 1e-18);
        assert!(construct(&Shape::new().texts("stations", &["S1".to_owned()]), &machine()).is_err());
    }
}
