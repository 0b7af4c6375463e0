//! Jump of the zero of a tracer: its beam was interrupted for a moment, and from then on all its ranges are off by the same amount.
//!
//! Formula: range += step on the readings of these lines, the last ones of a station, nothing on all others. Inputs: names of
//! station and line. Typical 1–50 µm. It says nothing about the machine: what is right is to give the station a name of its own from there on,
//! or to measure these lines again.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "zero_jump",
    title: "jump of the zero of a tracer",
    formula: "range += step on the last lines of one station",
    typical: "1-50 um",
    source: "loss of counts of an incremental interferometer",
    needs: "several lines of a station before and after",
    decided_by: "measure the first lines of that station again at its end",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct ZeroJump {
    station: String,
    lines: Vec<String>,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = ZeroJump { station: reader.text("station")?.to_owned(), lines: reader.texts("lines")?.to_vec() };
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

    fn runs(&self) -> Vec<String> {
        self.lines.clone()
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        vec![ParameterSpec::new("step", "m", 1e-3)]
    }

    fn range(&self, _state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        if sight.station == self.station && self.lines.iter().any(|line| line == sight.line) {
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
    fn what_comes_after_is_off_and_nothing_before() {
        let lines = ["S1-02", "S1-03"].map(str::to_owned);
        let shape = Shape::new().text("station", "S1").texts("lines", &lines);
        let effect = construct(&shape, &machine()).unwrap();
        let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(0.0) };
        let read = |line: &str| {
            let sight = Sight { station: "S1", line, ray: Ray { direction: Vector3::x(), range_m: 1.0 } };
            range_m(effect.as_ref(), &state, &sight, &[-8e-6])
        };
        assert_eq!((read("S1-01"), read("S1-02"), read("S1-03")), (0.0, -8e-6, -8e-6));
    }
}
