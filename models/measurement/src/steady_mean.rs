//! The mean of what was read while nothing moved, and what it is worth.
//!
//! Place in the flow: lengths and scales of a standstill in, one value with its uncertainty out. Readings at short intervals hang
//! together (filters, air, the floor), so that a hundred of them are not a hundred independent ones: the correlation time
//! τ = 1 + 2 Σ ρ_k, summed over pairs of neighbours as long as they are positive, says how many they are worth. A value that
//! stands there again unchanged is no new one. Few independent ones know their own scatter badly: the uncertainty is
//! widened by Student's factor, so that twice it is an interval of 95 %. Any unit. Source: Geyer, Practical Markov chain Monte
//! Carlo, Statistical Science 7 (1992), section 3.3.

/// 97.5 % of the standard normal distribution.
const NORMAL: f64 = 1.959_964;
/// Independent readings that are counted at least where there are two different ones.
const FEWEST: f64 = 2.0;
/// Shortest series whose correlation is looked for; below it neighbours say too little of each other.
const LOOKED_AT: usize = 8;
/// Farthest neighbours that are looked at, as a share of the series.
const FARTHEST: usize = 2;

/// A mean and what it is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SteadyMean {
    /// The mean of all.
    pub mean: f64,
    /// Standard deviation of a single one.
    pub scatter: f64,
    /// Standard uncertainty of the mean; 0 where all are the same, which says nothing.
    pub u: f64,
    /// How many there were.
    pub count: usize,
    /// How often the value changed, and one: what is repeated is not counted again.
    pub distinct: usize,
    /// So many independent ones are worth as much.
    pub effective: f64,
}

/// Mean of values in the order in which they were read; nothing for none.
pub fn steady_mean(values: &[f64]) -> Option<SteadyMean> {
    let first = values.first()?;
    let count = values.len();
    let mean = first + values.iter().map(|value| value - first).sum::<f64>() / count as f64;
    let distinct = 1 + values.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let square = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    if distinct < 2 || square == 0.0 {
        return Some(SteadyMean { mean, scatter: 0.0, u: 0.0, count, distinct, effective: 1.0 });
    }
    let effective = (count as f64 / correlation_time(values, mean)).min(distinct as f64).max(FEWEST);
    // The mean took a part of the scatter along, the more of it the fewer independent ones there are.
    let scatter = (square / (count as f64 * (1.0 - 1.0 / effective))).sqrt();
    let u = scatter / effective.sqrt() * student(effective - 1.0) / NORMAL;
    Some(SteadyMean { mean, scatter, u, count, distinct, effective })
}

/// τ, at least 1.
fn correlation_time(values: &[f64], mean: f64) -> f64 {
    let count = values.len();
    if count < LOOKED_AT {
        return 1.0;
    }
    let at = |lag: usize| -> f64 {
        values.iter().zip(&values[lag..]).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>() / count as f64
    };
    let variance = at(0);
    // ρ₀ + ρ₁, ρ₂ + ρ₃, …: sums of two are positive for any stationary chain.
    let pairs = (0..count / FARTHEST).step_by(2).map(|lag| (at(lag) + at(lag + 1)) / variance);
    let sum: f64 = pairs.take_while(|pair| *pair > 0.0).sum();
    let raw = (2.0 * sum - 1.0).max(1.0);
    // Correlations about the own mean are too small by τ/n of the variance; τ solves τ = raw + what that took.
    let share = raw / count as f64;
    raw * (1.0 + 2.0 * share).min(2.0)
}

/// 97.5 % of Student's distribution, by its expansion about the normal one.
fn student(degrees: f64) -> f64 {
    let (z, n) = (NORMAL, degrees.max(1.0));
    let first = (z.powi(3) + z) / (4.0 * n);
    let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * n * n);
    let third = (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / (384.0 * n.powi(3));
    z + first + second + third
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Share of intervals of mean ± 2 u that hold the truth, over series of an autoregression.
    fn coverage(neighbours: f64, count: usize) -> f64 {
        const TRIALS: u64 = 1500;
        let holds = |seed: u64| {
            let mut generator = ChaCha8Rng::seed_from_u64(seed);
            let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
            let mut now = normal();
            let series: Vec<f64> = (0..count)
                .map(|_| {
                    now = neighbours * now + (1.0 - neighbours * neighbours).sqrt() * normal();
                    7.0 + 1e-6 * now
                })
                .collect();
            let found = steady_mean(&series).unwrap();
            (found.mean - 7.0).abs() <= 2.0 * found.u
        };
        (0..TRIALS).filter(|seed| holds(*seed)).count() as f64 / TRIALS as f64
    }

    /// Two thousand trials have a standard deviation of half a percent; beyond 0.5 an estimate from one short series is
    /// known to fall short.
    #[test]
    fn twice_the_uncertainty_holds_the_truth_however_readings_hang_together() {
        for (neighbours, count, least) in
            [(0.0, 50, 0.93), (0.0, 5, 0.93), (0.5, 100, 0.91), (0.9, 200, 0.88), (0.9, 1000, 0.91)]
        {
            let share = coverage(neighbours, count);
            assert!((least..=0.99).contains(&share), "{neighbours} {count}: {share}");
        }
    }

    #[test]
    fn what_is_repeated_counts_once() {
        let fresh: Vec<f64> = (0..20).map(|k| f64::from(k * 7 % 20)).collect();
        let held: Vec<f64> = fresh.iter().flat_map(|value| [*value; 10]).collect();
        let (fresh, held) = (steady_mean(&fresh).unwrap(), steady_mean(&held).unwrap());
        assert_eq!((held.count, held.distinct), (200, 20));
        assert!(held.effective <= 20.0 && held.u >= held.scatter / 20.0_f64.sqrt(), "{fresh:?} {held:?}");
        let frozen = steady_mean(&[0.123; 500]).unwrap();
        assert_eq!((frozen.distinct, frozen.scatter, frozen.mean), (1, 0.0, 0.123));
        assert_eq!(steady_mean(&[]), None);
    }

    #[test]
    fn students_factor_is_that_of_the_tables() {
        for (degrees, expected) in [(4.0, 2.776), (9.0, 2.262), (30.0, 2.042)] {
            assert!((student(degrees) - expected).abs() < 0.02, "{degrees}");
        }
    }
}
