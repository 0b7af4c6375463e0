//! What a user sees of graphs that run live, end to end: in one program, and beside nothing that takes a core for long.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;
mod connect;
mod interop;
mod live_loop;
mod present;
mod proxy;
mod publishers;
mod realtime;
mod recording;
mod ros2;
mod ros_driver;
mod scene;
mod shipped;
