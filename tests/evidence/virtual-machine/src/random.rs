//! Seeded random streams: one seed, one independent ChaCha stream for every purpose.
//!
//! Place in the flow: whatever draws a number takes its generator from here. Separate streams mean that
//! switching one part on (outliers, say) leaves the draws of every other part as they were.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::StandardNormal;

/// What a stream is for; the number is the ChaCha stream and part of the "same seed, same bytes" promise.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Purpose {
    Machine = 1,
    Plan = 2,
    Spacing = 3,
    Repeatability = 4,
    RangeNoise = 5,
    Outliers = 6,
    EnvironmentDrift = 7,
    SensorNoise = 8,
    Verification = 9,
    Undescribed = 10,
    ReflectorOffset = 11,
    LengthTest = 12,
    SphereScan = 13,
    Head = 14,
    Tracker = 15,
    CorrelatedNoise = 16,
}

/// The generator of one purpose under one seed.
pub(crate) fn stream(seed: u64, purpose: Purpose) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(purpose as u64);
    generator
}

/// One standard normal deviate.
pub(crate) fn normal(generator: &mut ChaCha8Rng) -> f64 {
    generator.sample(StandardNormal)
}

/// One deviate uniform in [low, high); `low` itself where the interval is empty.
pub(crate) fn uniform(generator: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * generator.random::<f64>()
}

/// One entry of a slice, or `None` of an empty one.
pub(crate) fn pick<'a, T>(generator: &mut ChaCha8Rng, from: &'a [T]) -> Option<&'a T> {
    if from.is_empty() {
        return None;
    }
    from.get(generator.random_range(0..from.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_purposes_under_one_seed_are_not_correlated() {
        let mut one = stream(4, Purpose::RangeNoise);
        let mut other = stream(4, Purpose::Repeatability);
        let count = 4000;
        let total: f64 = (0..count).map(|_| normal(&mut one) * normal(&mut other)).sum();
        // The mean of n products of unit normals has the deviation 1/√n; four of them.
        let count = f64::from(count);
        assert!((total / count).abs() < 4.0 / count.sqrt());
    }
}
