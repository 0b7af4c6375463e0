//! Where a long command stands, on standard error: on a terminal a line that turns, else a line now and then.
//!
//! Place in the flow: between what a model tells of its steps and whoever waits, be it a person, a log or another program.

use crate::command::spinner;
use indicatif::ProgressBar;
use std::cell::Cell;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Time between two lines: a log of an hour stays readable, and what is done sooner says nothing.
const EVERY: Duration = Duration::from_secs(5);

/// Tells where a command stands.
pub(crate) struct Told {
    what: String,
    bar: ProgressBar,
    since: Instant,
    pace: Option<Cell<Pace>>,
}

impl Told {
    pub(crate) fn new(what: &str) -> Told {
        let pace = (!std::io::stderr().is_terminal()).then(Cell::default);
        Told { what: what.to_owned(), bar: spinner(what), since: Instant::now(), pace }
    }

    /// Says what comes next; without a terminal only where the last line was some time ago.
    pub(crate) fn say(&self, words: String) {
        if let Some(pace) = &self.pace {
            let (is_due, next) = pace.get().at(self.since.elapsed());
            pace.set(next);
            if is_due {
                // Not `eprintln!`: it goes on whether or not somebody reads this.
                let _ = writeln!(std::io::stderr(), "abbe: {}: {words}", self.what);
            }
        }
        self.bar.set_message(words);
    }

    /// Takes the line from the terminal.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// When the last line was written, counted from the beginning.
#[derive(Debug, Clone, Copy, Default)]
struct Pace {
    last: Duration,
}

impl Pace {
    /// Whether a line is due at this time, and the pace after it.
    fn at(self, now: Duration) -> (bool, Pace) {
        let is_due = now >= self.last + EVERY;
        (is_due, if is_due { Pace { last: now } } else { self })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_comes_only_some_time_after_the_last() {
        let mut pace = Pace::default();
        let mut due = |seconds: f64| {
            let (is_due, next) = pace.at(Duration::from_secs_f64(seconds));
            pace = next;
            is_due
        };
        let told: Vec<bool> = [0.0, 1.0, 4.9, 6.0, 6.1, 10.9, 11.0, 60.0].into_iter().map(&mut due).collect();
        assert_eq!(told, [false, false, false, true, false, false, true, true]);
    }
}
