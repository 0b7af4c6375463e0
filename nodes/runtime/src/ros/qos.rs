//! The quality of service of every topic, in one place. The library's own defaults (best effort,
//! depth 1) are used nowhere.
//!
//! | use | reliability | durability | history |
//! |---|---|---|---|
//! | streams of samples, standard messages | best effort | volatile | keep last `depth` |
//! | `/diagnostics` | reliable, never waits | volatile | keep last 10 |
//! | services | reliable, never waits | volatile | keep last 10 |
//!
//! Streams go best effort because a reliable reader that dies holds up a reliable writer until its
//! lease ends (measured: 40 s at 1 kHz). History is never "keep all": such readers hold 64 samples.

use std::num::NonZeroUsize;

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Liveliness, Reliability, WhenFull};

const EVENT_DEPTH: usize = 10;

/// Streams of samples: best effort, the newest `depth`.
#[must_use]
pub fn stream_qos(depth: NonZeroUsize) -> QosProfile {
    profile(Reliability::BestEffort, depth.get())
}

/// `/diagnostics`: as ROS 2 tools ask for it.
#[must_use]
pub fn diagnostics_qos() -> QosProfile {
    profile(NEVER_WAITS, EVENT_DEPTH)
}

/// Requests and replies of services.
#[must_use]
pub fn service_qos() -> QosProfile {
    profile(NEVER_WAITS, EVENT_DEPTH)
}

/// A full window of unacknowledged samples is an error at once, not a wait.
const NEVER_WAITS: Reliability = Reliability::Reliable { when_full: WhenFull::Fail };

fn profile(reliability: Reliability, depth: usize) -> QosProfile {
    QosProfile {
        reliability,
        durability: Durability::Volatile,
        history: History::KeepLast { depth },
        deadline: None,
        lifespan: None,
        liveliness: Liveliness::Automatic,
        liveliness_lease: None,
    }
}
