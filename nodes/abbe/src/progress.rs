//! Where a long command stands, on standard error: on a terminal a line that turns, else a line now and then.
//!
//! Place in the flow: between what a model tells of its steps and whoever waits, be it a person, a log or another program.

use indicatif::{ProgressBar, ProgressStyle};
use std::cell::Cell;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Time between two lines: a log of an hour stays readable, and what is done sooner says nothing.
const EVERY: Duration = Duration::from_secs(5);

/// A line that says what is being done, and turns.
pub fn spinner(what: &str) -> ProgressBar {
    let style =
        ProgressStyle::with_template("{spinner} {prefix}: {msg}").unwrap_or_else(|_| ProgressStyle::default_spinner());
    let bar = ProgressBar::new_spinner().with_style(style).with_prefix(what.to_owned());
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

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

    /// How long it has been going on.
    pub(crate) fn elapsed(&self) -> Duration {
        self.since.elapsed()
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

/// How long work of several parts of one size may still take, as those that are done took.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Parts {
    /// When the first of them began.
    began: Duration,
    /// The part that is worked on, from 0, and when it began.
    now: (usize, Duration),
}

impl Parts {
    /// In words, where this part of so many (from 0) is worked on at this time; nothing before the first is done. Parts that begin anew are other
    /// work.
    pub(crate) fn left(&mut self, part: usize, of: usize, elapsed: Duration) -> Option<String> {
        if part < self.now.0 {
            self.began = elapsed;
        }
        if part != self.now.0 {
            self.now = (part, elapsed);
        }
        let (done, since) = self.now;
        let one = (since - self.began).checked_div(u32::try_from(done).ok()?)?;
        let whole = one * u32::try_from(of.saturating_sub(done)).ok()?;
        Some(match whole.saturating_sub(elapsed - since).as_secs() {
            0..10 => "a few s left".to_owned(),
            seconds @ 10..90 => format!("about {} s left", seconds / 10 * 10),
            seconds => format!("about {} min left", (seconds + 30) / 60),
        })
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

    #[test]
    fn parts_that_are_done_say_how_long_the_others_take() {
        let mut parts = Parts::default();
        let mut left = |part: usize, seconds: u64| parts.left(part, 4, Duration::from_secs(seconds));
        assert_eq!(left(0, 300), None);
        // One part took 300 s, so that three take 900.
        assert_eq!(left(1, 300).unwrap(), "about 15 min left");
        assert_eq!(left(1, 420).unwrap(), "about 13 min left");
        assert_eq!(left(2, 560).unwrap(), "about 9 min left");
        assert_eq!(left(3, 900).unwrap(), "about 5 min left");
        assert_eq!(left(3, 1165).unwrap(), "about 30 s left");
        assert_eq!(left(3, 9999).unwrap(), "a few s left");
        // A second round of parts, of which one took 60 s.
        assert_eq!(left(0, 10_000), None);
        assert_eq!(left(1, 10_060).unwrap(), "about 3 min left");
    }
}
