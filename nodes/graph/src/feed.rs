//! A file that a running node takes new versions of: watched, read and checked on a thread of its own.
//!
//! Place in the flow: between a model file and a node's loop. The thread looks at the file several times a second and
//! reads it when it has changed and come to rest, or when asked; what it has read and found good waits in a queue that
//! the loop empties between two samples, without ever waiting itself. What cannot be used is refused and told, and the
//! version in use goes on. Any artifact with a hash can come this way: the caller says how to load it.

use abbe_files::FileError;
use abbe_msgs::Sha256;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;
use thiserror::Error;

/// How often the file is looked at. A change is taken when two looks in a row find the same, so that a file that is
/// still being copied is left to grow.
const LOOK_EVERY: Duration = Duration::from_millis(200);
const STOPPING: &str = "the node is stopping";
/// Longest that somebody who asks for a load waits for its outcome.
const ANSWER_WITHIN: Duration = Duration::from_secs(30);

/// Why a file cannot be fed to a node.
#[derive(Debug, Error)]
pub enum FeedError {
    /// The version at the start cannot be used.
    #[error(transparent)]
    File(#[from] FileError),
    /// The thread that reads could not be started.
    #[error("{file}: cannot be watched: {source}; let this user start more threads, and start the node again")]
    Thread {
        /// The file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// What became of the versions of a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FeedStatus {
    /// Versions found good, the one at the start included.
    pub loaded: u64,
    /// Versions refused.
    pub refused: u64,
    /// Why the file as it is now is not in use, and what to do; `None` while it is.
    pub problem: Option<String>,
    /// The file that is watched.
    pub path: PathBuf,
}

/// What the reading thread can be asked.
enum Ask {
    /// Load now if the file differs from what was read last.
    Look,
    /// Load now and say what came of it.
    Load(SyncSender<Result<Sha256, String>>),
    /// Load this file, and go over to it where it can be used and nobody has given up waiting.
    GoOver(PathBuf, Decided, SyncSender<Result<Sha256, String>>),
}

/// Whether a file that was asked for is put to use or given up: who sets it first decides.
type Decided = Arc<AtomicBool>;

/// The loop's end: takes what is ready.
#[derive(Debug)]
pub struct Feed<T> {
    ready: Receiver<(T, Sha256)>,
    asks: Sender<Ask>,
    status: Arc<Mutex<FeedStatus>>,
}

/// Asks for a load from any thread.
#[derive(Debug, Clone)]
pub struct Reload(Sender<Ask>);

impl<T: Send + 'static> Feed<T> {
    /// Loads the file now, and watches it from then on; gives what was loaded.
    ///
    /// `load` reads and checks one version; it runs on this thread once, then on that of the feed.
    pub fn open(
        path: &Path,
        mut load: impl FnMut(&Path) -> Result<(T, Sha256), FileError> + Send + 'static,
    ) -> Result<((T, Sha256), Feed<T>), FeedError> {
        // Before the load: what changes while it reads is then a change, not the version that was read.
        let read = Version::of(path);
        let mut load = move |path: &Path| check_regular(path).and_then(|()| load(path));
        let first = load(path)?;
        let (give, ready) = channel();
        let (asks, asked) = channel();
        let status = FeedStatus { loaded: 1, path: path.to_owned(), ..FeedStatus::default() };
        let status = Arc::new(Mutex::new(status));
        let reader = Reader { path: path.to_owned(), load, read, sha256: first.1, give, status: Arc::clone(&status) };
        let started = thread::Builder::new().name("file-feed".into()).spawn(move || reader.run(&asked));
        started.map_err(|source| FeedError::Thread { file: path.to_owned(), source })?;
        Ok((first, Feed { ready, asks, status }))
    }
}

impl<T> Feed<T> {
    /// The newest version that has become ready since the last call. Never waits for the file.
    pub fn newest(&self) -> Option<(T, Sha256)> {
        self.ready.try_iter().last()
    }

    /// Has the file looked at now rather than at the next look. Does not wait.
    pub fn look_now(&self) {
        // The thread lives as long as this end of the queue.
        let _ = self.asks.send(Ask::Look);
    }

    /// The handle by which others ask for a load.
    pub fn reload(&self) -> Reload {
        Reload(self.asks.clone())
    }

