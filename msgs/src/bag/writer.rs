//! Writes bags that rosbag2, Foxglove and Python readers open.
//!
//! Place in the flow: samples and ROS messages -> `.mcap` (and `metadata.yaml`). The same messages
//! in the same order give the same bytes. Chunks are small, so that a killed recorder loses at most
//! the last [`FLUSH_INTERVAL`] messages.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;

use super::metadata::{self, Metadata, TopicSummary};
use super::{BagError, BagMessage, Qos};
use crate::{Message, RosType, cdr, definition};

/// Uncompressed size at which a chunk is closed.
const CHUNK_SIZE: u64 = 64 * 1024;

/// Messages after which a chunk is closed and handed to the operating system.
const FLUSH_INTERVAL: u64 = 100;

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BagSummary {
    /// The bag: directory or `.mcap` file.
    pub path: PathBuf,
    /// Messages of each topic.
    pub messages_by_topic: BTreeMap<String, u64>,
}

struct Topic {
    channel_id: u16,
    /// Counts the messages of the topic, as MCAP wants; wraps around.
    sequence: u32,
    summary: TopicSummary,
}

/// A bag that is being recorded. Call [`BagWriter::finish`]; a writer that is dropped leaves a
/// readable `.mcap`, but a directory without `metadata.yaml`.
pub struct BagWriter {
    path: PathBuf,
    /// The directory, unless the bag is a bare file.
    directory: Option<PathBuf>,
    file_path: PathBuf,
    mcap: mcap::Writer<BufWriter<File>>,
    /// In the order of their first message.
    topics: Vec<Topic>,
    index_by_topic: BTreeMap<String, usize>,
    qos_by_topic: BTreeMap<String, Qos>,
    span_ns: Option<(u64, u64)>,
    unflushed: u64,
}

