//! What the system tests share: the program under test, the files it works on, and a network of their own.
//!
//! Place in the flow: these tests see only what a user sees: the `abbe` command, its files, its topics and its
//! shared memory. Nothing here reaches into the crates behind it, except for reading bags and message types.

#![allow(dead_code)] // Every test program uses another part.

pub(crate) mod attack;
pub(crate) mod clock;
pub(crate) mod dds;
pub(crate) mod files;
pub(crate) mod graph;
pub(crate) mod hosts;
pub(crate) mod printed;
pub(crate) mod program;
pub(crate) mod python;
pub(crate) mod spoil;
pub(crate) mod watched;

#[path = "../../../nodes/runtime/tests/common/network.rs"]
pub(crate) mod network;
#[path = "../../../nodes/runtime/tests/common/peer.rs"]
pub(crate) mod peer;

/// Asserts that a text says all of this.
#[track_caller]
pub(crate) fn assert_says(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "{text:?} does not say {part:?}");
    }
}
