//! Writes bags that rosbag2, Foxglove and Python readers open.
//!
//! Place in the flow: samples and ROS messages -> one or more `.mcap` (and `metadata.yaml`). The same
//! messages in the same order, split at the same places, give the same bytes.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::file_writer::FileWriter;
use super::metadata::{self, FileSummary, Metadata, TopicSummary};
use super::{BagError, BagMessage, Qos};
use crate::{Message, RosType, cdr, definition, type_description};

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BagSummary {
    /// The bag: directory or `.mcap` file.
    pub path: PathBuf,
    /// Messages of each topic.
    pub messages_by_topic: BTreeMap<String, u64>,
}

/// A bag that is being recorded. Call [`BagWriter::finish`]; a writer that is dropped leaves a bag whose
/// last file has no index: it is read to its last whole chunk, and recovering completes it.
pub struct BagWriter {
    path: PathBuf,
    /// The directory, unless the bag is a bare file.
    directory: Option<PathBuf>,
    /// The file that is written.
    file: FileWriter,
    /// Files that are complete.
    finished: Vec<FileSummary>,
    finished_messages: u64,
    type_by_topic: BTreeMap<String, String>,
    qos_by_topic: BTreeMap<String, Qos>,
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
        let file = FileWriter::create(&file_path)?;
        if let Some(directory) = &directory {
            sync_directory(directory)?;
        }
        Ok(Self {
            path: path.to_owned(),
            directory,
            file,
            finished: Vec::new(),
            finished_messages: 0,
            type_by_topic: BTreeMap::new(),
            qos_by_topic: BTreeMap::new(),
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
            path: self.file.path().to_owned(),
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
            path: self.file.path().to_owned(),
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
                    type_hash: type_description::hash(ros_type).unwrap_or_default(),
                    messages: 0,
                };
                self.add_topic(summary, "ros2msg", schema.as_bytes())?
            }
        };
        self.file.write(index, cdr, log_time_ns)
    }

    /// Writes a message that was read from another bag, with the schema, quality of service and
    /// hash of the type it had there.
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
                    type_hash: channel.type_hash.clone(),
                    messages: 0,
                };
                self.add_topic(summary, &channel.schema_encoding, &channel.schema)?
            }
        };
        self.file.write(index, &message.cdr, message.log_time_ns)
    }

    /// Hands everything written so far to the operating system, so that it survives a kill.
    ///
    /// # Errors
    /// When writing fails.
    pub fn flush(&mut self) -> Result<(), BagError> {
        self.file.flush()
    }

    /// Has everything written so far put on the disk, so that it survives a power cut. Waits for the disk.
    ///
    /// # Errors
    /// When writing fails.
    pub fn sync(&mut self) -> Result<(), BagError> {
        self.file.sync()
    }

    /// Size of the file that is written, as far as it has been handed to the operating system.
    ///
    /// # Errors
    /// When the operating system does not say.
    pub fn file_bytes(&self) -> Result<u64, BagError> {
        self.file.bytes()
    }

    /// Files that the bag consists of, the one that is written included.
    #[must_use]
    pub fn files(&self) -> usize {
        self.finished.len() + 1
    }

    /// Completes the file that is written and goes on in the next one: `<name>_1.mcap` and so on. What is
    /// complete is on the disk and named in `metadata.yaml` then. Does nothing while the file is empty.
    ///
    /// # Errors
    /// When the bag is a bare file, or writing fails.
    pub fn split(&mut self) -> Result<(), BagError> {
        let Some(directory) = &self.directory else {
            return Err(BagError::Bare { path: self.path.clone() });
        };
        if self.file.messages() == 0 {
            return Ok(());
        }
        let next = FileWriter::create(&file_path(directory, self.finished.len() + 1)?)?;
        let complete = std::mem::replace(&mut self.file, next).finish()?;
        self.finished_messages += complete.messages();
        self.finished.push(complete);
        write_metadata(directory, &self.finished)
    }

    /// Messages written so far.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.finished_messages + self.file.messages()
    }

    /// Completes the bag: index, and `metadata.yaml` of a directory.
    ///
    /// # Errors
    /// When writing fails.
    pub fn finish(self) -> Result<BagSummary, BagError> {
        let mut files = self.finished;
        files.push(self.file.finish()?);
        if let Some(directory) = &self.directory {
            write_metadata(directory, &files)?;
        }
        let topics = Metadata { files: &files }.topics().into_iter();
        Ok(BagSummary {
            path: self.path,
            messages_by_topic: topics.map(|topic| (topic.topic, topic.messages)).collect(),
        })
    }

    fn known_topic(&self, topic: &str, ros_type: &str) -> Result<Option<usize>, BagError> {
        match self.type_by_topic.get(topic) {
            Some(known) if known != ros_type => Err(BagError::TopicType {
                path: self.path.clone(),
                topic: topic.to_owned(),
                known: known.clone(),
                new: ros_type.to_owned(),
            }),
            _ => Ok(self.file.topic(topic)),
        }
    }

    fn add_topic(&mut self, summary: TopicSummary, schema_encoding: &str, schema: &[u8]) -> Result<usize, BagError> {
        let (topic, ros_type) = (summary.topic.clone(), summary.ros_type.clone());
        let index = self.file.add_topic(summary, schema_encoding, schema)?;
        self.type_by_topic.insert(topic, ros_type);
        Ok(index)
    }
}

/// Creates the directory of a bag and names the first file in it.
fn create_directory(path: &Path) -> Result<PathBuf, BagError> {
    let first = file_path(path, 0)?;
    std::fs::create_dir(path).map_err(|error| BagError::already(path, error))?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    sync_directory(folder)?;
    Ok(first)
}

/// The file of this number in a bag's directory.
fn file_path(directory: &Path, number: usize) -> Result<PathBuf, BagError> {
    let Some(name) = directory.file_name() else {
        return Err(BagError::NotABag {
            path: directory.to_owned(),
            reason: "the path has no last part to name the bag; name a new directory".to_owned(),
        });
    };
    let mut file_name = name.to_os_string();
    file_name.push(format!("_{number}.mcap"));
    Ok(directory.join(file_name))
}

/// Writes `metadata.yaml` about these files: the old text or the new one, whatever happens meanwhile.
fn write_metadata(directory: &Path, files: &[FileSummary]) -> Result<(), BagError> {
    let path = directory.join(metadata::FILE_NAME);
    let partial = path.with_extension("yaml.partial");
    let text = Metadata { files }.text();
    File::create(&partial)
        .and_then(|mut file| file.write_all(text.as_bytes()).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&partial, &path))
        .map_err(BagError::io(&path, "write the metadata"))?;
    sync_directory(directory)
}

/// A new name in a directory is on the disk only after the directory is.
fn sync_directory(path: &Path) -> Result<(), BagError> {
    File::open(path).and_then(|directory| directory.sync_all()).map_err(BagError::io(path, "put the bag on the disk"))
}
