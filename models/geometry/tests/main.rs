//! The chain against its published form, and the error over a volume.
//! One program: what these share is compiled once.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod chain;
mod volumetric;
