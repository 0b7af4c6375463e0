//! Keeps what is readable of a bag that was cut off or damaged.
//!
//! Place in the flow: damaged bag -> new, complete bag. Each file is read to its first fault and
//! its messages are written anew, unchanged.

use std::fs::File;
use std::path::{Path, PathBuf};

use super::reader::FileMessages;
use super::{BagError, BagWriter};

/// What a recovery saved.
#[derive(Debug)]
pub struct Recovery {
    /// Messages in the new bag.
    pub messages_saved: u64,
    /// What ended the reading, one for each file that is damaged; empty when none is.
    pub faults: Vec<BagError>,
}

/// Reads the bag at `input` up to the first fault of each file and writes the messages to a new
/// bag at `output`. A directory needs no `metadata.yaml`.
///
/// # Errors
/// When `input` holds no `.mcap` file or cannot be opened, or `output` exists or cannot be
/// written. Damage in `input` is no error here; it is reported in [`Recovery::faults`].
pub fn recover(input: impl AsRef<Path>, output: impl AsRef<Path>) -> Result<Recovery, BagError> {
    let mut sources = Vec::new();
    for path in files(input.as_ref())? {
        let file = File::open(&path).map_err(BagError::io(&path, "open the bag's file"))?;
        sources.push((path, file));
    }
    let mut writer = BagWriter::create(output)?;
    let mut faults = Vec::new();
    for (path, file) in sources {
        for message in FileMessages::new(&path, file, writer.message_count()) {
            match message {
                Ok(message) => writer.copy(&message)?,
                Err(fault) => faults.push(fault),
            }
        }
    }
    let messages_saved = writer.message_count();
    writer.finish()?;
    Ok(Recovery { messages_saved, faults })
}

/// The `.mcap` files of a bag, in the order of the number that rosbag2 puts at the end of a name.
fn files(input: &Path) -> Result<Vec<PathBuf>, BagError> {
    let entry = std::fs::metadata(input).map_err(BagError::io(input, "open the bag"))?;
    if !entry.is_dir() {
        return Ok(vec![input.to_owned()]);
    }
    let mut files = Vec::new();
    for entry in std::fs::read_dir(input).map_err(BagError::io(input, "list the bag"))? {
        let path = entry.map_err(BagError::io(input, "list the bag"))?.path();
        if path.extension().is_some_and(|extension| extension == "mcap") {
            files.push(path);
        }
    }
    if files.is_empty() {
        return Err(BagError::NotABag {
            path: input.to_owned(),
            reason: "the directory holds no .mcap file; name the directory of the recording".to_owned(),
        });
    }
    files.sort_by_key(|path| (split_number(path), path.clone()));
    Ok(files)
}

fn split_number(path: &Path) -> Option<u64> {
    let stem = path.file_stem()?.to_str()?;
    stem.rsplit_once('_')?.1.parse().ok()
}
