//! What is told about how a file is written: once, however often a command reads the file.
//!
//! Place in the flow: readers of tables tell here, as events of `tracing`.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

/// Notices that are remembered; further ones are told each time.
const REMEMBERED: usize = 1000;

static TOLD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// Tells a notice, unless it was told before.
pub(crate) fn tell_once(notice: String) {
    let mut told = TOLD.lock().unwrap_or_else(PoisonError::into_inner);
    if told.contains(&notice) {
        return;
    }
    tracing::info!("{notice}");
    if told.len() < REMEMBERED {
        told.insert(notice);
    }
}

/// What was told of a file, in the order of the words.
#[cfg(test)]
pub(crate) fn told_of(file: &str) -> Vec<String> {
    let told = TOLD.lock().unwrap_or_else(PoisonError::into_inner);
    told.iter().filter(|notice| notice.starts_with(file)).cloned().collect()
}
