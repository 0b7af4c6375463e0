//! The trial bench: machines with a known flaw go in, how often it is detected and rightly named comes out.
//!
//! Place in the flow: a [`Scenario`] and a seed make a [`Trial`] (campaign, machine description, verification points,
//! all from the virtual machine); a [`Diagnoser`] is asked about its campaign alone; a [`Record`] holds what it found
//! beside what was there; [`summary`] counts. The effect's size is chosen by what it does to the verification error
//! ([`sizing`]), so that effects can be compared. Pure numerics; `examples/trials` runs it and keeps the files.

pub mod attribution;
pub mod description;
mod error;
pub mod record;
pub mod scenario;
pub mod score;
pub mod sizing;
pub mod statistics;
pub mod suite;
pub mod summary;
pub mod template;
pub mod trial;

pub use attribution::{Accepted, Finding};
pub use error::TrialError;
pub use record::Record;
pub use scenario::{Family, PlanKind, Scenario};
pub use trial::{Diagnoser, Trial, Verdict, run};
