//! What a user sees of the whole project, end to end: one program, so that tests that wait leave the cores to others.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod bad_input;
mod calibrations;
mod capture;
mod capture_drive;
mod capture_opcua;
mod capture_ros;
mod common;
mod connect;
mod demo;
mod diagnose;
mod documents;
mod faults;
mod formats;
mod interop;
mod leftovers;
mod live_loop;
mod plan;
mod positions;
mod present;
mod proxy;
mod publishers;
mod recording;
mod replay;
mod reports;
mod ros2;
mod ros_driver;
mod scene;
mod secured;
mod shipped;
mod study_models;
mod zenoh;
