//! Dead path: air between interferometer and centre of rotation that no compensation covers, drifting.
//!
//! Formula: range += length of the station·δn, δn = −0.96e-6·(T − 20 °C) + 0.27e-6·(p − 1013.25 hPa) −
//! 0.009e-6·(h − 50 %), of those that the shape lists (what does not change is part of the station's zero of length).
//! Inputs: `temp_air_c`, `pressure_hpa`, `humidity_pct`. Typical 0.1–2 m, so 0.2–2 µm. Source of δn: Edlén's formula
//! near 20 °C and 633 nm, as revised by Birch and Downs 1994. A station that is not listed has none.

use super::known::{Known, Observed};
use super::refraction::{Air, air, observed_air};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "dead_path",
    title: "drift of the dead path",
    formula: "range += L_station (-0.96e-6/K (T - 20 C) + 0.27e-6/hPa (p - 1013.25 hPa) - 0.009e-6/% (h - 50 %))",
    typical: "0.1-2 m, so 0.2-2 µm",
    source: "Edlen 1966, revised by Birch and Downs 1994; Ciddor 1996",
    needs: "temp_air_c, pressure_hpa or humidity_pct beside the beam, changing while a station is measured",
    decided_by: "return to one near point throughout a station while the air changes",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct DeadPath {
    stations: Vec<String>,
    terms: Vec<&'static Air>,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = DeadPath { stations: reader.texts("stations")?.to_vec(), terms: air(&mut reader)? };
    reader.finish()?;
    Ok(Box::new(effect))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let terms = observed_air(observed);
    if terms.is_empty() || observed.stations.is_empty() {
        return Vec::new();
    }
    vec![Shape::new().texts("stations", observed.stations).texts("terms", &terms)]
}

impl Effect for DeadPath {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn range_covariates(&self) -> Vec<String> {
        self.terms.iter().map(|air| air.name.to_owned()).collect()
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        self.stations.iter().map(|station| ParameterSpec::new(format!("length_{station}"), "m", 10.0)).collect()
    }

    fn range(&self, state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        let mut index = 0.0;
        for air in &self.terms {
            index += air.index_per_unit * (state.covariate(air.name)? - air.standard);
        }
        if let Some(k) = self.stations.iter().position(|station| station == sight.station) {
            part(k, index);
        }
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
    fn a_metre_of_air_a_kelvin_warmer_reads_a_micrometre_short_at_any_range() {
        let stations = ["S1", "S2"].map(str::to_owned);
        let terms = ["temp_air_c", "pressure_hpa", "humidity_pct"].map(str::to_owned);
        let shape = Shape::new().texts("stations", &stations).texts("terms", &terms);
        let effect = construct(&shape, &machine()).unwrap();
        let source = Each(&[("temp_air_c", 21.0), ("pressure_hpa", 1013.25), ("humidity_pct", 50.0)]);
        let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &source };
        let read = |station: &str, range: f64| {
            let ray = Ray { direction: Vector3::y(), range_m: range };
            range_m(effect.as_ref(), &state, &Sight { station, line: "L", ray }, &[1.0, 0.5])
        };
        assert!((read("S1", 0.3) + 0.96e-6).abs() < 1e-18);
        assert_eq!(read("S1", 0.3), read("S1", 3.0));
        assert!((read("S2", 0.3) + 0.48e-6).abs() < 1e-18);
        assert_eq!(read("S3", 0.3), 0.0);
    }
}
