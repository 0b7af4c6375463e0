//! The definition of a topic a second time, outside chunks, with a checksum of its own.
//!
//! Place in the flow: [`super::file_writer`] writes one before the first message of each topic;
//! [`super::recover()`] takes them where the chunk that defines a topic is damaged. They are metadata
//! records, which other readers pass over.

use std::borrow::Cow;
use std::collections::BTreeMap;

use mcap::records::{Channel, Metadata, Record, SchemaHeader};

/// Name of the metadata records.
const NAME: &str = "abbe.channel";
/// Key of the quality of service in the record of a channel.
pub(super) const QOS: &str = "offered_qos_profiles";
/// Key of the hash of the type there.
pub(super) const TYPE_HASH: &str = "topic_type_hash";

/// A topic as its file defines it.
pub(super) struct Definition<'a> {
    pub(super) schema_id: u16,
    pub(super) channel_id: u16,
    pub(super) topic: &'a str,
    pub(super) ros_type: &'a str,
    pub(super) schema_encoding: &'a str,
    pub(super) schema: &'a [u8],
    pub(super) qos_yaml: &'a str,
    pub(super) type_hash: &'a str,
}

impl Definition<'_> {
    /// The record; `None` where the schema is no text (none that this crate knows).
    pub(super) fn to_metadata(&self) -> Option<Metadata> {
        let texts = [
            ("channel_id", self.channel_id.to_string()),
            ("qos", self.qos_yaml.to_owned()),
            ("schema", std::str::from_utf8(self.schema).ok()?.to_owned()),
            ("schema_encoding", self.schema_encoding.to_owned()),
            ("schema_id", self.schema_id.to_string()),
            ("topic", self.topic.to_owned()),
            ("type", self.ros_type.to_owned()),
            ("type_hash", self.type_hash.to_owned()),
        ];
        let mut metadata: BTreeMap<String, String> = texts.map(|(key, text)| (key.to_owned(), text)).into();
        metadata.insert("crc32".to_owned(), crc32(&metadata));
        Some(Metadata { name: NAME.to_owned(), metadata })
    }
}

/// What rosbag2 says of a topic beside its name and type.
pub(super) fn channel_metadata(qos_yaml: &str, type_hash: &str) -> BTreeMap<String, String> {
    BTreeMap::from([(QOS.to_owned(), qos_yaml.to_owned()), (TYPE_HASH.to_owned(), type_hash.to_owned())])
}

/// The schema and channel records that such a metadata record stands for; nothing where it is another
/// one, or damaged.
pub(super) fn of_metadata(mut record: Metadata) -> Option<[Record<'static>; 2]> {
    let stated = record.metadata.remove("crc32")?;
    if record.name != NAME || stated != crc32(&record.metadata) {
        return None;
    }
    let mut take = |key: &str| record.metadata.remove(key);
    let (id, schema_id) = (take("channel_id")?.parse().ok()?, take("schema_id")?.parse().ok()?);
    let header = SchemaHeader { id: schema_id, name: take("type")?, encoding: take("schema_encoding")? };
    let schema = Record::Schema { header, data: Cow::Owned(take("schema")?.into_bytes()) };
    // Bags of before have none.
    let metadata = channel_metadata(&take("qos")?, &take("type_hash").unwrap_or_default());
    let channel = Channel { id, schema_id, topic: take("topic")?, message_encoding: "cdr".to_owned(), metadata };
    Some([schema, Record::Channel(channel)])
}

/// Checksum over all keys and texts with their lengths.
fn crc32(metadata: &BTreeMap<String, String>) -> String {
    let mut hasher = crc32fast::Hasher::new();
    for text in metadata.iter().flat_map(|(key, text)| [key, text]) {
        hasher.update(&(text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    }
    format!("{:08x}", hasher.finalize())
}
