//! The request to stop: SIGINT, SIGTERM, SIGHUP, or the death of the process that started this one.
//!
//! Place in the flow: every loop of a node polls [`Shutdown::requested`], or sleeps with
//! [`Shutdown::sleep`]; then the node drops its endpoints and returns from `main`, which removes
//! its shared-memory files and tells its DDS peers. A command that only prints ends with its reader instead:
//! [`end_with_reader`].

use std::os::unix::process::parent_id;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError, Weak};
use std::thread;
use std::time::{Duration, Instant};

use nix::sys::signal::{SigSet, Signal};
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
    /// How often it was asked for.
    requests: Mutex<u32>,
    raised: Condvar,
    seen: Arc<Seen>,
    /// Flags that are raised with this one.
    parts: Mutex<Vec<Weak<Flag>>>,
}

/// Who looks at a flag, or at that of one of its parts.
#[derive(Debug, Default)]
struct Seen {
    /// How often a loop has looked.
    looks: AtomicU64,
    /// Threads that sleep on the flag.
    asleep: AtomicUsize,
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
    #[error("cannot start a thread that watches: {0}")]
    Watch(#[source] std::io::Error),
}

impl Shutdown {
    /// A flag that only [`Shutdown::request`] raises: for tests and for loops within a process.
    #[must_use]
    pub fn manual() -> Self {
        Self::default()
    }

    /// The flag of the process, raised by SIGTERM, and by SIGINT and SIGHUP unless the process was started with these
    /// ignored (`nohup abbe …`, `abbe … &` in a script). Every call gives the same. From the first call on, only one
    /// thread of its own takes these signals: the caller, and what it starts later, is not interrupted by them. So call
    /// it first in `main`.
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
        let handled = signals_to_handle();
        let mut signals = Signals::new(&handled).map_err(ShutdownError::Signals)?;
        let taken = mask_of(&handled)?;
        // The thread takes them over from this one.
        taken.thread_unblock().map_err(of_system)?;
        let raise = move || signals.forever().for_each(|_| raised_by_signal.request());
        thread::Builder::new().name("signals".into()).spawn(raise).map_err(ShutdownError::Signals)?;
        // iceoryx2 and RustDDS give up where a signal interrupts one of their calls.
        taken.thread_block().map_err(of_system)?;
        Ok(OF_PROCESS.get_or_init(|| shutdown).clone())
    }

    /// Whether the process should stop.
    #[must_use]
    pub fn requested(&self) -> bool {
        self.0.seen.looks.fetch_add(1, Ordering::Relaxed);
        *self.requests() > 0
    }

    /// The same, by somebody other than the loop: it does not count as a look ([`Shutdown::is_looked_at`]).
    #[must_use]
    pub fn is_raised(&self) -> bool {
        *self.requests() > 0
    }

    /// Whether it was asked for more than once (a second Ctrl-C): then nothing more is waited for.
    #[must_use]
    pub fn is_urgent(&self) -> bool {
        *self.requests() > 1
    }

    /// Asks the process to stop.
    pub fn request(&self) {
        let parts = self.parts();
        let mut requests = self.requests();
        *requests = requests.saturating_add(1);
        drop(requests);
        self.0.raised.notify_all();
        parts.iter().filter_map(Weak::upgrade).for_each(|part| Shutdown(part).request());
    }

    /// A flag for a part of the process, which is raised with this one and can be raised alone. Who looks at it counts as
    /// looking at this one.
    #[must_use]
    pub fn part(&self) -> Shutdown {
        let mut parts = self.parts();
        parts.retain(|part| part.strong_count() > 0);
        let requests = Mutex::new(*self.requests());
        let seen = Arc::clone(&self.0.seen);
        let part = Arc::new(Flag { requests, seen, ..Flag::default() });
        parts.push(Arc::downgrade(&part));
        Shutdown(part)
    }

    fn parts(&self) -> MutexGuard<'_, Vec<Weak<Flag>>> {
        self.0.parts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls `act` on a thread of its own when stopping was asked for `times` times. For a command that looks at
    /// [`Shutdown::requested`] too seldom, or whose user asks twice.
    ///
    /// # Errors
    /// When the operating system refuses the thread.
    pub fn when_requested(&self, times: u32, act: impl FnOnce() + Send + 'static) -> Result<(), ShutdownError> {
        let shutdown = self.clone();
        let wait = move || {
            let flag = &shutdown.0;
            let requests = flag.requests.lock().unwrap_or_else(PoisonError::into_inner);
            drop(flag.raised.wait_while(requests, |requests| *requests < times));
            act();
        };
        thread::Builder::new().name("on-request".into()).spawn(wait).map_err(ShutdownError::Watch)?;
        Ok(())
    }

