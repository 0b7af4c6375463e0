//! Driver: a recorded bag.
//!
//! Place in the flow: `kind = "bag"` in a launch configuration replays what was recorded, message by message.

use super::{DriverError, ScaleDriver, TracerDriver};
use abbe_msgs::bag::{Messages, messages};
use abbe_msgs::{Message, ScaleReading, TracerReading};
use std::path::Path;

/// Messages of one topic of a bag.
pub(super) struct BagTopic {
    messages: Messages,
    topic: String,
}

impl BagTopic {
    fn next_message<M: Message>(&mut self) -> Result<Option<M>, DriverError> {
        for message in self.messages.by_ref() {
            let message = message?;
            if message.topic() == self.topic {
                return Ok(Some(message.decode()?));
            }
        }
        Ok(None)
    }
}

fn open(path: &Path, topic: &str) -> Result<BagTopic, DriverError> {
    Ok(BagTopic { messages: messages(path)?, topic: topic.to_owned() })
}

pub(super) fn open_scale(path: &Path, topic: &str) -> Result<BagTopic, DriverError> {
    open(path, topic)
}

pub(super) fn open_tracer(path: &Path, topic: &str) -> Result<BagTopic, DriverError> {
    open(path, topic)
}

impl ScaleDriver for BagTopic {
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError> {
        self.next_message()
    }
}

impl TracerDriver for BagTopic {
    fn next_reading(&mut self) -> Result<Option<TracerReading>, DriverError> {
        self.next_message()
    }
}
