//! An axis on a screw: pitch error, a wave of the screw, play and noise, measured after ISO 230-2 at slightly unequal steps; and what
//! a model of such runs says between the targets.

use abbe_diagnose::study::Terms;
use abbe_diagnose::study::runs::{Approach, Run};
use abbe_geometry::effects::{Acts, CovariateSource, CovariateValue, State};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::MachineModel;
use abbe_geometry::{Axis, ErrorId};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Cycles of the standard.
const CYCLES: i64 = 5;
/// Marks of a scale to a mean step.
const MARKS: f64 = 5.0;

/// What one axis does (m), and where it was measured.
#[derive(Debug, Clone)]
pub(crate) struct Screw {
    pub(crate) stroke_m: f64,
    pub(crate) targets_m: Vec<f64>,
    pub(crate) slope: f64,
    pub(crate) play_m: f64,
    pub(crate) sigma_m: f64,
    /// Amplitude, period and phase.
    pub(crate) wave: (f64, f64, f64),
    /// Sizes of three parts of a smooth error.
    pub(crate) bow_m: [f64; 3],
    /// Sizes of errors of a scale that add up from mark to mark, five to a step, and that are drawn anew at each.
    pub(crate) walk_m: f64,
    pub(crate) marks_m: f64,
    seed: u64,
}

pub(crate) fn normal(generator: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (generator.random(), generator.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}

impl Screw {
    /// One of many: so many targets, each off its place by up to a share of the step as the standard asks.
    pub(crate) fn new(targets: usize, seed: u64) -> Screw {
        let mut generator = ChaCha8Rng::seed_from_u64(0x005c_4e00 + seed);
        let stroke_m = [0.3, 0.5, 0.8, 1.2][generator.random_range(0..4)];
        let lead_m = [5e-3, 10e-3, 16e-3, 20e-3][generator.random_range(0..4)];
        let step_m = stroke_m / (targets as f64 - 1.0);
        let off = |generator: &mut ChaCha8Rng| 0.3 * generator.random_range(-1.0..1.0);
        // A driver of an axis writes hundredths of a millimetre.
        let targets_m =
            (0..targets).map(|k| ((k as f64 + off(&mut generator)) * step_m * 1e5).round() * 1e-5).collect();
        let sign = if generator.random_bool(0.5) { 1.0 } else { -1.0 };
        Screw {
            stroke_m,
            targets_m,
            slope: sign * generator.random_range(5e-6..50e-6),
            play_m: generator.random_range(2e-6..10e-6),
            sigma_m: generator.random_range(1e-6..2e-6),
            wave: (generator.random_range(2e-6..6e-6), lead_m, generator.random_range(0.0..TAU)),
            bow_m: [0.0; 3],
            walk_m: 0.0,
            marks_m: 0.0,
            seed,
        }
    }

    /// Mean of both approaches (m).
    pub(crate) fn error_m(&self, x_m: f64) -> f64 {
        let (size_m, period_m, phase) = self.wave;
        let share = x_m / self.stroke_m;
        let bow: f64 = (1..).zip(self.bow_m).map(|(k, m)| m * (1.3 * f64::from(k) * share + 0.4).sin()).sum();
        self.slope * x_m + size_m * (TAU * x_m / period_m + phase).sin() + bow + self.rough_m(x_m)
    }

    /// Errors of marks, five to a mean step, linear between them (m).
    fn rough_m(&self, x_m: f64) -> f64 {
        if self.walk_m == 0.0 && self.marks_m == 0.0 {
            return 0.0;
        }
        let mut generator = ChaCha8Rng::seed_from_u64(0x7_0000 + self.seed);
        let apart_m = self.stroke_m / (self.targets_m.len() as f64 - 1.0) / MARKS;
        let at = (x_m + self.stroke_m) / apart_m;
        let (mut sum_m, mut last_m) = (0.0, 0.0);
        for _ in 0..=at.floor() as usize + 1 {
            last_m = sum_m;
            sum_m = if self.walk_m > 0.0 { sum_m } else { 0.0 };
            sum_m += (self.walk_m / MARKS.sqrt() + self.marks_m) * normal(&mut generator);
        }
        last_m + (sum_m - last_m) * (at - at.floor())
    }

    pub(crate) fn runs(&self) -> Vec<Run> {
        let mut generator = ChaCha8Rng::seed_from_u64(0x0900_0000 + self.seed);
        let mut runs = Vec::new();
        for cycle in 1..=CYCLES {
            for approach in [Approach::Positive, Approach::Negative] {
                let mut order = self.targets_m.clone();
                if approach == Approach::Negative {
                    order.reverse();
                }
                for target_m in order {
                    let play_m = 0.5 * self.play_m * approach.sign();
                    let error_m = self.error_m(target_m) - play_m + self.sigma_m * normal(&mut generator);
                    let (measured_m, time_s) = (target_m + error_m + 2e-6, Some(8.0 * runs.len() as f64));
                    let covariates = BTreeMap::new();
                    runs.push(Run { axis: "X".to_owned(), target_m, approach, cycle, measured_m, time_s, covariates });
                }
            }
        }
        runs
    }
}

/// One quantity, and nothing else known.
struct Only<'a>(&'a str, f64);

impl CovariateSource for Only<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == self.0 { CovariateValue::Fresh(self.1) } else { CovariateValue::Missing }
    }
}

/// What terms say at a reading of X, approached from one side, and its standard uncertainty (m). Those that need anything logged beside
/// the side say nothing.
pub(crate) fn predicted_m(terms: &Terms, machine: &Machine, reading_m: f64, side: f64) -> (f64, f64) {
    predicted_at_m(terms, machine, reading_m, ("dir_x", side))
}

/// The same with another quantity known.
pub(crate) fn predicted_at_m(terms: &Terms, machine: &Machine, reading_m: f64, known: (&str, f64)) -> (f64, f64) {
    let along = Acts::Error(ErrorId::linear(Axis::X, Axis::X));
    let only = Only(known.0, known.1);
    let state = State { reading_m: [reading_m, 0.0, 0.0], offset_m: [0.0; 3], covariates: &only };
    let (mut parts, mut value_m, mut first) = (Vec::new(), 0.0, 0);
    for term in &terms.list {
        let fitted =
            MachineModel::fitted_effect(term.effect, term.shape.clone(), machine, term.values.clone()).unwrap();
        let mut own = Vec::new();
        let mut add = |k: usize, acts: Acts, part: f64| {
            if acts == along {
                own.push((first + k, part));
            }
        };
        if fitted.effect.motion(&state, &mut add).is_ok() {
            value_m += own.iter().map(|(k, part)| part * term.values[k - first]).sum::<f64>();
            parts.extend(own);
        }
        first += term.values.len();
    }
    let packed = |a: usize, b: usize| terms.covariance[a.max(b) * (a.max(b) + 1) / 2 + a.min(b)];
    let variance: f64 = parts.iter().map(|(a, x)| parts.iter().map(|(b, y)| x * y * packed(*a, *b)).sum::<f64>()).sum();
    (value_m, variance.max(0.0).sqrt())
}
