//! Correlated noise: whitening of ordered rows, and its parameters by restricted maximum likelihood (REML).
//!
//! Place in the flow: numerics only. Rows are anything that was measured one after the other and divided by its declared
//! standard uncertainty: readings of a tracer station, targets of a positioning run. Blocks of ordered rows in, parameters
//! and whitened rows out. Covariance of rows i and j of one block at the places t, for a noise of variance 1:
//!
//! > K = (1 − s − g) δ_ij + s exp(−|t_i − t_j|/ℓ) + g [i and j in one group] + (1/w_i − 1) δ_ij
//!
//! an Ornstein-Uhlenbeck process with the share s of the variance and the length ℓ, an offset common to a group (a line, a
//! cycle) with the share g, white noise with the rest, and robust weights w as further white noise, so that no share gives
//! the rows times √w. Process and offset are the state of a Kalman filter; its innovations over their standard deviations
//! are the whitened rows, K⁻¹ = WᵀW, in a time linear in the rows (Durbin & Koopman 2012, ch. 4; Harvey 1989, 3.4).

mod reml;
#[cfg(test)]
mod tests;

pub use reml::{Fitted, Found, Restricted};

use crate::robust::median;
use faer::Mat;

/// Columns that are whitened side by side.
const BESIDE: usize = 4;

/// How noise is correlated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlation {
    /// Share of the variance that decays with the distance.
    pub share: f64,
    /// Distance at which it has fallen to 1/e, in the unit of the places.
    pub length: f64,
    /// Share of the variance that is common to a group.
    pub group_share: f64,
}

impl Correlation {
    /// Correlation of two rows of one group at this distance.
    pub fn at(&self, distance: f64) -> f64 {
        self.share * (-distance / self.length).exp() + self.group_share
    }
}

/// Rows in the order in which they were measured.
#[derive(Debug, Clone, Default)]
pub struct Sequence {
    places: Vec<Place>,
}

#[derive(Debug, Clone, Copy)]
struct Place {
    row: usize,
    /// Distance to the row before; infinite for the first of a block.
    gap: f64,
    /// First of its group.
    starts_group: bool,
}

impl Sequence {
    /// Blocks of rows in their order; nothing is correlated across blocks. `place` says where a row stands along its block
    /// (its number, or s), in ascending order, `group` which of a block's groups it belongs to.
    pub fn new(blocks: &[Vec<usize>], place: impl Fn(usize) -> f64, group: impl Fn(usize) -> usize) -> Sequence {
        let mut places = Vec::with_capacity(blocks.iter().map(Vec::len).sum());
        for block in blocks {
            let before = |k: usize| k.checked_sub(1).map(|k| block[k]);
            places.extend(block.iter().enumerate().map(|(k, row)| Place {
                row: *row,
                gap: before(k).map_or(f64::INFINITY, |other| (place(*row) - place(other)).max(0.0)),
                starts_group: before(k).is_none_or(|other| group(*row) != group(other)),
            }));
        }
        Sequence { places }
    }

    /// Median distance of neighbours in one block; `None` where no block has two rows.
    pub fn usual_step(&self) -> Option<f64> {
        median(self.places.iter().map(|p| p.gap).filter(|gap| gap.is_finite() && *gap > 0.0).collect())
    }
}

/// What is done to one row.
#[derive(Debug, Clone, Copy)]
struct Step {
    row: usize,
    /// What is left of process and offset since the row before.
    kept: [f64; 2],
    /// Gains of process and offset.
    gain: [f64; 2],
    /// One over the innovation's standard deviation; 0 for a row without weight.
    inverse_deviation: f64,
}

/// W with K⁻¹ = WᵀW, as the steps of a filter.
#[derive(Debug, Clone)]
pub struct Whitener {
    steps: Vec<Step>,
    log_determinant: f64,
}

impl Whitener {
    /// Of these rows with these robust weights (by row, 1 for full).
    pub fn new(sequence: &Sequence, correlation: &Correlation, weights: &[f64]) -> Whitener {
        let Correlation { share, length, group_share } = *correlation;
        let (mut xx, mut xb, mut bb, mut log_determinant) = (0.0, 0.0, 0.0, 0.0);
        let mut step = |place: &Place| {
            let decay = if place.gap.is_finite() { (-place.gap / length).exp() } else { 0.0 };
            let kept = [decay, if place.starts_group { 0.0 } else { 1.0 }];
            (xx, xb, bb) = (decay * decay * xx + share * (1.0 - decay * decay), decay * kept[1] * xb, kept[1] * bb);
            if place.starts_group {
                bb = group_share;
            }
            let weight = weights[place.row];
            if weight <= 0.0 {
                return Step { row: place.row, kept, gain: [0.0; 2], inverse_deviation: 0.0 };
            }
            let (to_x, to_b) = (xx + xb, xb + bb);
            let variance = to_x + to_b + (1.0 / weight - share - group_share);
            let gain = [to_x / variance, to_b / variance];
            (xx, xb, bb) = (xx - gain[0] * to_x, xb - gain[0] * to_b, bb - gain[1] * to_b);
            log_determinant += variance.ln();
            Step { row: place.row, kept, gain, inverse_deviation: variance.sqrt().recip() }
        };
        let steps = sequence.places.iter().map(&mut step).collect();
        Whitener { steps, log_determinant }
    }

