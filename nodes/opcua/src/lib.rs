//! OPC UA, as far as a source of scale readings and covariates needs it: a client that runs on a thread of its own ([`client`]),
//! units as servers name them ([`units`]), and how values of several nodes become samples of one instant ([`join`]); and a small
//! server for rehearsals ([`server`]).
//!
//! Place in the flow: under the driver `opcua` of `abbe-graph`. The one crate that knows the library for the protocol, and that
//! its futures are driven by a scheduler: nothing of either is seen from outside.

pub mod client;
mod cnc;
pub mod join;
mod log;
pub mod node;
pub mod server;
mod session;
pub mod units;
