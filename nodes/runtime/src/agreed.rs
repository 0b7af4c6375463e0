//! What the processes of a run agree about: the word of the first is that of all.
//!
//! Place in the flow: sources that stamp what they play with the present ask here which recorded instant is which present
//! one, so that scale and tracer say the same. The word lies in a file in memory of the run, and goes with it.

use std::fs;
use std::io::{ErrorKind, Result};
use std::path::Path;

use crate::RunId;
use crate::transport::shared_memory::object_path;

/// Says `word` about `subject`; gives it back, or what a process of the run said before.
///
/// # Errors
/// When the file cannot be written or read.
pub fn agree(run: &RunId, subject: &str, word: &str) -> Result<String> {
    agree_at(&object_path(run, &format!("agreed.{subject}")), word)
}

fn agree_at(path: &Path, word: &str) -> Result<String> {
    // Whole or not at all: written beside, then given its name, which only one can get.
    let own = path.with_added_extension(format!("of-{}", std::process::id()));
    fs::write(&own, word)?;
    let named = fs::hard_link(&own, path);
    fs::remove_file(&own)?;
    match named {
        Ok(()) => Ok(word.to_owned()),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => fs::read_to_string(path),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_word_is_that_of_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("agreed.played");
        assert_eq!(agree_at(&path, "one").unwrap(), "one");
        assert_eq!(agree_at(&path, "two").unwrap(), "one");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left lying about");
    }
}
