//! First populations: spread over bounds, or scattered about an estimate.
//!
//! Place in the flow: what [`super::minimise`] begins with. Spread evenly is the start of Zhang & Sanderson 2009, an estimate
//! with small random perturbations that of Liang 2025 (after eq. 10).

use super::{Bounds, JadeError};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// The ChaCha stream of first populations, apart from that of the search under the same seed.
const STREAM: u64 = 1;

/// Members spread evenly over finite bounds.
///
/// # Errors
/// Bounds that are not finite, or that hold nothing.
pub fn uniform_population(bounds: &Bounds, members: usize, seed: u64) -> Result<Vec<Vec<f64>>, JadeError> {
    check_bounds(bounds)?;
    if let Some((number, (lower, upper))) = bounds.iter().enumerate().find(|(_, (l, u))| !(u - l).is_finite()) {
        return Err(JadeError::Bounds { number: number + 1, lower: *lower, upper: *upper });
    }
    let mut generator = generator(seed);
    let mut member =
        || bounds.iter().map(|(lower, upper)| lower + (upper - lower) * generator.random::<f64>()).collect();
    Ok((0..members).map(|_| member()).collect())
}

/// Members about an estimate with a normal deviation for each number; the estimate itself is none of them.
///
/// # Errors
/// Lists of different length, or a deviation that is not above zero.
pub fn perturbed_population(
    estimate: &[f64],
    deviations: &[f64],
    members: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>, JadeError> {
    if estimate.len() != deviations.len() {
        return Err(JadeError::Length { member: 1, found: deviations.len(), expected: estimate.len() });
    }
    if let Some(value) = deviations.iter().find(|d| !(d.is_finite() && **d > 0.0)) {
        return Err(JadeError::Option { option: "deviation", value: *value, range: "a finite number above 0" });
    }
    let mut generator = generator(seed);
    let mut about = || {
        let numbers = estimate.iter().zip(deviations);
        numbers.map(|(value, deviation)| value + deviation * generator.sample::<f64, _>(StandardNormal)).collect()
    };
    Ok((0..members).map(|_| about()).collect())
}

pub(super) fn check_bounds(bounds: &Bounds) -> Result<(), JadeError> {
    match bounds.iter().enumerate().find(|(_, (lower, upper))| lower >= upper || lower.is_nan() || upper.is_nan()) {
        Some((number, (lower, upper))) => Err(JadeError::Bounds { number: number + 1, lower: *lower, upper: *upper }),
        None => Ok(()),
    }
}

fn generator(seed: u64) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(STREAM);
    generator
}
