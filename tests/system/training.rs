//! What a user sees of the whole project, end to end, where something is trained: one program, with `abbe` beside `abbe-train`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod broken_pipe;
mod common;
mod conformity;
mod contradictions;
mod outside;
mod points;
mod residual;
mod residual_inputs;
mod ros2_residual;
mod training_program;
