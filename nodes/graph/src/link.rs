//! How a live driver stands with what it reads from: connected, silent or lost, and why.
//!
//! Place in the flow: the driver notes it as it happens, the source node puts it on `/diagnostics` from a thread of its own, so
//! that a driver that waits is told of all the same.

use std::sync::{Arc, Mutex, PoisonError};

/// How it stands.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum LinkState {
    /// Nothing has been reached yet.
    #[default]
    Waiting,
    /// Values come, from whom.
    Connected(String),
    /// Nothing has come for longer than was agreed.
    Silent(String),
    /// It is gone, and why; the driver tries again.
    Lost(String),
}

/// What is known of a link.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LinkStatus {
    /// How it stands.
    pub state: LinkState,
    /// So often it was lost.
    pub losses: u64,
    /// So many times something came that was no reading, or lacked a covariate that it should have.
    pub refused: u64,
    /// The last such thing in words.
    pub last_refusal: String,
    /// So many messages are known to have been lost on the way here.
    pub missed: u64,
}

/// The driver's and the node's hold on it.
#[derive(Debug, Clone, Default)]
pub struct Link(Arc<Mutex<LinkStatus>>);

impl Link {
    /// What is known now.
    pub fn status(&self) -> LinkStatus {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// So often it was lost, and so many messages were.
    pub(crate) fn losses(&self) -> (u64, u64) {
        let status = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        (status.losses, status.missed)
    }

    pub(crate) fn stands(&self, state: LinkState) {
        let mut status = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        status.losses += u64::from(matches!(state, LinkState::Lost(_)));
        status.state = state;
    }

    /// So many messages were lost on the way so far.
    pub(crate) fn missed(&self, so_far: u64) {
        let mut status = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        status.missed = status.missed.max(so_far);
    }

    pub(crate) fn refused(&self, words: String) {
        let mut status = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        status.refused += 1;
        status.last_refusal = words;
    }
}
