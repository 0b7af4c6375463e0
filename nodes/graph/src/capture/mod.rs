//! Capturing a campaign: from the streams of scales and tracer to one checked reading a point.
//!
//! Place in the flow: `abbe capture`. A plan says where readings are wanted; `run` waits for the drivers; [`Capturer`] finds the
//! standstills at planned points, averages, and holds each reading against those before; the journal of `abbe_files` keeps it. The
//! campaign that comes out is the one that `abbe identify` reads.

mod average;
mod campaign;
mod check;
mod config;
mod doubt;
mod drive;
mod fit;
mod planned;
mod run;
mod step;
#[cfg(test)]
mod tests;

pub use campaign::{CapturedCampaign, campaign_of};
pub use config::{
    CaptureConfig, CheckConfig, ConfigError, DriveConfig, LengthsConfig, PointsConfig, StandstillConfig, Takes,
};
pub use drive::preview;
pub use fit::{SoFar, Volume, identify_options, so_far};
pub use planned::{Place, Planned, PlannedLine, PlannedStation, SetUp};
pub use run::{CaptureError, Ending, Shown, capture, volume_of};
pub use step::{Capturer, Told};
