//! Drift of the stand: a station creeps at a constant rate of its own while it is measured.
//!
//! Formula: range −= direction·rate·(t − start), direction from station to reflector, rate of that station (m/s,
//! machine frame), t the time since the campaign began. The stations of the fit are where they stood at `start_s`.
//! Input: `time_s`. Typical 0.5–5 µm/h. A station that is not listed does not creep.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State, TIME};
use crate::axis::Axis;
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "station_drift",
    title: "drift of the stand",
    formula: "range -= direction . rate (t - start), with a rate for each station",
    typical: "0.5-5 µm/h",
    source: "geometry of a station that moves",
    needs: "time_s, and sights in many directions early and late at each station",
    decided_by: "end each station with the lines that it began with",
    construct,
    propose,
    refine: None,
};
/// Largest rate believed: 360 µm/h (m/s).
const PLAUSIBLE_M_S: f64 = 100e-9;

#[derive(Debug)]
struct StationDrift {
    stations: Vec<String>,
    start_s: f64,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = StationDrift { stations: reader.texts("stations")?.to_vec(), start_s: reader.number("start_s")? };
    reader.finish()?;
    Ok(Box::new(effect))
}

/// From the middle of the campaign on: rates and positions of the stations are then told apart best.
fn propose(observed: &Observed) -> Vec<Shape> {
    let (first_s, last_s) = observed.time_s;
    if !observed.varies(TIME) || observed.stations.is_empty() {
        return Vec::new();
    }
    vec![Shape::new().texts("stations", observed.stations).number("start_s", 0.5 * (first_s + last_s))]
}

impl Effect for StationDrift {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn moves_stand(&self) -> bool {
        true
    }

    fn range_covariates(&self) -> Vec<String> {
        vec![TIME.to_owned()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let of = |station: &String| {
            Axis::ALL.map(|axis| ParameterSpec::new(format!("{}_{station}", axis.lower()), "m/s", PLAUSIBLE_M_S))
        };
        self.stations.iter().flat_map(of).collect()
    }

    fn range(&self, state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        let elapsed_s = state.covariate(TIME)? - self.start_s;
        if let Some(k) = self.stations.iter().position(|station| station == sight.station) {
            (0..3).for_each(|d| part(3 * k + d, -sight.ray.direction[d] * elapsed_s));
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
    fn two_micrometres_an_hour_towards_the_reflector_are_four_short_after_two_hours() {
        let shape = Shape::new().texts("stations", &["S1", "S2"].map(str::to_owned)).number("start_s", 600.0);
        let effect = construct(&shape, &machine()).unwrap();
        let rate = 2e-6 / 3600.0;
        let read = |station: &str, time_s: f64| {
            let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(time_s) };
            let sight = Sight { station, line: "L", ray: Ray { direction: Vector3::y(), range_m: 1.0 } };
            range_m(effect.as_ref(), &state, &sight, &[rate, rate, rate, 0.0, 0.0, 0.0])
        };
        assert!((read("S1", 7800.0) + 4e-6).abs() < 1e-18);
        assert_eq!((read("S1", 600.0), read("S2", 7800.0), read("S3", 7800.0)), (0.0, 0.0, 0.0));
    }
}
