//! Bags that rosbag2 alone reads, and the commands by which it makes of one what is read here.
//!
//! Place in the flow: [`super::metadata`] and [`super::reader`] meet SQLite, or files or messages that are packed one by
//! one -> words of an error. The commands are those of ROS 2 Jazzy: `ros2 bag convert` takes what it writes as YAML.

use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::{BagError, metadata};

/// How every SQLite database begins (<https://www.sqlite.org/fileformat.html>).
const SQLITE: &[u8] = b"SQLite format 3\0";

/// How rosbag2 makes a bag in MCAP of the one at `input`, beside it.
pub(super) fn by_rosbag2(input: &Path) -> String {
    // A folder may have a dot in its name.
    let name = if input.is_dir() { input.file_name() } else { input.file_stem() };
    let mut output = name.unwrap_or(OsStr::new("bag")).to_os_string();
    output.push("_mcap");
    let output = metadata::quoted(&input.with_file_name(output).to_string_lossy());
    let yaml = format!("output_bags: [{{uri: {output}, storage_id: mcap, all_topics: true}}]");
    format!(
        "convert the bag with ROS 2:\n  echo {} > out.yaml\n  ros2 bag convert -i {} -o out.yaml",
        shell_word(&yaml),
        shell_word(&input.to_string_lossy())
    )
}

/// Refuses a folder that no `metadata.yaml` describes, where its files are such as only rosbag2 reads.
///
/// # Errors
/// When there is a file in SQLite, or one that is packed as a whole, or the folder cannot be read.
pub(super) fn refuse_unlisted(directory: &Path) -> Result<(), BagError> {
    let listed = std::fs::read_dir(directory).map_err(BagError::io(directory, "list the bag"))?;
    let paths = listed.map(|entry| Ok(entry.map_err(BagError::io(directory, "list the bag"))?.path()));
    let mut paths = paths.collect::<Result<Vec<_>, BagError>>()?;
    // The same words whatever the order of the folder.
    paths.sort();
    let refused = |path: &Path, reason: String| Err(BagError::Storage { path: path.to_owned(), reason });
    let folder = shell_word(&directory.to_string_lossy());
    for path in paths.iter().filter(|path| path.is_file()) {
        if path.extension().is_some_and(|extension| extension == "zstd") {
            let reason = format!(
                "the file is packed, and no metadata.yaml lies beside it; unpack all of them, and name the folder again:\n  \
                 zstd --decompress {folder}/*.zstd"
            );
            return refused(path, reason);
        }
        if is_sqlite(path)? {
            // Neither reads nor converts a folder without one.
            let first = format!("\n  ros2 bag reindex -s sqlite3 {folder}\n");
            let how = by_rosbag2(directory).replacen('\n', &first, 1);
            return refused(path, format!("storage is SQLite, not mcap, and no metadata.yaml lies beside it; {how}"));
        }
    }
    Ok(())
}

/// Refuses a file of a bag in SQLite, which is named where the folder was meant.
///
/// # Errors
/// When the file is such a database, or cannot be read.
pub(super) fn refuse_sqlite(path: &Path) -> Result<(), BagError> {
    if !is_sqlite(path)? {
        return Ok(());
    }
    // It may be one of several files: the folder has them all.
    let input = match path.parent().filter(|folder| folder.join(metadata::FILE_NAME).is_file()) {
        Some(folder) if folder.as_os_str().is_empty() => Path::new("."),
        Some(folder) => folder,
        None => path,
    };
    let reason = format!("storage is SQLite, not mcap; {}", by_rosbag2(input));
    Err(BagError::Storage { path: path.to_owned(), reason })
}

fn is_sqlite(path: &Path) -> Result<bool, BagError> {
    let mut begins = Vec::new();
    let file = File::open(path).map_err(BagError::io(path, "open the bag's file"))?;
    file.take(SQLITE.len() as u64).read_to_end(&mut begins).map_err(BagError::io(path, "read the bag"))?;
    Ok(begins == SQLITE)
}

/// A word as a shell takes it for one.
fn shell_word(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+,:=@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}
