//! The nodes: drivers, what each node computes, how it is wired, and the launcher that starts them.
//!
//! Place in the flow: `scale` and `tracer` publish what a [`driver`] gives; `geometric` and `residual` correct;
//! `monitor` compares predicted with measured range. What a node computes is a pure function in [`step`], the same
//! for live, replay and tests; [`node`] only wires it to transports. SI, machine frame.

mod again;
pub mod bag_campaign;
pub mod capture;
mod connecting;
pub mod diagnosis;
pub mod driver;
pub mod feed;
pub mod launch;
pub mod link;
pub mod node;
mod present;
pub mod proxy;
pub mod record;
pub mod replay;
pub mod scene;
pub mod serving;
pub mod step;
pub mod supervisor;
pub mod topics;
mod units;
