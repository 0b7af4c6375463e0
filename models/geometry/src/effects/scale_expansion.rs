//! Thermal expansion of the scales: an axis at temperature T reads short by x·α·(T − 20 °C).
//!
//! Place in the flow: one entry of the effect registry; inputs are the axis readings (m) and the logged scale
//! temperatures (°C), output the tip's motion in the machine frame (m). Reference temperature: ISO 1. Typical α
//! is 8-12 µm/(m·K) for steel and glass scales.

use super::{CovariateProblem, Effect, EffectError, ParameterSpec, Shape, State, without_shape};
use nalgebra::Vector3;

/// Name in model files.
pub(super) const NAME: &str = "scale_expansion";
/// ISO 1 reference temperature (°C).
const REFERENCE_C: f64 = 20.0;
const COVARIATES: [&str; 3] = ["temp_scale_x_c", "temp_scale_y_c", "temp_scale_z_c"];

#[derive(Debug)]
struct ScaleExpansion;

pub(super) fn construct(shape: &Shape) -> Result<Box<dyn Effect>, EffectError> {
    without_shape(NAME, shape)?;
    Ok(Box::new(ScaleExpansion))
}

impl Effect for ScaleExpansion {
    fn name(&self) -> &'static str {
        NAME
    }

    fn covariates(&self) -> Vec<String> {
        COVARIATES.map(str::to_owned).to_vec()
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let spec = |axis| ParameterSpec { name: format!("alpha_{axis}"), unit: "1/K", plausible: 30e-6 };
        ["x", "y", "z"].map(spec).to_vec()
    }

    fn tip_columns(&self, state: &State) -> Result<Vec<Vector3<f64>>, CovariateProblem> {
        let column = |k: usize| {
            let above_reference_k = state.covariate(COVARIATES[k])? - REFERENCE_C;
            Ok(Vector3::ith(k, state.reading_m[k] * above_reference_k))
        };
        (0..3).map(column).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{CovariateSource, CovariateValue};

    struct Warm;
    impl CovariateSource for Warm {
        fn covariate(&self, name: &str) -> CovariateValue {
            CovariateValue::Fresh(if name == "temp_scale_x_c" { 21.5 } else { 20.0 })
        }
    }

    #[test]
    fn a_metre_of_steel_one_and_a_half_kelvin_warm_is_seventeen_micrometres_longer() {
        let state = State { reading_m: [1.0, 1.0, 1.0], offset_m: [0.0; 3], covariates: &Warm };
        let columns = ScaleExpansion.tip_columns(&state).unwrap();
        let tip_m: Vector3<f64> = columns.iter().map(|c| c * 11.5e-6).sum();
        assert!((tip_m - Vector3::new(17.25e-6, 0.0, 0.0)).norm() < 1e-15);
    }
}
