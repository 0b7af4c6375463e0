//! The nodes: drivers, what each node computes, how it is wired, and the launcher that starts them.
//!
//! Place in the flow: `scale` and `tracer` publish what a [`driver`] gives; `geometric` and `residual` correct;
//! `monitor` compares predicted with measured range. What a node computes is a pure function in [`step`], the same
//! for live, replay and tests; [`node`] only wires it to transports. SI, machine frame.
//!
//! Nodes are for Linux. Elsewhere there are the steps, and what does offline with a bag what nodes did live.

#![cfg_attr(not(target_os = "linux"), allow(dead_code, unused_imports))] // what only nodes use

#[cfg(target_os = "linux")]
mod again;
pub mod bag_campaign;
#[cfg(target_os = "linux")]
pub mod capture;
#[cfg(target_os = "linux")]
mod connecting;
#[cfg(target_os = "linux")]
pub mod diagnosis_run;
#[cfg(target_os = "linux")]
pub mod driver;
#[cfg(target_os = "linux")]
pub mod feed;
#[cfg(target_os = "linux")]
pub mod launch;
#[cfg(target_os = "linux")]
pub mod link;
#[cfg(target_os = "linux")]
pub mod node;
#[cfg(target_os = "linux")]
mod present;
#[cfg(target_os = "linux")]
pub mod proxy;
#[cfg(target_os = "linux")]
pub mod record;
pub mod replay;
#[cfg(target_os = "linux")]
pub mod scene;
#[cfg(target_os = "linux")]
pub mod serving;
pub mod step;
#[cfg(target_os = "linux")]
pub mod supervisor;
pub mod topics;
#[cfg(target_os = "linux")]
mod units;
mod way;
