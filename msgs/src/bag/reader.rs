//! Reads bags message by message, with bounded memory.
//!
//! Place in the flow: rosbag2 directory or `.mcap` file -> [`BagMessage`] -> replay,
//! identification, correction. Messages come in the order they were recorded. Checksums of chunks,
//! data and index are compared; the first fault is an error and the end.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::McapError;
use mcap::read::ChannelAccumulator;
use mcap::records::{MessageHeader, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::{BagError, chunk, metadata};
use crate::{Message, RosType, cdr};

/// Bytes asked of the operating system at once.
const READ_SIZE: usize = 64 * 1024;

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
}

/// One recorded message.
#[derive(Debug, Clone)]
pub struct BagMessage {
    /// Instant of recording in nanoseconds.
    pub log_time_ns: u64,
    /// The message in CDR, header included.
    pub cdr: Vec<u8>,
    /// Position in the bag, from 0.
    pub index: u64,
    channel: Arc<BagChannel>,
    file_path: Arc<Path>,
}

impl BagMessage {
    /// The topic, its type and its definition.
    #[must_use]
    pub fn channel(&self) -> &BagChannel {
        &self.channel
    }

    /// Name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.channel.topic
    }

    /// Full name of the type, such as `abbe_msgs/msg/ScaleReading`.
    #[must_use]
    pub fn ros_type(&self) -> &str {
        &self.channel.ros_type
    }

    /// The message as ROS 2 sees it.
    ///
    /// # Errors
    /// When it is of another type or its bytes are not that message.
    pub fn decode_ros<R: RosType>(&self) -> Result<R, BagError> {
        if self.ros_type() != R::ROS_TYPE {
            return Err(BagError::WrongType {
                path: self.file_path.to_path_buf(),
                index: self.index,
                topic: self.topic().to_owned(),
                found: self.ros_type().to_owned(),
                expected: R::ROS_TYPE,
            });
        }
        cdr::decode(&self.cdr).map_err(|source| BagError::Cdr {
            path: self.file_path.to_path_buf(),
            index: self.index,
            topic: self.topic().to_owned(),
            source,
        })
    }

    /// The message as a checked sample.
    ///
    /// # Errors
    /// As [`BagMessage::decode_ros`], and when the sample must not be used.
    pub fn decode<M: Message>(&self) -> Result<M, BagError> {
        M::from_ros(self.decode_ros()?).map_err(|source| BagError::Message {
            path: self.file_path.to_path_buf(),
            index: self.index,
            topic: self.topic().to_owned(),
            source,
        })
    }
}

/// The messages of a bag in the order they were recorded. Ends after the first error.
pub struct Messages {
    current: Option<FileMessages<File>>,
    /// Files still to come, in reverse order.
    later: Vec<PathBuf>,
    /// The `metadata.yaml` and the number of messages it promises.
    promised: Option<(PathBuf, u64)>,
    read: u64,
}

/// Opens a bag: a rosbag2 directory or a `.mcap` file.
///
/// # Errors
/// When there is none at `path`, or the `metadata.yaml` of the directory is missing or wrong.
pub fn messages(path: impl AsRef<Path>) -> Result<Messages, BagError> {
    let path = path.as_ref();
    let entry = std::fs::metadata(path).map_err(BagError::io(path, "open the bag"))?;
    let (mut later, promised) = if entry.is_dir() {
        let (files, count) = metadata::read(path)?;
        (files, Some((path.join(metadata::FILE_NAME), count)))
    } else {
        (vec![path.to_owned()], None)
    };
    later.reverse();
    let mut messages = Messages { current: None, later, promised, read: 0 };
    messages.open_next()?;
    Ok(messages)
}

/// Reads one `.mcap` from any source; `name` stands for it in errors.
pub fn messages_from<R: Read>(name: &Path, source: R) -> impl Iterator<Item = Result<BagMessage, BagError>> + use<R> {
    FileMessages::new(name, source, 0)
}

impl Messages {
    fn open_next(&mut self) -> Result<(), BagError> {
        self.current = match self.later.pop() {
            None => None,
            Some(path) => {
                let file = File::open(&path).map_err(BagError::io(&path, "open the bag's file"))?;
                Some(FileMessages::new(&path, file, self.read))
            }
        };
        Ok(())
    }

    fn step(&mut self) -> Result<Option<BagMessage>, BagError> {
        while let Some(current) = &mut self.current {
            if let Some(message) = current.next().transpose()? {
                self.read += 1;
                return Ok(Some(message));
            }
            self.open_next()?;
        }
        match self.promised.take() {
            Some((path, count)) if count != self.read => Err(BagError::Metadata {
                path,
                reason: format!(
                    "names {count} messages, but the files hold {}; recover the bag to write it \
                     anew",
                    self.read
                ),
            }),
            _ => Ok(None),
        }
    }
}

impl Iterator for Messages {
    type Item = Result<BagMessage, BagError>;

    fn next(&mut self) -> Option<Self::Item> {
        let step = self.step();
        if step.is_err() {
            (self.current, self.promised) = (None, None);
            self.later.clear();
        }
        step.transpose()
    }
}

