//! What a view of a study remembers between fits, so that no step of a search computes it again.
//!
//! Place in the flow: beside the rows of a [`super::view::View`]. The base model and columns of candidates are the same in
//! every fit of a linear study; the base model's fit is, until the noise is another. The noise that a chain is left with
//! hangs on no more than the columns that act on it: its restricted likelihood is free of what they hold of the rows.

use super::series::Noise;
use crate::linear::Linear;
use faer::Mat;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};

/// Most numbers kept in columns (64 MiB). What comes later is made anew each time: taking it in for what is kept would have all made anew
/// in a search that goes through more than that in one order.
const MOST: usize = 1 << 23;

/// The base model and the rows, not whitened.
#[derive(Debug)]
pub(super) struct Start {
    /// Where columns of candidates are taken.
    pub(super) point: Vec<f64>,
    /// Columns that do not depend on each other.
    pub(super) base: Mat<f64>,
    pub(super) rows: Mat<f64>,
}

/// The fit of the base model alone, in the noise of the view.
#[derive(Debug)]
pub(super) struct Based {
    pub(super) linear: Linear,
    /// Whitened rows.
    pub(super) observed: Mat<f64>,
}

/// Columns of candidates, and how many numbers these are.
#[derive(Debug, Default)]
struct Columns {
    of: BTreeMap<usize, Arc<Mat<f64>>>,
    numbers: usize,
}

fn numbers(columns: &Mat<f64>) -> usize {
    columns.nrows() * columns.ncols()
}

/// All that is remembered.
#[derive(Debug, Default)]
pub(super) struct Memory {
    pub(super) start: OnceLock<Arc<Start>>,
    pub(super) based: OnceLock<Arc<Based>>,
    columns: Mutex<Columns>,
    noises: BTreeMap<(usize, Vec<usize>), Noise>,
}

impl Memory {
    /// Columns of a candidate.
    pub(super) fn columns(&self, candidate: usize, make: impl FnOnce() -> Mat<f64>) -> Arc<Mat<f64>> {
        if let Some(found) = self.columns.lock().ok().and_then(|kept| kept.of.get(&candidate).cloned()) {
            return found;
        }
        let made = Arc::new(make());
        if let Ok(mut kept) = self.columns.lock()
            && kept.numbers + numbers(&made) <= MOST
            && kept.of.insert(candidate, Arc::clone(&made)).is_none()
        {
            kept.numbers += numbers(&made);
        }
        made
    }

    /// Noise of a chain beside the candidates that act on it, in ascending order.
    pub(super) fn noise(&self, chain: usize, beside: &[usize]) -> Option<&Noise> {
        self.noises.get(&(chain, beside.to_vec()))
    }

    pub(super) fn keep_noise(&mut self, chain: usize, beside: Vec<usize>, noise: &Noise) {
        self.noises.insert((chain, beside), noise.clone());
    }

    /// After the noise of the view became another.
    pub(super) fn forget_fit(&mut self) {
        self.based = OnceLock::new();
    }

    /// After columns of this candidate became others.
    pub(super) fn forget_columns(&mut self, candidate: usize) {
        if let Ok(kept) = self.columns.get_mut() {
            kept.numbers -= kept.of.remove(&candidate).map_or(0, |columns| numbers(&columns));
        }
        self.noises.retain(|(_, beside), _| !beside.contains(&candidate));
    }
}
