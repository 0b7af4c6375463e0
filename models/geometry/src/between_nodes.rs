//! What straight lines between nodes miss, as part of a model's uncertainty.
//!
//! Place in the flow: made from node values by [`crate::model::MachineModel`], which adds it to every corrected coordinate,
//! error and predicted length, and by identification, which adds what it does to the fitted parameters. Between two nodes a
//! function departs from its chord; each interval has one unknown, the departure midway (m or rad), of expectation zero. It
//! acts as 4t(1 − t) to the power of q, t from node to node: with q = 1 the interpolation error of a function of constant curvature.
//!
//! Its size is told by the nodes themselves: the departure of a node from the chord of its neighbours is that of chords
//! twice as long, d₂; from the chord of the next but one, that of chords four times as long, d₄. Departures grow with
//! length as d ~ hᵖ, p = 2 for a smooth function (Taylor), 0 for one that the nodes do not resolve, so that those of single
//! intervals are d₁ = d₂·2⁻ᵖ with p = log₂(d₄/d₂) (Richardson's extrapolation with the observed order). d₂ is the root mean
//! square over an error function; p comes from all functions of the same unit, noise of the node values taken off. How fast a function leaves its
//! node is told by the same p: as tᵖ, so that q = p below 1 (½, the bridge of a random walk, for errors that add up from line to line of a
//! scale; Mandelbrot and van Ness 1968), and 1 above.

use crate::axis::ErrorId;
use crate::error_function::{Basis, FunctionKind};
use crate::layout::Layout;

/// Where p cannot be observed, because there are fewer than five nodes or because departures are lost in noise: midway
/// between smooth and not resolved.
const UNOBSERVED_ORDER: f64 = 1.0;
/// Least power of the shape between nodes: the node itself is known, whatever lies beside it.
const LEAST_POWER: f64 = 0.25;

/// The departures midway between nodes, one for each interval of each error function that is made of nodes.
#[derive(Debug, Clone, Default)]
pub struct BetweenNodes {
    /// By [`ErrorId::index`].
    functions: Vec<Option<Function>>,
    variances: Vec<f64>,
}

/// The departures of one error function.
#[derive(Debug, Clone)]
struct Function {
    /// Index of the first interval.
    first: usize,
    basis: Basis,
    /// Power of the parabola that each is shaped as.
    power: f64,
}

impl BetweenNodes {
    /// Of the geometric coefficients of a model, whose covariance is `covariance(row, column)`.
    pub fn new(layout: &Layout, coefficients: &[f64], covariance: impl Fn(usize, usize) -> f64) -> BetweenNodes {
        let sampled: Vec<Option<Nodes>> = ErrorId::all().map(|id| Nodes::of(layout, id, coefficients)).collect();
        let order = |angular: bool| {
            let same = ErrorId::all().zip(&sampled).filter(|(id, _)| id.is_angular() == angular);
            observed_order(same.filter_map(|(_, nodes)| nodes.as_ref()), &covariance)
        };
        let orders = [order(false), order(true)];
        let mut all = BetweenNodes::default();
        for (id, nodes) in ErrorId::all().zip(sampled) {
            let order = orders[usize::from(id.is_angular())];
            all.functions.push(nodes.map(|nodes| {
                let first = all.variances.len();
                let shrink = 4.0_f64.powf(-order);
                let variance = mean(nodes.departures(1).map(|(d, _)| d * d)).unwrap_or(0.0) * shrink;
                all.variances.extend(std::iter::repeat_n(variance, nodes.values.len() - 1));
                Function { first, basis: nodes.basis, power: order.clamp(LEAST_POWER, 1.0) }
            }));
        }
        all
    }

    /// Index of the departure that acts on an error at an axis position (m), and its shape there, 0 … 1.
    pub fn at(&self, id: ErrorId, position_m: f64) -> Option<(usize, f64)> {
        let Function { first, basis, power } = self.functions[id.index()].as_ref()?;
        basis.between_nodes(position_m).map(|(interval, parabola)| (first + interval, parabola.powf(*power)))
    }

