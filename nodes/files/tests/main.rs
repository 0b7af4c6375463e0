//! Files of every kind: whole, spoilt, and read back by what they are for.
//! One program: what these share is compiled once.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod arbitrary_bytes;
mod campaign_bad_input;
mod common;
mod conformity_files;
mod controllers;
mod exported_volume;
mod exports;
mod machine_bad_input;
mod mangled;
mod model_files;
mod points;
mod recorded_plan;
mod residual_files;
mod shipped_machines;
mod study_files;
