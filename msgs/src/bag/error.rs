//! What can be wrong with a bag: each error names the file, what is wrong, and what to do.

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::{MessageError, cdr::CdrError};

/// A bag that cannot be written or read.
#[derive(Debug, Error)]
pub enum BagError {
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// File or directory.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// Why not.
        source: std::io::Error,
    },
    /// There is something at the place already.
    #[error("{}: exists already; name another bag or remove it first", path.display())]
    Exists {
        /// File or directory.
        path: PathBuf,
    },
    /// Neither a `.mcap` file nor a directory of rosbag2.
    #[error("{}: not a bag: {reason}", path.display())]
    NotABag {
        /// File or directory.
        path: PathBuf,
        /// What is missing, and what to do.
        reason: String,
    },
    /// `metadata.yaml` is missing, unreadable, or contradicts the files.
    #[error("{}: {reason}", path.display())]
    Metadata {
        /// The `metadata.yaml`.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// A file in a storage that rosbag2 alone reads.
    #[error("{}: {reason}", path.display())]
    Storage {
        /// The file.
        path: PathBuf,
        /// What it is, and what to do.
        reason: String,
    },
    /// The file ends early or its content does not match its checksums.
    #[error(
        "{}: damaged or cut off after {messages_read} readable messages: {reason}; recover the bag \
         to keep these messages",
        path.display()
    )]
    Damaged {
        /// The `.mcap` file.
        path: PathBuf,
        /// Messages of this file that were read before.
        messages_read: u64,
        /// What the reader met.
        reason: String,
    },
    /// A channel that is not ROS 2 in CDR.
    #[error("{}: topic {topic}: {reason}; record it with rosbag2 in CDR", path.display())]
    Channel {
        /// The `.mcap` file.
        path: PathBuf,
        /// Topic of the channel.
        topic: String,
        /// What is wrong.
        reason: String,
    },
    /// A message that should be of another type.
    #[error(
        "{}: message {index}: topic {topic} carries {found}, not {expected}; name another topic",
        path.display()
    )]
    WrongType {
        /// The `.mcap` file.
        path: PathBuf,
        /// Position of the message in the bag, from 0.
        index: u64,
        /// Topic of the message.
        topic: String,
        /// Type in the bag.
        found: String,
        /// Type that was asked for.
        expected: &'static str,
    },
    /// Bytes that are not the message.
    #[error("{}: message {index} on {topic}: {source}", path.display())]
    Cdr {
        /// The `.mcap` file.
        path: PathBuf,
        /// Position of the message in the bag, from 0.
        index: u64,
        /// Topic of the message.
        topic: String,
        /// What is wrong.
        source: CdrError,
    },
    /// A message that must not be used.
    #[error("{}: message {index} on {topic}: {source}", path.display())]
    Message {
        /// The `.mcap` file.
        path: PathBuf,
        /// Position of the message in the bag, from 0.
        index: u64,
        /// Topic of the message.
        topic: String,
        /// What is wrong.
        source: MessageError,
    },
    /// Two types on one topic.
    #[error(
        "{}: topic {topic} carries {known} already, not {new}; give the other type its own topic",
        path.display()
    )]
    TopicType {
        /// The bag.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Type of the earlier messages.
        known: String,
        /// Type of the new message.
        new: String,
    },
    /// A type whose `.msg` text this crate does not embed.
    #[error("{}: topic {topic}: no .msg text of {ros_type} to embed; add it to the crate abbe-msgs", path.display())]
    UnknownType {
        /// The bag.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// The type.
        ros_type: String,
    },
    /// A bag of one file that should be split.
    #[error("{}: is one .mcap file, which cannot be split; name a directory", path.display())]
    Bare {
        /// The `.mcap` file.
        path: PathBuf,
    },
    /// The MCAP writer failed.
    #[error("{}: cannot write: {source}; check the free space, then record again", path.display())]
    Write {
        /// The `.mcap` file.
        path: PathBuf,
        /// Why.
        source: mcap::McapError,
    },
}

impl BagError {
    /// Makes an error of an operating-system error.
    pub(super) fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> BagError + use<> {
        let path = path.to_owned();
        move |source| BagError::Io { path, action, source }
    }

    /// Makes an error of a place that could not be created.
    pub(super) fn already(path: &Path, error: std::io::Error) -> BagError {
        if error.kind() == std::io::ErrorKind::AlreadyExists {
            BagError::Exists { path: path.to_owned() }
        } else {
            BagError::io(path, "create the bag")(error)
        }
    }

    /// Makes an error of an error of the MCAP writer.
    pub(super) fn write(path: &Path) -> impl FnOnce(mcap::McapError) -> BagError + use<> {
        let path = path.to_owned();
        move |source| BagError::Write { path, source }
    }
}
