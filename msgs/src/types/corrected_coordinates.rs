//! The actual position of the reflector or tip: `abbe_msgs/msg/CorrectedCoordinates`.
//!
//! Place in the flow: `geometric` node -> `residual` node -> every user of corrected coordinates.
//! Positions and corrections in metres in the machine frame. Error = actual - indicated, so
//! corrected = indicated + offset + corrections.

use iceoryx2::prelude::ZeroCopySend;

use super::{NAME_CAPACITY, Sha256, Stamp, Text, checks};
use crate::{Message, MessageError, RosType, ros, standard::Header};

/// How far a corrected position may be trusted.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, ZeroCopySend)]
#[type_name("abbe/CorrectionStatus")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub enum CorrectionStatus {
    /// Inside the identified volume and offsets; the uncertainty holds.
    InVolume = 0,
    /// Outside the identified volume or offsets; the uncertainty is a lower bound.
    Extrapolated = 1,
    /// An effect of the model needs a covariate that the sample lacks.
    CovariateMissing = 2,
    /// A covariate or the sample is older than allowed.
    Stale = 3,
    /// The reading is not a number, or beyond the stroke by more than a quarter of it; not corrected.
    Rejected = 4,
    /// No model loaded; not corrected.
    NoModel = 5,
    /// The frame is empty or not that of the model's machine; not corrected.
    OtherFrame = 6,
    /// The samples of several publishers are mixed on the topic; not corrected.
    SeveralSources = 7,
    /// The stamp does not follow that of the sample before; corrected, but the instant is not to be trusted.
    OutOfOrder = 8,
    /// Another program publishes the topic as well; corrected, but not everything on the topic is of this corrector.
    OtherPublisher = 9,
    /// A correcting node is deactivated (its lifecycle); not corrected.
    Inactive = 10,
}

impl CorrectionStatus {
    /// All statuses, in the order of their numbers.
    pub const ALL: [Self; 11] = [
        Self::InVolume,
        Self::Extrapolated,
        Self::CovariateMissing,
        Self::Stale,
        Self::Rejected,
        Self::NoModel,
        Self::OtherFrame,
        Self::SeveralSources,
        Self::OutOfOrder,
        Self::OtherPublisher,
        Self::Inactive,
    ];

    /// Name of the constant in the `.msg` file, without `STATUS_`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::InVolume => "IN_VOLUME",
            Self::Extrapolated => "EXTRAPOLATED",
            Self::CovariateMissing => "COVARIATE_MISSING",
            Self::Stale => "STALE",
            Self::Rejected => "REJECTED",
            Self::NoModel => "NO_MODEL",
            Self::OtherFrame => "OTHER_FRAME",
            Self::SeveralSources => "SEVERAL_SOURCES",
            Self::OutOfOrder => "OUT_OF_ORDER",
            Self::OtherPublisher => "OTHER_PUBLISHER",
            Self::Inactive => "INACTIVE",
        }
    }

    /// The one of two that says worse of the position. What is said of the stream or of the topic weighs less than what is said of the
    /// position itself: one that is extrapolated or stale stays so.
    #[must_use]
    pub fn worse_of(self, other: Self) -> Self {
        let worth = |status: Self| match status {
            Self::InVolume => 0,
            Self::OtherPublisher => 1,
            Self::OutOfOrder => 2,
            Self::Extrapolated => 3,
            Self::CovariateMissing => 4,
            Self::Stale => 5,
            Self::Rejected | Self::NoModel | Self::OtherFrame | Self::SeveralSources | Self::Inactive => 6,
        };
        if worth(other) > worth(self) { other } else { self }
    }
}

impl TryFrom<u8> for CorrectionStatus {
    type Error = MessageError;

    fn try_from(value: u8) -> Result<Self, MessageError> {
        Self::ALL.get(usize::from(value)).copied().ok_or(MessageError::UnknownStatus {
            message: ros::CorrectedCoordinates::ROS_TYPE,
            value,
            highest: Self::Inactive as u8,
        })
    }
}

/// One corrected position, what it is made of, and how far to trust it.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("abbe/CorrectedCoordinates/d88709c3")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub struct CorrectedCoordinates {
    /// Stamp of the scale reading.
    pub stamp: Stamp,
    /// Sequence of the scale reading.
    pub sequence: u64,
    /// Indicated position of the axes in metres.
    pub reading_m: [f64; 3],
    /// Reflector or tip relative to the ram reference point in metres, ram frame.
    pub offset_m: [f64; 3],
    /// Correction of the rigid-body errors at the reflector or tip, in metres.
    pub geometric_correction_m: [f64; 3],
    /// Correction of the effects beyond geometry at the reflector or tip, in metres.
    pub effect_correction_m: [f64; 3],
    /// Correction by the residual field at the reflector or tip, in metres.
    pub residual_correction_m: [f64; 3],
    /// Actual position in metres when `corrected_valid`; see
    /// [`CorrectedCoordinates::corrected_point_in_machine_m`].
    pub corrected_m: [f64; 3],
    /// Covariance of `corrected_m` in m², row-major; zeros when not `corrected_valid`.
    pub covariance_m2: [f64; 9],
    /// SHA-256 of the geometric model.
    pub model_sha256: Sha256,
    /// SHA-256 of the residual model.
    pub residual_model_sha256: Sha256,
    /// Name of the machine frame.
    pub frame_id: Text<NAME_CAPACITY>,
    /// Whether `corrected_m` is a corrected position; otherwise it repeats the indicated one.
    pub corrected_valid: bool,
    /// How far to trust it.
    pub status: CorrectionStatus,
}

