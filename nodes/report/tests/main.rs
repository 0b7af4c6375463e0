//! Reports: what they show, in a browser and as PDF.
//! One program: what these share is compiled once.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod any_numbers;
mod browser;
mod common;
mod diagnosis;
mod pdf;
mod report;
