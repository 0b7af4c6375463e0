//! This project's messages as ROS 2 sees them, field by field in the order of `msg/*.msg`.
//!
//! Place in the flow: what DDS and bags carry, in CDR. Nodes work with [`crate::types`]; these
//! structs only cross the border. Units and frames as in the `.msg` files. A test decodes each of
//! them by the text of its `.msg` file, so that the two cannot drift apart.

use serde::{Deserialize, Serialize};

use crate::{RosType, standard::Header};

/// One latching of the machine's scales.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ScaleReading {
    /// Stamp: instant of latching; `frame_id`: machine frame.
    pub header: Header,
    /// Counts the latchings of one source from 0.
    pub sequence: u64,
    /// Indicated position of the axes in metres.
    pub reading_m: [f64; 3],
    /// Reflector or tip relative to the ram reference point in metres, ram frame.
    pub offset_m: [f64; 3],
    /// Names of the covariates, unit as suffix.
    pub covariate_names: Vec<String>,
    /// Values, in the unit of the suffix.
    pub covariate_values: Vec<f64>,
    /// Age of each value at the instant of latching, in seconds.
    pub covariate_age_s: Vec<f64>,
}

impl RosType for ScaleReading {
    const ROS_TYPE: &'static str = "abbe_msgs/msg/ScaleReading";
}

/// One reading of a laser tracer.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TracerReading {
    /// Stamp: instant of latching; `frame_id`: machine frame.
    pub header: Header,
    /// Counts the readings of one source from 0.
    pub sequence: u64,
    /// Name of the station the tracer stands on.
    pub station: String,
    /// Run of points measured in one go; empty when not part of a campaign.
    pub line: String,
    /// Length in metres relative to the station's first reading.
    pub length_m: f64,
    /// Standard uncertainty (k = 1) of `length_m` in metres.
    pub u_length_m: f64,
}

impl RosType for TracerReading {
    const ROS_TYPE: &'static str = "abbe_msgs/msg/TracerReading";
}

/// The actual position of the reflector or tip.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CorrectedCoordinates {
    /// Stamp of the scale reading; `frame_id`: machine frame.
    pub header: Header,
    /// Sequence of the scale reading.
    pub sequence: u64,
    /// Indicated position of the axes in metres.
    pub reading_m: [f64; 3],
    /// Reflector or tip relative to the ram reference point in metres, ram frame.
    pub offset_m: [f64; 3],
    /// Correction of the rigid-body errors, in metres.
    pub geometric_correction_m: [f64; 3],
    /// Correction of the effects beyond geometry, in metres.
    pub effect_correction_m: [f64; 3],
    /// Correction by the residual field, in metres.
    pub residual_correction_m: [f64; 3],
    /// Whether `corrected_m` is a corrected position.
    pub corrected_valid: bool,
    /// Actual position in metres.
    pub corrected_m: [f64; 3],
    /// Covariance of `corrected_m` in m², row-major.
    pub covariance_m2: [f64; 9],
    /// Number of the [`crate::CorrectionStatus`].
    pub status: u8,
    /// SHA-256 of the geometric model; zeros when none.
    pub model_sha256: [u8; 32],
    /// SHA-256 of the residual model; zeros when none.
    pub residual_model_sha256: [u8; 32],
}

impl RosType for CorrectedCoordinates {
    const ROS_TYPE: &'static str = "abbe_msgs/msg/CorrectedCoordinates";
}

/// Measured minus predicted range of one tracer reading.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RangeResidual {
    /// Stamp of the tracer reading; `frame_id`: machine frame.
    pub header: Header,
    /// Sequence of the tracer reading.
    pub sequence: u64,
    /// Name of the station.
    pub station: String,
    /// Whether anything could be predicted.
    pub residual_valid: bool,
    /// Length the tracer measured, in metres.
    pub measured_length_m: f64,
    /// Predicted length in metres.
    pub predicted_length_m: f64,
    /// Measured minus predicted, in metres.
    pub residual_m: f64,
    /// Standard uncertainty (k = 1) of `residual_m` in metres.
    pub u_residual_m: f64,
    /// Number of the [`crate::ResidualStatus`].
    pub status: u8,
    /// SHA-256 of the model that predicted; zeros when none.
    pub model_sha256: [u8; 32],
}

impl RosType for RangeResidual {
    const ROS_TYPE: &'static str = "abbe_msgs/msg/RangeResidual";
}
