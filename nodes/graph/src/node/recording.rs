//! The disk's side of the recorder: one thread that writes, splits, watches the free space and waits for the disk.
//!
//! Place in the flow: [`super::recorder`] -> bounded queue -> bag. Nothing else of the node touches the disk, so that a
//! disk that stalls costs room in the queue and, when that is used up, counted messages, but never holds anybody up. What
//! was taken is on the disk half a second later: a power cut costs less than a second.

use crate::launch::RecordConfig;
use abbe_msgs::bag::{BagError, BagWriter};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Messages that wait for the disk at most: some seconds of a 1 kHz graph with all topics, some 20 MB.
const QUEUE: usize = 32_768;
/// How often everything is put on the disk.
const SYNC_EVERY: Duration = Duration::from_millis(500);
/// Warned is below so many times the space that is left free.
const WARN_FACTOR: u64 = 2;

/// A message on its way to the bag.
pub(crate) struct Record {
    pub(crate) topic: Arc<str>,
    pub(crate) ros_type: &'static str,
    pub(crate) cdr: Vec<u8>,
    pub(crate) log_time_ns: u64,
}

/// What there is to say of the recording.
#[derive(Debug, Clone, Default)]
pub(crate) struct Status {
    /// Messages in the bag.
    pub(crate) recorded: u64,
    /// Messages that came after recording had stopped, or that found the queue full.
    pub(crate) unrecorded: u64,
    /// Files of the bag.
    pub(crate) files: u64,
    /// Free space of the disk (bytes); `None` where the system does not say.
    pub(crate) free_bytes: Option<u64>,
    /// Whether little space is left.
    pub(crate) is_low: bool,
    /// Longest that the disk took to have everything.
    pub(crate) longest_sync: Duration,
    /// Why recording has stopped, and what to do.
    pub(crate) stopped: Option<String>,
}

/// A recording under way.
pub(crate) struct Recording {
    path: PathBuf,
    queue: Option<SyncSender<Record>>,
    status: Arc<Mutex<Status>>,
    thread: Option<JoinHandle<Result<(), BagError>>>,
}

impl Recording {
    /// Creates the bag at `path` and starts the thread that writes it.
    pub(crate) fn start(path: &Path, config: &RecordConfig) -> Result<std::io::Result<Recording>, BagError> {
        let writer = BagWriter::create(path)?;
        let status = Arc::new(Mutex::new(Status { files: 1, ..Status::default() }));
        let (queue, records) = sync_channel(QUEUE);
        let mut disk = Disk {
            path: path.to_owned(),
            split_bytes: config.split_mib.map(|mib| mib.saturating_mul(1 << 20)),
            split_after: config.split_s.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok()),
            least_free_bytes: config.least_free_bytes(),
            begun: Instant::now(),
            safe: 0,
            status: Arc::clone(&status),
        };
        let started = thread::Builder::new().name("recording".into()).spawn(move || disk.run(writer, &records));
        let path = path.to_owned();
        Ok(started.map(|thread| Recording { path, queue: Some(queue), status, thread: Some(thread) }))
    }

    /// The same at the first free place: `bag`, `bag-2`, `bag-3` and so on. What a launch before recorded, or one that
    /// crashed, is kept, and keeps nobody from recording. The folder of the bag is made where there is none.
    pub(crate) fn start_beside(bag: &Path, config: &RecordConfig) -> Result<std::io::Result<Recording>, BagError> {
        make_folder_of(bag)?;
        let mut number = 1_u64;
        loop {
            let path = numbered(bag, number);
            match Recording::start(&path, config) {
                // Asked of the creation itself: another launch may take the name at this moment.
                Err(BagError::Exists { .. }) => number += 1,
                started => {
                    if number > 1 {
                        tracing::warn!("{} exists already and stays; recording to {}", bag.display(), path.display());
                    }
                    return started;
                }
            }
        }
    }

    /// Hands a message on; never waits.
    pub(crate) fn push(&self, record: Record) {
        let handed = self.queue.as_ref().is_some_and(|queue| queue.try_send(record).is_ok());
        if !handed {
            lock(&self.status).unrecorded += 1;
        }
    }

    pub(crate) fn status(&self) -> Status {
        lock(&self.status).clone()
    }

    /// Completes the bag, or takes it away where nothing came to be recorded: a launch that was broken off leaves none.
    pub(crate) fn finish_unless_empty(self) -> Result<Status, BagError> {
        let path = self.path.clone();
        let status = self.finish()?;
        if (status.recorded, status.unrecorded, status.files) == (0, 0, 1) {
            match remove_bag(&path) {
                Ok(()) => tracing::info!("{}: nothing came to be recorded, so there is no bag", path.display()),
                Err(error) => tracing::warn!("{}: the empty bag cannot be removed: {error}", path.display()),
            }
        }
        Ok(status)
    }

    /// Completes the bag.
    pub(crate) fn finish(mut self) -> Result<Status, BagError> {
        drop(self.queue.take());
        let ended = self.thread.take().map(JoinHandle::join);
        if let Some(Err(_)) = ended {
            lock(&self.status).stopped = Some("the recording broke off; recover the bag".to_owned());
        }
        if let Some(Ok(outcome)) = ended {
            outcome?;
        }
        Ok(self.status())
    }
}

