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

/// Most candidates of which columns are kept.
const MOST: usize = 64;

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

/// All that is remembered.
#[derive(Debug, Default)]
pub(super) struct Memory {
    pub(super) start: OnceLock<Arc<Start>>,
    pub(super) based: OnceLock<Arc<Based>>,
    columns: Mutex<BTreeMap<usize, Arc<Mat<f64>>>>,
    noises: BTreeMap<(usize, Vec<usize>), Noise>,
}

impl Memory {
    /// Columns of a candidate.
    pub(super) fn columns(&self, candidate: usize, make: impl FnOnce() -> Mat<f64>) -> Arc<Mat<f64>> {
        if let Some(found) = self.columns.lock().ok().and_then(|all| all.get(&candidate).cloned()) {
            return found;
        }
        let made = Arc::new(make());
        if let Ok(mut all) = self.columns.lock() {
            if all.len() >= MOST {
                all.clear();
            }
            all.insert(candidate, Arc::clone(&made));
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

    /// After columns of a candidate became others.
    pub(super) fn forget_columns(&mut self) {
        self.columns = Mutex::default();
        self.noises.clear();
    }
}
