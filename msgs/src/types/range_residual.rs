//! Measured minus predicted range of one tracer reading: `abbe_msgs/msg/RangeResidual`.
//!
//! Place in the flow: `monitor` node -> whoever watches the machine's health. Lengths in metres.

use iceoryx2::prelude::ZeroCopySend;

use super::{NAME_CAPACITY, Sha256, Stamp, Text, checks};
use crate::{Message, MessageError, RosType, ros, standard::Header};

/// What the monitor makes of a residual.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, ZeroCopySend)]
#[type_name("abbe/ResidualStatus")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub enum ResidualStatus {
    /// Within the bounds of the declared uncertainty.
    Consistent = 0,
    /// The single residual exceeds its bounds.
    OutOfBounds = 1,
    /// The model has no such station; nothing predicted.
    UnknownStation = 2,
    /// The corrected sample of that instant is not valid; nothing predicted.
    NotCorrected = 3,
    /// The sample lacks what an effect of the model depends on; nothing predicted.
    NotPredicted = 4,
    /// The frame is empty or not that of the model's machine; nothing predicted.
    OtherFrame = 5,
    /// Several publishers are mixed on a topic; nothing predicted.
    SeveralSources = 6,
    /// A stamp does not follow that of the sample before; nothing predicted.
    OutOfOrder = 7,
}

impl ResidualStatus {
    /// All statuses, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::Consistent,
        Self::OutOfBounds,
        Self::UnknownStation,
        Self::NotCorrected,
        Self::NotPredicted,
        Self::OtherFrame,
        Self::SeveralSources,
        Self::OutOfOrder,
    ];

    /// Name of the constant in the `.msg` file, without `STATUS_`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Consistent => "CONSISTENT",
            Self::OutOfBounds => "OUT_OF_BOUNDS",
            Self::UnknownStation => "UNKNOWN_STATION",
            Self::NotCorrected => "NOT_CORRECTED",
            Self::NotPredicted => "NOT_PREDICTED",
            Self::OtherFrame => "OTHER_FRAME",
            Self::SeveralSources => "SEVERAL_SOURCES",
            Self::OutOfOrder => "OUT_OF_ORDER",
        }
    }
}

impl TryFrom<u8> for ResidualStatus {
    type Error = MessageError;

    fn try_from(value: u8) -> Result<Self, MessageError> {
        Self::ALL.get(usize::from(value)).copied().ok_or(MessageError::UnknownStatus {
            message: ros::RangeResidual::ROS_TYPE,
            value,
            highest: Self::OutOfOrder as u8,
        })
    }
}

/// One comparison of the instrument with the model.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("abbe/RangeResidual/84f4d7de")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub struct RangeResidual {
    /// Stamp of the tracer reading.
    pub stamp: Stamp,
    /// Sequence of the tracer reading.
    pub sequence: u64,
    /// Length the tracer measured, in metres.
    pub measured_length_m: f64,
    /// Length from the corrected coordinates, the station and its dead path, in metres; 0 when
    /// not `residual_valid`.
    pub predicted_length_m: f64,
    /// Measured minus predicted, in metres; 0 when not `residual_valid`. See
    /// [`RangeResidual::residual`].
    pub residual_m: f64,
    /// Standard uncertainty (k = 1) of `residual_m`, in metres; 0 when not `residual_valid`.
    pub u_residual_m: f64,
    /// SHA-256 of the model that predicted.
    pub model_sha256: Sha256,
    /// Name of the machine frame.
    pub frame_id: Text<NAME_CAPACITY>,
    /// Name of the station.
    pub station: Text<NAME_CAPACITY>,
    /// Whether anything could be predicted.
    pub residual_valid: bool,
    /// What the monitor makes of it.
    pub status: ResidualStatus,
}

impl RangeResidual {
    /// Residual and its standard uncertainty (k = 1) in metres, if a range could be predicted.
    #[must_use]
    pub fn residual(&self) -> Option<(f64, f64)> {
        self.residual_valid.then_some((self.residual_m, self.u_residual_m))
    }

    fn check_status(&self) -> Result<(), MessageError> {
        let predicted = matches!(self.status, ResidualStatus::Consistent | ResidualStatus::OutOfBounds);
        if predicted == self.residual_valid {
            return Ok(());
        }
        Err(MessageError::Contradiction {
            field: "residual_valid",
            status: self.status.name(),
            reason: if predicted { "a verdict needs a residual" } else { "nothing could be predicted" },
        })
    }
}

impl Message for RangeResidual {
    type Ros = ros::RangeResidual;

    fn to_ros(&self) -> ros::RangeResidual {
        ros::RangeResidual {
            header: Header::new(self.stamp, self.frame_id.as_str()),
            sequence: self.sequence,
            station: self.station.to_string(),
            residual_valid: self.residual_valid,
            measured_length_m: self.measured_length_m,
            predicted_length_m: self.predicted_length_m,
            residual_m: self.residual_m,
            u_residual_m: self.u_residual_m,
            status: self.status as u8,
            model_sha256: self.model_sha256.to_bytes(),
        }
    }

    fn from_ros(ros: ros::RangeResidual) -> Result<Self, MessageError> {
        let sample = Self {
            stamp: ros.header.stamp.to_stamp()?,
            sequence: ros.sequence,
            measured_length_m: ros.measured_length_m,
            predicted_length_m: ros.predicted_length_m,
            residual_m: ros.residual_m,
            u_residual_m: ros.u_residual_m,
            model_sha256: Sha256::from_bytes(ros.model_sha256),
            frame_id: checks::to_text("header.frame_id", &ros.header.frame_id)?,
            station: checks::to_text("station", &ros.station)?,
            residual_valid: ros.residual_valid,
            status: ResidualStatus::try_from(ros.status)?,
        };
        sample.validate()?;
        Ok(sample)
    }

    fn validate(&self) -> Result<(), MessageError> {
        checks::stamp(self.stamp)?;
        checks::text("header.frame_id", &self.frame_id)?;
        checks::text("station", &self.station)?;
        self.check_status()?;
        checks::finite("measured_length_m", &[self.measured_length_m])?;
        checks::finite("predicted_length_m", &[self.predicted_length_m])?;
        checks::finite("residual_m", &[self.residual_m])?;
        checks::uncertainty("u_residual_m", self.u_residual_m)
    }

    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn sequence(&self) -> u64 {
        self.sequence
    }
}
