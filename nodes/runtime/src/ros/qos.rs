//! The quality of service of every topic, in one place. The library's own defaults (best effort,
//! depth 1) are used nowhere.
//!
//! | use | reliability | durability | history |
//! |---|---|---|---|
//! | streams of samples and standard messages, as offered | reliable, never waits | volatile | keep last `depth` |
//! | the same, as our own nodes ask for them | best effort | volatile | keep last `depth` |
//! | `/diagnostics` | reliable, never waits | volatile | keep last 10 |
//! | services | reliable, never waits | volatile | keep last 10 |
//! | `/rosout` | reliable, never waits | transient local, for 10 s | keep last 1000 |
//! | messages that stand | reliable, never waits | transient local | keep last 1 |
//!
//! What is offered as reliable matches subscribers of either kind. A reliable reader that dies would hold up the
//! library's writer until its lease ends (measured: 40 s at 1 kHz); [`super::writer`] sees to it that none does. History
//! is never "keep all": such readers hold 64 samples.

use std::num::NonZeroUsize;
use std::time::Duration;

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Liveliness, Reliability, WhenFull};

const EVENT_DEPTH: usize = 10;
/// Changes of parameters that are kept.
const PARAMETER_EVENTS: usize = 1000;
const LOG_DEPTH: usize = 1000;
/// How long a line is kept for who joins later.
const LOG_LIVES: Duration = Duration::from_secs(10);

/// Streams of samples, as they are offered: reliable, the newest `depth`.
#[must_use]
pub fn offered_qos(depth: NonZeroUsize) -> QosProfile {
    profile(NEVER_WAITS, depth.get())
}

/// Streams of samples, as our own nodes ask for them: best effort, the newest `depth`.
#[must_use]
pub fn stream_qos(depth: NonZeroUsize) -> QosProfile {
    profile(Reliability::BestEffort, depth.get())
}

/// `/diagnostics`: as ROS 2 tools ask for it.
#[must_use]
pub fn diagnostics_qos() -> QosProfile {
    profile(NEVER_WAITS, EVENT_DEPTH)
}

/// A message that stands, such as the description of a robot: whoever joins later gets it as well.
#[must_use]
pub fn latched_qos() -> QosProfile {
    QosProfile { durability: Durability::TransientLocal, ..profile(NEVER_WAITS, 1) }
}

/// The log of a node: as ROS 2 has it.
#[must_use]
pub fn rosout_qos() -> QosProfile {
    let durability = Durability::TransientLocal;
    QosProfile { durability, lifespan: Some(LOG_LIVES), ..profile(NEVER_WAITS, LOG_DEPTH) }
}

/// Requests and replies of services.
#[must_use]
pub fn service_qos() -> QosProfile {
    profile(NEVER_WAITS, EVENT_DEPTH)
}

/// `/parameter_events`: as ROS 2 has it.
pub(super) fn parameter_events_qos() -> QosProfile {
    profile(NEVER_WAITS, PARAMETER_EVENTS)
}

/// A full window of unacknowledged samples is an error at once, not a wait.
pub(super) const NEVER_WAITS: Reliability = Reliability::Reliable { when_full: WhenFull::Fail };

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
