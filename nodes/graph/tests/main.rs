//! Nodes: drivers, steps, swaps and what a launch file makes of them.
//! One program: what these share is compiled once.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod ages;
#[path = "../../ippdme/tests/cmm/mod.rs"]
mod cmm;
mod common;
mod diagnosis;
mod drivers;
#[path = "../../ippdme/tests/cmm/errors.rs"]
mod errors;
mod ippdme;
mod launch;
mod lines;
mod linuxcnc;
#[cfg(feature = "opcua")]
mod opcua;
#[cfg(feature = "opcua")]
#[path = "../../opcua/tests/peer/mod.rs"]
mod peer;
mod residual_swap;
mod ros_driver;
mod serial;
mod steps;
mod supervision;
mod swap;
#[path = "../../ippdme/tests/cmm/tcp.rs"]
mod tcp;
