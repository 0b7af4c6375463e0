//! What Linux tells a process: signals, and the death of the one that started it.
//!
//! Place in the flow: under [`Shutdown`], which it raises.

use std::os::unix::process::parent_id;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::{Duration, Instant};

use nix::sys::signal::{SigSet, Signal};
use signal_hook::consts::{SIGHUP, SIGINT, SIGPIPE, SIGTERM};
use signal_hook::flag::register_conditional_default;
use signal_hook::iterator::Signals;

use super::{LAUNCHER_PID, Shutdown, ShutdownError, Signalled};

/// How often the watcher looks whether the launcher still lives.
const PARENT_POLL: Duration = Duration::from_millis(100);

/// How long an orphaned node may take to stop by itself before it is ended.
const ORPHAN_GRACE: Duration = Duration::from_secs(3);

/// Exit code of an orphaned node that did not stop by itself.
const ORPHAN_EXIT_CODE: i32 = 70;

/// Raises the flag by SIGTERM, and by SIGINT and SIGHUP unless the process was started with these ignored.
pub(super) fn raise_on_signals(shutdown: &Shutdown) -> Result<(), ShutdownError> {
    let mut signalled = Signalled::new(shutdown);
    let handled = signals_to_handle();
    let mut signals = Signals::new(&handled).map_err(ShutdownError::Signals)?;
    let taken = mask_of(&handled)?;
    // The thread takes them over from this one.
    taken.thread_unblock().map_err(of_system)?;
    let raise = move || signals.forever().for_each(|_| signalled.take(Instant::now()));
    thread::Builder::new().name("signals".into()).spawn(raise).map_err(ShutdownError::Signals)?;
    // iceoryx2 and RustDDS give up where a signal interrupts one of their calls.
    taken.thread_block().map_err(of_system)
}

impl Shutdown {
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

/// Whether Ctrl-C, or SIGINT from anywhere, is a request to stop: not where this process was started to ignore it, as by a script with `&`.
#[must_use]
pub fn heeds_interrupt() -> bool {
    signals_to_handle().contains(&SIGINT)
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
    fn a_stranger_is_not_taken_for_the_parent() {
        let error = Shutdown::manual().follow_parent(std::process::id()).unwrap_err();
        assert!(matches!(error, ShutdownError::ParentGone { .. }), "{error}");
    }
}
