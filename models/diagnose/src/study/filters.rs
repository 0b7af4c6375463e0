//! The filters of all descriptions of the noise for rows at the same gaps, each made when it is first asked for.
//!
//! Place in the flow: every estimate and every test of a study goes through the same descriptions of the noise on the same
//! rows, again and again; a filter takes an exponential and a logarithm a row, more than whitening a few columns does.

use super::series::{Filter, Theta, place_of};
use std::borrow::Cow;
use std::sync::OnceLock;

/// Most rows of which filters are kept: beyond, they would fill the memory.
const MOST: usize = 20_000;

/// Rows in order, with the steps since the one before (the first is not read).
#[derive(Debug)]
pub(super) struct Gaps {
    steps: Vec<f64>,
    filters: Vec<OnceLock<Filter>>,
}

impl Gaps {
    pub(super) fn new(steps: Vec<f64>) -> Gaps {
        let count = if steps.len() > MOST { 0 } else { place_of(None) };
        Gaps { steps, filters: (0..count).map(|_| OnceLock::new()).collect() }
    }

    pub(super) fn steps(&self) -> &[f64] {
        &self.steps
    }

    /// What frees these rows of noise that is so correlated.
    pub(super) fn filter(&self, theta: Theta) -> Cow<'_, Filter> {
        match self.filters.get(place_of(Some(theta))) {
            Some(filter) => Cow::Borrowed(filter.get_or_init(|| Filter::new(theta, &self.steps))),
            None => Cow::Owned(Filter::new(theta, &self.steps)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::Mat;

    /// Kept or made for the occasion, of a description that is weighed or of any other.
    #[test]
    fn a_filter_is_that_of_its_description() {
        for (count, rho) in [(30, 0.5), (30, 0.51), (MOST + 1, 0.5)] {
            let (theta, steps) = (Theta { rho, share: 0.5 }, vec![1.0; count]);
            let column = Mat::from_fn(count, 1, |k, _| (0.7 * k as f64).sin());
            let expected = Filter::new(theta, &steps).whitened(column.clone());
            let gaps = Gaps::new(steps);
            for _ in 0..2 {
                assert_eq!(gaps.filter(theta).whitened(column.clone()), expected, "{count} {rho}");
            }
        }
    }
}
