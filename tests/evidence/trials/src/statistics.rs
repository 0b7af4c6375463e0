//! Counts with their uncertainty, and medians.
//!
//! Place in the flow: [`crate::summary`] says with it how far a count of trials can be trusted.
//! Source: Wilson 1927, score interval of a binomial share; it holds for few trials and for shares near 0 and 1.

/// Standard normal quantile of a two-sided 95 % interval.
const Z_95: f64 = 1.959_963_984_540_054;

/// A number of trials that came out one way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Count {
    /// Trials that did.
    pub hits: usize,
    /// Trials at all.
    pub of: usize,
}

impl Count {
    /// Counts the trials for which a condition holds.
    pub fn among(outcomes: impl Iterator<Item = bool>) -> Count {
        outcomes.fold(Count { hits: 0, of: 0 }, |count, hit| Count {
            hits: count.hits + usize::from(hit),
            of: count.of + 1,
        })
    }

    /// Share of the trials that did, `None` without trials.
    pub fn share(&self) -> Option<f64> {
        (self.of > 0).then(|| self.hits as f64 / self.of as f64)
    }

    /// Wilson's 95 % interval of the share behind the count, `None` without trials.
    pub fn interval(&self) -> Option<[f64; 2]> {
        let (n, share) = (self.of as f64, self.share()?);
        let z2 = Z_95 * Z_95;
        let centre = (share + z2 / (2.0 * n)) / (1.0 + z2 / n);
        let half = Z_95 / (1.0 + z2 / n) * (share * (1.0 - share) / n + z2 / (4.0 * n * n)).sqrt();
        // Rounding can carry the end of a share of 0 or 1 past it by one unit in the last place.
        Some([(centre - half).max(0.0), (centre + half).min(1.0)])
    }
}

/// Mean and least of values; `None` without any.
pub fn mean_and_least(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let all: Vec<f64> = values.collect();
    let least = all.iter().copied().min_by(f64::total_cmp)?;
    Some([all.iter().sum::<f64>() / all.len() as f64, least])
}

/// Median and largest of values; `None` without any. Values that are not finite are a fault of the caller.
pub fn median_and_largest(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let largest = *sorted.last()?;
    let middle = sorted.len() / 2;
    let median = if sorted.len() % 2 == 1 { sorted[middle] } else { 0.5 * (sorted[middle - 1] + sorted[middle]) };
    Some([median, largest])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_wilson_interval_of_textbook_counts() {
        // Newcombe 1998, table I: 81 of 263 gives 0.2553 to 0.3662, 0 of 20 gives 0 to 0.1611.
        let [low, high] = Count { hits: 81, of: 263 }.interval().unwrap();
        assert!((low - 0.2553).abs() < 5e-5 && (high - 0.3662).abs() < 5e-5);
        let [low, high] = Count { hits: 0, of: 20 }.interval().unwrap();
        assert!(low == 0.0 && (high - 0.1611).abs() < 5e-5);
        assert_eq!(Count { hits: 20, of: 20 }.interval().unwrap()[1], 1.0);
        assert_eq!(Count { hits: 0, of: 0 }.interval(), None);
    }

    #[test]
    fn medians_of_odd_even_and_none() {
        assert_eq!(median_and_largest([3.0, 1.0, 2.0].into_iter()), Some([2.0, 3.0]));
        assert_eq!(median_and_largest([4.0, 1.0, 2.0, 3.0].into_iter()), Some([2.5, 4.0]));
        assert_eq!(median_and_largest(std::iter::empty()), None);
    }
}