    /// Sleeps for `duration`, or until the process should stop. Returns [`Shutdown::requested`].
    pub fn sleep(&self, duration: Duration) -> bool {
        self.0.seen.asleep.fetch_add(1, Ordering::Relaxed);
        let slept = self.0.raised.wait_timeout_while(self.requests(), duration, |requests| *requests == 0);
        let requested = *slept.unwrap_or_else(PoisonError::into_inner).0 > 0;
        self.0.seen.looks.fetch_add(1, Ordering::Relaxed);
        self.0.seen.asleep.fetch_sub(1, Ordering::Relaxed);
        requested
    }

    /// The same, by somebody other than the loop: it does not count as a look ([`Shutdown::is_looked_at`]).
    pub fn sleep_beside(&self, duration: Duration) -> bool {
        let slept = self.0.raised.wait_timeout_while(self.requests(), duration, |requests| *requests == 0);
        *slept.unwrap_or_else(PoisonError::into_inner).0 > 0
    }

    /// Whether a loop of this process sleeps on the flag, or has looked at it since the last call with `looks`: a loop
    /// that hangs does neither.
    #[must_use]
    pub fn is_looked_at(&self, looks: &mut u64) -> bool {
        let now = self.0.seen.looks.load(Ordering::Relaxed);
        std::mem::replace(looks, now) != now || self.0.seen.asleep.load(Ordering::Relaxed) > 0
    }

    fn requests(&self) -> MutexGuard<'_, u32> {
        self.0.requests.lock().unwrap_or_else(PoisonError::into_inner)
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

/// Lets SIGINT, SIGTERM and SIGHUP end this process, whatever the one that started it blocks: nodes do, and what a process
/// blocks it hands down. For a program that a node starts; call it first in `main`.
///
/// # Errors
/// When the operating system refuses.
pub fn end_on_signals() -> Result<(), ShutdownError> {
    mask_of(&signals_to_handle())?.thread_unblock().map_err(of_system)
}

/// Ends this process, with exit code 70, within some seconds of the end of the one that [`LAUNCHER_PID`] names, its
/// parent; signals end it as well ([`end_on_signals`]). Does nothing where the variable is not set. For a program that a node starts for work beside its own, and
/// that is started by hand as well.
///
/// # Errors
/// When the launcher has ended already, is no process id, or the operating system refuses the watch.
pub fn follow_launcher() -> Result<(), ShutdownError> {
    let Some(value) = std::env::var_os(LAUNCHER_PID) else { return Ok(()) };
    end_on_signals()?;
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

fn mask_of(signals: &[i32]) -> Result<SigSet, ShutdownError> {
    signals.iter().map(|&number| Signal::try_from(number)).collect::<Result<_, _>>().map_err(of_system)
}

fn of_system(error: nix::Error) -> ShutdownError {
    ShutdownError::Signals(error.into())
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
    fn what_shall_happen_at_the_second_request_does_not_happen_at_the_first() {
        let shutdown = Shutdown::manual();
        let (send, acted) = std::sync::mpsc::channel();
        for times in [2, 1] {
            let send = send.clone();
            shutdown.when_requested(times, move || send.send(times).unwrap()).unwrap();
        }
        shutdown.request();
        assert_eq!(acted.recv().unwrap(), 1);
        assert!(acted.recv_timeout(Duration::from_millis(50)).is_err());
        shutdown.request();
        assert_eq!(acted.recv().unwrap(), 2);
    }

    #[test]
    fn a_second_request_is_urgent() {
        let shutdown = Shutdown::manual();
        shutdown.request();
        assert!(shutdown.requested() && !shutdown.is_urgent());
        shutdown.request();
        assert!(shutdown.is_urgent());
    }

    #[test]
    fn a_loop_that_looks_or_sleeps_is_told_from_one_that_hangs() {
        let shutdown = Shutdown::manual();
        let mut looks = 0;
        assert!(!shutdown.is_looked_at(&mut looks), "nobody looked");
        assert!(!shutdown.requested());
        assert!(shutdown.is_looked_at(&mut looks));
        assert!(!shutdown.is_looked_at(&mut looks), "nobody looked again");
        let sleeper = shutdown.clone();
        let asleep = thread::spawn(move || sleeper.sleep(Duration::from_secs(60)));
        while !shutdown.is_looked_at(&mut looks) {
            thread::yield_now();
        }
        assert!(shutdown.is_looked_at(&mut looks), "a sleeper does not hang");
        shutdown.request();
        assert!(asleep.join().unwrap());
    }

    #[test]
    fn a_part_is_raised_with_the_whole_and_alone_without_it() {
        let whole = Shutdown::manual();
        let (one, other) = (whole.part(), whole.part());
        one.request();
        assert!(one.requested() && !other.requested() && !whole.requested());
        whole.request();
        assert!(other.requested() && !other.is_urgent());
        assert!(whole.part().requested(), "of what is to stop, every part is");
        let mut looks = 0;
        assert!(whole.is_looked_at(&mut looks) && !whole.is_looked_at(&mut looks));
        assert!(other.requested());
        assert!(whole.is_looked_at(&mut looks), "who looks at a part looks at the whole");
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
