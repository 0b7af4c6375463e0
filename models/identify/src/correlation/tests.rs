//! The filter against a dense Cholesky factor; parameters against processes of known correlation.

use super::*;
use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{Mat, Side};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const CORRELATION: Correlation = Correlation { share: 0.5, length: 2.5, group_share: 0.2 };

/// Block, group and place of a row.
type Place = (usize, usize, f64);

/// Two blocks of 9 and 14 rows that are not in the order of the rows, each of two groups, at uneven places.
fn sequence() -> (Sequence, Vec<Option<Place>>) {
    let blocks: Vec<Vec<usize>> =
        vec![(0..9).map(|k| 2 * k).collect(), (0..14).map(|k| 24 - k).filter(|k| k % 2 == 1 || *k > 17).collect()];
    let mut known = vec![None; 26];
    for (block, rows) in blocks.iter().enumerate() {
        let mut at = 3.0;
        for (k, row) in rows.iter().enumerate() {
            at += 0.3 + 1.7 * (1.3 * k as f64).sin().abs();
            known[*row] = Some((block, usize::from(k >= 5), at));
        }
    }
    let of = known.clone();
    let sequence = Sequence::new(&blocks, |row| of[row].map_or(0.0, |k| k.2), |row| of[row].map_or(0, |k| k.1));
    (sequence, known)
}

fn weights() -> Vec<f64> {
    (0..26).map(|k| [1.0, 1.0, 0.3, 1.0, 0.0, 0.8][k % 6]).collect()
}

/// Rows with weight, and K over them.
fn dense() -> (Vec<usize>, Mat<f64>) {
    let (_, known) = sequence();
    let weights = weights();
    let rows: Vec<usize> = (0..26).filter(|k| known[*k].is_some() && weights[*k] > 0.0).collect();
    let entry = |i: usize, j: usize| {
        let ((Some(a), Some(b)), Correlation { share, length, group_share }) =
            ((known[rows[i]], known[rows[j]]), CORRELATION)
        else {
            return 0.0;
        };
        let process = if a.0 == b.0 { share * (-(a.2 - b.2).abs() / length).exp() } else { 0.0 };
        let offset = if (a.0, a.1) == (b.0, b.1) { group_share } else { 0.0 };
        let white = if i == j { 1.0 - share - group_share + 1.0 / weights[rows[i]] - 1.0 } else { 0.0 };
        process + offset + white
    };
    let matrix = Mat::from_fn(rows.len(), rows.len(), entry);
    (rows, matrix)
}

fn wave(k: usize, a: f64) -> f64 {
    (a * k as f64 + 0.2).sin()
}

#[test]
fn whitened_rows_give_the_inverse_and_the_determinant_of_the_dense_covariance() {
    let (rows, matrix) = dense();
    let factor = Llt::new(matrix.as_ref(), Side::Lower).unwrap();
    let whitener = Whitener::new(&sequence().0, &CORRELATION, &weights());
    let log_determinant: f64 = (0..rows.len()).map(|k| 2.0 * factor.L()[(k, k)].ln()).sum();
    assert!(
        (whitener.log_determinant() - log_determinant).abs() < 1e-10,
        "{} {log_determinant}",
        whitener.log_determinant()
    );
    let columns: Vec<Vec<f64>> = [0.3, 0.9, 2.2].iter().map(|a| (0..26).map(|k| wave(k, *a)).collect()).collect();
    let whitened: Vec<Vec<f64>> = columns
        .iter()
        .map(|column| {
            let mut values = column.clone();
            whitener.apply(&mut values);
            values
        })
        .collect();
    let dense = |column: &[f64]| Mat::from_fn(rows.len(), 1, |k, _| column[rows[k]]);
    let in_sequence = |k: usize| sequence().1[k].is_some();
    for (a, wa) in columns.iter().zip(&whitened) {
        for (b, wb) in columns.iter().zip(&whitened) {
            let expected = (dense(a).transpose() * factor.solve(dense(b)))[(0, 0)];
            let found: f64 = (0..26).filter(|k| in_sequence(*k)).map(|k| wa[k] * wb[k]).sum();
            assert!((found - expected).abs() < 1e-10, "{found} {expected}");
        }
        let mut back = wa.clone();
        whitener.apply_transposed(&mut back);
        let solved = factor.solve(dense(a));
        assert!(rows.iter().enumerate().all(|(k, row)| (back[*row] - solved[(k, 0)]).abs() < 1e-10));
    }
    let mut streamed = vec![vec![0.0; 26]; 3];
    let fill =
        |row: usize, values: &mut [f64]| values.iter_mut().zip(&columns).for_each(|(v, column)| *v = column[row]);
    whitener.stream(3, fill, |row, values| streamed.iter_mut().zip(values).for_each(|(column, v)| column[row] = *v));
    for (a, b) in streamed.iter().zip(&whitened) {
        assert!(rows.iter().all(|k| (a[*k] - b[*k]).abs() < 1e-12));
        assert!((0..26).filter(|k| in_sequence(*k) && !rows.contains(k)).all(|k| a[k] == 0.0 && b[k] == 0.0));
    }
}

