//! Outlying run: all ranges of one line are wrong by the same amount, after a knock or a lost count.
//!
//! Formula: range += shift on the readings of that line, nothing on all others. Input: name of the line.
//! Typical 1–50 µm. It says nothing about the machine: what is right is to measure the line again.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "outlying_run",
    title: "outlying run",
    formula: "range += shift on the readings of one line",
    typical: "1-50 µm",
    source: "loss of counts of an incremental interferometer",
    needs: "lines by name",
    decided_by: "measure the line again",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct OutlyingRun {
    line: String,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = OutlyingRun { line: reader.text("line")?.to_owned() };
    reader.finish()?;
    Ok(Box::new(effect))
}

/// None: a scan over all lines proposes the one that stands out.
fn propose(_observed: &Observed) -> Vec<Shape> {
    Vec::new()
}

impl Effect for OutlyingRun {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn runs(&self) -> Vec<String> {
        vec![self.line.clone()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        vec![ParameterSpec::new("shift", "m", 1e-3)]
    }

    fn range(&self, _state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        if sight.line == self.line {
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
    fn twenty_micrometres_on_one_line_are_on_no_other() {
        let effect = construct(&Shape::new().text("line", "S1-03"), &machine()).unwrap();
        let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(0.0) };
        let read = |line: &str| {
            let sight = Sight { station: "S1", line, ray: Ray { direction: Vector3::x(), range_m: 1.0 } };
            range_m(effect.as_ref(), &state, &sight, &[20e-6])
        };
        assert_eq!((read("S1-03"), read("S1-04")), (20e-6, 0.0));
    }
}
