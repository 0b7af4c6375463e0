//! Reads bags message by message, with bounded memory.
//!
//! Place in the flow: rosbag2 directory or `.mcap` file -> [`BagMessage`] -> replay,
//! identification, correction. Messages come in the order they were recorded. Checksums of chunks,
//! data and index are compared; the first fault is an error and the end.

use std::collections::{BTreeSet, VecDeque};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::McapError;
use mcap::records::{MessageHeader, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::channels::{BagChannel, ChannelFault, Channels};
use super::{BagError, chunk, convert, metadata};
use crate::{Message, RosType, cdr};

/// Bytes asked of the operating system at once.
const READ_SIZE: usize = 64 * 1024;

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
    pub(super) fn new(
        log_time_ns: u64,
        cdr: Vec<u8>,
        index: u64,
        channel: Arc<BagChannel>,
        file_path: &Arc<Path>,
    ) -> BagMessage {
        BagMessage { log_time_ns, cdr, index, channel, file_path: Arc::clone(file_path) }
    }

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
    /// What is wrong with the bag as a whole; told when everything readable has been given.
    at_end: Option<BagError>,
    read: u64,
    /// Topics of what is known: of `metadata.yaml`, and of the files that have been read.
    topics: BTreeSet<String>,
}

/// Opens a bag: a rosbag2 directory or a `.mcap` file.
///
/// A recording that was not finished is given as far as it can be read; then comes an error.
///
/// # Errors
/// When there is none at `path`, or the `metadata.yaml` of the directory is wrong.
pub fn messages(path: impl AsRef<Path>) -> Result<Messages, BagError> {
    let path = path.as_ref();
    let entry = std::fs::metadata(path).map_err(BagError::io(path, "open the bag"))?;
    // What is no file, such as a pipe, can be read once only.
    if entry.is_file() {
        convert::refuse_sqlite(path)?;
    }
    let listing = if entry.is_dir() { metadata::list(path)? } else { metadata::Listing::file(path) };
    let metadata::Listing { files: mut later, promised, at_end, topics } = listing;
    later.reverse();
    let mut messages = Messages { current: None, later, promised, at_end, read: 0, topics };
    messages.open_next()?;
    Ok(messages)
}

/// Reads one `.mcap` from any source; `name` stands for it in errors.
pub fn messages_from<R: Read>(name: &Path, source: R) -> impl Iterator<Item = Result<BagMessage, BagError>> + use<R> {
    FileMessages::new(name, source, 0)
}

impl Messages {
    /// Topics that are known so far, with messages or without: all of the bag at its end.
    pub fn topics(&self) -> BTreeSet<String> {
        let current = self.current.iter().flat_map(|file| file.channels.topics());
        self.topics.iter().chain(current).cloned().collect()
    }

    fn open_next(&mut self) -> Result<(), BagError> {
        self.topics = self.topics();
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
        if let Some(problem) = self.at_end.take() {
            return Err(problem);
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
            (self.current, self.promised, self.at_end) = (None, None, None);
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
    channels: Channels,
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
            channels: Channels::default(),
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
        match record {
            Record::Message { header, data } => self.take_message(&header, data.into_owned()),
            definition => self.channels.define(definition).map_err(|error| self.damaged(error)),
        }
    }

    fn take_message(&mut self, header: &MessageHeader, cdr: Vec<u8>) -> Result<(), BagError> {
        let channel = self.channels.of(header, &self.path).map_err(|fault| match fault {
            ChannelFault::Unknown(error) => self.damaged(error),
            ChannelFault::Unusable(error) => error,
        })?;
        let index = self.first_index + self.read;
        self.ready.push_back(BagMessage::new(header.log_time, cdr, index, channel, &self.path));
        self.read += 1;
        Ok(())
    }

    fn damaged(&self, error: McapError) -> BagError {
        if matches!(error, McapError::BadMagic) && self.read == 0 && self.channels.none_used() {
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
