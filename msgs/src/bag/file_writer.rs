//! Writes one MCAP file of a bag.
//!
//! Place in the flow: [`super::writer`] hands it CDR and topics -> `.mcap`. The same messages in the
//! same order give the same bytes. Chunks are small, so that a killed recorder loses at most the last
//! [`FLUSH_INTERVAL`] messages. The definition of a topic stands in the first chunk that uses it, and
//! before that in a metadata record of its own: where one of the two is damaged, the other serves.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;

use super::BagError;
use super::definitions::{Definition, channel_metadata};
use super::metadata::{FileSummary, Metadata, TopicSummary};

/// Uncompressed size at which a chunk is closed.
const CHUNK_SIZE: u64 = 64 * 1024;

/// Messages after which a chunk is closed and handed to the operating system.
const FLUSH_INTERVAL: u64 = 100;

struct Topic {
    channel_id: u16,
    /// Counts the messages of the topic, as MCAP wants; wraps around.
    sequence: u32,
    summary: TopicSummary,
}

/// A file that is being written. One that is dropped is readable up to its last whole chunk.
pub(super) struct FileWriter {
    path: PathBuf,
    mcap: mcap::Writer<BufWriter<File>>,
    /// The same file, to have it put on the disk.
    handle: File,
    /// In the order of their first message.
    topics: Vec<Topic>,
    /// Types, how they are written, and their texts, each once.
    schemas: Vec<(String, String, Vec<u8>)>,
    index_by_topic: BTreeMap<String, usize>,
    span_ns: Option<(u64, u64)>,
    unflushed: u64,
}

