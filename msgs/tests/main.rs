//! Messages: their definitions, their bytes, and bags that others read.
//! One program: what these share is compiled once.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod arbitrary_bytes;
mod bags;
mod common;
mod definitions;
mod interop;
mod round_trips;
mod validation;
