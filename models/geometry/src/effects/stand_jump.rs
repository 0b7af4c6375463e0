//! Jump of the stand: somebody bumps it, or it slips, and from then on a station measures from another place.
//!
//! Formula: range −= direction·step on the readings of one station from a time on, direction from station to reflector, step in the
//! machine frame (m). Inputs: name of the station, `time_s` since the campaign began. Typical 2–100 µm. It says nothing about the
//! machine, unless the zero of the machine jumped by −step instead: at one station both are the same.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State, TIME};
use crate::axis::Axis;
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "stand_jump",
    title: "jump of the stand",
    formula: "range -= direction . step on the readings of one station from a time on",
    typical: "2-100 µm",
    source: "geometry of a station that moves",
    needs: "time_s, and several lines of a station in many directions before and after",
    decided_by: "measure a mark on the table from that station before and after: the stand moves it, and the zero of an axis does not",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct StandJump {
    station: String,
    after_s: f64,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = StandJump { station: reader.text("station")?.to_owned(), after_s: reader.number("after_s")? };
    reader.finish()?;
    Ok(Box::new(effect))
}

/// None: a scan over all pauses between lines proposes the one that stands out.
fn propose(_observed: &Observed) -> Vec<Shape> {
    Vec::new()
}

impl Effect for StandJump {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn moves_stand(&self) -> bool {
        true
    }

    fn happens_once(&self) -> bool {
        true
    }

    fn range_covariates(&self) -> Vec<String> {
        vec![TIME.to_owned()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        Axis::ALL.map(|axis| ParameterSpec::new(axis.lower(), "m", 1e-3)).into()
    }

    fn range(&self, state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        if sight.station == self.station && state.covariate(TIME)? >= self.after_s {
            (0..3).for_each(|d| part(d, -sight.ray.direction[d]));
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
    fn what_comes_after_is_measured_from_another_place_at_that_station() {
        let shape = Shape::new().text("station", "S1").number("after_s", 600.0);
        let effect = construct(&shape, &machine()).unwrap();
        let read = |station: &str, time_s: f64, direction: Vector3<f64>| {
            let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(time_s) };
            let sight = Sight { station, line: "1", ray: Ray { direction, range_m: 1.0 } };
            range_m(effect.as_ref(), &state, &sight, &[8e-6, -3e-6, 0.0])
        };
        let (x, y) = (Vector3::x(), Vector3::y());
        assert_eq!((read("S1", 599.0, x), read("S1", 600.0, x), read("S1", 600.0, y)), (0.0, -8e-6, 3e-6));
        assert_eq!(read("S2", 900.0, x), 0.0);
    }
}