    /// What became of the versions so far.
    pub fn status(&self) -> FeedStatus {
        lock(&self.status).clone()
    }
}

impl Reload {
    /// Loads the file whether it has changed or not, and waits for what comes of it.
    ///
    /// # Errors
    /// Why the file is refused, in words for a person.
    pub fn load(&self) -> Result<Sha256, String> {
        let (reply, outcome) = sync_channel(1);
        self.0.send(Ask::Load(reply)).map_err(|_| STOPPING)?;
        match outcome.recv_timeout(ANSWER_WITHIN) {
            Ok(outcome) => outcome,
            Err(RecvTimeoutError::Timeout) => Err(format!(
                "the file is still being read after {} s; look at /diagnostics for the outcome",
                ANSWER_WITHIN.as_secs()
            )),
            Err(RecvTimeoutError::Disconnected) => Err(STOPPING.to_owned()),
        }
    }

    /// Loads another file, and watches that one from then on. Where it cannot be used, or is not read in time, everything stays as it
    /// is: what was answered with an error is not put to use afterwards.
    ///
    /// # Errors
    /// Why the file is refused, in words for a person.
    pub fn load_from(&self, path: &Path) -> Result<Sha256, String> {
        self.go_over(path, ANSWER_WITHIN)
    }

    fn go_over(&self, path: &Path, within: Duration) -> Result<Sha256, String> {
        let ((reply, outcome), decided) = (sync_channel(1), Decided::default());
        self.0.send(Ask::GoOver(path.to_owned(), Arc::clone(&decided), reply)).map_err(|_| STOPPING)?;
        match outcome.recv_timeout(within) {
            Ok(outcome) => outcome,
            Err(RecvTimeoutError::Timeout) if !decided.swap(true, Ordering::AcqRel) => Err(format!(
                "{} is still being read after {} s, and is not put to use; see what keeps it, and ask again",
                path.display(),
                within.as_secs_f64()
            )),
            // It is being put to use this moment.
            Err(RecvTimeoutError::Timeout) => outcome.recv().unwrap_or_else(|_| Err(STOPPING.to_owned())),
            Err(RecvTimeoutError::Disconnected) => Err(STOPPING.to_owned()),
        }
    }
}

/// Refuses what is there and is no file: who opens a pipe waits for its writer, and a device has no end.
fn check_regular(path: &Path) -> Result<(), FileError> {
    match std::fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => Err(FileError::Io {
            file: path.display().to_string(),
            action: "read it",
            source: std::io::Error::other("a folder, a pipe or a device is no model file"),
        }),
        // What is not there, or may not be looked at, is told by who reads it.
        _ => Ok(()),
    }
}

/// What tells one version of a file from the next without reading it; `None` where there is no file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Version(Option<[i64; 7]>);

impl Version {
    fn of(path: &Path) -> Version {
        let numbers = |m: std::fs::Metadata| {
            let [device, inode, bytes] = [m.dev(), m.ino(), m.size()].map(|number| number as i64);
            [device, inode, bytes, m.mtime(), m.mtime_nsec(), m.ctime(), m.ctime_nsec()]
        };
        Version(std::fs::metadata(path).ok().map(numbers))
    }

    /// Whether this is another version than the one `read`, and the same as a look `before`.
    fn has_settled(self, before: Version, read: Version) -> bool {
        self != read && self == before
    }
}

/// The thread's end: looks, reads, checks, gives.
struct Reader<T, L> {
    path: PathBuf,
    load: L,
    /// The version that was read last, used or refused.
    read: Version,
    /// Hash of the last version found good.
    sha256: Sha256,
    give: Sender<(T, Sha256)>,
    status: Arc<Mutex<FeedStatus>>,
}

