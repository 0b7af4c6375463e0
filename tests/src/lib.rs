//! What the whole-system tests share: the rules of the workspace.
//!
//! Place in the flow: beside it. Nothing depends on this crate; `tests/tests/*.rs` call it. The rules are functions
//! of text or of a graph, so that each is shown to catch a violation (unit tests here) before it is held against
//! the real workspace (`tests/tests/invariants.rs`).

// Only tests call this crate: what goes wrong here is a failed test, with its reason.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

pub mod dependencies;
pub mod documents;
pub mod links;
pub mod mutual;
pub mod named;
pub mod registry;
pub mod rules;
pub mod source;
pub mod workspace;
