//! Equal steps that a person can enter: whole multiples of a unit.
//!
//! Place in the flow: under formats whose points lie at first + k·step. Values at the nodes of an axis, which divide its stroke evenly, in;
//! values at such points out, linear between the nodes. The step is rounded up, so that the points cover the stroke; the last then lies beyond
//! its end, on the line of the last two nodes.

use abbe_geometry::sampled::SampledAxis;

/// Steps (in units) that are whole but for rounding.
const ROUNDING: f64 = 1e-6;

/// Points of an axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Points {
    /// Step, in units.
    pub(super) units: f64,
    /// Values at the points.
    pub(super) values: Vec<f64>,
    /// Places of the points (m).
    pub(super) positions_m: Vec<f64>,
}

impl Points {
    /// As many as the axis has nodes, in steps of a multiple of a unit of which a metre holds so many.
    pub(super) fn of(axis: &SampledAxis, values: &[f64], per_metre: f64) -> Points {
        let nodes_m = &axis.positions_m;
        let cells = nodes_m.len() - 1;
        let node_m = (nodes_m[cells] - nodes_m[0]) / cells as f64;
        let units = (node_m * per_metre - ROUNDING).ceil().max(1.0);
        let step_m = units / per_metre;
        let value = |k: usize| {
            let at = step_m * k as f64 / node_m;
            let cell = (at.floor() as usize).min(cells - 1);
            values[cell] + (values[cell + 1] - values[cell]) * (at - cell as f64)
        };
        Points {
            units,
            values: (0..=cells).map(value).collect(),
            positions_m: (0..=cells).map(|k| nodes_m[0] + step_m * k as f64).collect(),
        }
    }
}

/// A length (m) in millimetres with at most so many decimals, one at least.
pub(super) fn millimetres(length_m: f64, decimals: usize) -> String {
    let text = super::fixed(length_m * 1e3, decimals.max(1));
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