/// Seven columns: some go side by side, the rest alone; with an offset of groups all do.
#[test]
fn columns_side_by_side_are_whitened_as_each_alone() {
    for group_share in [0.0, 0.2] {
        let whitener = Whitener::new(&sequence().0, &Correlation { group_share, ..CORRELATION }, &weights());
        let mut columns = Mat::from_fn(26, 7, |k, j| wave(k, 0.3 + 0.4 * j as f64));
        let before = columns.clone();
        whitener.apply_to_columns(&mut columns);
        for j in 0..7 {
            let mut alone = before.col_as_slice(j).to_vec();
            whitener.apply(&mut alone);
            assert_eq!(columns.col_as_slice(j), alone, "{group_share} {j}");
        }
    }
}

#[test]
fn without_correlation_rows_are_multiplied_by_the_roots_of_their_weights() {
    let white = Correlation { share: 0.0, length: 1.0, group_share: 0.0 };
    let whitener = Whitener::new(&sequence().0, &white, &weights());
    let mut values: Vec<f64> = (0..26).map(|k| wave(k, 0.7)).collect();
    whitener.apply(&mut values);
    for k in (0..26).filter(|k| sequence().1[*k].is_some()) {
        assert!((values[k] - wave(k, 0.7) * weights()[k].sqrt()).abs() < 1e-14);
    }
}

/// −2 log of the restricted likelihood as it is defined, with dense matrices: a proper prior is marginalised.
#[test]
fn the_restricted_likelihood_is_that_of_dense_matrices() {
    let (rows, matrix) = dense();
    let design = Mat::from_fn(26, 4, |k, j| wave(k, 0.4 * (j + 1) as f64) + if j == 0 { 1.0 } else { 0.0 });
    let observed: Vec<f64> = (0..26).map(|k| wave(k, 5.1)).collect();
    // Two directions with a prior, two without.
    let prior = Mat::from_fn(4, 4, |i, j| if i == j && i > 1 { 0.3 * i as f64 } else { 0.0 });
    let (weights, sequence) = (weights(), sequence().0);
    let fitted =
        Fitted { design: design.as_ref(), residuals: &observed, weights: &weights, prior: prior.as_ref(), improper: 2 };
    let by_dense = |noise: &Mat<f64>| {
        let own = Mat::from_fn(rows.len(), 4, |k, j| design[(rows[k], j)]);
        let marginal = Mat::from_fn(rows.len(), rows.len(), |i, j| {
            noise[(i, j)] + (2..4).map(|p| own[(i, p)] * own[(j, p)] / prior[(p, p)]).sum::<f64>()
        });
        let free = own.as_ref().subcols(0, 2).to_owned();
        let factor = Llt::new(marginal.as_ref(), Side::Lower).unwrap();
        let y = Mat::from_fn(rows.len(), 1, |k, _| observed[rows[k]]);
        let information = free.transpose() * factor.solve(&free);
        let own_factor = Llt::new(information.as_ref(), Side::Lower).unwrap();
        let gradient = free.transpose() * factor.solve(&y);
        let square = (y.transpose() * factor.solve(&y))[(0, 0)]
            - (gradient.transpose() * own_factor.inverse() * &gradient)[(0, 0)];
        let log_determinant = |factor: &Llt<f64>, n: usize| (0..n).map(|k| 2.0 * factor.L()[(k, k)].ln()).sum::<f64>();
        (rows.len() - 2) as f64 * square.ln() + log_determinant(&factor, rows.len()) + log_determinant(&own_factor, 2)
    };
    let white = Mat::from_fn(rows.len(), rows.len(), |i, j| if i == j { 1.0 / weights[rows[i]] } else { 0.0 });
    let whitener = Whitener::new(&sequence, &CORRELATION, &weights);
    // Rows outside of the sequence take part in neither.
    let inside: Vec<f64> = (0..26).map(|k| if rows.contains(&k) { weights[k] } else { 0.0 }).collect();
    let fitted = Fitted { weights: &inside, ..fitted };
    let found =
        fitted.minus_two_log_likelihood(Some(&whitener)).unwrap() - fitted.minus_two_log_likelihood(None).unwrap();
    let expected = by_dense(&matrix) - by_dense(&white);
    assert!((found - expected).abs() < 1e-9, "{found} {expected}");
}

