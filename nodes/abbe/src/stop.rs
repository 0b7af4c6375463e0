//! Ctrl-C: a command that keeps nothing ends within half a second, whatever it computes; one that keeps what it has says so.
//!
//! Place in the flow: asked for before the work begins. Work looks at the request where it can; where it cannot (a file being
//! read, a matrix being factored, an input that is waited for) the program ends without it. That is safe, because outputs
//! appear whole or not at all, and what lies beside them under a temporary name is removed first.

use crate::exit::{self, Ended, STOPPED};
use abbe_files::remove_unfinished;
use abbe_runtime::Shutdown;
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::Duration;

/// How long work may take to end by itself, with its own words.
const GRACE: Duration = Duration::from_millis(250);

/// Ends the program soon after Ctrl-C.
pub(crate) fn end_soon() -> anyhow::Result<Shutdown> {
    let shutdown = Shutdown::on_signals()?;
    shutdown.when_requested(1, || {
        sleep(GRACE);
        end("stopped on request before the work was done");
    })?;
    Ok(shutdown)
}

/// Lets the work keep what it has: says so on Ctrl-C, and ends at once on the second. As long as `has_something` is false there
/// is nothing to keep, and the program ends soon.
pub fn keep_what_there_is(has_something: &Arc<AtomicBool>) -> anyhow::Result<Shutdown> {
    let shutdown = Shutdown::on_signals()?;
    let has_something = Arc::clone(has_something);
    shutdown.when_requested(1, move || {
        if has_something.load(Ordering::Relaxed) {
            say("stopping; what is done so far is being kept. Ctrl-C again ends at once and keeps nothing");
            return;
        }
        sleep(GRACE);
        end("stopped on request before there was anything to keep");
    })?;
    shutdown.when_requested(2, || end("stopped on request; nothing was kept"))?;
    Ok(shutdown)
}

/// What a command ends with that was asked to stop: not wrong input.
pub fn told_as_stopped(error: anyhow::Error, shutdown: &Shutdown) -> anyhow::Error {
    match shutdown.requested() && exit::code(&error) == exit::REFUSED {
        true => Ended::stopped(crate::told(&error)).into(),
        false => error,
    }
}

fn end(words: &str) {
    remove_unfinished();
    say(words);
    std::process::exit(i32::from(STOPPED));
}

fn say(words: &str) {
    // Not `eprintln!`: where nobody reads it, the exit code still tells.
    let _ = writeln!(std::io::stderr(), "abbe: {words}");
}
