//! Step in the scale of one axis: a tape joined of two pieces, a damaged grating, a reference mark that was counted wrongly, a screw or
//! rail with a joint.
//!
//! Formula: e = step along the axis at readings beyond the place (m), none before it. Campaigns show between which readings the place
//! lies, `from_m` and `to_m`, and not where between them. With a place anywhere there, equally likely, a reading of which the share
//! t = (r − `from_m`)/(`to_m` − `from_m`) lies below has passed the step with probability t. So on average e = step·t, and the variance of a thing
//! that is there or is not, step²·t·(1 − t), goes into the uncertainty. Typical 1–20 µm. A search over the readings finds the place.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "scale_step",
    title: "step in a scale",
    formula: "e = step along the axis beyond a place that lies between from_m and to_m",
    typical: "1-20 µm: joined tapes, a damaged grating, a joint of rails",
    source: "ISO 230-1 (positioning error); calibration of line scales: Nyce 2004, Linear Position Sensors",
    needs: "readings close to each other along the axis, from several lines",
    decided_by: "measure a line along the axis in steps of some millimetres across the place",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct ScaleStep {
    axis: Axis,
    from_m: f64,
    to_m: f64,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let (axis, from_m, to_m) = (reader.axis("axis")?, reader.number("from_m")?, reader.number("to_m")?);
    if from_m >= to_m {
        return Err(reader.wrong("to_m", "must lie above from_m: the step is somewhere between them"));
    }
    reader.finish()?;
    Ok(Box::new(ScaleStep { axis, from_m, to_m }))
}

/// None: a search over all readings proposes the place that stands out.
fn propose(_observed: &Observed) -> Vec<Shape> {
    Vec::new()
}

impl ScaleStep {
    /// Probability that a reading has passed the step.
    fn passed(&self, state: &State) -> f64 {
        let reading_m = state.reading_m[self.axis.index()];
        if reading_m >= self.to_m {
            return 1.0;
        }
        ((reading_m - self.from_m) / (self.to_m - self.from_m)).max(0.0)
    }

    fn along(&self) -> Acts {
        Acts::Error(ErrorId::linear(self.axis, self.axis))
    }
}

impl Effect for ScaleStep {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn is_abrupt(&self) -> bool {
        true
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        vec![ParameterSpec::new("step", "m", 200e-6)]
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        part(0, self.along(), self.passed(state));
        Ok(())
    }

    fn undecided(&self, state: &State, part: &mut Motion) {
        let passed = self.passed(state);
        if passed > 0.0 && passed < 1.0 {
            part(0, self.along(), (passed * (1.0 - passed)).sqrt());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Each, NONE, machine, tip_m};
    use super::*;

    fn between(from_m: f64, to_m: f64) -> Shape {
        Shape::new().text("axis", "y").number("from_m", from_m).number("to_m", to_m)
    }

    fn state(y_m: f64) -> State<'static> {
        State { reading_m: [0.1, y_m, 0.2], offset_m: [0.0; 3], covariates: &Each(NONE) }
    }

    #[test]
    fn all_beyond_the_step_is_moved_and_what_lies_between_is_undecided() {
        let effect = construct(&between(0.3, 0.31), &machine()).unwrap();
        let moved = |y_m: f64| tip_m(effect.as_ref(), &state(y_m), &[6e-6]).y;
        for (y_m, um) in [(0.0, 0.0), (0.3, 0.0), (0.3025, 1.5), (0.305, 3.0), (0.31, 6.0), (0.6, 6.0)] {
            assert!((moved(y_m) - um * 1e-6).abs() < 1e-17, "{y_m}: {}", moved(y_m));
        }
        let undecided = |y_m: f64| {
            let mut all = Vec::new();
            effect.undecided(&state(y_m), &mut |k, acts, amount| all.push((k, acts, amount)));
            all
        };
        assert!([0.0, 0.3, 0.31, 0.6].into_iter().all(|y_m| undecided(y_m).is_empty()));
        // Half has passed: 0 or 1, a standard deviation of a half; a tenth: the root of 0.09.
        for (y_m, share) in [(0.305, 0.5), (0.301, 0.3)] {
            let [(k, acts, amount)] = undecided(y_m)[..] else { panic!("{y_m}") };
            assert_eq!((k, acts), (0, Acts::Error(ErrorId::linear(Axis::Y, Axis::Y))));
            assert!((amount - share).abs() < 1e-12, "{y_m}: {amount}");
        }
    }

    #[test]
    fn a_place_between_readings_the_wrong_way_round_is_refused() {
        for (from_m, to_m) in [(0.3, 0.3), (0.4, 0.3)] {
            let refused = construct(&between(from_m, to_m), &machine()).unwrap_err().to_string();
            assert!(refused.contains("to_m") && refused.contains("above from_m"), "{refused}");
        }
    }
}
