//! What a plan promises, held against campaigns that follow it.
//! One program: what these share is compiled once.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod better;
mod common;
mod promise;
mod told;
