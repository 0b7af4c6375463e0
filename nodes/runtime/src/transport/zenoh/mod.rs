//! The transport over Zenoh, to programs of ROS 2 on rmw_zenoh: for plants, Wi-Fi and hosts that multicast does not reach.
//!
//! Place in the flow: beside DDS, in gateways. Topics alone, with rmw_zenoh's key expressions, CDR, type hashes, attachments
//! and liveliness tokens; services, parameters and the lifecycle stay with DDS. Whom a session meets, TLS and who may do
//! what is the matter of its configuration and of the router, an ordinary `zenohd`.
//!
//! | part | does |
//! |---|---|
//! | `config` | rmw_zenoh's environment: how the session is set up |
//! | `keys` | names of topics and of liveliness tokens |
//! | `attachment` | who sent a sample, and its number |
//! | `graph` | publishers and subscribers there are |
//! | `session` | opens it all |
//! | `inbox` | what has arrived and is not taken yet |
//!
//! The library is there where this was built with the feature `zenoh`. Without it a session is refused with words that say
//! how to build it (`absent`).

#[cfg(feature = "zenoh")]
mod attachment;
#[cfg(feature = "zenoh")]
mod config;
#[cfg(feature = "zenoh")]
mod graph;
#[cfg(feature = "zenoh")]
mod inbox;
#[cfg(feature = "zenoh")]
mod keys;
#[cfg(feature = "zenoh")]
mod publisher;
#[cfg(feature = "zenoh")]
mod session;
#[cfg(feature = "zenoh")]
mod subscriber;

#[cfg(not(feature = "zenoh"))]
mod absent;

#[cfg(not(feature = "zenoh"))]
pub use absent::{ZenohConfig, ZenohPublisher, ZenohSession, ZenohSubscriber};
#[cfg(feature = "zenoh")]
pub use config::ZenohConfig;
#[cfg(feature = "zenoh")]
pub use publisher::ZenohPublisher;
#[cfg(feature = "zenoh")]
pub use session::ZenohSession;
#[cfg(feature = "zenoh")]
pub use subscriber::ZenohSubscriber;

/// Whether the library is there.
pub const IS_BUILT: bool = cfg!(feature = "zenoh");
