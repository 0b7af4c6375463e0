//! Load on the table: a heavy part bends it, more where tip or reflector is far from its supports.
//!
//! Formula: tip along z = load·Σ c_ij P_i(u)·P_j(v), i and j from 0 to 2, u and v the readings of x and y, each
//! −1 … 1 over its stroke, P Legendre polynomials: mean, tilts, twist and dish of the compliance. A half-wave each
//! way (sin πu · sin πv) is met to 4 %. Inputs: `load_kg`, readings (m). Typical compliance 0.05–0.5 µm/kg.
//! The frame is that of the table: where it sinks, the tip is higher above it than the scales say.

use super::empirical::legendre;
use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State};
use crate::axis::Axis;
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "table_load",
    title: "table bending under load",
    formula: "tip along z = load sum c_ij P_i(u) P_j(v), i and j from 0 to 2, u and v along x and y",
    typical: "0.05-0.5 um/kg",
    source: "bending of a supported plate; Schwenke et al. 2008 (load-induced errors)",
    needs: "the load (load_kg), at two loads or more",
    decided_by: "repeat some lines over the table, with a vertical part of the sight, at another load",
    construct,
    propose,
    refine: None,
};
const LOAD: &str = "load_kg";
/// Highest order along each of x and y.
const ORDER: usize = 2;

#[derive(Debug)]
struct TableLoad {
    stroke_m: [(f64, f64); 3],
}

fn construct(shape: &Shape, machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    Reader::new(KNOWN.name, shape).finish()?;
    Ok(Box::new(TableLoad { stroke_m: machine.stroke_m }))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    if observed.varies(LOAD) { vec![Shape::new()] } else { Vec::new() }
}

impl TableLoad {
    fn orders(&self, axis: Axis, state: &State) -> Vec<f64> {
        let (lower_m, upper_m) = self.stroke_m[axis.index()];
        legendre((2.0 * state.reading_m[axis.index()] - lower_m - upper_m) / (upper_m - lower_m), ORDER)
    }
}

impl Effect for TableLoad {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![LOAD.to_owned()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let orders = (0..=ORDER).flat_map(|i| (0..=ORDER).map(move |j| (i, j)));
        orders.map(|(i, j)| ParameterSpec::new(format!("c_{i}_{j}"), "m/kg", 5e-6)).collect()
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let load_kg = state.covariate(LOAD)?;
        let (u, v) = (self.orders(Axis::X, state), self.orders(Axis::Y, state));
        let products = u.iter().flat_map(|along_x| v.iter().map(move |along_y| along_x * along_y));
        products.enumerate().for_each(|(k, product)| part(k, Acts::Tip(Axis::Z), load_kg * product));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{One, machine, tip_m};
    use super::*;
    use std::f64::consts::PI;

    /// Legendre coefficients of sin πu on 0 … 1: 2/π and 10/π·(1 − 12/π²); the rest is what order 2 cannot say.
    #[test]
    fn a_half_wave_dish_of_a_hundred_kilograms_is_met_to_four_per_cent() {
        let effect = construct(&Shape::new(), &machine()).unwrap();
        let (even, dish) = (2.0 / PI, 10.0 / PI * (1.0 - 12.0 / (PI * PI)));
        let compliance = [even * even, 0.0, even * dish, 0.0, 0.0, 0.0, dish * even, 0.0, dish * dish];
        let parameters = compliance.map(|c| 0.1e-6 * c);
        let (mut missed, mut whole) = (0.0, 0.0);
        for (i, j) in (0..=40).flat_map(|i| (0..=40).map(move |j| (f64::from(i) / 40.0, f64::from(j) / 40.0))) {
            let state = State { reading_m: [0.8 * i, 0.6 * j, 0.1], offset_m: [0.0; 3], covariates: &One(100.0) };
            let expected_m = 10e-6 * (PI * i).sin() * (PI * j).sin();
            missed += (tip_m(effect.as_ref(), &state, &parameters).z - expected_m).powi(2);
            whole += expected_m.powi(2);
        }
        assert!((missed / whole).sqrt() < 0.04, "{}", (missed / whole).sqrt());
    }
}
