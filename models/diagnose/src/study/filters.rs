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
