//! What `abbe launch` tells the service manager (systemd, or whoever else set `NOTIFY_SOCKET`): ready, alive, stopping.
//!
//! Place in the flow: beside the supervisor's loop. Alive means that the correcting chain is: every source and correcting
//! node runs, has been ready, and turns its loop. A chain that does not for longer than `WatchdogSec=` is started anew by
//! the service manager. Without one, nothing here does anything.

use sd_notify::NotifyState;
use std::time::{Duration, Instant};

/// Words to the service manager.
pub(crate) struct ServiceManager {
    /// Half of the time after which the service manager takes the chain for dead; none where it does not watch.
    every: Option<Duration>,
    is_ready: bool,
    was_healthy: Option<bool>,
    told_at: Option<Instant>,
}

impl ServiceManager {
    /// That of the environment.
    pub(crate) fn from_environment() -> ServiceManager {
        let every = sd_notify::watchdog_enabled().map(|limit| limit / 2);
        ServiceManager { every, is_ready: false, was_healthy: None, told_at: None }
    }

    /// Tells how the chain is, as often as that is wanted.
    pub(crate) fn tell(&mut self, is_healthy: bool) {
        if is_healthy && !self.is_ready {
            self.is_ready = true;
            say(&[NotifyState::Ready]);
        }
        if self.is_ready && self.was_healthy != Some(is_healthy) {
            self.was_healthy = Some(is_healthy);
            say(&[NotifyState::Status(match is_healthy {
                true => "correcting",
                false => "a node of the correcting chain does not run, or hangs",
            })]);
        }
        let Some(every) = self.every else { return };
        if is_healthy && self.told_at.is_none_or(|at| at.elapsed() >= every) {
            self.told_at = Some(Instant::now());
            say(&[NotifyState::Watchdog]);
        }
    }

    /// Tells that the chain stops.
    pub(crate) fn stopping(&self) {
        say(&[NotifyState::Stopping]);
    }
}

fn say(state: &[NotifyState]) {
    // Without a service manager this does nothing; one that does not listen is no reason to stop correcting.
    if let Err(error) = sd_notify::notify(state) {
        tracing::warn!(%error, "the service manager cannot be told");
    }
}
