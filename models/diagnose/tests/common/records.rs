//! Records in time, written by themselves: residual vectors at random positions with pauses, a level that steps, drifts or stays,
//! and noise of several kinds. Told in µm and s.

use abbe_diagnose::study::vectors::ResidualVector;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// How single readings scatter, all with unit deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Scatter {
    Normal,
    /// Tails heavier than normal ones.
    Laplace,
    /// No tails.
    Uniform,
}

impl Scatter {
    pub(crate) fn draw(self, generator: &mut ChaCha8Rng) -> f64 {
        let u: f64 = generator.random_range(-0.5..0.5);
        match self {
            Scatter::Normal => {
                // Marsaglia's polar method.
                loop {
                    let (a, b): (f64, f64) = (generator.random_range(-1.0..1.0), generator.random_range(-1.0..1.0));
                    let s = a * a + b * b;
                    if s > 0.0 && s < 1.0 {
                        return a * (-2.0 * s.ln() / s).sqrt();
                    }
                }
            }
            Scatter::Laplace => -u.signum() * (1.0 - 2.0 * u.abs()).max(1e-12).ln() / 2f64.sqrt(),
            Scatter::Uniform => u * 12f64.sqrt(),
        }
    }
}

/// A campaign of vectors.
#[derive(Clone, Debug)]
pub(crate) struct Record {
    pub(crate) vectors: usize,
    /// A pause of an hour before each of these vectors.
    pub(crate) pauses: Vec<usize>,
    pub(crate) scatter: Scatter,
    pub(crate) sigma_um: f64,
    /// Correlation of a vector with the next.
    pub(crate) rho: f64,
}

impl Record {
    pub(crate) fn new(vectors: usize, pauses: &[usize]) -> Record {
        Record { vectors, pauses: pauses.to_vec(), scatter: Scatter::Normal, sigma_um: 20.0, rho: 0.0 }
    }

    /// Times (s) of the vectors.
    pub(crate) fn times_s(&self) -> Vec<f64> {
        let pauses = |k: usize| self.pauses.iter().filter(|pause| k >= **pause).count();
        (0..self.vectors).map(|k| 30.0 * k as f64 + 3600.0 * pauses(k) as f64).collect()
    }

    /// Vectors whose levels (µm, of vector and time as a share of the record, position in m) are those given.
    pub(crate) fn measured(&self, levels: impl Fn(usize, f64, [f64; 3]) -> [f64; 3], seed: u64) -> Vec<ResidualVector> {
        let mut generator = ChaCha8Rng::seed_from_u64(0x57e9_0000 + seed);
        let times = self.times_s();
        let mut slow = [0, 1, 2].map(|_| self.scatter.draw(&mut generator));
        let one = |(k, time_s): (usize, &f64)| {
            let position_m = [1.2, 1.0, 0.8].map(|stroke| stroke * generator.random::<f64>());
            for value in &mut slow {
                *value = self.rho * *value + (1.0 - self.rho * self.rho).sqrt() * self.scatter.draw(&mut generator);
            }
            let level = levels(k, time_s / times[times.len() - 1], position_m);
            ResidualVector {
                position_m,
                residual_m: [0, 1, 2].map(|d| 1e-6 * (level[d] + self.sigma_um * slow[d])),
                time_s: Some(*time_s),
                ..ResidualVector::default()
            }
        };
        times.iter().enumerate().map(one).collect()
    }
}
