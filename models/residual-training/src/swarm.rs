//! A network on the position whose weights are searched by a particle swarm with genetic operators.
//!
//! Place in the flow: rival in [`crate::compare()`], after Li et al. 2022 (Chinese Journal of Aeronautics 35(2)), whose sizes are
//! not given in Liang 2025. One hidden layer with tanh. Each particle is a vector of all weights; after each move the worse
//! half is replaced by children of the better half (arithmetic crossover), some of whose weights mutate. The fitness is the
//! mean squared error on the training examples; the best particle by the validation examples is kept.

use crate::optimise::{Examples, OUTPUTS, View};
use crate::perceptron::POSITION;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Hidden units.
const HIDDEN: usize = 12;
/// Particles.
const PARTICLES: usize = 40;
/// Moves of the swarm.
const MOVES: usize = 300;
/// Inertia, and pull towards the particle's own and the swarm's best (Clerc & Kennedy 2002).
const INERTIA: f64 = 0.729;
const PULL: f64 = 1.494;
/// Probability that a weight of a child mutates, and by how much.
const MUTATION: (f64, f64) = (0.05, 0.5);
/// Weights of the first particles.
const START: f64 = 1.0;

/// A trained network.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Swarm {
    weights: Vec<f64>,
}

const WEIGHTS: usize = (POSITION + 1) * HIDDEN + (HIDDEN + 1) * OUTPUTS;

impl Swarm {
    /// Searches the weights.
    pub(crate) fn train(examples: &Examples, seed: u64) -> Swarm {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let training = &examples.training[0];
        let mut draw = |size: f64| -> Vec<f64> { (0..WEIGHTS).map(|_| random.random_range(-size..size)).collect() };
        let mut particles: Vec<Particle> =
            (0..PARTICLES).map(|_| Particle::new(draw(START), draw(0.1), training)).collect();
        let mut best = particles[0].best.clone();
        let mut best_value = f64::INFINITY;
        let (mut kept, mut kept_value) = (best.clone(), f64::INFINITY);
        for _ in 0..MOVES {
            for particle in &mut particles {
                if particle.best_value < best_value {
                    (best_value, best) = (particle.best_value, particle.best.clone());
                    let validation = error(&best, &examples.validation);
                    if validation < kept_value {
                        (kept_value, kept) = (validation, best.clone());
                    }
                }
                particle.advance(&best, &mut random);
                particle.judge(training);
            }
            breed(&mut particles, training, &mut random);
        }
        Swarm { weights: kept }
    }

    /// Output for a position.
    pub(crate) fn output(&self, position: &[f32]) -> [f64; OUTPUTS] {
        output(&self.weights, position)
    }
}

struct Particle {
    at: Vec<f64>,
    speed: Vec<f64>,
    value: f64,
    best: Vec<f64>,
    best_value: f64,
}

impl Particle {
    fn new(at: Vec<f64>, speed: Vec<f64>, training: &View) -> Particle {
        let mut particle = Particle { best: at.clone(), at, speed, value: f64::INFINITY, best_value: f64::INFINITY };
        particle.judge(training);
        particle
    }

    fn advance(&mut self, best: &[f64], random: &mut ChaCha8Rng) {
        for k in 0..WEIGHTS {
            let own = PULL * random.random::<f64>() * (self.best[k] - self.at[k]);
            let common = PULL * random.random::<f64>() * (best[k] - self.at[k]);
            self.speed[k] = INERTIA * self.speed[k] + own + common;
            self.at[k] += self.speed[k];
        }
    }

    fn judge(&mut self, training: &View) {
        self.value = error(&self.at, training);
        if self.value < self.best_value {
            self.best_value = self.value;
            self.best.clone_from(&self.at);
        }
    }
}

/// Replaces the worse half by children of the better half.
fn breed(particles: &mut [Particle], training: &View, random: &mut ChaCha8Rng) {
    particles.sort_by(|a, b| a.value.total_cmp(&b.value));
    let half = particles.len() / 2;
    let (better, worse) = particles.split_at_mut(half);
    for child in worse {
        let (a, b) = (random.random_range(0..half), random.random_range(0..half));
        let share = random.random::<f64>();
        for k in 0..WEIGHTS {
            child.at[k] = share * better[a].at[k] + (1.0 - share) * better[b].at[k];
            if random.random::<f64>() < MUTATION.0 {
                child.at[k] += random.random_range(-MUTATION.1..MUTATION.1);
            }
        }
        child.judge(training);
    }
}

fn output(weights: &[f64], position: &[f32]) -> [f64; OUTPUTS] {
    let (first, second) = weights.split_at((POSITION + 1) * HIDDEN);
    let hidden: [f64; HIDDEN] = std::array::from_fn(|h| {
        let row = &first[h * (POSITION + 1)..(h + 1) * (POSITION + 1)];
        let sum: f64 = position.iter().zip(row).map(|(x, w)| f64::from(*x) * w).sum();
        (sum + row[POSITION]).tanh()
    });
    std::array::from_fn(|o| {
        let row = &second[o * (HIDDEN + 1)..(o + 1) * (HIDDEN + 1)];
        hidden.iter().zip(row).map(|(x, w)| x * w).sum::<f64>() + row[HIDDEN]
    })
}

/// Mean squared component.
fn error(weights: &[f64], view: &View) -> f64 {
    let rows = view.inputs.chunks_exact(POSITION).zip(view.outputs.chunks_exact(OUTPUTS));
    let square = |(x, y): (&[f32], &[f32])| {
        let found = output(weights, x);
        found.iter().zip(y).map(|(f, y)| (f - f64::from(*y)).powi(2)).sum::<f64>()
    };
    rows.map(square).sum::<f64>() / view.outputs.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_is_found_and_the_search_repeats() {
        let mut view = View::default();
        for k in 0..60 {
            let x = [0.7, 1.3, 0.37].map(|f: f32| (k as f32 * f).sin());
            view.inputs.extend(x);
            view.outputs.extend([x[0], 0.5 * x[1] - 0.3, -x[2]]);
        }
        let examples = Examples { training: vec![view.clone()], validation: view.clone() };
        let swarm = Swarm::train(&examples, 4);
        assert!(error(&swarm.weights, &view) < 0.05, "{}", error(&swarm.weights, &view));
        assert_eq!(Swarm::train(&examples, 4), swarm);
    }
}