/// The messages of one `.mcap`.
pub(super) struct FileMessages<R> {
    path: Arc<Path>,
    source: R,
    reader: LinearReader,
    accumulator: ChannelAccumulator<'static>,
    channels: BTreeMap<u16, Arc<BagChannel>>,
    /// Messages of the chunk that was unpacked last.
    ready: VecDeque<BagMessage>,
    first_index: u64,
    read: u64,
    ended: bool,
}

impl<R: Read> FileMessages<R> {
    pub(super) fn new(path: &Path, source: R, first_index: u64) -> Self {
        Self {
            path: path.into(),
            source,
            reader: LinearReader::new_with_options(
                LinearReaderOptions::default()
                    .with_emit_chunks(true)
                    .with_validate_data_section_crc(true)
                    .with_validate_summary_section_crc(true)
                    .with_check_finishes_after_end_magic(true)
                    .with_record_length_limit(chunk::RECORD_LIMIT),
            ),
            accumulator: ChannelAccumulator::default(),
            channels: BTreeMap::new(),
            ready: VecDeque::new(),
            first_index,
            read: 0,
            ended: false,
        }
    }

    /// The next message of the file; `None` at its proper end.
    fn step(&mut self) -> Result<Option<BagMessage>, BagError> {
        loop {
            if let Some(message) = self.ready.pop_front() {
                return Ok(Some(message));
            }
            let records = match self.reader.next_event() {
                None => return Ok(None),
                Some(Err(error)) => return Err(self.damaged(error)),
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    self.fill(wanted)?;
                    continue;
                }
                Some(Ok(LinearReadEvent::Record { data, opcode })) => match opcode {
                    op::CHUNK => chunk::records(data),
                    _ => chunk::parse(opcode, data).map(|record| record.map(Record::into_owned).into_iter().collect()),
                },
            };
            for record in records.map_err(|error| self.damaged(error))? {
                self.take(record)?;
            }
        }
    }

    fn fill(&mut self, wanted: usize) -> Result<(), BagError> {
        // Never as much as a damaged length asks for at once; the reader asks again.
        let room = self.reader.insert(wanted.clamp(1, READ_SIZE));
        let count = loop {
            match self.source.read(room) {
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                result => break result.map_err(BagError::io(&self.path, "read the bag"))?,
            }
        };
        self.reader.notify_read(count);
        Ok(())
    }

    fn take(&mut self, record: Record<'static>) -> Result<(), BagError> {
        let taken = match record {
            Record::Schema { header, data } => self.accumulator.add_schema(header, data),
            Record::Channel(channel) => self.accumulator.add_channel(channel),
            Record::Message { header, data } => {
                return self.take_message(&header, data.into_owned());
            }
            _ => Ok(()),
        };
        taken.map_err(|error| self.damaged(error))
    }

    fn take_message(&mut self, header: &MessageHeader, cdr: Vec<u8>) -> Result<(), BagError> {
        let channel = self.channel(header)?;
        self.ready.push_back(BagMessage {
            log_time_ns: header.log_time,
            cdr,
            index: self.first_index + self.read,
            channel,
            file_path: Arc::clone(&self.path),
        });
        self.read += 1;
        Ok(())
    }

    fn channel(&mut self, header: &MessageHeader) -> Result<Arc<BagChannel>, BagError> {
        let id = header.channel_id;
        if let Some(channel) = self.channels.get(&id) {
            return Ok(Arc::clone(channel));
        }
        let Some(found) = self.accumulator.get(id) else {
            return Err(self.damaged(McapError::UnknownChannel(header.sequence, id)));
        };
        let unusable =
            |reason: String| BagError::Channel { path: self.path.to_path_buf(), topic: found.topic.clone(), reason };
        if found.message_encoding != "cdr" {
            return Err(unusable(format!("messages are '{}', not cdr", found.message_encoding)));
        }
        let Some(schema) = &found.schema else {
            return Err(unusable("has no schema, so its type is unknown".to_owned()));
        };
        let qos = found.metadata.get("offered_qos_profiles");
        let channel = Arc::new(BagChannel {
            topic: found.topic.clone(),
            ros_type: schema.name.clone(),
            schema_encoding: schema.encoding.clone(),
            schema: schema.data.to_vec(),
            offered_qos_profiles: qos.cloned().unwrap_or_default(),
        });
        self.channels.insert(id, Arc::clone(&channel));
        Ok(channel)
    }

    fn damaged(&self, error: McapError) -> BagError {
        if matches!(error, McapError::BadMagic) && self.read == 0 && self.channels.is_empty() {
            return BagError::NotABag {
                path: self.path.to_path_buf(),
                reason: "does not begin and end as MCAP does; name a .mcap file or the directory \
                         of a rosbag2 recording"
                    .to_owned(),
            };
        }
        let reason = match &error {
            McapError::Parse(_) => "a record cannot be parsed".to_owned(),
            McapError::Io(source) => source.to_string(),
            other => other.to_string(),
        };
        BagError::Damaged {
            path: self.path.to_path_buf(),
            // Messages of a chunk come out only when all of it was taken.
            messages_read: self.read - self.ready.len() as u64,
            reason,
        }
    }
}

impl<R: Read> Iterator for FileMessages<R> {
    type Item = Result<BagMessage, BagError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let step = self.step();
        self.ended = !matches!(step, Ok(Some(_)));
        step.transpose()
    }
}
