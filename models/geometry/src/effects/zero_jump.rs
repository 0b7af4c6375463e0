//! Jump of the zero of a tracer: its beam was interrupted for a moment, and from then on all its ranges are off by the same amount.
//!
//! Formula: range += step on the readings of one station from a time on. Inputs: name of the station, `time_s` since the campaign
//! began. Typical 1–50 µm. It says nothing about the machine: what is right is to give the station a name of its own from there on.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State, TIME};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "zero_jump",
    title: "jump of the zero of a tracer",
    formula: "range += step on the readings of one station from a time on",
    typical: "1-50 µm",
    source: "loss of counts of an incremental interferometer",
    needs: "time_s, and several lines of a station before and after",
    decided_by: "measure the first lines of that station again at its end",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct ZeroJump {
    station: String,
    after_s: f64,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = ZeroJump { station: reader.text("station")?.to_owned(), after_s: reader.number("after_s")? };
    reader.finish()?;
    Ok(Box::new(effect))
}

/// None: a scan over all pauses between lines proposes the one that stands out.
fn propose(_observed: &Observed) -> Vec<Shape> {
    Vec::new()
}

impl Effect for ZeroJump {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn happens_once(&self) -> bool {
        true
    }

    fn range_covariates(&self) -> Vec<String> {
        vec![TIME.to_owned()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        vec![ParameterSpec::new("step", "m", 1e-3)]
    }

    fn range(&self, state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        if sight.station == self.station && state.covariate(TIME)? >= self.after_s {
            part(0, 1.0);
        }
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
    fn what_comes_after_at_that_station_is_off() {
        let shape = Shape::new().text("station", "S1").number("after_s", 600.0);
        let effect = construct(&shape, &machine()).unwrap();
        let read = |station: &str, time_s: f64| {
            let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(time_s) };
            let sight = Sight { station, line: "1", ray: Ray { direction: Vector3::x(), range_m: 1.0 } };
            range_m(effect.as_ref(), &state, &sight, &[-8e-6])
        };
        assert_eq!((read("S1", 599.0), read("S1", 600.0), read("S2", 900.0)), (0.0, -8e-6, 0.0));
    }
}
