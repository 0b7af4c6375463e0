//! Load on the table: a heavy part bends it, more where tip or reflector is far from its supports.
//!
//! Formula: tip along z = load·Σ c_ij P_i(u)·P_j(v), i and j from 0 to 2, u and v the readings of x and y, each
//! −1 … 1 over its stroke, P Legendre polynomials: mean, tilts, twist and dish of the compliance. A half-wave each
//! way (sin πu · sin πv) is met to 4 %. Form `dish` is (1 − u²)(1 − v²)·(depth + waist·(P_2(u) + P_2(v)) + lean_x·u +
//! lean_y·v), zero on the edges that it rests on; form `free` is the sum. Inputs: `load_kg`, readings (m). Typical compliance 0.05–0.5 µm/kg.
//! The frame is that of the table: where it sinks, the tip is higher above it than the scales say.

use super::empirical::legendre;
use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State, Values};
use crate::axis::Axis;
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "table_load",
    title: "table bending under load",
    formula: "tip along z = load sum c_ij P_i(u) P_j(v), i and j from 0 to 2, u and v along x and y",
    typical: "0.05-0.5 µm/kg",
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

/// What is assumed of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    /// It rests on its edges and gives way between them: what sinks as a whole is known from the shape, even where the
    /// load changes only from station to station and the stations' heights would take it.
    Dish,
    /// Nothing: any surface of low order.
    Free,
}

#[derive(Debug)]
struct TableLoad {
    form: Form,
    stroke_m: [(f64, f64); 3],
}

fn construct(shape: &Shape, machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let form = match reader.text("form")? {
        "dish" => Form::Dish,
        "free" => Form::Free,
        _ => return Err(reader.wrong("form", "must be dish or free")),
    };
    reader.finish()?;
    Ok(Box::new(TableLoad { form, stroke_m: machine.stroke_m }))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let forms = ["dish", "free"].map(|form| Shape::new().text("form", form)).to_vec();
    if observed.varies(LOAD) { forms } else { Vec::new() }
}

impl TableLoad {
    fn orders(&self, axis: Axis, state: &State) -> Values {
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
        let names = match self.form {
            Form::Dish => ["depth", "waist", "lean_x", "lean_y"].map(str::to_owned).to_vec(),
            Form::Free => {
                let orders = (0..=ORDER).flat_map(|i| (0..=ORDER).map(move |j| (i, j)));
                orders.map(|(i, j)| format!("c_{i}_{j}")).collect()
            }
        };
        names.into_iter().map(|name| ParameterSpec::new(name, "m/kg", 5e-6)).collect()
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let load_kg = state.covariate(LOAD)?;
        let (u, v) = (self.orders(Axis::X, state), self.orders(Axis::Y, state));
        let products: Values = match self.form {
            Form::Dish => {
                let inside = (1.0 - u[1] * u[1]) * (1.0 - v[1] * v[1]);
                Values::from_slice(&[1.0, u[2] + v[2], u[1], v[1]].map(|factor| inside * factor))
            }
            Form::Free => u.iter().flat_map(|along_x| v.iter().map(move |along_y| along_x * along_y)).collect(),
        };
        products.iter().enumerate().for_each(|(k, product)| part(k, Acts::Tip(Axis::Z), load_kg * product));
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
        let (even, dish) = (2.0 / PI, 10.0 / PI * (1.0 - 12.0 / (PI * PI)));
        let compliance = [even * even, 0.0, even * dish, 0.0, 0.0, 0.0, dish * even, 0.0, dish * dish];
        let free = compliance.map(|c| 0.1e-6 * c);
        // cos(πu/2)/(1 − u²) is 1 − 0.2157·u² in the least squares of the dish; u² = (1 + 2 P2)/3.
        let (whole, bend) = (1.0 - 2.0 * 0.2157 / 3.0, -0.2157 * 2.0 / 3.0);
        let dish = [whole, bend, 0.0, 0.0].map(|c| 0.1e-6 * c);
        assert!(missed_share("free", &free) < 0.04, "{}", missed_share("free", &free));
        assert!(missed_share("dish", &dish) < 0.04, "{}", missed_share("dish", &dish));
    }

    /// Share of a half-wave dish of 10 µm under 100 kg that is missed.
    fn missed_share(form: &str, parameters: &[f64]) -> f64 {
        let effect = construct(&Shape::new().text("form", form), &machine()).unwrap();
        let (mut missed, mut whole) = (0.0, 0.0);
        for (i, j) in (0..=40).flat_map(|i| (0..=40).map(move |j| (f64::from(i) / 40.0, f64::from(j) / 40.0))) {
            let state = State { reading_m: [0.8 * i, 0.6 * j, 0.1], offset_m: [0.0; 3], covariates: &One(100.0) };
            let expected_m = 10e-6 * (PI * i).sin() * (PI * j).sin();
            missed += (tip_m(effect.as_ref(), &state, parameters).z - expected_m).powi(2);
            whole += expected_m.powi(2);
        }
        (missed / whole).sqrt()
    }
}