    /// Variance of a departure (m² or rad²).
    pub fn variance(&self, index: usize) -> f64 {
        self.variances[index]
    }

    /// Number of departures.
    pub fn len(&self) -> usize {
        self.variances.len()
    }

    /// True for a model without nodes.
    pub fn is_empty(&self) -> bool {
        self.variances.is_empty()
    }
}

/// An error function at its nodes.
struct Nodes {
    basis: Basis,
    values: Vec<f64>,
    /// Coefficient that each value is, `None` where it is held at zero.
    coefficients: Vec<Option<usize>>,
}

impl Nodes {
    fn of(layout: &Layout, id: ErrorId, coefficients: &[f64]) -> Option<Nodes> {
        let basis = *layout.basis(id)?;
        let FunctionKind::Nodes { count } = basis.kind() else { return None };
        let own = layout.range(id);
        let indices: Vec<Option<usize>> =
            (0..count).map(|node| node.checked_sub(1).map(|k| own.start + k).filter(|k| own.contains(k))).collect();
        let values = indices.iter().map(|index| index.map_or(0.0, |k| coefficients[k])).collect();
        Some(Nodes { basis, values, coefficients: indices })
    }

    /// Departure of each node from the chord of the nodes `reach` away, and what it is made of.
    fn departures(&self, reach: usize) -> impl Iterator<Item = (f64, [(Option<usize>, f64); 3])> + Clone {
        (reach..self.values.len().saturating_sub(reach)).map(move |k| {
            let parts = [(k - reach, -0.5), (k, 1.0), (k + reach, -0.5)];
            let departure = parts.iter().map(|(node, factor)| factor * self.values[*node]).sum();
            (departure, parts.map(|(node, factor)| (self.coefficients[node], factor)))
        })
    }

    /// Mean square of these departures, and what the uncertainty of the node values adds to it.
    fn square(&self, reach: usize, covariance: &impl Fn(usize, usize) -> f64) -> Option<(f64, f64)> {
        let noise = |parts: [(Option<usize>, f64); 3]| {
            let known = parts.into_iter().filter_map(|(index, factor)| index.map(|index| (index, factor)));
            let row = |(a, x): (usize, f64)| known.clone().map(|(b, y)| x * y * covariance(a, b)).sum::<f64>();
            known.clone().map(row).sum()
        };
        let departures = self.departures(reach);
        Some((mean(departures.clone().map(|(d, _)| d * d))?, mean(departures.map(|(_, parts)| noise(parts)))?))
    }
}

