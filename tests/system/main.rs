//! What a user sees of the whole project, end to end: one program, so that tests that wait leave the cores to others. Graphs that run live are in `live.rs`,
//! beside nothing that takes a core for long; the faults are alone.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod answers;
mod bad_input;
mod calibrations;
mod capture;
mod capture_drive;
mod capture_opcua;
mod capture_ros;
mod common;
mod demo;
mod diagnose;
mod documents;
mod formats;
mod leftovers;
mod plan;
mod positions;
mod replay;
mod reports;
mod secured;
mod study_models;
mod terminal;
mod zenoh;
