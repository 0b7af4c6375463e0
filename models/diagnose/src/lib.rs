//! Closing the loop: finds what a model lacks in measured data, traces it to an effect, adds it and judges the gain.
//!
//! Place in the flow: model and campaign (SI, machine frame) in, a diagnosis out: is the residual consistent with noise,
//! which effects were found and how surely, what cannot be told apart, and the model with the effects added. Pure: the
//! `abbe diagnose` command reads, reports and stores.
//!
//! What a machine lacks, from its campaign:
//!
//! ```no_run
//! use abbe_diagnose::{DiagnoseError, Options, diagnose};
//! use abbe_geometry::{machine::Machine, model::FittedEffect};
//! use abbe_measurement::{campaign::Campaign, instrument::RangeUncertainty};
//!
//! fn what_is_missing(machine: &Machine, tracer: RangeUncertainty, campaign: &Campaign) -> Result<(), DiagnoseError> {
//!     let none: &[FittedEffect] = &[];
//!     let diagnosis = diagnose(machine, none, tracer, campaign, &Options::default(), &mut |_progress| true)?;
//!     for found in &diagnosis.found {
//!         println!("{}: {:.1} µm", found.title, found.size_m * 1e6);
//!     }
//!     Ok(())
//! }
//! ```

mod alias;
mod candidates;
mod clock;
mod competing;
mod context;
mod cut_off;
mod diagnose;
mod diagnosis;
mod error;
mod exchange;
mod floor;
mod foresight;
mod gate;
pub mod held_out;
mod judge;
mod jumps;
mod lags;
pub mod linear;
mod logs;
mod look;
mod machine_step;
mod noise;
mod options;
mod order;
mod outdone;
mod paired;
mod pass;
mod periodic;
mod quadratic_form;
mod runs;
pub mod score;
mod search;
mod serial;
mod side_by_side;
mod step;
pub mod study;
mod taken;
mod together;
mod tomorrow;
mod wald;
mod wander;
mod within_stations;
mod worth;
mod zero_of_scale;

pub use clock::ClockShift;
pub use diagnose::diagnose;
pub use diagnosis::{Competing, Diagnosis, Found, FoundParameter, Kind, NotIdentifiable, Rival, SetAside, Untestable};
pub use error::DiagnoseError;
pub use foresight::{Foresight, Told, ToldParameter, foresee};
pub use gate::{Judged, Verdict};
pub use judge::{Blocked, HeldOutError, Placebo, Unseen};
pub use logs::mended;
pub use machine_step::{Change, MachineStep};
pub use noise::{Detection, Group, Structure};
pub use options::{Options, Progress};
pub use pass::{Scored, score_pass};
pub use wander::Wander;

#[cfg(test)]
mod tests;
