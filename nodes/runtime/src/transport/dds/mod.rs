//! The transport to everyone else: ROS 2 over DDS.
//!
//! Place in the flow: between hosts, and to tools. Sending costs the caller one copy into a queue
//! ([`crate::ros::QueuedPublisher`]); conversion and the socket run on another thread. What arrives
//! is checked before a node sees it, because DDS matches topics by name and not by type.
//!
//! Quality of service: offered as [`crate::ros::offered_qos`], asked for as [`crate::ros::stream_qos`]. Reliable readers
//! of someone else match, and none of them can hold up a stream.

mod publisher;
mod subscriber;

pub use publisher::DdsPublisher;
pub use subscriber::DdsSubscriber;
