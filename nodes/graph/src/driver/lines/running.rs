//! The command whose output is read: started in a process group of its own, and ended with all that it started.
//!
//! Place in the flow: the thread that reads the command starts it; the port ends it when its loop ends, even where the thread waits for a
//! line that does not come.

use rustix::process::{Pid, Signal, kill_process_group};
use std::io::ErrorKind;
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdout, Command, ExitStatus};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long a command that was asked to end may take.
const PATIENCE: Duration = Duration::from_millis(500);
/// How often it is asked whether it has.
const STEP: Duration = Duration::from_millis(5);

#[derive(Debug, Default)]
enum State {
    #[default]
    Waits,
    Runs(Child),
    /// Nothing starts any more.
    Over,
}

/// Shared by the port and its thread.
#[derive(Debug, Clone, Default)]
pub(super) struct Running(Arc<Mutex<State>>);

impl Running {
    /// Starts it, and gives its output; `None` where the port is gone.
    pub(super) fn start(&self, command: &mut Command) -> std::io::Result<Option<ChildStdout>> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if matches!(*state, State::Over) {
            return Ok(None);
        }
        let mut child = command.process_group(0).spawn()?;
        let output = child.stdout.take();
        *state = State::Runs(child);
        output.map(Some).ok_or_else(|| ErrorKind::BrokenPipe.into())
    }

    /// Ends the one that runs; how it ended, if it is known.
    pub(super) fn end(&self) -> Option<ExitStatus> {
        self.leave(State::Waits)
    }

    /// Ends the one that runs, and no other starts.
    pub(super) fn end_for_good(&self) {
        self.leave(State::Over);
    }

    fn leave(&self, next: State) -> Option<ExitStatus> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let next = if matches!(*state, State::Over) { State::Over } else { next };
        match std::mem::replace(&mut *state, next) {
            State::Runs(child) => end(child),
            State::Waits | State::Over => None,
        }
    }
}

/// Asks the group to end, then makes it.
fn end(mut child: Child) -> Option<ExitStatus> {
    let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    // Whoever is asked may have ended by itself.
    let signal = |signal| group.map(|group| kill_process_group(group, signal));
    let mut ended = child.try_wait().ok().flatten();
    let _ = signal(Signal::TERM);
    let since = Instant::now();
    while ended.is_none() && since.elapsed() < PATIENCE {
        std::thread::sleep(STEP);
        ended = child.try_wait().ok().flatten();
    }
    let _ = signal(Signal::KILL);
    ended.or_else(|| child.wait().ok())
}
