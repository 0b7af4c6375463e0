//! Removes what a run left in memory and on disk.
//!
//! Place in the flow: called by the launcher after its nodes have ended, and for a run that was
//! killed. Touches only files that carry the name of the run, and none while a node of it lives.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use iceoryx2::node::{Node, NodeListFailure, NodeState};
use iceoryx2::prelude::CallbackProgression;
use iceoryx2::service::ipc_threadsafe::Service;
use thiserror::Error;

use super::{SHARED_MEMORY_FOLDER, again_when, config, prefix, root};
use crate::RunId;
use crate::transport::TransportError;

/// Why files of a run remain.
#[derive(Debug, Error)]
pub enum CleanupError {
    /// Nodes of the run are alive.
    #[error("{nodes} nodes of run {run} are still alive; stop them, then clean up")]
    Alive {
        /// The run.
        run: RunId,
        /// How many.
        nodes: usize,
    },
    /// The state of the run's nodes is unknown.
    #[error("cannot list the nodes of run {run}: {reason}")]
    List {
        /// The run.
        run: RunId,
        /// Why.
        reason: String,
    },
    /// A file remains.
    #[error("cannot remove {path}: {source}; remove it by hand")]
    Remove {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The name cannot be turned into paths.
    #[error(transparent)]
    Config(#[from] TransportError),
}

/// Removes every file of `run`. A run that left nothing is no error.
///
/// # Errors
/// When a node of the run is alive, or a file cannot be removed; the others are removed then.
pub fn cleanup(run: &RunId) -> Result<(), CleanupError> {
    let root = PathBuf::from(root(run));
    if root.exists() {
        refuse_if_alive(run)?;
    }
    let mut outcome = Ok(());
    for object in objects(Path::new(SHARED_MEMORY_FOLDER), &prefix(run))? {
        outcome = outcome.and(removed(&object, fs::remove_file(&object)));
    }
    outcome.and(removed(&root, fs::remove_dir_all(&root)))
}

/// In place of a launcher or a node that was killed: who leaves the run last removes what is left of it.
pub fn cleanup_by_the_last(run: &RunId) {
    match cleanup(run) {
        // Others are still there; the last of them removes the files.
        Ok(()) | Err(CleanupError::Alive { .. }) => {}
        Err(error) => tracing::warn!(%error, "shared memory of the run could not be removed"),
    }
}

/// Removes what runs with automatic names left behind whose process has ended without a chance to clean up (`kill -9`,
/// a crash, a power cut that `/tmp` outlived). Returns how many runs these were.
///
/// A run stays untouched while a node of it lives, while a process with the number in its name does, where its files
/// are another user's, and where its folder is not here: then it may be that of a container that shares `/dev/shm`.
pub fn remove_leftovers() -> usize {
    let Ok(folders) = fs::read_dir("/tmp") else { return 0 };
    let names = folders.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let runs = names.filter_map(|name| name.strip_prefix("abbe_")?.parse::<RunId>().ok());
    let dead =
        runs.filter(|run| run.chosen_by().is_some_and(|process| !Path::new(&format!("/proc/{process}")).exists()));
    let removed = dead.filter(|run| match cleanup(run) {
        Ok(()) => true,
        Err(error) => {
            tracing::debug!(%error, "a leftover stays");
            false
        }
    });
    removed.count()
}

fn refuse_if_alive(run: &RunId) -> Result<(), CleanupError> {
    let config = config(run)?;
    let count = || {
        let mut nodes = 0;
        let listed = Node::<Service>::list(&config, |state| {
            nodes += usize::from(!matches!(state, NodeState::Dead(_)));
            CallbackProgression::Continue
        });
        listed.map(|()| nodes)
    };
    // A second Ctrl-C that comes just now must not leave the files.
    let nodes = again_when(|error| matches!(error, NodeListFailure::Interrupt), count)
        .map_err(|error| CleanupError::List { run: run.clone(), reason: format!("{error:?}") })?;
    if nodes > 0 {
        return Err(CleanupError::Alive { run: run.clone(), nodes });
    }
    Ok(())
}

fn objects(folder: &Path, prefix: &str) -> Result<Vec<PathBuf>, CleanupError> {
    let unreadable = |source| CleanupError::Remove { path: folder.to_owned(), source };
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        if entry.file_name().to_string_lossy().starts_with(prefix) {
            found.push(entry.path());
        }
    }
    Ok(found)
}

/// Gone is gone, whoever removed it.
fn removed(path: &Path, outcome: io::Result<()>) -> Result<(), CleanupError> {
    match outcome {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(CleanupError::Remove { path: path.to_owned(), source })
        }
        _ => Ok(()),
    }
}