    /// Log determinant of K over the rows that have weight.
    pub fn log_determinant(&self) -> f64 {
        self.log_determinant
    }

    /// Whitens one value a row, in place; rows without weight become zero.
    pub fn apply(&self, values: &mut [f64]) {
        let mut state = [0.0; 2];
        for step in &self.steps {
            state = [step.kept[0] * state[0], step.kept[1] * state[1]];
            let innovation = values[step.row] - state[0] - state[1];
            state = [state[0] + step.gain[0] * innovation, state[1] + step.gain[1] * innovation];
            values[step.row] = innovation * step.inverse_deviation;
        }
    }

    /// Whitens several columns, each as [`Whitener::apply`] does, in place: side by side, since a value must wait for the one
    /// before it in its own column but not for those of others.
    pub fn apply_to_columns(&self, columns: &mut Mat<f64>) {
        // Columns of a matrix that owns them lie in one piece.
        let slices = columns.as_mut().col_iter_mut().filter_map(|column| column.try_as_col_major_mut());
        let mut slices: Vec<&mut [f64]> = slices.map(|column| column.as_slice_mut()).collect();
        let has_offsets = self.steps.iter().any(|step| step.gain[1] != 0.0);
        let whole = if has_offsets { 0 } else { slices.len() / BESIDE * BESIDE };
        let (whole, rest) = slices.split_at_mut(whole);
        let (beside, _) = whole.as_chunks_mut::<BESIDE>();
        beside.iter_mut().for_each(|columns| self.apply_beside(columns));
        rest.iter_mut().for_each(|column| self.apply(column));
    }

    /// So many columns at once, where no offset is common to a group.
    fn apply_beside<const COUNT: usize>(&self, columns: &mut [&mut [f64]; COUNT]) {
        let mut state = [0.0; COUNT];
        for step in &self.steps {
            for (state, column) in state.iter_mut().zip(columns.iter_mut()) {
                *state *= step.kept[0];
                let innovation = column[step.row] - *state;
                *state += step.gain[0] * innovation;
                column[step.row] = innovation * step.inverse_deviation;
            }
        }
    }

    /// Wᵀ times one value a row, in place: of whitened residuals it makes K⁻¹ times the residuals.
    pub fn apply_transposed(&self, values: &mut [f64]) {
        let mut state = [0.0; 2];
        for step in self.steps.iter().rev() {
            let value = values[step.row] * step.inverse_deviation + step.gain[0] * state[0] + step.gain[1] * state[1];
            values[step.row] = value;
            state = [step.kept[0] * (state[0] - value), step.kept[1] * (state[1] - value)];
        }
    }

    /// Whitens rows of many columns, which `visit` asks for one by one in the order of measurement and gets back
    /// whitened: `fill(row, values)`, then `take(row, values)`. Rows without weight are left out.
    pub fn stream(&self, columns: usize, mut fill: impl FnMut(usize, &mut [f64]), mut take: impl FnMut(usize, &[f64])) {
        let (mut process, mut offset) = (vec![0.0; columns], vec![0.0; columns]);
        let mut values = vec![0.0; columns];
        for step in &self.steps {
            let ([kept, stays], [gain, to_offset]) = (step.kept, step.gain);
            if step.inverse_deviation > 0.0 {
                fill(step.row, &mut values);
            }
            for ((value, process), offset) in values.iter_mut().zip(&mut process).zip(&mut offset) {
                (*process, *offset) = (kept * *process, stays * *offset);
                let innovation = *value - *process - *offset;
                *process += gain * innovation;
                *offset += to_offset * innovation;
                *value = innovation * step.inverse_deviation;
            }
            if step.inverse_deviation > 0.0 {
                take(step.row, &values);
            }
        }
    }

    /// How many white rows would tell as much of what is common to neighbours: 1ᵀK⁻¹1.
    pub fn effective_rows(&self, rows: usize) -> f64 {
        let mut ones = vec![1.0; rows];
        self.apply(&mut ones);
        self.steps.iter().map(|step| ones[step.row].powi(2)).sum()
    }
}
