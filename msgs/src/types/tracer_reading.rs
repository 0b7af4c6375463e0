//! One reading of a laser tracer: `abbe_msgs/msg/TracerReading`.
//!
//! Place in the flow: driver -> `tracer` node -> `monitor` node. Lengths in metres, relative to the
//! station's first reading.

use iceoryx2::prelude::ZeroCopySend;

use super::{NAME_CAPACITY, Stamp, Text, checks};
use crate::{Message, MessageError, ros, standard::Header};

/// Interferometric length, compensated for refraction by the instrument.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend)]
#[type_name("abbe/TracerReading/02719f32")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub struct TracerReading {
    /// Instant of latching.
    pub stamp: Stamp,
    /// Counts the readings of one source from 0.
    pub sequence: u64,
    /// Length in metres relative to the station's first reading.
    pub length_m: f64,
    /// Standard uncertainty (k = 1) of `length_m` in metres.
    pub u_length_m: f64,
    /// Name of the machine frame.
    pub frame_id: Text<NAME_CAPACITY>,
    /// Name of the station the tracer stands on.
    pub station: Text<NAME_CAPACITY>,
    /// Run of points measured in one go; empty when not part of a campaign.
    pub line: Text<NAME_CAPACITY>,
}

impl Message for TracerReading {
    type Ros = ros::TracerReading;

    fn to_ros(&self) -> ros::TracerReading {
        ros::TracerReading {
            header: Header::new(self.stamp, self.frame_id.as_str()),
            sequence: self.sequence,
            station: self.station.to_string(),
            line: self.line.to_string(),
            length_m: self.length_m,
            u_length_m: self.u_length_m,
        }
    }

    fn from_ros(ros: ros::TracerReading) -> Result<Self, MessageError> {
        let sample = Self {
            stamp: ros.header.stamp.to_stamp()?,
            sequence: ros.sequence,
            length_m: ros.length_m,
            u_length_m: ros.u_length_m,
            frame_id: checks::to_text("header.frame_id", &ros.header.frame_id)?,
            station: checks::to_text("station", &ros.station)?,
            line: checks::to_text("line", &ros.line)?,
        };
        sample.validate()?;
        Ok(sample)
    }

    fn validate(&self) -> Result<(), MessageError> {
        checks::stamp(self.stamp)?;
        checks::text("header.frame_id", &self.frame_id)?;
        checks::text("station", &self.station)?;
        checks::text("line", &self.line)?;
        checks::finite("length_m", &[self.length_m])?;
        checks::uncertainty("u_length_m", self.u_length_m)
    }

    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn sequence(&self) -> u64 {
        self.sequence
    }
}
