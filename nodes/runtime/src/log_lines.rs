//! Lines of the log, for whoever publishes them: the nodes of this process, on `/rosout`.
//!
//! Place in the flow: the program's log hands each line that it writes over; the node's place in the graph
//! ([`crate::gateway`]) publishes it. Nothing here waits: where lines come faster than they are published, they are lost,
//! and the log on standard error has them.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

/// Lines that wait to be published.
const WAITING: usize = 256;
/// Longest text of a line (bytes); what is longer is cut, and ends in "…".
const LONGEST: usize = 4096;

/// A line of the log.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogLine {
    /// How grave: as in `rcl_interfaces/Log`.
    pub level: u8,
    /// What it says.
    pub text: String,
    /// File of the source code; empty where it is not known.
    pub file: String,
    /// Line in it; 0 where it is not known.
    pub line: u32,
}

static HEARERS: Mutex<Vec<SyncSender<LogLine>>> = Mutex::new(Vec::new());

/// Hands a line over to who publishes it, if anybody does.
pub fn tell_log_line(mut line: LogLine) {
    let mut hearers = HEARERS.lock().unwrap_or_else(PoisonError::into_inner);
    if hearers.is_empty() {
        return;
    }
    if line.text.len() > LONGEST {
        let end = (0..=LONGEST).rev().find(|end| line.text.is_char_boundary(*end)).unwrap_or(0);
        line.text.truncate(end);
        line.text.push('…');
    }
    // Who is gone hears no more; who is slow misses this one.
    use std::sync::mpsc::TrySendError::Disconnected;
    hearers.retain(|hearer| !matches!(hearer.try_send(line.clone()), Err(Disconnected(_))));
}

/// All lines from now on.
#[cfg_attr(not(target_os = "linux"), allow(dead_code))] // nodes alone hear them
pub(crate) fn hear_log_lines() -> Receiver<LogLine> {
    let (hearer, lines) = sync_channel(WAITING);
    HEARERS.lock().unwrap_or_else(PoisonError::into_inner).push(hearer);
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_heard_whole_or_cut_where_letters_end_and_nobody_waits() {
        let lines = hear_log_lines();
        let line = |text: String| LogLine { level: 30, text, file: String::new(), line: 0 };
        tell_log_line(line("a word".to_owned()));
        assert_eq!(lines.recv().unwrap().text, "a word");
        tell_log_line(line("ä".repeat(LONGEST)));
        let cut = lines.recv().unwrap().text;
        assert!(cut.len() <= LONGEST + 3 && cut.ends_with("ä…"), "{} bytes", cut.len());
        for number in 0..10 * WAITING {
            tell_log_line(line(number.to_string()));
        }
        assert_eq!(lines.try_iter().count(), WAITING);
    }
}