impl FileWriter {
    /// Starts the file.
    ///
    /// # Errors
    /// When there is something at `path` already, or it cannot be created.
    pub(super) fn create(path: &Path) -> Result<FileWriter, BagError> {
        let file = File::create_new(path).map_err(|error| BagError::already(path, error))?;
        let handle = file.try_clone().map_err(BagError::io(path, "create the bag"))?;
        let options = mcap::WriteOptions::new()
            .profile("ros2")
            .library("abbe")
            .compression(Some(mcap::Compression::Lz4))
            .chunk_size(Some(CHUNK_SIZE))
            // A chunk is written whole or not at all, so that a kill leaves whole chunks.
            .disable_seeking(true);
        let mcap = options.create(BufWriter::new(file)).map_err(BagError::write(path))?;
        Ok(FileWriter {
            path: path.to_owned(),
            mcap,
            handle,
            topics: Vec::new(),
            schemas: Vec::new(),
            index_by_topic: BTreeMap::new(),
            span_ns: None,
            unflushed: 0,
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Place of a topic that has been added.
    pub(super) fn topic(&self, topic: &str) -> Option<usize> {
        self.index_by_topic.get(topic).copied()
    }

    /// Adds a topic; gives its place.
    pub(super) fn add_topic(
        &mut self,
        summary: TopicSummary,
        schema_encoding: &str,
        schema: &[u8],
    ) -> Result<usize, BagError> {
        let index = self.topics.len();
        let kind = (summary.ros_type.clone(), schema_encoding.to_owned(), schema.to_vec());
        let schema_place = self.schemas.iter().position(|known| *known == kind).unwrap_or(self.schemas.len());
        let number = |place: usize| u16::try_from(place + 1).map_err(|_| mcap::McapError::TooManyChannels);
        let schema_id = number(schema_place).map_err(BagError::write(&self.path))?;
        let channel_id = number(index).map_err(BagError::write(&self.path))?;
        let definition = Definition {
            schema_id,
            channel_id,
            topic: &summary.topic,
            ros_type: &summary.ros_type,
            schema_encoding,
            schema,
            qos_yaml: &summary.qos_yaml,
            type_hash: &summary.type_hash,
        };
        self.define(&definition).map_err(BagError::write(&self.path))?;
        if schema_place == self.schemas.len() {
            self.schemas.push(kind);
        }
        self.index_by_topic.insert(summary.topic.clone(), index);
        self.topics.push(Topic { channel_id, sequence: 0, summary });
        Ok(index)
    }

    /// Writes the definition of a topic: outside chunks, and into the chunk that its first message goes into.
    fn define(&mut self, definition: &Definition<'_>) -> Result<(), mcap::McapError> {
        if let Some(copy) = definition.to_metadata() {
            self.mcap.write_metadata(&copy)?;
        }
        let Definition { schema_id, channel_id, topic, ros_type, schema_encoding, schema, .. } = *definition;
        self.mcap.add_schema_with_id(schema_id, ros_type, schema_encoding, schema)?;
        let metadata = channel_metadata(definition.qos_yaml, definition.type_hash);
        self.mcap.add_channel_with_id(channel_id, schema_id, topic, "cdr", &metadata)?;
        Ok(())
    }

    /// Writes a message of the topic at `index`.
    pub(super) fn write(&mut self, index: usize, cdr: &[u8], log_time_ns: u64) -> Result<(), BagError> {
        let topic = &mut self.topics[index];
        let header = MessageHeader {
            channel_id: topic.channel_id,
            sequence: topic.sequence,
            log_time: log_time_ns,
            publish_time: log_time_ns,
        };
        self.mcap.write_to_known_channel(&header, cdr).map_err(BagError::write(&self.path))?;
        topic.sequence = topic.sequence.wrapping_add(1);
        topic.summary.messages += 1;
        self.span_ns = Some(match self.span_ns {
            None => (log_time_ns, log_time_ns),
            Some((first, last)) => (first.min(log_time_ns), last.max(log_time_ns)),
        });
        self.unflushed += 1;
        if self.unflushed >= FLUSH_INTERVAL {
            self.flush()?;
        }
        Ok(())
    }

    /// Hands everything to the operating system, so that it survives a kill.
    pub(super) fn flush(&mut self) -> Result<(), BagError> {
        if self.unflushed > 0 {
            self.unflushed = 0;
            self.mcap.flush().map_err(BagError::write(&self.path))?;
        }
        Ok(())
    }

    /// Has everything put on the disk, so that it survives a power cut. Waits for the disk.
    pub(super) fn sync(&mut self) -> Result<(), BagError> {
        self.flush()?;
        self.handle.sync_data().map_err(BagError::io(&self.path, "put the bag on the disk"))
    }

    /// Size of the file as far as it has been handed to the operating system.
    pub(super) fn bytes(&self) -> Result<u64, BagError> {
        let entry = self.handle.metadata().map_err(BagError::io(&self.path, "look at the bag"))?;
        Ok(entry.len())
    }

    /// Messages written so far.
    pub(super) fn messages(&self) -> u64 {
        self.topics.iter().map(|topic| topic.summary.messages).sum()
    }

    pub(super) fn summary(&self) -> FileSummary {
        let name = self.path.file_name().unwrap_or_default();
        FileSummary {
            file_name: name.to_string_lossy().into_owned(),
            span_ns: self.span_ns,
            topics: self.topics.iter().map(|topic| topic.summary.clone()).collect(),
        }
    }

    /// Completes the file with its index and puts it on the disk.
    pub(super) fn finish(mut self) -> Result<FileSummary, BagError> {
        let summary = self.summary();
        // rosbag2 reads the version of its metadata from this record of the file.
        let body = Metadata { files: std::slice::from_ref(&summary) }.body();
        let record = mcap::records::Metadata {
            name: "rosbag2".to_owned(),
            metadata: BTreeMap::from([("serialized_metadata".to_owned(), body)]),
        };
        self.mcap.write_metadata(&record).and_then(|()| self.mcap.finish()).map_err(BagError::write(&self.path))?;
        self.mcap
            .into_inner()
            .into_inner()
            .map_err(std::io::IntoInnerError::into_error)
            .and_then(|file| file.sync_all())
            .map_err(BagError::io(&self.path, "complete the file"))?;
        Ok(summary)
    }
}
