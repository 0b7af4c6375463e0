//! One latching of the machine's scales: `abbe_msgs/msg/ScaleReading`.
//!
//! Place in the flow: driver -> `scale` node -> `geometric` node. Positions in metres in the
//! machine frame, the offset in metres in the ram frame.

use iceoryx2::prelude::ZeroCopySend;

use super::{Covariates, NAME_CAPACITY, Stamp, Text, checks};
use crate::{Message, MessageError, ros, standard::Header};

/// What the machine indicates, before any correction.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend)]
#[type_name("abbe/ScaleReading/faf89a05")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub struct ScaleReading {
    /// Instant of latching.
    pub stamp: Stamp,
    /// Counts the latchings of one source from 0; a gap is a lost sample.
    pub sequence: u64,
    /// Indicated position of the axes X, Y, Z in metres, machine frame. May be NaN when the driver
    /// had no value: the corrector answers such a reading with the status `Rejected`.
    pub reading_m: [f64; 3],
    /// Reflector or tip relative to the ram reference point in metres, ram frame.
    pub offset_m: [f64; 3],
    /// Temperatures and the like that an effect may need.
    pub covariates: Covariates,
    /// Name of the machine frame.
    pub frame_id: Text<NAME_CAPACITY>,
}

impl Message for ScaleReading {
    type Ros = ros::ScaleReading;

    fn to_ros(&self) -> ros::ScaleReading {
        let covariates = &self.covariates;
        ros::ScaleReading {
            header: Header::new(self.stamp, self.frame_id.as_str()),
            sequence: self.sequence,
            reading_m: self.reading_m,
            offset_m: self.offset_m,
            covariate_names: covariates.iter().map(|c| c.name.to_string()).collect(),
            covariate_values: covariates.iter().map(|c| c.value).collect(),
            covariate_age_s: covariates.iter().map(|c| c.age_s).collect(),
        }
    }

    fn from_ros(ros: ros::ScaleReading) -> Result<Self, MessageError> {
        let sample = Self {
            stamp: ros.header.stamp.to_stamp()?,
            sequence: ros.sequence,
            reading_m: ros.reading_m,
            offset_m: ros.offset_m,
            covariates: Covariates::from_lists(&ros.covariate_names, &ros.covariate_values, &ros.covariate_age_s)?,
            frame_id: checks::to_text("header.frame_id", &ros.header.frame_id)?,
        };
        sample.validate()?;
        Ok(sample)
    }

    // reading_m and offset_m may be non-finite on purpose: the corrector answers them with a
    // sample of status Rejected, so that no sequence number vanishes on the way.
    fn validate(&self) -> Result<(), MessageError> {
        checks::stamp(self.stamp)?;
        checks::text("header.frame_id", &self.frame_id)?;
        self.covariates.check()?;
        Ok(())
    }

    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn sequence(&self) -> u64 {
        self.sequence
    }
}
