//! Topics of one MCAP file by the number that its messages name.
//!
//! Place in the flow: schema and channel records -> [`Channels`] -> each message of
//! [`super::reader`] and [`super::recover()`] gets its [`BagChannel`].

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use mcap::McapError;
use mcap::read::ChannelAccumulator;
use mcap::records::{MessageHeader, Record};

use super::BagError;
use super::definitions::{QOS, TYPE_HASH};

/// A topic of a bag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BagChannel {
    /// Name of the topic.
    pub topic: String,
    /// Full name of the messages' type, such as `abbe_msgs/msg/ScaleReading`.
    pub ros_type: String,
    /// How `schema` is written: `ros2msg` or `ros2idl`.
    pub schema_encoding: String,
    /// Definition of the type.
    pub schema: Vec<u8>,
    /// Quality of service, as YAML; empty when the bag does not say.
    pub offered_qos_profiles: String,
    /// RIHS01 hash of the type; empty when the bag does not say.
    pub type_hash: String,
}

/// Why a message has no topic.
pub(super) enum ChannelFault {
    /// Its number was never defined.
    Unknown(McapError),
    /// The topic is not ROS 2 in CDR.
    Unusable(BagError),
}

/// What was defined so far.
#[derive(Default)]
pub(super) struct Channels {
    defined: ChannelAccumulator<'static>,
    used: BTreeMap<u16, Arc<BagChannel>>,
    topics: BTreeSet<String>,
}

impl Channels {
    /// Whether no message has named a topic yet.
    pub(super) fn none_used(&self) -> bool {
        self.used.is_empty()
    }

    /// Topics that were defined so far, with messages or without.
    pub(super) fn topics(&self) -> &BTreeSet<String> {
        &self.topics
    }

    /// Takes a definition; other records mean nothing here.
    pub(super) fn define(&mut self, record: Record<'static>) -> Result<(), McapError> {
        match record {
            Record::Schema { header, data } => self.defined.add_schema(header, data),
            Record::Channel(channel) => {
                if !self.topics.contains(&channel.topic) {
                    self.topics.insert(channel.topic.clone());
                }
                self.defined.add_channel(channel)
            }
            _ => Ok(()),
        }
    }

    /// The topic of a message; `path` stands for the file in errors.
    pub(super) fn of(&mut self, header: &MessageHeader, path: &Path) -> Result<Arc<BagChannel>, ChannelFault> {
        let id = header.channel_id;
        if let Some(channel) = self.used.get(&id) {
            return Ok(Arc::clone(channel));
        }
        let unknown = || ChannelFault::Unknown(McapError::UnknownChannel(header.sequence, id));
        let found = self.defined.get(id).ok_or_else(unknown)?;
        let unusable = |reason: String| {
            ChannelFault::Unusable(BagError::Channel { path: path.to_owned(), topic: found.topic.clone(), reason })
        };
        if found.message_encoding != "cdr" {
            return Err(unusable(format!("messages are '{}', not cdr", found.message_encoding)));
        }
        let Some(schema) = &found.schema else {
            return Err(unusable("has no schema, so its type is unknown".to_owned()));
        };
        let said = |key: &str| found.metadata.get(key).cloned().unwrap_or_default();
        let channel = Arc::new(BagChannel {
            topic: found.topic.clone(),
            ros_type: schema.name.clone(),
            schema_encoding: schema.encoding.clone(),
            schema: schema.data.to_vec(),
            offered_qos_profiles: said(QOS),
            type_hash: said(TYPE_HASH),
        });
        self.used.insert(id, Arc::clone(&channel));
        Ok(channel)
    }
}