/// p of d ~ hᵖ, from functions of one unit.
fn observed_order<'a>(functions: impl Iterator<Item = &'a Nodes>, covariance: &impl Fn(usize, usize) -> f64) -> f64 {
    let squares = functions.filter_map(|nodes| Some((nodes.square(1, covariance)?, nodes.square(2, covariance)?)));
    let (mut short, mut short_noise, mut long) = (0.0, 0.0, 0.0);
    for ((square, noise), (square_of_long, noise_of_long)) in squares {
        short += square - noise;
        short_noise += noise;
        long += square_of_long - noise_of_long;
    }
    if short > short_noise { (0.5 * (long / short).max(1.0).log2()).min(2.0) } else { UNOBSERVED_ORDER }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;
    use crate::machine::{Joint, Machine, Side, Squareness, USUAL_RAM_TURN_RAD};
    use crate::rotation::RotationForm;

    const COUNT: usize = 9;

    /// Departures of EXX with these values at its nodes, the first of which is zero.
    fn of_exx(value: impl Fn(f64) -> f64, count: usize, variance: f64) -> (Layout, BetweenNodes) {
        let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
        let mut kinds = [None; ErrorId::COUNT];
        kinds[0] = Some(FunctionKind::Nodes { count });
        let machine = Machine {
            name: "one error".to_owned(),
            frame_id: "machine".to_owned(),
            joints: Axis::ALL.map(|axis| Joint { axis, side: Side::Tool }),
            stroke_m: [(-0.2, 0.6); 3],
            squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
            rotation: RotationForm::Exact,
            kinds,
            repeatability_m: [0.0; 3],
            u_ram_turn_rad: [USUAL_RAM_TURN_RAD; 3],
            default_offset_m: None,
        };
        let layout = Layout::new(&machine, [0.0; 3]).unwrap();
        let nodes = (1..count).map(|k| value(k as f64 / (count - 1) as f64));
        let coefficients: Vec<f64> = nodes.chain([0.0; 6]).collect();
        let between = BetweenNodes::new(&layout, &coefficients, |a, b| if a == b { variance } else { 0.0 });
        (layout, between)
    }

    fn midway(between: &BetweenNodes) -> f64 {
        between.variance(0).sqrt()
    }

    #[test]
    fn a_parabola_departs_from_its_chords_by_a_quarter_of_its_step_squared() {
        let (_, between) = of_exx(|t| 8e-6 * t * t, COUNT, 0.0);
        assert_eq!(between.len(), COUNT - 1);
        // a·h²/4 with h = 1/8.
        assert!((midway(&between) - 8e-6 / 256.0).abs() < 1e-20, "{}", midway(&between));
        let exx = ErrorId::all().next().unwrap();
        assert_eq!(between.at(exx, -0.2), Some((0, 0.0)));
        let (interval, shape) = between.at(exx, 0.25).unwrap();
        assert!(interval == 4 && (shape - 1.0).abs() < 1e-12, "{interval} {shape}");
        // Beyond the stroke the model says that it extrapolates.
        assert_eq!(between.at(exx, 0.61), None);
        assert_eq!(between.at(ErrorId::all().nth(1).unwrap(), 0.25), None);
    }

    #[test]
    fn what_the_nodes_do_not_resolve_departs_between_them_as_much_as_at_them() {
        // Up and down from node to node: a node is 2 µm off the chord of its neighbours, 0 off that of the next but one.
        let (_, between) = of_exx(|t| if (t * 8.0).round() % 2.0 == 1.0 { 2e-6 } else { 0.0 }, COUNT, 0.0);
        assert!((midway(&between) - 2e-6).abs() < 1e-18, "{}", midway(&between));
    }

    #[test]
    fn a_rough_function_leaves_its_nodes_faster_than_a_smooth_one() {
        let exx = ErrorId::all().next().unwrap();
        // A tenth of an interval behind the first node.
        let beside = |between: &BetweenNodes| between.at(exx, -0.2 + 0.01).map(|(_, shape)| shape).unwrap();
        let (_, smooth) = of_exx(|t| 8e-6 * t * t, COUNT, 0.0);
        assert!((beside(&smooth) - 0.36).abs() < 1e-12, "{}", beside(&smooth));
        // A walk of equal steps, one up and the next down or up by turns: departures of chords twice as long are √2 times as large.
        let walk = [0.0, 1.0, 0.0, 1.0, 2.0, 1.0, 2.0, 3.0, 2.0, 1.0, 2.0, 3.0, 4.0, 3.0, 4.0, 5.0, 4.0];
        let (_, rough) = of_exx(|t| 1e-6 * walk[(t * 16.0).round() as usize], 17, 0.0);
        let power = rough.at(exx, -0.2 + 0.005).unwrap().1.ln() / 0.36_f64.ln();
        assert!((0.25..0.8).contains(&power), "{power}");
        assert_eq!(rough.at(exx, -0.2), Some((0, 0.0)));
    }

    #[test]
    fn noise_of_the_nodes_is_no_curvature_and_few_nodes_show_no_order() {
        let parabola = |t: f64| 8e-6 * t * t;
        // Departures of 0.125 µm at the nodes, 0.2 µm of noise: the order is not seen, and 0.125/2 is taken.
        let (_, noisy) = of_exx(parabola, COUNT, 0.2e-6_f64.powi(2));
        assert!((midway(&noisy) - 0.0625e-6).abs() < 1e-18, "{}", midway(&noisy));
        let (_, few) = of_exx(parabola, 4, 0.0);
        assert!((midway(&few) - 0.5 * 8e-6 / 9.0).abs() < 1e-18, "{}", midway(&few));
        let (_, two) = of_exx(parabola, 2, 0.0);
        assert_eq!(midway(&two), 0.0);
    }
}
