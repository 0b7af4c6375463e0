//! Standard messages made from this project's own.
//!
//! Place in the flow: right before a sample leaves for DDS or a bag. The samples know the header of a standard message; only here
//! does a standard message know a sample.

use super::{Header, JointState, Point, PointStamped};
use crate::{CorrectedCoordinates, ScaleReading};

impl PointStamped {
    /// The corrected position, or nothing when the reading was not corrected: the standard
    /// message has no field that could say so.
    #[must_use]
    pub fn from_corrected(corrected: &CorrectedCoordinates) -> Option<Self> {
        let [x, y, z] = corrected.corrected_point_in_machine_m()?;
        Some(Self { header: Header::new(corrected.stamp, corrected.frame_id.as_str()), point: Point { x, y, z } })
    }
}

impl JointState {
    /// The indicated positions of the three axes under the given joint names.
    #[must_use]
    pub fn from_scales(scales: &ScaleReading, axis_names: [&str; 3]) -> Self {
        Self {
            header: Header::new(scales.stamp, scales.frame_id.as_str()),
            name: axis_names.map(str::to_owned).to_vec(),
            position: scales.reading_m.to_vec(),
            velocity: Vec::new(),
            effort: Vec::new(),
        }
    }
}