impl BagWriter {
    /// Starts a bag: a bare file when `path` ends in `.mcap`, otherwise a rosbag2 directory.
    ///
    /// # Errors
    /// When there is something at `path` already, or it cannot be created.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, BagError> {
        let path = path.as_ref();
        let bare = path.extension().is_some_and(|extension| extension == "mcap");
        let (directory, file_path) =
            if bare { (None, path.to_owned()) } else { (Some(path.to_owned()), create_directory(path)?) };
        let file = File::create_new(&file_path).map_err(|error| already(&file_path, error))?;
        let options = mcap::WriteOptions::new()
            .profile("ros2")
            .library("abbe")
            .compression(Some(mcap::Compression::Lz4))
            .chunk_size(Some(CHUNK_SIZE))
            // A chunk is written whole or not at all, so that a kill leaves whole chunks.
            .disable_seeking(true);
        let mcap = options.create(BufWriter::new(file)).map_err(BagError::write(&file_path))?;
        Ok(Self {
            path: path.to_owned(),
            directory,
            file_path,
            mcap,
            topics: Vec::new(),
            index_by_topic: BTreeMap::new(),
            qos_by_topic: BTreeMap::new(),
            span_ns: None,
            unflushed: 0,
        })
    }

    /// Names the quality of service of a topic; without it, and after its first message, it is
    /// [`Qos::STREAM`].
    pub fn set_qos(&mut self, topic: &str, qos: Qos) {
        self.qos_by_topic.insert(topic.to_owned(), qos);
    }

    /// Writes one sample; `log_time_ns` is the instant of recording in nanoseconds.
    ///
    /// # Errors
    /// When the sample is not valid (a reader would refuse it), the topic carries another type, or
    /// writing fails.
    pub fn write<M: Message>(&mut self, topic: &str, sample: &M, log_time_ns: u64) -> Result<(), BagError> {
        sample.validate().map_err(|source| BagError::Message {
            path: self.file_path.clone(),
            index: self.message_count(),
            topic: topic.to_owned(),
            source,
        })?;
        self.write_ros(topic, &sample.to_ros(), log_time_ns)
    }

    /// Writes one ROS message; `log_time_ns` is the instant of recording in nanoseconds.
    ///
    /// # Errors
    /// When the topic carries another type, or writing fails.
    pub fn write_ros<R: RosType>(&mut self, topic: &str, ros: &R, log_time_ns: u64) -> Result<(), BagError> {
        let bytes = cdr::encode(ros).map_err(|source| BagError::Cdr {
            path: self.file_path.clone(),
            index: self.message_count(),
            topic: topic.to_owned(),
            source,
        })?;
        self.write_cdr(topic, R::ROS_TYPE, &bytes, log_time_ns)
    }

    /// Writes one message of this crate's types that is CDR already, header included.
    ///
    /// # Errors
    /// When the type is not one of this crate's, the topic carries another type, or writing fails.
    pub fn write_cdr(&mut self, topic: &str, ros_type: &str, cdr: &[u8], log_time_ns: u64) -> Result<(), BagError> {
        let index = match self.known_topic(topic, ros_type)? {
            Some(index) => index,
            None => {
                let schema = definition::schema(ros_type).ok_or_else(|| BagError::UnknownType {
                    path: self.path.clone(),
                    topic: topic.to_owned(),
                    ros_type: ros_type.to_owned(),
                })?;
                let qos = self.qos_by_topic.get(topic).copied().unwrap_or(Qos::STREAM);
                let summary = TopicSummary {
                    topic: topic.to_owned(),
                    ros_type: ros_type.to_owned(),
                    qos_yaml: qos.to_yaml(),
                    messages: 0,
                };
                self.add_topic(summary, "ros2msg", schema.as_bytes())?
            }
        };
        self.write_bytes(index, cdr, log_time_ns)
    }

    /// Writes a message that was read from another bag, with the schema and quality of service it
    /// had there.
    ///
    /// # Errors
    /// When the topic carries another type, or writing fails.
    pub fn copy(&mut self, message: &BagMessage) -> Result<(), BagError> {
        let channel = message.channel();
        let index = match self.known_topic(&channel.topic, &channel.ros_type)? {
            Some(index) => index,
            None => {
                let summary = TopicSummary {
                    topic: channel.topic.clone(),
                    ros_type: channel.ros_type.clone(),
                    qos_yaml: channel.offered_qos_profiles.clone(),
                    messages: 0,
                };
                self.add_topic(summary, &channel.schema_encoding, &channel.schema)?
            }
        };
        self.write_bytes(index, &message.cdr, message.log_time_ns)
    }

    /// Hands everything written so far to the operating system, so that it survives a kill.
    ///
    /// # Errors
    /// When writing fails.
    pub fn flush(&mut self) -> Result<(), BagError> {
        self.unflushed = 0;
        self.mcap.flush().map_err(BagError::write(&self.file_path))
    }

    /// Messages written so far.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.topics.iter().map(|topic| topic.summary.messages).sum()
    }

    /// Completes the bag: index, and `metadata.yaml` of a directory.
    ///
    /// # Errors
    /// When writing fails.
    pub fn finish(mut self) -> Result<BagSummary, BagError> {
        let metadata = self.metadata();
        // rosbag2 reads the version of its metadata from this record of the file.
        let record = mcap::records::Metadata {
            name: "rosbag2".to_owned(),
            metadata: BTreeMap::from([("serialized_metadata".to_owned(), metadata.body())]),
        };
        self.mcap
            .write_metadata(&record)
            .and_then(|()| self.mcap.finish())
            .map_err(BagError::write(&self.file_path))?;
        self.mcap
            .into_inner()
            .into_inner()
            .map_err(std::io::IntoInnerError::into_error)
            .and_then(|file| file.sync_all())
            .map_err(BagError::io(&self.file_path, "complete the file"))?;
        if let Some(directory) = &self.directory {
            write_atomically(&directory.join(metadata::FILE_NAME), &metadata.text())?;
        }
        let topics = self.topics.into_iter().map(|topic| topic.summary);
        Ok(BagSummary {
            path: self.path,
            messages_by_topic: topics.map(|topic| (topic.topic, topic.messages)).collect(),
        })
    }

    fn metadata(&self) -> Metadata {
        let file_name = self.file_path.file_name().unwrap_or_default();
        Metadata {
            file_name: file_name.to_string_lossy().into_owned(),
            span_ns: self.span_ns,
            topics: self.topics.iter().map(|t| t.summary.clone()).collect(),
        }
    }

    fn known_topic(&self, topic: &str, ros_type: &str) -> Result<Option<usize>, BagError> {
        let Some(&index) = self.index_by_topic.get(topic) else {
            return Ok(None);
        };
        let known = &self.topics[index].summary.ros_type;
        if known != ros_type {
            return Err(BagError::TopicType {
                path: self.path.clone(),
                topic: topic.to_owned(),
                known: known.clone(),
                new: ros_type.to_owned(),
            });
        }
        Ok(Some(index))
    }

    fn add_topic(&mut self, summary: TopicSummary, schema_encoding: &str, schema: &[u8]) -> Result<usize, BagError> {
        let channel_metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), summary.qos_yaml.clone())]);
        let mcap = &mut self.mcap;
        let channel_id = mcap
            .add_schema(&summary.ros_type, schema_encoding, schema)
            .and_then(|schema_id| mcap.add_channel(schema_id, &summary.topic, "cdr", &channel_metadata))
            .map_err(BagError::write(&self.file_path))?;
        let index = self.topics.len();
        self.index_by_topic.insert(summary.topic.clone(), index);
        self.topics.push(Topic { channel_id, sequence: 0, summary });
        Ok(index)
    }

    fn write_bytes(&mut self, index: usize, cdr: &[u8], log_time_ns: u64) -> Result<(), BagError> {
        let topic = &mut self.topics[index];
        let header = MessageHeader {
            channel_id: topic.channel_id,
            sequence: topic.sequence,
            log_time: log_time_ns,
            publish_time: log_time_ns,
        };
        self.mcap.write_to_known_channel(&header, cdr).map_err(BagError::write(&self.file_path))?;
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
}

/// Creates the directory of a bag and names the file in it.
fn create_directory(path: &Path) -> Result<PathBuf, BagError> {
    let Some(name) = path.file_name() else {
        return Err(BagError::NotABag {
            path: path.to_owned(),
            reason: "the path has no last part to name the bag; name a new directory".to_owned(),
        });
    };
    let mut file_name = name.to_os_string();
    file_name.push("_0.mcap");
    std::fs::create_dir(path).map_err(|error| already(path, error))?;
    Ok(path.join(file_name))
}

fn already(path: &Path, error: std::io::Error) -> BagError {
    if error.kind() == std::io::ErrorKind::AlreadyExists {
        BagError::Exists { path: path.to_owned() }
    } else {
        BagError::io(path, "create the bag")(error)
    }
}

fn write_atomically(path: &Path, text: &str) -> Result<(), BagError> {
    let partial = path.with_extension("yaml.partial");
    std::fs::write(&partial, text)
        .and_then(|()| std::fs::rename(&partial, path))
        .map_err(BagError::io(path, "write the metadata"))
}
