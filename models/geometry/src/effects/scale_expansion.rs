//! Thermal expansion of a scale: an axis whose scale is warmer than 20 °C reads short.
//!
//! Formula: e = α·(T − 20 °C)·(r − r₀) along the axis, r the reading and r₀ where the scale is fixed; the second
//! parameter is −α·r₀. Inputs: reading (m), a logged temperature (°C). Reference temperature: ISO 1. Typical α is
//! 8–12 µm/(m·K) for steel and glass scales (Schwenke 2008).

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "scale_expansion",
    title: "thermal expansion of a scale",
    formula: "e = alpha (T - 20 C) (r - r0) along the axis; shift = -alpha r0",
    typical: "8-12 µm/(m K)",
    source: "ISO 1; Schwenke et al. 2008",
    needs: "a temperature of the scale or of what it is fixed to (temp_scale_x_c ...) that changes in the campaign",
    decided_by: "repeat some lines along the axis at another temperature, or measure a calibrated length along it",
    construct,
    propose,
    refine: None,
};
/// ISO 1 reference temperature (°C).
const REFERENCE_C: f64 = 20.0;

#[derive(Debug)]
struct ScaleExpansion {
    axis: Axis,
    sensor: String,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = ScaleExpansion { axis: reader.axis("axis")?, sensor: reader.text("sensor")?.to_owned() };
    reader.finish()?;
    Ok(Box::new(effect))
}

/// Every axis with every temperature: the scale's own sensor may not be the one that follows it best.
fn propose(observed: &Observed) -> Vec<Shape> {
    let shapes = |axis: Axis| {
        let of = move |sensor: &str| Shape::new().text("axis", axis.lower()).text("sensor", sensor);
        observed.named("temp_", "_c").map(of).collect::<Vec<_>>()
    };
    Axis::ALL.into_iter().flat_map(shapes).collect()
}

impl Effect for ScaleExpansion {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![self.sensor.clone()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        vec![ParameterSpec::new("alpha", "1/K", 30e-6), ParameterSpec::new("shift", "m/K", 60e-6)]
    }

    /// Without an expansion it is the tip that moves with a temperature.
    fn essential(&self) -> &'static [usize] {
        &[0]
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let above_reference_k = state.covariate(&self.sensor)? - REFERENCE_C;
        let along = Acts::Error(ErrorId::linear(self.axis, self.axis));
        part(0, along, state.reading_m[self.axis.index()] * above_reference_k);
        part(1, along, above_reference_k);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{One, machine, tip_m};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn a_metre_of_steel_one_and_a_half_kelvin_warm_is_seventeen_micrometres_longer() {
        let shape = Shape::new().text("axis", "x").text("sensor", "temp_scale_x_c");
        let effect = construct(&shape, &machine()).unwrap();
        let state = State { reading_m: [1.0, 1.0, 1.0], offset_m: [0.0; 3], covariates: &One(21.5) };
        let tip_m = tip_m(effect.as_ref(), &state, &[11.5e-6, 0.0]);
        assert!((tip_m - Vector3::new(17.25e-6, 0.0, 0.0)).norm() < 1e-15);
    }
}
