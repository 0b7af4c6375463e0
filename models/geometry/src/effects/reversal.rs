//! Reversal (backlash): the tip lags behind the reading by half the reversal value, against the approach.
//!
//! Place in the flow: one entry of the effect registry; inputs are the logged signs of approach (−1, 0, +1),
//! output the tip's motion in the machine frame (m). Parameter: reversal value B as in ISO 230-2, positive when
//! the mean position from above lies higher than from below. Typical 0.1-2 µm.

use super::{CovariateProblem, Effect, EffectError, ParameterSpec, Shape, State, without_shape};
use nalgebra::Vector3;

/// Name in model files.
pub(super) const NAME: &str = "reversal";
const COVARIATES: [&str; 3] = ["dir_x", "dir_y", "dir_z"];

#[derive(Debug)]
struct Reversal;

pub(super) fn construct(shape: &Shape) -> Result<Box<dyn Effect>, EffectError> {
    without_shape(NAME, shape)?;
    Ok(Box::new(Reversal))
}

impl Effect for Reversal {
    fn name(&self) -> &'static str {
        NAME
    }

    fn covariates(&self) -> Vec<String> {
        COVARIATES.map(str::to_owned).to_vec()
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let spec = |axis| ParameterSpec { name: format!("b_{axis}"), unit: "m", plausible: 50e-6 };
        ["x", "y", "z"].map(spec).to_vec()
    }

    fn tip_columns(&self, state: &State) -> Result<Vec<Vector3<f64>>, CovariateProblem> {
        let column = |k: usize| Ok(Vector3::ith(k, -0.5 * state.covariate(COVARIATES[k])?));
        (0..3).map(column).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{CovariateSource, CovariateValue};

    struct Approach(f64);
    impl CovariateSource for Approach {
        fn covariate(&self, _name: &str) -> CovariateValue {
            CovariateValue::Fresh(self.0)
        }
    }

    #[test]
    fn two_approaches_differ_by_the_reversal_value() {
        let at = |sign: f64| {
            let source = Approach(sign);
            let state = State { reading_m: [0.5; 3], offset_m: [0.0; 3], covariates: &source };
            Reversal.tip_columns(&state).unwrap()[1] * 1.2e-6
        };
        assert!((at(-1.0) - at(1.0) - Vector3::new(0.0, 1.2e-6, 0.0)).norm() < 1e-18);
        assert_eq!(at(0.0), Vector3::zeros());
    }
}
