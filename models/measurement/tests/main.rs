//! Instruments: distances from nothing but counts, and what is stated against what comes out.
//! One program: what these share is compiled once.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod absolute;
mod stated;
