//! What a process is told where there is no live node: Ctrl-C.
//!
//! Place in the flow: under [`Shutdown`], which it raises. Nobody starts this process as part of a graph, and no signal tells
//! that nobody reads its output any more: writing then fails.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use signal_hook::consts::SIGINT;
use signal_hook::flag::register;

use super::{Shutdown, ShutdownError, Signalled};

/// How often the watcher looks whether Ctrl-C was pressed.
const LOOK_UP: Duration = Duration::from_millis(20);

/// Raises the flag by Ctrl-C, which Windows knows under the name of SIGINT.
pub(super) fn raise_on_signals(shutdown: &Shutdown) -> Result<(), ShutdownError> {
    let (mut signalled, pressed) = (Signalled::new(shutdown), Arc::new(AtomicBool::new(false)));
    register(SIGINT, Arc::clone(&pressed)).map_err(ShutdownError::Signals)?;
    let raise = move || {
        loop {
            thread::sleep(LOOK_UP);
            if pressed.swap(false, Ordering::Relaxed) {
                signalled.take(Instant::now());
            }
        }
    };
    thread::Builder::new().name("signals".into()).spawn(raise).map_err(ShutdownError::Signals)?;
    Ok(())
}

/// Whether Ctrl-C is a request to stop: always.
#[must_use]
pub fn heeds_interrupt() -> bool {
    true
}

/// Nothing: no signal is kept from this process.
///
/// # Errors
/// Never.
pub fn end_on_signals() -> Result<(), ShutdownError> {
    Ok(())
}

/// Nothing: there is no launcher.
///
/// # Errors
/// Never.
pub fn follow_launcher() -> Result<(), ShutdownError> {
    Ok(())
}

/// Nothing: there is no such signal.
///
/// # Errors
/// Never.
pub fn end_with_reader() -> Result<(), ShutdownError> {
    Ok(())
}