impl<T, L: FnMut(&Path) -> Result<(T, Sha256), FileError>> Reader<T, L> {
    /// Until the loop's end is dropped and nobody can ask any more.
    fn run(mut self, asked: &Receiver<Ask>) {
        let mut before = self.read;
        loop {
            let ask = asked.recv_timeout(LOOK_EVERY);
            let now = Version::of(&self.path);
            match ask {
                // Who asked may have given up.
                Ok(Ask::Load(reply)) => drop(reply.send(self.take(now, None))),
                Ok(Ask::GoOver(path, decided, reply)) => {
                    let _ = reply.send(self.take_from(path, &decided));
                    before = self.read;
                    continue;
                }
                // The outcome is in the status and in the log.
                Ok(Ask::Look) if now != self.read => drop(self.take(now, None)),
                Err(RecvTimeoutError::Timeout) if now.has_settled(before, self.read) => {
                    drop(self.take(now, None));
                }
                Ok(Ask::Look) | Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            before = now;
        }
    }

    /// Goes over to another file where that one is good.
    fn take_from(&mut self, path: PathBuf, decided: &Decided) -> Result<Sha256, String> {
        let version = Version::of(&path);
        let (before, read) = (std::mem::replace(&mut self.path, path), self.read);
        let problem = lock(&self.status).problem.clone();
        let taken = self.take(version, Some(decided));
        let mut status = lock(&self.status);
        if taken.is_ok() {
            status.path.clone_from(&self.path);
        } else {
            // The file in use is as good as it was.
            (self.path, self.read) = (before, read);
            status.problem = problem;
        }
        drop(status);
        taken
    }

    /// Reads and checks the file; what is good and new goes to the loop, unless who asked for it was told that it does not.
    fn take(&mut self, version: Version, decided: Option<&Decided>) -> Result<Sha256, String> {
        self.read = version;
        match (self.load)(&self.path) {
            Ok(_) if decided.is_some_and(|decided| decided.swap(true, Ordering::AcqRel)) => {
                let problem = format!("it was read too late; version {} stays in use", self.sha256);
                tracing::warn!(file = %self.path.display(), "{problem}");
                Err(problem)
            }
            Ok((_, sha256)) if sha256 == self.sha256 => {
                lock(&self.status).problem = None;
                Ok(sha256)
            }
            Ok((artifact, sha256)) => {
                let mut status = lock(&self.status);
                (status.loaded, status.problem) = (status.loaded + 1, None);
                drop(status);
                self.sha256 = sha256;
                // A loop that has ended needs no model.
                let _ = self.give.send((artifact, sha256));
                tracing::info!(file = %self.path.display(), %sha256, "new version in use from the next sample on");
                Ok(sha256)
            }
            Err(error) => {
                let problem = format!("{error}; version {} stays in use", self.sha256);
                tracing::warn!("refused a new version: {problem}");
                let mut status = lock(&self.status);
                (status.refused, status.problem) = (status.refused + 1, Some(problem.clone()));
                Err(problem)
            }
        }
    }
}

/// The status is consistent between any two statements; it is never held while the file is read.
fn lock(status: &Mutex<FeedStatus>) -> MutexGuard<'_, FeedStatus> {
    status.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_file_that_was_answered_with_an_error_is_not_put_to_use_afterwards() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        for file in [&a, &b] {
            std::fs::write(file, "").unwrap();
        }
        // The disk is slow: the second load waits until it is let go.
        let (let_go, go) = channel::<()>();
        let mut loads = 0;
        let load = move |path: &Path| {
            loads += 1;
            if loads > 1 {
                let _ = go.recv();
            }
            let is_b = path.ends_with("b");
            Ok((is_b, Sha256::from_bytes([u8::from(is_b) + 1; 32])))
        };
        let ((first, _), feed) = Feed::open(&a, load).unwrap();
        assert!(!first);
        let told = feed.reload().go_over(&b, Duration::from_millis(20)).unwrap_err();
        assert!(told.contains("is not put to use"), "{told}");
        let_go.send(()).unwrap();
        // The one that is waited for comes after it, on the same thread.
        let_go.send(()).unwrap();
        assert_eq!(feed.reload().load().unwrap(), Sha256::from_bytes([1; 32]));
        assert_eq!((feed.newest(), feed.status().path), (None, a));
        let_go.send(()).unwrap();
        assert_eq!(feed.reload().load_from(&b).unwrap(), Sha256::from_bytes([2; 32]));
        assert_eq!((feed.newest().map(|(is_b, _)| is_b), feed.status().path), (Some(true), b));
    }

    #[test]
    fn a_file_that_is_still_growing_is_left_to_grow() {
        let [old, part, more] = [1, 2, 3].map(|bytes| Version(Some([0, 0, bytes, 0, 0, 0, 0])));
        assert!(!old.has_settled(old, old), "nothing new");
        assert!(!part.has_settled(old, old), "just changed");
        assert!(!more.has_settled(part, old), "still growing");
        assert!(more.has_settled(more, old));
        assert!(!more.has_settled(more, more), "already read, used or refused");
        assert!(Version(None).has_settled(Version(None), old), "gone for good");
    }
}
