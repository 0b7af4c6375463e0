//! What is identified from simulated campaigns, and what is said of it.
//! One program: what these share is compiled once.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod accuracy;
mod bad_input;
mod bound;
mod common;
mod common_scale;
mod correlated_noise;
mod coverage;
mod foresee;
mod held;
mod jade;
mod nodes_coverage;
mod observability;
mod plates;
mod points;
mod robust;
mod unseen_expansion;
