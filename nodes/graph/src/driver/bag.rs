//! Driver: a recorded bag.
//!
//! Place in the flow: `kind = "bag"` in a launch configuration replays what was recorded, message by message.

use super::{DriverError, ScaleDriver, TracerDriver};
use abbe_msgs::bag::{BagError, BagMessage, Messages, messages};
use abbe_msgs::{Message, ScaleReading, TracerReading};
use std::path::Path;

/// Messages of one topic of a bag.
pub(super) struct BagTopic {
    /// The first message of the topic, which was looked for at the start; or why the bag cannot be read that far.
    first: Option<Result<BagMessage, BagError>>,
    messages: Messages,
    topic: String,
}

impl BagTopic {
    fn next_message<M: Message>(&mut self) -> Result<Option<M>, DriverError> {
        for message in self.first.take().into_iter().chain(self.messages.by_ref()) {
            let message = message?;
            if message.topic() == self.topic {
                return Ok(Some(message.decode()?));
            }
        }
        Ok(None)
    }
}

/// Reads up to the first message of the topic. One that the bag does not have is refused: its node would be done at once,
/// and nobody would hear why nothing comes.
fn open(path: &Path, topic: &str) -> Result<BagTopic, DriverError> {
    let mut messages = messages(path)?;
    let first = messages.find(|message| message.as_ref().map_or(true, |message| message.topic() == topic));
    if first.is_none() {
        let topics = messages.topics();
        if !topics.contains(topic) {
            let known: Vec<String> = topics.into_iter().collect();
            let known = if known.is_empty() { "no topic at all".to_owned() } else { known.join(", ") };
            return Err(DriverError::NoTopic { bag: path.to_owned(), topic: topic.to_owned(), known });
        }
        tracing::warn!("{}: topic {topic} is without a message, so no reading comes from it", path.display());
    }
    Ok(BagTopic { first, messages, topic: topic.to_owned() })
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
