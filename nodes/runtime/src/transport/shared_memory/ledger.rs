//! How far a node has come with a topic, where the next process of that node finds it.
//!
//! Place in the flow: written by the subscriber of a node with every sample, one write of 24 bytes into a file in memory
//! (about a microsecond). A node that is killed tells nobody what it took; the one that is started in its place reads it
//! here, and counts what was sent in between as lost. A sample counts as done when the next is asked for, so the one that
//! a node is killed with counts as lost, even where its answer just went out.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

use super::{SHARED_MEMORY_FOLDER, prefix};
use crate::RunId;

/// Bytes of an entry: the publisher, and the number that comes next.
const ENTRY: usize = 24;

/// The entry of one node about one topic.
#[derive(Debug)]
pub(super) struct Ledger {
    file: File,
    written: Option<([u8; 16], u64)>,
}

impl Ledger {
    /// Opens the entry of `node` about `topic`, both absolute names.
    pub(super) fn open(run: &RunId, node: &str, topic: &str) -> std::io::Result<Ledger> {
        // Names in ROS have no dots, so that no two become the same.
        let name = format!("{}taken.{node}.{topic}", prefix(run)).replace('/', ".");
        let path = PathBuf::from(SHARED_MEMORY_FOLDER).join(name);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        Ok(Ledger { file, written: None })
    }

    /// What the process before this one wrote last.
    pub(super) fn read(&self) -> Option<([u8; 16], u64)> {
        let mut entry = [0; ENTRY];
        // Nothing, or half an entry, is no entry.
        self.file.read_exact_at(&mut entry, 0).ok()?;
        let (publisher, next) = entry.split_at(16);
        Some((publisher.try_into().ok()?, u64::from_le_bytes(next.try_into().ok()?)))
    }

    /// Notes how far the node has come.
    pub(super) fn write(&mut self, state: Option<([u8; 16], u64)>) {
        if state == self.written {
            return;
        }
        if let Some((publisher, next)) = state {
            let mut entry = [0; ENTRY];
            entry[..16].copy_from_slice(&publisher);
            entry[16..].copy_from_slice(&next.to_le_bytes());
            if let Err(error) = self.file.write_all_at(&entry, 0) {
                tracing::warn!(%error, "what this node has taken cannot be noted; a new start will not count losses");
            }
        }
        // Also after a failure: once is enough.
        self.written = state;
    }
}
