//! The request to stop: SIGINT, SIGTERM, SIGHUP, or the death of the process that started this one.
//!
//! Place in the flow: every loop of a node polls [`Shutdown::requested`], or sleeps with
//! [`Shutdown::sleep`]; then the node drops its endpoints and returns from `main`, which removes
//! its shared-memory files and tells its DDS peers. A command that only prints ends with its reader instead:
//! [`end_with_reader`].

use std::os::unix::process::parent_id;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGPIPE, SIGTERM};
use signal_hook::flag::register_conditional_default;
use signal_hook::iterator::Signals;
use thiserror::Error;

/// Environment variable that names the process whose end is the end of this one; see [`follow_launcher`].
pub const LAUNCHER_PID: &str = "ABBE_LAUNCHER_PID";

/// How often the watcher looks whether the launcher still lives.
const PARENT_POLL: Duration = Duration::from_millis(100);

/// How long an orphaned node may take to stop by itself before it is ended.
const ORPHAN_GRACE: Duration = Duration::from_secs(3);

/// Exit code of an orphaned node that did not stop by itself.
const ORPHAN_EXIT_CODE: i32 = 70;

/// A flag that says that the process should stop. Clones share the flag.
#[derive(Debug, Clone, Default)]
pub struct Shutdown(Arc<Flag>);

#[derive(Debug, Default)]
struct Flag {
    requested: Mutex<bool>,
    raised: Condvar,
}

