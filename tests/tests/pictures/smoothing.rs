//! One error function with three penalties: far too small, far too large, and as the restricted likelihood chooses it.

use crate::canvas::{BLUE, Canvas, MUTED, ORANGE, Plot};
use crate::hold;
use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{Mat, Side};

const NODES: usize = 41;
/// Readings, in places that follow no grid, each with this deviation (µm).
const READINGS: usize = 90;
const NOISE_UM: f64 = 0.5;
/// Updates of the penalty.
const UPDATES: usize = 60;

fn truth_um(t: f64) -> f64 {
    2.0 * (4.0 * t).sin() + 2.5 * t * t - 1.5 * (-(t - 0.7).powi(2) / 0.004).exp()
}

/// Places and readings; noise is the sum of twelve numbers that are even between zero and one, less six.
fn readings() -> Vec<(f64, f64)> {
    let even = |k: usize| (k as f64 * 0.754_877_666_246_692_7 + 0.3).fract();
    let noise = |k: usize| (0..12).map(|j| ((12 * k + j) as f64 * 0.569_840_290_998_053_2).fract()).sum::<f64>() - 6.0;
    let one = |k: usize| (even(k), truth_um(even(k)) + NOISE_UM * noise(k));
    (0..READINGS).map(one).collect()
}

/// Values at nodes from the readings, curvature penalised: β = (XᵀX/σ² + λ S)⁻¹ Xᵀy/σ², with S = ∫ f″² of straight pieces.
struct Spline {
    normal: Mat<f64>,
    right: Mat<f64>,
    roughness: Mat<f64>,
}

impl Spline {
    fn new(readings: &[(f64, f64)]) -> Spline {
        let step = 1.0 / (NODES - 1) as f64;
        let mut design = Mat::zeros(readings.len(), NODES);
        for (i, (t, _)) in readings.iter().enumerate() {
            let below = ((t / step) as usize).min(NODES - 2);
            let share = t / step - below as f64;
            (design[(i, below)], design[(i, below + 1)]) = (1.0 - share, share);
        }
        let second = Mat::from_fn(NODES - 2, NODES, |i, j| match j.wrapping_sub(i) {
            0 | 2 => step.powf(-1.5),
            1 => -2.0 * step.powf(-1.5),
            _ => 0.0,
        });
        let observed = Mat::from_fn(readings.len(), 1, |i, _| readings[i].1);
        let weight = NOISE_UM.powi(-2);
        Spline {
            normal: faer::Scale(weight) * (design.transpose() * &design),
            right: faer::Scale(weight) * (design.transpose() * &observed),
            roughness: second.transpose() * &second,
        }
    }

    /// Values, and the degrees of freedom that the penalty takes: λ tr(V S).
    fn solved(&self, penalty: f64) -> (Vec<f64>, f64) {
        let matrix = &self.normal + faer::Scale(penalty) * &self.roughness;
        let factor = Llt::new(matrix.as_ref(), Side::Lower).unwrap();
        let (values, covariance) = (factor.solve(&self.right), factor.inverse());
        let both = &covariance * &self.roughness;
        let taken = penalty * (0..NODES).map(|k| both[(k, k)]).sum::<f64>();
        ((0..NODES).map(|k| values[(k, 0)]).collect(), taken)
    }

    fn roughness_of(&self, values: &[f64]) -> f64 {
        let row = |i: usize| (0..NODES).map(|j| self.roughness[(i, j)] * values[j]).sum::<f64>();
        (0..NODES).map(|i| values[i] * row(i)).sum()
    }

    /// λ by the generalised Fellner-Schall update with the prior, as the page has it.
    fn chosen(&self) -> f64 {
        let mut penalty = 1e-3;
        for _ in 0..UPDATES {
            let (values, taken) = self.solved(penalty);
            penalty = ((NODES - 2) as f64 - taken) / (self.roughness_of(&values) + 1.0 / penalty);
        }
        penalty
    }
}

fn rms_um(values: &[f64]) -> f64 {
    let square = |(k, value): (usize, &f64)| (value - truth_um(k as f64 / (NODES - 1) as f64)).powi(2);
    (values.iter().enumerate().map(square).sum::<f64>() / NODES as f64).sqrt()
}

#[test]
fn the_penalty_that_the_data_choose_leaves_least() {
    let readings = readings();
    let spline = Spline::new(&readings);
    let chosen = spline.chosen();
    let mut canvas = Canvas::new(720.0, 240.0);
    let mut errors_um = Vec::new();
    for (k, (factor, words)) in
        [(1e-4, "λ / 10 000"), (1.0, "λ as chosen"), (1e4, "λ · 10 000")].into_iter().enumerate()
    {
        let (values, _) = spline.solved(factor * chosen);
        errors_um.push(rms_um(&values));
        let left = 45.0 + 230.0 * k as f64;
        let plot = Plot { left, top: 30.0, width: 190.0, height: 150.0, x: (0.0, 1.0), y: (-3.0, 4.0) };
        plot.frame(&mut canvas, (&[0.0, 0.5, 1.0], &[-2.0, 0.0, 2.0, 4.0]), ("t", "f in µm"));
        readings.iter().for_each(|(t, value)| canvas.dot(plot.at(*t, value.clamp(-3.0, 4.0)), 1.5, MUTED));
        let at = |k: usize| k as f64 / (NODES - 1) as f64;
        let truth: Vec<(f64, f64)> = (0..NODES).map(|k| (at(k), truth_um(at(k)))).collect();
        let found: Vec<(f64, f64)> = values.iter().enumerate().map(|(k, value)| (at(k), *value)).collect();
        canvas.path(&plot.curve(&truth), ORANGE, 1.5, "4 3");
        canvas.path(&plot.curve(&found), BLUE, 2.0, "");
        canvas.text((left + 95.0, 232.0), "middle", MUTED, &format!("{words}: {:.2} µm off", rms_um(&values)));
    }
    assert!(errors_um[1] < 0.8 * errors_um[0] && errors_um[1] < 0.5 * errors_um[2], "{errors_um:?}");
    hold("smoothing", &canvas.finished("An error function with three penalties; dashed: the truth; dots: readings"));
}