/// 60 lines of 15 rows of one station after the other, a parabola in each of the first two columns' places, and noise.
fn lines(
    seed: u64,
    share: f64,
    neighbours: f64,
    offset: f64,
    over_lines: bool,
) -> (Mat<f64>, Vec<f64>, Vec<Vec<usize>>) {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
    let (mut observed, mut process, mut common) = (Vec::new(), normal(), 0.0);
    for k in 0..900 {
        if k % 15 == 0 {
            common = normal();
            if !over_lines {
                process = normal();
            }
        }
        process = neighbours * process + (1.0 - neighbours * neighbours).sqrt() * normal();
        observed.push(share.sqrt() * process + offset.sqrt() * common + (1.0 - share - offset).sqrt() * normal());
    }
    let design = Mat::from_fn(900, 5, |k, j| ((k % 15) as f64 / 7.0 - 1.0).powi(j as i32));
    (design, observed, (0..60).map(|line| (15 * line..15 * line + 15).collect()).collect())
}

fn found(seed: u64, share: f64, neighbours: f64, offset: f64, over_lines: bool) -> Option<Found> {
    let (design, observed, blocks) = lines(seed, share, neighbours, offset, over_lines);
    let (weights, prior) = (vec![1.0; 900], Mat::zeros(5, 5));
    let factor = Llt::new((design.transpose() * &design).as_ref(), Side::Lower).unwrap();
    let values = Mat::from_fn(900, 1, |k, _| observed[k]);
    let left = &values - &design * factor.solve(design.transpose() * &values);
    let residuals: Vec<f64> = (0..900).map(|k| left[(k, 0)]).collect();
    let fitted = Fitted {
        design: design.as_ref(),
        residuals: &residuals,
        weights: &weights,
        prior: prior.as_ref(),
        improper: 5,
    };
    let whole: Vec<usize> = (0..900).collect();
    let by_line = Sequence::new(&blocks, |row| row as f64, |row| row / 15);
    let over = Sequence::new(&[whole], |row| row as f64, |row| row / 15);
    fitted.hints_at_correlation(&by_line).then(|| fitted.correlation(&[by_line, over])).flatten()
}

#[test]
fn white_noise_is_not_taken_for_correlated() {
    let shown = (0..60).filter(|seed| found(*seed, 0.0, 0.0, 0.0, false).is_some()).count();
    assert!(shown <= 1, "{shown} of 60");
}

#[test]
fn share_and_length_of_a_process_are_found_with_the_order_it_goes_by() {
    for (neighbours, over_lines) in [(0.5, false), (0.9, false), (0.5, true), (0.9, true)] {
        let (mut own, mut sum) = (0, 0.0);
        for seed in 0..8 {
            let found = found(seed, 0.6, neighbours, 0.0, over_lines).unwrap();
            own += usize::from((found.sequence == 1) == over_lines);
            sum += found.correlation.at(1.0) / 8.0;
            assert!(found.gain > 14.0, "{neighbours} {over_lines} {seed}");
        }
        // A correlation of neighbours over 900 rows is known to 0.03, its mean of eight to 0.01.
        assert!((sum - 0.6 * neighbours).abs() < 0.04, "{neighbours} {over_lines}: {sum}");
        // Sixty turns from line to line tell which, where neighbours are alike enough.
        assert!(neighbours < 0.9 || own >= 7, "{neighbours} {over_lines}: {own} of 8");
    }
}

#[test]
fn offsets_of_whole_lines_are_found_beside_a_process() {
    let mut sum = 0.0;
    for seed in 0..6 {
        let found = found(seed, 0.0, 0.0, 0.3, false).unwrap();
        // Neighbours three apart are as alike as neighbours.
        sum += (found.correlation.at(3.0) + found.correlation.at(1.0)) / 12.0;
    }
    assert!((sum - 0.3).abs() < 0.06, "{sum}");
    let found = found(3, 0.5, 0.6, 0.3, false).unwrap().correlation;
    assert!((found.at(1.0) - 0.6).abs() < 0.1 && (found.at(10.0) - 0.3).abs() < 0.12, "{found:?}");
}

#[test]
fn effective_rows_are_those_that_tell_the_mean_as_well() {
    // n rows with one common offset: 1ᵀK⁻¹1 = n/(1 − g + n g).
    let sequence = Sequence::new(&[(0..10).collect()], |row| row as f64, |_| 0);
    let offset = Correlation { share: 0.0, length: 1.0, group_share: 0.4 };
    let whitener = Whitener::new(&sequence, &offset, &[1.0; 10]);
    assert!((whitener.effective_rows(10) - 10.0 / (0.6 + 4.0)).abs() < 1e-12);
}
