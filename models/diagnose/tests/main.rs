//! What is found in simulated campaigns, in those of a simulator of somebody else, and in runs, vectors and plates.
//! One program: what these share is compiled once.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

#[path = "common/bridge.rs"]
mod bridge;
mod common;
mod diagnosis;
mod foreign;
mod honest;
#[path = "common/logger.rs"]
mod logger;
mod periods;
#[path = "common/records.rs"]
mod records;
#[path = "common/screw.rs"]
mod screw;
#[path = "common/seeds.rs"]
mod seeds;
mod steps;
mod study_five_axis_simulated;
mod study_five_axis_zhang;
mod study_instrument;
mod study_plates;
mod study_runs;
mod study_runs_measured;
mod study_steps;
mod study_unseen;
mod study_vectors;
mod study_vectors_measured;
mod study_waves;
