//! Locks that outlive a panic elsewhere.
//!
//! Place in the flow: wherever threads share something that is whole between any two statements.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks; what a thread that panicked left is taken as it is.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
