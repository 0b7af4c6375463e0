//! Shuffled columns: what the flexibility of an effect gains where its meaning is gone.
//!
//! Place in the flow: beside every effect found. Columns are exchanged between blocks and, by one permutation that all
//! blocks of equal size share, between the points of a block; the rows of one point stay together. Only blocks that the
//! effect touches take part. So a placebo has as many parameters, values of the same size and the same pattern of
//! repetition as the true columns. Seeded; no clock.

use super::candidate::Study;
use super::diagnosis::Placebo;
use super::fit::Fit;
use super::judge::held_out_rms;
use crate::error::DiagnoseError;
use faer::Mat;
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Compares the columns with shuffled ones on a fit without them.
pub(super) fn placebo(
    study: &dyn Study,
    without: &Fit,
    columns: &Mat<f64>,
    draws: usize,
    seed: u64,
) -> Result<Placebo, DiagnoseError> {
    let before = held_out_rms(study, &without.linear);
    let gain = |columns: &Mat<f64>| -> Result<f64, DiagnoseError> {
        Ok(before.rms_um - held_out_rms(study, &without.with_columns(columns.as_ref())?).rms_um)
    };
    let own = gain(columns)?;
    let touched = touched(study, columns);
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut gains = Vec::with_capacity(draws);
    for _ in 0..draws {
        let from = shuffle(study, &touched, &mut generator);
        let shuffled = Mat::from_fn(columns.nrows(), columns.ncols(), |i, j| columns[(from[i], j)]);
        gains.push(gain(&shuffled)?);
    }
    gains.sort_by(f64::total_cmp);
    let as_good = gains.iter().filter(|value| **value >= own * (1.0 - 1e-9)).count();
    let at = |share: f64| gains.get(((gains.len() as f64 - 1.0) * share).round() as usize).copied().unwrap_or(own);
    Ok(Placebo {
        draws,
        median_gain_um: at(0.5),
        gain_95_um: at(0.95),
        share_as_good: (1 + as_good) as f64 / (1 + draws) as f64,
    })
}

/// Blocks in which the columns are anything but zero.
fn touched(study: &dyn Study, columns: &Mat<f64>) -> Vec<usize> {
    let touches = |rows: &[usize]| rows.iter().any(|row| (0..columns.ncols()).any(|j| columns[(*row, j)] != 0.0));
    (0..study.blocks().len()).filter(|k| touches(&study.blocks()[*k])).collect()
}

/// For each row the row whose columns it takes.
fn shuffle(study: &dyn Study, touched: &[usize], generator: &mut ChaCha8Rng) -> Vec<usize> {
    let (blocks, per_point) = (study.blocks(), study.rows_per_point());
    let mut from: Vec<usize> = (0..blocks.iter().map(Vec::len).sum()).collect();
    let longest = touched.iter().map(|k| blocks[*k].len() / per_point).max().unwrap_or(0);
    let keys: Vec<u64> = (0..longest).map(|_| generator.random()).collect();
    let mut partner = touched.to_vec();
    partner.shuffle(generator);
    for (own, other) in touched.iter().zip(&partner) {
        let (own, other) = (&blocks[*own], &blocks[*other]);
        let mut order: Vec<usize> = (0..other.len() / per_point).collect();
        order.sort_by_key(|k| keys[*k]);
        if order.is_empty() {
            continue;
        }
        for (k, row) in own.iter().enumerate() {
            from[*row] = other[order[(k / per_point) % order.len()] * per_point + k % per_point];
        }
    }
    from
}
