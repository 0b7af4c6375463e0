//! Refraction left in the range: air temperature, pressure or humidity that the instrument compensates wrongly.
//!
//! Formula: range reads longer by range·(per_kelvin·(T − 20 °C) + per_hpa·(p − 1013.25 hPa) + per_percent·(h − 50 %)).
//! Inputs: range (m), those of `temp_air_c`, `pressure_hpa`, `humidity_pct` that the shape lists. Air that is denser
//! slows the light, so a length not compensated at all reads long by −0.96e-6/K, +0.27e-6/hPa and −0.009e-6/%
//! (Edlén's formula near 20 °C and 633 nm, as revised by Birch and Downs 1994); an instrument leaves a part of it.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "refraction",
    title: "uncompensated refraction",
    formula: "range += range (per_kelvin (T - 20 C) + per_hpa (p - 1013.25 hPa) + per_percent (h - 50 %))",
    typical: "up to 1-3 µm/m: -0.96e-6/K, +0.27e-6/hPa, -0.009e-6/%",
    source: "Edlen 1966, revised by Birch and Downs 1994; Ciddor 1996",
    needs: "temp_air_c, pressure_hpa or humidity_pct beside the beam, changing within the campaign",
    decided_by: "repeat short and long ranges of one station in other air, or measure a calibrated length",
    construct,
    propose,
    refine: None,
};

/// A quantity of the air and what it does to the refractive index.
#[derive(Debug)]
pub(super) struct Air {
    /// Covariate.
    pub(super) name: &'static str,
    /// Value in standard air, in the covariate's unit.
    pub(super) standard: f64,
    /// Change of the refractive index per unit of the covariate.
    pub(super) index_per_unit: f64,
    parameter: (&'static str, &'static str, f64),
}

/// The air as Edlén's formula knows it. No instrument leaves more than a few times of what air does.
const AIR: [Air; 3] = [
    Air { name: "temp_air_c", standard: 20.0, index_per_unit: -0.96e-6, parameter: ("per_kelvin", "1/K", 3e-6) },
    Air { name: "pressure_hpa", standard: 1013.25, index_per_unit: 0.27e-6, parameter: ("per_hpa", "1/hPa", 0.8e-6) },
    Air { name: "humidity_pct", standard: 50.0, index_per_unit: -0.009e-6, parameter: ("per_percent", "1/%", 0.03e-6) },
];

/// The quantities that a shape lists as `terms`.
pub(super) fn air(reader: &mut Reader) -> Result<Vec<&'static Air>, EffectError> {
    let find = |name: &String| AIR.iter().find(|air| air.name == name.as_str());
    let found: Option<Vec<&'static Air>> = reader.texts("terms")?.iter().map(find).collect();
    found.ok_or_else(|| reader.wrong("terms", "may list temp_air_c, pressure_hpa and humidity_pct only"))
}

/// The quantities that a campaign logs and that vary: the others are constants that no reading can tell.
pub(super) fn observed_air(observed: &Observed) -> Vec<String> {
    AIR.iter().filter(|air| observed.varies(air.name)).map(|air| air.name.to_owned()).collect()
}

#[derive(Debug)]
struct Refraction {
    terms: Vec<&'static Air>,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = Refraction { terms: air(&mut reader)? };
    reader.finish()?;
    Ok(Box::new(effect))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let terms = observed_air(observed);
    if terms.is_empty() { Vec::new() } else { vec![Shape::new().texts("terms", &terms)] }
}

impl Effect for Refraction {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn has_open_zero(&self) -> bool {
        true
    }

    fn range_covariates(&self) -> Vec<String> {
        self.terms.iter().map(|air| air.name.to_owned()).collect()
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let specs = self.terms.iter().map(|air| air.parameter);
        specs.map(|(name, unit, plausible)| ParameterSpec::new(name, unit, plausible)).collect()
    }

    fn range(&self, state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        for (k, air) in self.terms.iter().enumerate() {
            part(k, sight.ray.range_m * (state.covariate(air.name)? - air.standard));
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
    fn two_metres_in_air_two_kelvin_warm_and_ten_hectopascal_up_read_this_long() {
        let terms = ["temp_air_c", "pressure_hpa"].map(str::to_owned);
        let effect = construct(&Shape::new().texts("terms", &terms), &machine()).unwrap();
        let source = Each(&[("temp_air_c", 22.0), ("pressure_hpa", 1023.25)]);
        let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &source };
        let ray = Ray { direction: Vector3::x(), range_m: 2.0 };
        let sight = Sight { station: "S1", line: "S1-00", ray };
        let read_m = range_m(effect.as_ref(), &state, &sight, &[-0.96e-6, 0.27e-6]);
        assert!((read_m - 2.0 * (-1.92e-6 + 2.7e-6)).abs() < 1e-17, "{read_m}");
        let wrong = Shape::new().texts("terms", &["temp_scale_x_c".to_owned()]);
        assert!(construct(&wrong, &machine()).is_err());
    }
}