fn make_folder_of(bag: &Path) -> Result<(), BagError> {
    let Some(folder) = bag.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) else {
        return Ok(());
    };
    let action = "make the folder of the bag; name another in record";
    fs::create_dir_all(folder).map_err(|source| BagError::Io { path: folder.to_owned(), action, source })?;
    tracing::info!("{}: made for the bag", folder.display());
    Ok(())
}

/// The path of the bag of this number; a bare file keeps its extension, by which it is known as one.
fn numbered(bag: &Path, number: u64) -> PathBuf {
    let is_bare = bag.extension().is_some_and(|extension| extension == "mcap");
    match (if is_bare { bag.file_stem() } else { bag.file_name() }, number) {
        (None, _) | (_, 1) => bag.to_owned(),
        (Some(name), _) => {
            let extension = if is_bare { ".mcap" } else { "" };
            bag.with_file_name(format!("{}-{number}{extension}", name.to_string_lossy()))
        }
    }
}

/// Removes a bag of this process with the one file that it has; a folder in which others have put something stays with that.
fn remove_bag(path: &Path) -> std::io::Result<()> {
    if path.is_file() {
        return fs::remove_file(path);
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    fs::remove_file(path.join(format!("{name}_0.mcap")))?;
    fs::remove_file(path.join("metadata.yaml"))?;
    fs::remove_dir(path)
}

/// What the thread works with.
struct Disk {
    path: PathBuf,
    split_bytes: Option<u64>,
    split_after: Option<Duration>,
    least_free_bytes: u64,
    /// When the file that is written was begun.
    begun: Instant,
    /// Messages that are on the disk.
    safe: u64,
    status: Arc<Mutex<Status>>,
}

impl Disk {
    /// Writes until the queue is closed, or until nothing more may be written; then only counts.
    fn run(&mut self, mut writer: BagWriter, records: &Receiver<Record>) -> Result<(), BagError> {
        let reason = match self.record(&mut writer, records) {
            Ok(None) => return writer.finish().map(drop),
            Ok(Some(reason)) => match writer.finish() {
                Ok(_) => reason,
                Err(error) => self.cut_short(format!("{reason}; {error}")),
            },
            Err(error) => {
                // What is on the disk stays as it is: a writer that failed cannot complete its file.
                std::mem::forget(writer);
                self.cut_short(error.to_string())
            }
        };
        self.stop(reason, records);
        Ok(())
    }

    /// Why recording has stopped, where the bag could not be completed: only what had been put on the disk counts.
    fn cut_short(&self, reason: String) -> String {
        let mut status = lock(&self.status);
        status.unrecorded += status.recorded - self.safe;
        status.recorded = self.safe;
        format!("{reason}; what was written before can be recovered")
    }

    /// Writes what comes; gives why no more may be written, or nothing when the queue is closed.
    fn record(&mut self, writer: &mut BagWriter, records: &Receiver<Record>) -> Result<Option<String>, BagError> {
        let mut synced = Instant::now();
        if let Some(reason) = self.look(writer)? {
            return Ok(Some(reason));
        }
        loop {
            match records.recv_timeout(SYNC_EVERY.saturating_sub(synced.elapsed())) {
                Ok(record) => {
                    // Before it is written: one that fails counts among those that are not on the disk.
                    lock(&self.status).recorded += 1;
                    writer.write_cdr(&record.topic, record.ros_type, &record.cdr, record.log_time_ns)?;
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Ok(None),
            }
            if synced.elapsed() >= SYNC_EVERY {
                let since = Instant::now();
                writer.sync()?;
                let mut status = lock(&self.status);
                self.safe = status.recorded;
                status.longest_sync = status.longest_sync.max(since.elapsed());
                drop(status);
                synced = Instant::now();
                if let Some(reason) = self.look(writer)? {
                    return Ok(Some(reason));
                }
            }
        }
    }

    /// Begins the next file where that is due, and looks at the free space; gives why no more may be written.
    fn look(&mut self, writer: &mut BagWriter) -> Result<Option<String>, BagError> {
        let large = match self.split_bytes {
            Some(limit) => writer.file_bytes()? >= limit,
            None => false,
        };
        if large || self.split_after.is_some_and(|after| self.begun.elapsed() >= after) {
            writer.split()?;
            self.begun = Instant::now();
        }
        let free_bytes = free_bytes(&self.path);
        let least = self.least_free_bytes;
        let mut status = lock(&self.status);
        status.files = writer.files() as u64;
        status.free_bytes = free_bytes;
        let was_low = status.is_low;
        status.is_low = free_bytes.is_some_and(|free| free < least.saturating_mul(WARN_FACTOR));
        let free_mib = free_bytes.unwrap_or(0) >> 20;
        if status.is_low && !was_low {
            tracing::warn!(
                free_mib,
                "{}: little space is left; recording stops at {} MiB",
                self.path.display(),
                least >> 20
            );
        }
        let full = free_bytes.is_some_and(|free| free < least);
        Ok(full.then(|| {
            format!("{free_mib} MiB are free, less than the {} MiB to be left; make room and start again", least >> 20)
        }))
    }

    /// Says why, and counts what still comes until the queue is closed.
    fn stop(&self, reason: String, records: &Receiver<Record>) {
        tracing::error!("{}: recording has stopped: {reason}; the graph goes on without it", self.path.display());
        lock(&self.status).stopped = Some(reason);
        while records.recv().is_ok() {
            lock(&self.status).unrecorded += 1;
        }
    }
}

/// Free space for this user where the bag lies.
fn free_bytes(path: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(path).ok()?;
    disk.f_bavail.checked_mul(disk.f_frsize)
}

/// The status is consistent between any two statements.
fn lock(status: &Mutex<Status>) -> MutexGuard<'_, Status> {
    status.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_msgs::bag::messages;
    use abbe_msgs::{Message, ScaleReading, cdr};

    fn record(sequence: u64) -> Record {
        let reading = ScaleReading { sequence, ..ScaleReading::default() };
        let cdr = cdr::encode(&reading.to_ros()).unwrap();
        Record { topic: "/m/scale/reading".into(), ros_type: ScaleReading::ROS_TYPE, cdr, log_time_ns: sequence }
    }

    fn start(path: &Path, config: &RecordConfig) -> Recording {
        Recording::start(path, config).unwrap().unwrap()
    }

    #[test]
    fn a_recording_is_split_by_time_and_holds_everything_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run");
        let recording = start(&path, &RecordConfig { split_s: Some(1.0), ..RecordConfig::new(&path) });
        for sequence in 0..320 {
            recording.push(record(sequence));
            thread::sleep(Duration::from_millis(8));
        }
        let status = recording.finish().unwrap();
        assert_eq!((status.recorded, status.unrecorded, status.stopped), (320, 0, None));
        assert!(status.files >= 2 && status.longest_sync > Duration::ZERO, "{} files", status.files);
        let times = messages(&path).unwrap().map(|message| message.unwrap().log_time_ns);
        assert!(times.eq(0..320));
    }

    #[test]
    fn regress_what_is_there_already_is_kept_and_the_next_bag_is_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        for (name, beside) in
            [("no/such/run", ["run", "run-2", "run-3"]), ("a.mcap", ["a.mcap", "a-2.mcap", "a-3.mcap"])]
        {
            let bag = folder.path().join(name);
            let beside = beside.map(|name| bag.with_file_name(name));
            for (sequence, path) in (0..).zip(&beside) {
                let recording = Recording::start_beside(&bag, &RecordConfig::new(&bag)).unwrap().unwrap();
                recording.push(record(sequence));
                assert_eq!(&recording.path, path);
                assert_eq!(recording.finish_unless_empty().unwrap().recorded, 1);
            }
            for (sequence, path) in (0..).zip(&beside) {
                let times: Vec<u64> = messages(path).unwrap().map(|message| message.unwrap().log_time_ns).collect();
                assert_eq!(times, [sequence], "{} is what was recorded there", path.display());
            }
        }
    }

    #[test]
    fn regress_where_nothing_came_no_bag_is_left_and_what_others_put_there_stays() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["run", "run.mcap"] {
            let bag = folder.path().join(name);
            let recording = Recording::start_beside(&bag, &RecordConfig::new(&bag)).unwrap().unwrap();
            assert!(bag.exists());
            recording.finish_unless_empty().unwrap();
            assert!(!bag.exists(), "{name}");
        }
        let bag = folder.path().join("run");
        let recording = Recording::start_beside(&bag, &RecordConfig::new(&bag)).unwrap().unwrap();
        let mine = ["notes.txt", "keep.mcap"].map(|name| bag.join(name));
        mine.iter().for_each(|own| fs::write(own, "mine").unwrap());
        recording.finish_unless_empty().unwrap();
        mine.iter().for_each(|own| assert_eq!(fs::read_to_string(own).unwrap(), "mine"));
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_refused_with_the_key() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), "").unwrap();
        let bag = folder.path().join("file/run");
        let error = Recording::start_beside(&bag, &RecordConfig::new(&bag)).err().unwrap().to_string();
        assert!(error.contains("file") && error.contains("name another in record"), "{error}");
    }

    #[test]
    fn what_was_taken_a_second_ago_is_in_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run");
        let recording = start(&path, &RecordConfig::new(&path));
        (0..5).for_each(|sequence| recording.push(record(sequence)));
        thread::sleep(Duration::from_millis(1000));
        // Five messages fill no chunk: only putting them on the disk in time brings them here.
        assert_eq!(messages(&path).unwrap().filter(Result::is_ok).count(), 5);
        recording.finish().unwrap();
    }

    #[test]
    fn a_disk_that_is_nearly_full_ends_the_bag_properly_and_what_comes_later_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run");
        let recording = start(&path, &RecordConfig { least_free_mib: Some(u64::MAX), ..RecordConfig::new(&path) });
        for _ in 0..200 {
            if recording.status().stopped.is_some() {
                break;
            }
            thread::sleep(Duration::from_millis(10));
        }
        (0..5).for_each(|sequence| recording.push(record(sequence)));
        let status = recording.finish().unwrap();
        assert!(status.is_low && status.stopped.unwrap().contains("make room"));
        assert_eq!((status.recorded, status.unrecorded), (0, 5));
        assert_eq!(messages(&path).unwrap().map(Result::unwrap).count(), 0, "a whole bag");
    }
}
