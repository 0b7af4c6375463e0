//! The traits that tie a sample of fixed size to its ROS 2 message.
//!
//! Place in the flow: transports and bags are generic over [`Message`] (samples of this project)
//! and [`RosType`] (any ROS 2 message, the standard ones included).

use std::fmt::Debug;

use iceoryx2::prelude::ZeroCopySend;
use serde::{Serialize, de::DeserializeOwned};

use crate::{MessageError, Stamp};

/// A ROS 2 message as ROS sees it: its fields in the order of the `.msg` file.
pub trait RosType: Serialize + DeserializeOwned + Clone + Debug + PartialEq + Send + Sync + 'static {
    /// Full name, such as `abbe_msgs/msg/ScaleReading`.
    const ROS_TYPE: &'static str;
}

/// A sample of fixed size that nodes exchange, and its ROS 2 message.
pub trait Message: Copy + Debug + PartialEq + ZeroCopySend + Send + Sync + 'static {
    /// The same message as ROS 2 sees it.
    type Ros: RosType;

    /// Full name of the ROS 2 message, such as `abbe_msgs/msg/ScaleReading`.
    const ROS_TYPE: &'static str = <Self::Ros as RosType>::ROS_TYPE;

    /// The ROS 2 message of this sample. Nothing is lost: [`Message::from_ros`] gives it back.
    fn to_ros(&self) -> Self::Ros;

    /// The sample of a ROS 2 message that arrived.
    ///
    /// # Errors
    /// When a text is too long, the covariate lists disagree, a status is unknown, or
    /// [`Message::validate`] refuses the sample.
    fn from_ros(ros: Self::Ros) -> Result<Self, MessageError>;

    /// Checks the sample itself, whichever way it came: the verdict is the same over shared
    /// memory, DDS and bag.
    ///
    /// # Errors
    /// When a number is not finite where it must be, or fields contradict each other.
    fn validate(&self) -> Result<(), MessageError>;

    /// Instant of latching of the reading that this sample is or stems from.
    fn stamp(&self) -> Stamp;

    /// Number of that reading, counted by its source from 0.
    fn sequence(&self) -> u64;
}
