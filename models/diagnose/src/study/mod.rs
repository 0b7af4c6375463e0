//! Diagnosis of measured data that come without a tracer's chain: sphere centres, positioning runs, residual vectors.
//!
//! Place in the flow: data in memory (SI) in, a [`StudyDiagnosis`] out; the same for all kinds. Each kind of data says
//! what its own model already has (base columns), which effects could be missing (candidates) and which rows were
//! measured together (blocks). The rest is common and stands on the crate's linear engine: candidates are tested as
//! groups with the base projected out ([`crate::score`]), corrected for their number after Holm, added one after another
//! and removed again where others take their place, and judged on blocks that no fit saw ([`crate::held_out`]) against
//! placebos of the same flexibility. Nothing is claimed that fails one of these.

mod assemble;
mod candidate;
mod diagnosis;
mod fit;
pub mod five_axis;
mod judge;
mod placebo;
pub mod runs;
mod search;
mod smooth;
pub mod vectors;

pub use diagnosis::{
    Alternative, Ambiguity, Blocks, Considered, Effect, HeldOutRms, Judgement, Kind, LackOfFit, Parameter, Placebo,
    Rung, StudyDiagnosis, Untestable,
};
pub use search::Options;
