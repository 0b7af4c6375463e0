//! What the tests of the runtime share: samples, a network of their own, processes of their own.

#![allow(dead_code)] // Every test program uses another part.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

pub(crate) mod network;
pub(crate) mod peer;
pub(crate) mod samples;
