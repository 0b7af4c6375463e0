//! Bags: recordings as MCAP that rosbag2, Foxglove and Python readers open.
//!
//! Place in the flow: the recorder writes every topic with [`BagWriter`]; replay, identification
//! and correction read with [`messages`]. Stamps inside the messages and `log_time_ns` are
//! nanoseconds since the epoch of the recording.
//!
//! A bag is a directory as rosbag2 writes it (`<name>/<name>_0.mcap`, further files where it was split,
//! and `metadata.yaml`) or one `.mcap` file. Schemas are embedded. A bag that is cut off or damaged gives
//! what can be read up to there and then an error; [`recover()`] keeps all that is whole.
//!
//! ```
//! use abbe_msgs::{Message, ScaleReading, bag};
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("first_run");
//! let mut writer = bag::BagWriter::create(&path)?;
//! let reading = ScaleReading { reading_m: [0.1, 0.2, 0.3], ..ScaleReading::default() };
//! writer.write("/bridge/scale_reading", &reading, 1_000_000)?;
//! writer.finish()?;
//!
//! for message in bag::messages(&path)? {
//!     let message = message?;
//!     assert_eq!(message.ros_type(), ScaleReading::ROS_TYPE);
//!     assert_eq!(message.decode::<ScaleReading>()?, reading);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod channels;
mod chunk;
mod convert;
mod definitions;
mod error;
mod file_writer;
mod framing;
mod index;
mod metadata;
mod qos;
mod reader;
mod recover;
mod salvage;
mod writer;

pub use channels::BagChannel;
pub use error::BagError;
pub use qos::Qos;
pub use reader::{BagMessage, Messages, messages, messages_from};
pub use recover::{Fault, FileRecovery, Recovery, recover, recover_from};
pub use writer::{BagSummary, BagWriter};
