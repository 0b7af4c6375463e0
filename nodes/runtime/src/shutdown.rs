//! The request to stop: SIGINT, SIGTERM, SIGHUP, or the death of the process that started this one.
//!
//! Place in the flow: every loop of a node polls [`Shutdown::requested`], or sleeps with
//! [`Shutdown::sleep`]; then the node drops its endpoints and returns from `main`, which removes
//! its shared-memory files and tells its DDS peers. A command that only prints ends with its reader instead:
//! [`end_with_reader`].

#[cfg(not(target_os = "linux"))]
#[path = "shutdown/elsewhere.rs"]
mod system;
#[cfg(target_os = "linux")]
#[path = "shutdown/linux.rs"]
mod system;

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError, Weak};
use std::thread;
use std::time::{Duration, Instant};

use thiserror::Error;

pub use system::{end_on_signals, end_with_reader, follow_launcher, heeds_interrupt};

/// Environment variable that names the process whose end is the end of this one; see [`follow_launcher`].
pub const LAUNCHER_PID: &str = "ABBE_LAUNCHER_PID";

/// Signals that follow the first one within this time are the same request: `timeout` of GNU signals its child and then the
/// child's group. Nobody decides in so short a time that the first was not enough.
const SAME_REQUEST: Duration = Duration::from_millis(500);

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

/// Takes the signals of the process, each of which is a request unless it belongs to the first one.
struct Signalled {
    shutdown: Shutdown,
    /// When the first one came.
    first: Option<Instant>,
}

impl Signalled {
    fn new(shutdown: &Shutdown) -> Self {
        Self { shutdown: shutdown.clone(), first: None }
    }

    /// A signal that came at this instant.
    fn take(&mut self, at: Instant) {
        let is_first = self.first.is_none();
        let first = *self.first.get_or_insert(at);
        if is_first || at.duration_since(first) >= SAME_REQUEST {
            self.shutdown.request();
        }
    }
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
        system::raise_on_signals(&shutdown)?;
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

    /// Whether it was asked for more than once (a second Ctrl-C, half a second or more after the first): then nothing more
    /// is waited for.
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
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn regress_two_signals_within_milliseconds_are_one_request_and_a_later_one_is_urgent() {
        let shutdown = Shutdown::manual();
        let mut signalled = Signalled::new(&shutdown);
        let first = Instant::now();
        for after_ms in [0, 2, 499] {
            signalled.take(first + Duration::from_millis(after_ms));
            assert!(shutdown.requested() && !shutdown.is_urgent(), "{after_ms} ms after the first");
        }
        signalled.take(first + SAME_REQUEST);
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
}
