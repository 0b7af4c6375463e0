//! The log on standard error, which no flood can fill: lines that repeat are counted instead of written.
//!
//! Place in the flow: under every command; what runs live is throttled, what works on a file says everything. A peer that sends nonsense a thousand times a second makes a node or the DDS
//! library warn as often. Of lines that differ in numbers only, the first [`BURST`] of each [`PERIOD`] are written, then
//! the 8th, 16th, 32nd and so on; each says how many before it were left out.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use tracing_subscriber::fmt::MakeWriter;

/// Lines of one kind that are all written in a [`PERIOD`].
const BURST: u64 = 5;
/// Time over which lines are counted.
const PERIOD: Duration = Duration::from_secs(10);
/// Kinds that are told apart at a time; all further ones count as one.
const KINDS: usize = 64;
/// Characters by which kinds are told apart.
const KIND_LENGTH: usize = 80;

/// Writes lines with something before each, without those that repeat.
pub(crate) struct Log<W> {
    before: &'static str,
    throttle: Option<Mutex<Throttle>>,
    output: fn() -> W,
    is_wanted: fn(&str) -> bool,
}

impl<W: Write> Log<W> {
    /// A log to `output`, with `before` at the beginning of each line, of the lines that are wanted; those that repeat
    /// are left out where it is `throttled`.
    pub(crate) fn new(before: &'static str, throttled: bool, output: fn() -> W, is_wanted: fn(&str) -> bool) -> Log<W> {
        Log { before, throttle: throttled.then(Mutex::default), output, is_wanted }
    }
}

impl<'a, W: Write + 'a> MakeWriter<'a> for Log<W> {
    type Writer = Line<'a, W>;

    fn make_writer(&'a self) -> Line<'a, W> {
        Line { log: self, text: Vec::new() }
    }
}

/// One line in the making; it is written when it is dropped.
pub(crate) struct Line<'a, W: Write> {
    log: &'a Log<W>,
    text: Vec<u8>,
}

impl<W: Write> Write for Line<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.text.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<W: Write> Drop for Line<'_, W> {
    fn drop(&mut self) {
        let text = String::from_utf8_lossy(&self.text);
        if text.is_empty() || !(self.log.is_wanted)(&text) {
            return;
        }
        let admit = |throttle: &Mutex<Throttle>| {
            throttle.lock().unwrap_or_else(PoisonError::into_inner).admit(&text, Instant::now())
        };
        let admitted = self.log.throttle.as_ref().map_or(Some(0), admit);
        let Some(left_out) = admitted else { return };
        let before = self.log.before;
        let note = match left_out {
            0 => String::new(),
            lines => format!("{before}{lines} more lines like the next were left out\n"),
        };
        // A log that nobody reads any more must not end the thread that writes to it.
        let _ = (self.log.output)().write_all(format!("{note}{before}{text}").as_bytes());
    }
}

/// What was written of each kind of line.
#[derive(Debug, Default)]
struct Throttle {
    kinds: BTreeMap<String, Kind>,
}

#[derive(Debug)]
struct Kind {
    since: Instant,
    seen: u64,
    left_out: u64,
}

impl Throttle {
    /// Whether to write a line, and how many like it were left out since the last one.
    fn admit(&mut self, line: &str, now: Instant) -> Option<u64> {
        let mut name = kind(line);
        if !self.kinds.contains_key(&name) && self.kinds.len() >= KINDS {
            self.kinds.retain(|_, kind| now.saturating_duration_since(kind.since) < PERIOD || kind.left_out > 0);
            if self.kinds.len() >= KINDS {
                name.clear();
            }
        }
        let kind = self.kinds.entry(name).or_insert(Kind { since: now, seen: 0, left_out: 0 });
        if now.saturating_duration_since(kind.since) >= PERIOD {
            (kind.since, kind.seen) = (now, 0);
        }
        kind.seen += 1;
        if kind.seen > BURST && !kind.seen.is_power_of_two() {
            kind.left_out += 1;
            return None;
        }
        Some(std::mem::take(&mut kind.left_out))
    }
}

/// The beginning of a line without its time and without digits: lines that differ in numbers are of one kind.
fn kind(line: &str) -> String {
    let after_time = line.split_once(' ').map_or(line, |(_, rest)| rest);
    after_time.chars().filter(|letter| !letter.is_ascii_digit()).take(KIND_LENGTH).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_flood_of_one_kind_is_counted_and_another_kind_still_heard() {
        let (mut throttle, start) = (Throttle::default(), Instant::now());
        let admitted = (0..60_000).filter(|number| {
            let line = format!("2026-01-01T00:00:{number}Z WARN sample {number} refused");
            throttle.admit(&line, start + Duration::from_micros(number * 100)).is_some()
        });
        // Five, and those from the 8th to the 32,768th.
        assert_eq!(admitted.count(), 5 + 13);
        assert_eq!(throttle.admit("2026 ERROR another thing", start), Some(0));
        let later = start + PERIOD;
        assert_eq!(throttle.admit("2026 WARN sample 7 refused", later), Some(60_000 - 32_768));
        assert_eq!(throttle.admit("2026 WARN sample 8 refused", later), Some(0));
    }

    #[test]
    fn endless_kinds_cost_neither_memory_nor_lines() {
        let (mut throttle, start) = (Throttle::default(), Instant::now());
        let word = |mut number: u32| {
            let mut word = String::new();
            while number > 0 {
                word.push(char::from(b'a' + (number % 26) as u8));
                number /= 26;
            }
            word
        };
        let admitted = (1..100_000).filter(|number| throttle.admit(&format!("t {}", word(*number)), start).is_some());
        // One of each kind, and the rest as one kind.
        assert!(admitted.count() <= KINDS + BURST as usize + 14);
        assert!(throttle.kinds.len() <= KINDS + 1);
    }
}
