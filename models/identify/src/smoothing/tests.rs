//! The search for smoothness beside the plain update, repeated until nothing moves, on splines of random problems.

use super::*;
use abbe_geometry::error_function::Basis;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Plain updates after which a search is at its end, whatever it began with.
const PLAIN_UPDATES: usize = 400;
/// −2 log likelihood by which the end of a search may be worse; 1 is a standard deviation of one penalty.
const AS_LIKELY: f64 = 0.1;

/// Sums of three to five splines seen by single rows with levers of any size, and noise that is `noise` times the declared.
struct Rows {
    normal: NormalEquations,
    smoothness: Smoothness,
}

impl Rows {
    fn new(seed: u64, noise: f64) -> Rows {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut smoothness = Smoothness::default();
        let mut bases = Vec::new();
        let mut first = 0;
        for curvature in 0..random.random_range(3..6) {
            let closure = if random.random_bool(0.7) { Closure::Origin } else { Closure::BothEnds };
            let intervals = [4, 6, 9][random.random_range(0..3)];
            let basis = Basis::new(FunctionKind::BSpline { intervals }, closure, 0.0, 1.0).unwrap();
            let own = Curvature::new(&basis).unwrap();
            let (rank, roughness) = (own.rank() as f64, Arc::new(own.at(0.0).unwrap()));
            let range = first..first + basis.len();
            first = range.end;
            smoothness.curvatures.push(own);
            smoothness.penalties.push(Penalty { range, lambda: 0.0, first_lambda: 0.0, rank, curvature, roughness });
            bases.push((basis, Shape::new(&mut random)));
        }
        let normal = normal(&mut random, &smoothness.penalties, &bases, noise);
        Rows { normal, smoothness }
    }

    /// What the search ends with, and what its next update would ask for.
    fn searched(&self) -> (Solution, f64) {
        let (at, free) = self.unknowns();
        let mut smoothness = self.smoothness.clone();
        let solution = solve(&self.normal, &at, &free, &mut smoothness, 1.0, true).unwrap();
        let problem = Problem::new(&self.normal, &at, &free);
        let left = problem.update(&smoothness, &solution).largest();
        (problem.solve(&smoothness, solution.noise_factor).unwrap(), left)
    }

    /// What the plain update ends with.
    fn plain(&self) -> Solution {
        let (at, free) = self.unknowns();
        let mut smoothness = self.smoothness.clone();
        smoothness.start(&self.normal);
        let problem = Problem::new(&self.normal, &at, &free);
        let mut solution = problem.solve(&smoothness, 1.0).unwrap();
        for _ in 0..PLAIN_UPDATES {
            let update = problem.update(&smoothness, &solution);
            smoothness.take(&update.to);
            solution = problem.solve(&smoothness, solution.noise_factor).unwrap();
        }
        solution
    }

    fn unknowns(&self) -> (Vec<f64>, Vec<usize>) {
        (vec![0.0; self.normal.size], (0..self.normal.size).collect())
    }
}

/// A function that is nothing, a bow, or a wave.
struct Shape {
    size: f64,
    waves: f64,
}

impl Shape {
    fn new(random: &mut impl Rng) -> Shape {
        let size = if random.random_bool(0.25) { 0.0 } else { 10f64.powf(random.random_range(-1.0..2.0)) };
        Shape { size, waves: random.random_range(0.0..2.0) }
    }

    fn at(&self, t: f64) -> f64 {
        self.size * t * (1.0 - t) * (std::f64::consts::TAU * self.waves * t).cos()
    }
}

fn normal(random: &mut ChaCha8Rng, penalties: &[Penalty], bases: &[(Basis, Shape)], noise: f64) -> NormalEquations {
    let size = penalties.last().unwrap().range.end;
    let levers: Vec<f64> = bases.iter().map(|_| 10f64.powf(random.random_range(-1.0..1.0))).collect();
    let mut normal = NormalEquations {
        size,
        matrix: vec![0.0; size * size],
        gradient: vec![0.0; size],
        weighted_square: 0.0,
        weight: 0.0,
        log_determinant: 0.0,
    };
    let gauss = |random: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(random) };
    for _ in 0..[150, 400, 1500][random.random_range(0..3)] {
        let (mut row, mut seen) = (vec![0.0; size], noise * gauss(random));
        for ((penalty, (basis, shape)), size) in penalties.iter().zip(bases).zip(&levers) {
            let (t, lever) = (random.random_range(0.0..1.0), size * gauss(random));
            let local = basis.at(t);
            for (k, value) in local.values().iter().enumerate() {
                row[penalty.range.start + local.first + k] = lever * value;
            }
            seen += lever * shape.at(t);
        }
        for i in 0..size {
            normal.gradient[i] += row[i] * seen;
            (i..size).for_each(|j| normal.matrix[i * size + j] += row[i] * row[j]);
        }
        normal.weighted_square += seen * seen;
        normal.weight += 1.0;
    }
    normal
}

#[test]
fn regress_the_search_ends_where_the_plain_update_does_whatever_the_noise() {
    for noise in [1.0, 2.0, 5.0, 30.0] {
        for seed in 0..20 {
            let rows = Rows::new(seed, noise);
            let ((found, left), plain) = (rows.searched(), rows.plain());
            let worse = found.minus_two_log_likelihood - plain.minus_two_log_likelihood;
            println!("noise {noise} seed {seed}: left {left:.3}, worse by {worse:.3}");
            assert!(left < UPDATE_TOLERANCE && worse < AS_LIKELY, "noise {noise}, seed {seed}: {left}, {worse}");
        }
    }
}