impl CorrectedCoordinates {
    /// The actual position in metres in the machine frame, if the reading was corrected.
    #[must_use]
    pub fn corrected_point_in_machine_m(&self) -> Option<[f64; 3]> {
        self.corrected_valid.then_some(self.corrected_m)
    }

    /// Covariance of the actual position in m², row-major, if the reading was corrected.
    #[must_use]
    pub fn covariance_of_corrected_m2(&self) -> Option<[f64; 9]> {
        self.corrected_valid.then_some(self.covariance_m2)
    }

    /// The same sample with nothing corrected: it repeats the indicated position, and `status` says why.
    #[must_use]
    pub fn withheld(self, status: CorrectionStatus) -> CorrectedCoordinates {
        CorrectedCoordinates {
            geometric_correction_m: [0.0; 3],
            effect_correction_m: [0.0; 3],
            residual_correction_m: [0.0; 3],
            corrected_m: std::array::from_fn(|d| self.reading_m[d] + self.offset_m[d]),
            covariance_m2: [0.0; 9],
            residual_model_sha256: Sha256::NONE,
            corrected_valid: false,
            status,
            ..self
        }
    }

    /// The same sample of a topic that another program publishes as well. What was not corrected, and what is doubtful in itself, says
    /// why already.
    #[must_use]
    pub fn beside_another_publisher(self) -> CorrectedCoordinates {
        CorrectedCoordinates { status: self.status.worse_of(CorrectionStatus::OtherPublisher), ..self }
    }

    /// The same sample of a node that is not active. What was not corrected says why already.
    #[must_use]
    pub fn while_inactive(self) -> CorrectedCoordinates {
        if self.corrected_valid { self.withheld(CorrectionStatus::Inactive) } else { self }
    }

    fn check_status(&self) -> Result<(), MessageError> {
        use CorrectionStatus::{
            CovariateMissing, Extrapolated, InVolume, Inactive, NoModel, OtherFrame, OtherPublisher, OutOfOrder,
            Rejected, SeveralSources, Stale,
        };
        let reason = match (self.status, self.corrected_valid) {
            (InVolume | Extrapolated | OutOfOrder | OtherPublisher, false) => "such a sample is corrected",
            (Rejected | NoModel | OtherFrame | SeveralSources | Inactive, true) => "such a sample is not corrected",
            (InVolume | Extrapolated | OutOfOrder | OtherPublisher, true)
            | (Rejected | NoModel | OtherFrame | SeveralSources | Inactive, false)
            | (CovariateMissing | Stale, _) => return Ok(()),
        };
        Err(MessageError::Contradiction { field: "corrected_valid", status: self.status.name(), reason })
    }
}

impl Message for CorrectedCoordinates {
    type Ros = ros::CorrectedCoordinates;

    fn to_ros(&self) -> ros::CorrectedCoordinates {
        ros::CorrectedCoordinates {
            header: Header::new(self.stamp, self.frame_id.as_str()),
            sequence: self.sequence,
            reading_m: self.reading_m,
            offset_m: self.offset_m,
            geometric_correction_m: self.geometric_correction_m,
            effect_correction_m: self.effect_correction_m,
            residual_correction_m: self.residual_correction_m,
            corrected_valid: self.corrected_valid,
            corrected_m: self.corrected_m,
            covariance_m2: self.covariance_m2,
            status: self.status as u8,
            model_sha256: self.model_sha256.to_bytes(),
            residual_model_sha256: self.residual_model_sha256.to_bytes(),
        }
    }

    fn from_ros(ros: ros::CorrectedCoordinates) -> Result<Self, MessageError> {
        let sample = Self {
            stamp: ros.header.stamp.to_stamp()?,
            sequence: ros.sequence,
            reading_m: ros.reading_m,
            offset_m: ros.offset_m,
            geometric_correction_m: ros.geometric_correction_m,
            effect_correction_m: ros.effect_correction_m,
            residual_correction_m: ros.residual_correction_m,
            corrected_m: ros.corrected_m,
            covariance_m2: ros.covariance_m2,
            model_sha256: Sha256::from_bytes(ros.model_sha256),
            residual_model_sha256: Sha256::from_bytes(ros.residual_model_sha256),
            frame_id: checks::to_text("header.frame_id", &ros.header.frame_id)?,
            corrected_valid: ros.corrected_valid,
            status: CorrectionStatus::try_from(ros.status)?,
        };
        sample.validate()?;
        Ok(sample)
    }

    fn validate(&self) -> Result<(), MessageError> {
        checks::stamp(self.stamp)?;
        checks::text("header.frame_id", &self.frame_id)?;
        self.check_status()?;
        // A sample that is not corrected repeats what the scales gave, which may be NaN.
        if self.corrected_valid {
            checks::finite("reading_m", &self.reading_m)?;
            checks::finite("offset_m", &self.offset_m)?;
            checks::finite("corrected_m", &self.corrected_m)?;
        }
        checks::finite("geometric_correction_m", &self.geometric_correction_m)?;
        checks::finite("effect_correction_m", &self.effect_correction_m)?;
        checks::finite("residual_correction_m", &self.residual_correction_m)?;
        checks::finite("covariance_m2", &self.covariance_m2)
    }

    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn sequence(&self) -> u64 {
        self.sequence
    }
}
