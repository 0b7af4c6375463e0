//! What each node computes, as pure functions of samples and model: no clock, no transport, no file.
//!
//! Place in the flow: called by [`crate::node`] live and by [`crate::replay`] on a recording, so that both give the
//! same bytes.

mod asked;
mod geometric;
mod health;
mod joined;
mod lagged;
mod monitor;
mod motion;
mod pairs;
mod readings;
mod residual;
mod stream;

pub(crate) use asked::Scales;
pub(crate) use geometric::is_fresh;
pub use geometric::{GeometricStep, SampleCovariates, opposite_offset};
pub use health::{Health, HealthState, Unsound};
pub use joined::SensorMemory;
pub use lagged::DerivedLags;
pub use monitor::{MonitorSettings, MonitorStep};
pub use motion::DerivedMotion;
pub use readings::{KEPT_READINGS, ReadingBuffer};
pub use residual::{OwnedField, ResidualStep};
pub use stream::{Mark, REMARKED_STEP_S, StreamCounts, StreamWatch, Verdict};
