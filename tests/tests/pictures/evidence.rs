//! What a model's own columns take of a candidate, and what is left to test.

use crate::canvas::{BLUE, Canvas, GREEN, MUTED, ORANGE, Plot};
use crate::hold;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

const ROWS: usize = 120;
/// Degree of the polynomials that stand for the error functions.
const DEGREE: i32 = 4;

fn at(k: usize) -> f64 {
    k as f64 / (ROWS - 1) as f64
}

/// A candidate without what the model's columns hold of it.
fn left(candidate: &[f64]) -> Vec<f64> {
    let model = Mat::from_fn(ROWS, DEGREE as usize + 1, |k, j| (2.0 * at(k) - 1.0).powi(j as i32));
    let column = Mat::from_fn(ROWS, 1, |k, _| candidate[k]);
    let normal = model.transpose() * &model;
    let taken = &model * Llt::new(normal.as_ref(), Side::Lower).unwrap().solve(model.transpose() * &column);
    (0..ROWS).map(|k| candidate[k] - taken[(k, 0)]).collect()
}

fn square(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum()
}

#[test]
fn what_the_model_can_bend_to_is_hardly_left() {
    let drift: Vec<f64> = (0..ROWS).map(|k| 1.0 - (-2.5 * at(k)).exp()).collect();
    let screw: Vec<f64> = (0..ROWS).map(|k| 0.5 + 0.5 * (std::f64::consts::TAU * 6.0 * at(k)).sin()).collect();
    let mut canvas = Canvas::new(720.0, 250.0);
    let mut shares = Vec::new();
    for (k, (candidate, name)) in [(drift, "warm-up"), (screw, "six turns of a screw")].into_iter().enumerate() {
        let rest = left(&candidate);
        let mean = candidate.iter().sum::<f64>() / ROWS as f64;
        let alone = square(&candidate.iter().map(|value| value - mean).collect::<Vec<f64>>());
        let share = square(&rest) / alone;
        shares.push(share);
        let plot = Plot {
            left: 50.0 + 350.0 * k as f64,
            top: 30.0,
            width: 290.0,
            height: 150.0,
            x: (0.0, 1.0),
            y: (-0.6, 1.2),
        };
        plot.frame(&mut canvas, (&[0.0, 0.5, 1.0], &[-0.5, 0.0, 0.5, 1.0]), ("reading, first to last", "column"));
        let curve = |values: &[f64]| values.iter().enumerate().map(|(k, v)| (at(k), *v)).collect::<Vec<_>>();
        let taken: Vec<f64> = candidate.iter().zip(&rest).map(|(value, rest)| value - rest).collect();
        canvas.path(&plot.curve(&curve(&taken)), ORANGE, 1.5, "4 3");
        canvas.path(&plot.curve(&curve(&candidate)), BLUE, 2.0, "");
        canvas.path(&plot.curve(&curve(&rest)), GREEN, 2.0, "");
        let words = match share {
            share if share < 0.01 => format!("{name}: {:.4} % is left", 100.0 * share),
            share => format!("{name}: {:.0} % is left", 100.0 * share),
        };
        canvas.text((plot.left + 145.0, 240.0), "middle", MUTED, &words);
    }
    assert!(shares[0] < 1e-3 && shares[1] > 0.8, "{shares:?}");
    hold(
        "evidence",
        &canvas
            .finished("Columns of two candidates (blue), what the model takes of them (dashed), what is left (green)"),
    );
}
