//! The time that a node goes by: the system's, or with `use_sim_time` that of `/clock`.
//!
//! Place in the flow: asked for the stamps of `/diagnostics`, for what is ahead of the clock, and for the stamps of
//! sources. The gateway hears `/clock` (`rosgraph_msgs/msg/Clock`) and tells its node. Steps read no clock, this one
//! included.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use abbe_msgs::standard::Clock as ClockMessage;

/// The topic of simulated time.
pub(crate) const CLOCK_TOPIC: &str = "/clock";
/// Nothing has come on it.
const SILENT: i64 = i64::MIN;

/// What `/clock` says, since 1970 (ns).
pub(crate) fn nanos_of(message: ClockMessage) -> i64 {
    i64::from(message.clock.sec) * 1_000_000_000 + i64::from(message.clock.nanosec)
}

/// A clock. Clones show the same time.
#[derive(Debug, Clone, Default)]
pub struct Clock(Option<Arc<AtomicI64>>);

impl PartialEq for Clock {
    fn eq(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (Some(ours), Some(theirs)) => Arc::ptr_eq(ours, theirs),
            (ours, theirs) => ours.is_none() && theirs.is_none(),
        }
    }
}

impl Clock {
    /// The system's, which is the default.
    #[must_use]
    pub fn of_system() -> Clock {
        Clock(None)
    }

    /// That of `/clock`, on which nothing has come yet.
    #[must_use]
    pub fn simulated() -> Clock {
        Clock(Some(Arc::new(AtomicI64::new(SILENT))))
    }

    /// Whether it is that of `/clock`.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.0.is_some()
    }

    /// Since 1970 (ns); none where nothing has come on `/clock` yet, or the system's clock is before 1970.
    #[must_use]
    pub fn now_ns(&self) -> Option<i128> {
        match &self.0 {
            Some(simulated) => {
                let now = simulated.load(Ordering::Relaxed);
                (now != SILENT).then_some(i128::from(now))
            }
            None => {
                let since = SystemTime::now().duration_since(UNIX_EPOCH).ok()?;
                Some(i128::try_from(since.as_nanos()).unwrap_or(i128::MAX))
            }
        }
    }

    /// `/clock` says so.
    pub(crate) fn set(&self, nanos: i64) {
        if let Some(simulated) = &self.0 {
            simulated.store(nanos, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_msgs::standard::Time;

    #[test]
    fn simulated_time_is_what_the_topic_said_last_and_nothing_before() {
        let clock = Clock::simulated();
        let same = clock.clone();
        assert_eq!(clock.now_ns(), None);
        same.set(nanos_of(ClockMessage { clock: Time { sec: 7, nanosec: 5 } }));
        assert_eq!(clock.now_ns(), Some(7_000_000_005));
        same.set(0);
        assert_eq!(clock.now_ns(), Some(0), "a replay that starts again takes time back");
        Clock::of_system().set(5);
        assert!(Clock::of_system().now_ns().unwrap() > 1_600_000_000_000_000_000);
    }
}