/// Why stopping could not be arranged.
#[derive(Debug, Error)]
pub enum ShutdownError {
    /// The signal handler.
    #[error("cannot handle SIGINT, SIGTERM and SIGHUP: {0}")]
    Signals(#[source] std::io::Error),
    /// The handler of broken pipes.
    #[error("cannot handle SIGPIPE: {0}")]
    BrokenPipe(#[source] std::io::Error),
    /// The parent is gone already.
    #[error("the process {expected} that started this node has ended; start the node again")]
    ParentGone {
        /// Process id of the launcher.
        expected: u32,
    },
    /// The launcher is not named by its process id.
    #[error("{LAUNCHER_PID}={value:?} is no process id; unset it, or give the id of the process that starts this one")]
    NoProcess {
        /// What the variable says.
        value: String,
    },
    /// The operating system refused.
    #[error("cannot watch the process that started this node: {0}")]
    Watch(#[source] std::io::Error),
}

impl Shutdown {
    /// A flag that only [`Shutdown::request`] raises: for tests and for loops within a process.
    #[must_use]
    pub fn manual() -> Self {
        Self::default()
    }

    /// The flag of the process, raised by SIGTERM, and by SIGINT and SIGHUP unless the process was started with these
    /// ignored (`nohup abbe …`, `abbe … &` in a script). Every call gives the same.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn on_signals() -> Result<Self, ShutdownError> {
        static OF_PROCESS: OnceLock<Shutdown> = OnceLock::new();
        static INSTALLING: Mutex<()> = Mutex::new(());
        let _only_one = INSTALLING.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(installed) = OF_PROCESS.get() {
            return Ok(installed.clone());
        }
        let shutdown = Self::default();
        let raised_by_signal = shutdown.clone();
        let mut signals = Signals::new(signals_to_handle()).map_err(ShutdownError::Signals)?;
        let raise = move || signals.forever().for_each(|_| raised_by_signal.request());
        thread::Builder::new().name("signals".into()).spawn(raise).map_err(ShutdownError::Signals)?;
        Ok(OF_PROCESS.get_or_init(|| shutdown).clone())
    }

    /// Whether the process should stop.
    #[must_use]
    pub fn requested(&self) -> bool {
        *self.0.requested.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks the process to stop.
    pub fn request(&self) {
        *self.0.requested.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.0.raised.notify_all();
    }

    /// Sleeps for `duration`, or until the process should stop. Returns [`Shutdown::requested`].
    pub fn sleep(&self, duration: Duration) -> bool {
        let requested = self.0.requested.lock().unwrap_or_else(PoisonError::into_inner);
        let slept = self.0.raised.wait_timeout_while(requested, duration, |requested| !*requested);
        *slept.unwrap_or_else(PoisonError::into_inner).0
    }

    /// Ties the life of this process to that of `launcher_pid`, its parent: when the launcher ends,
    /// however it ends, the flag is raised, and a node that has not stopped 3 s later is ended
    /// with exit code 70. Call it first in `main` of a node that a launcher starts.
    ///
    /// The parent's process id is looked at every 100 ms. The kernel's own signal
    /// (`PR_SET_PDEATHSIG`) would come when the *thread* that started the node ends.
    ///
    /// # Errors
    /// When the launcher has ended already, or the operating system refuses the watch.
    pub fn follow_parent(&self, launcher_pid: u32) -> Result<(), ShutdownError> {
        let is_parent = move || parent_id() == launcher_pid;
        if !is_parent() {
            return Err(ShutdownError::ParentGone { expected: launcher_pid });
        }
        let shutdown = self.clone();
        thread::Builder::new()
            .name("parent-watch".into())
            .spawn(move || shutdown.end_as_orphan(is_parent))
            .map_err(ShutdownError::Watch)?;
        Ok(())
    }

    fn end_as_orphan(&self, is_parent: impl Fn() -> bool) {
        while is_parent() {
            thread::sleep(PARENT_POLL);
        }
        // The request first: a log that cannot be written must not keep the node alive.
        self.request();
        tracing::warn!("the launcher has ended; stopping");
        let deadline = Instant::now() + ORPHAN_GRACE;
        while Instant::now() < deadline {
            thread::sleep(PARENT_POLL);
        }
        tracing::error!("did not stop within {ORPHAN_GRACE:?} of the launcher's end; exiting");
        std::process::exit(ORPHAN_EXIT_CODE);
    }
}

/// Ends this process, with exit code 70, within some seconds of the end of the one that [`LAUNCHER_PID`] names, its
/// parent; does nothing where the variable is not set. For a program that a node starts for work beside its own, and
/// that is started by hand as well.
///
/// # Errors
/// When the launcher has ended already, is no process id, or the operating system refuses the watch.
pub fn follow_launcher() -> Result<(), ShutdownError> {
    let Some(value) = std::env::var_os(LAUNCHER_PID) else { return Ok(()) };
    let value = value.to_string_lossy().into_owned();
    let launcher_pid = value.parse().map_err(|_| ShutdownError::NoProcess { value })?;
    // A flag of its own: the program may look at none, and then signals must go on ending it.
    Shutdown::manual().follow_parent(launcher_pid)
}

/// From now on, writing to a pipe that nobody reads any more (`abbe … | head`) ends this process without a word, by
/// SIGPIPE, as it ends other programs; before, a broken pipe is an error. Not for a process that has peers or children
/// to take leave of: it calls this when they are gone.
///
/// # Errors
/// When the operating system refuses.
pub fn end_with_reader() -> Result<(), ShutdownError> {
    let always = Arc::new(AtomicBool::new(true));
    register_conditional_default(SIGPIPE, always).map_err(ShutdownError::BrokenPipe)?;
    Ok(())
}

/// SIGTERM, and those of SIGINT and SIGHUP that the process was not started to ignore.
fn signals_to_handle() -> Vec<i32> {
    // Only the kernel's own account says what was inherited; where there is none, nothing counts as ignored.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = ignored_signals(&status);
    let inherited = |signal: &i32| ignored & (1 << (signal - 1)) != 0;
    [SIGTERM, SIGINT, SIGHUP].into_iter().filter(|signal| *signal == SIGTERM || !inherited(signal)).collect()
}

/// Mask of the ignored signals in the text of `/proc/PID/status`; bit 0 is signal 1.
fn ignored_signals(status: &str) -> u64 {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|digits| u64::from_str_radix(digits.trim(), 16).ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_are_read_from_the_kernels_account() {
        let status = "Name:\tabbe\nSigBlk:\t0000000000000000\nSigIgn:\t0000000000000003\nSigCgt:\t0\n";
        assert_eq!(ignored_signals(status), 0b11);
        assert_eq!(ignored_signals("nothing of the kind"), 0);
    }

    #[test]
    fn a_request_ends_the_sleep_of_every_clone() {
        let shutdown = Shutdown::manual();
        let sleeper = shutdown.clone();
        let asleep = thread::spawn(move || sleeper.sleep(Duration::from_secs(60)));
        assert!(!shutdown.requested());
        shutdown.request();
        assert!(asleep.join().unwrap(), "slept to the end");
        assert!(shutdown.requested());
    }

    #[test]
    fn an_undisturbed_sleep_says_go_on() {
        assert!(!Shutdown::manual().sleep(Duration::from_millis(5)));
    }

    #[test]
    fn a_stranger_is_not_taken_for_the_parent() {
        let error = Shutdown::manual().follow_parent(std::process::id()).unwrap_err();
        assert!(matches!(error, ShutdownError::ParentGone { .. }), "{error}");
    }
}
