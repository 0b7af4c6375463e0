//! Bags: recordings as MCAP that rosbag2, Foxglove and Python readers open.
//!
//! Place in the flow: the recorder writes every topic with [`BagWriter`]; replay, identification
//! and correction read with [`messages`]. Stamps inside the messages and `log_time_ns` are
//! nanoseconds since the epoch of the recording.
//!
//! A bag is a directory as rosbag2 writes it (`<name>/<name>_0.mcap` and `metadata.yaml`) or one
//! `.mcap` file. Schemas are embedded. A bag that is cut off or damaged is an error that says how
//! much came before; [`recover`] keeps that part.

mod chunk;
mod error;
mod metadata;
mod qos;
mod reader;
mod recover;
mod writer;

pub use error::BagError;
pub use qos::Qos;
pub use reader::{BagChannel, BagMessage, Messages, messages, messages_from};
pub use recover::{Recovery, recover};
pub use writer::{BagSummary, BagWriter};
