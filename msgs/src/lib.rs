//! ROS 2 messages, shared-memory samples, CDR, and rosbag2-readable MCAP bags.
//!
//! Place in the flow: every value that passes between nodes, hosts, recordings and other programs
//! is defined here and nowhere else. Nodes depend on this crate; it depends on no model.
//!
//! - `msg/*.msg` are the one definition; [`definition`] embeds their text for bags.
//! - [`types`] are the same messages as plain data of fixed size, for the correcting thread and
//!   for shared memory (iceoryx2).
//! - [`ros`] and [`standard`] are the same messages as ROS 2 sees them, field by field; a test
//!   decodes them by the text of the `.msg` files.
//! - [`type_description`] is what a message is made of, and its RIHS01 hash.
//! - [`cdr`] turns the ROS types into bytes and back; [`bag`] records and reads them.
//!
//! Units are SI, angles are radians, frames are named in `header.frame_id` (REP-103).

// The tests inside this crate share the samples of the tests beside it.
#[cfg(test)]
extern crate self as abbe_msgs;
#[cfg(test)]
#[path = "../tests/common/mod.rs"]
mod test_samples;

pub mod bag;
pub mod cdr;
pub mod definition;
mod error;
mod message;
pub mod ros;
pub mod standard;
pub mod type_description;
pub mod types;

pub use error::{CovariateError, MessageError, TextError};
pub use message::{Message, RosType};
pub use types::{
    COVARIATE_CAPACITY, COVARIATE_NAME_CAPACITY, CorrectedCoordinates, CorrectionStatus, Covariate, Covariates,
    RangeResidual, ResidualStatus, ScaleReading, Sha256, Stamp, Text, TracerReading,
};
