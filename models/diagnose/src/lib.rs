//! Closing the loop: finds what a model lacks in measured data, traces it to an effect, adds it and judges the gain.
//!
//! Place in the flow: model and campaign (SI, machine frame) in, a diagnosis out: is the residual consistent with noise,
//! which effects were found and how surely, what cannot be told apart, and the model with the effects added. Pure: the
//! `abbe diagnose` command reads, reports and stores.

pub mod error;
pub mod held_out;
pub mod linear;
pub mod score;
pub mod study;

pub use error::DiagnoseError;
