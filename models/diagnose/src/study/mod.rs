//! Diagnosis of measured data that come without a tracer's chain: sphere centres, positioning runs, residual vectors.
//!
//! Place in the flow: data in memory (SI) in, a [`StudyDiagnosis`] out; the same for all kinds. Each kind of data says
//! what its own model already has (base columns), which effects could be missing (candidates) and which rows were
//! measured together (blocks). The rest is common and stands on the crate's linear engine: candidates are tested as
//! groups with the base projected out ([`crate::score`]), in whatever noise the rows leave possible, corrected for their number after Holm, added one
//! after another where blocks left out are predicted better, and removed again where others take their place. Gross rows
//! are rejected and named before. The whole search is then judged on blocks that no step of it saw.

mod answer;
mod assemble;
mod beside;
mod between;
mod candidate;
mod combinations;
mod confirm;
mod contradictions;
mod display;
mod filters;
mod fit;
pub mod five_axis;
mod grid;
mod judge;
mod memory;
mod nested;
mod noise_words;
mod outcome;
mod outliers;
mod places;
mod placing;
mod reasons;
pub mod runs;
mod scatter_left;
mod scored;
mod search;
mod series;
mod significance;
mod smooth;
mod step;
mod terms;
mod together;
mod told;
mod two_lines;
pub mod vectors;
mod view;
mod waves;

pub use outcome::{
    Alternative, Ambiguity, Blocks, Considered, Correlation, Effect, HeldOutRms, Judgement, LackOfFit, LeftOver, Look,
    Parameter, RejectedRow, Rung, SeriesNoise, StudyDiagnosis, Unseen, Untestable,
};
pub use search::{Observe, Progress, StudyOptions};
pub use terms::{Term, Terms};
