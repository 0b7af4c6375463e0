//! Samples in and out of a node's loop, and what goes wrong with them.
//!
//! Place in the flow: between a node's loop and its transports. Only a start can fail. Once a node is at work, a sample
//! that must not be used, a transport that fails to receive or to send, and a report that cannot be made are counted, told
//! in the log (the first of a kind at once, then at most once in [`SAY_EVERY`]) and on `/diagnostics`, and the loop goes on.

use super::NodeSummary;
use abbe_msgs::Message;
use abbe_runtime::ros::Clock;
use abbe_runtime::{Publish, Subscribe, TransportError};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::time::{Duration, Instant};

/// How often the same kind of trouble is told in the log.
const SAY_EVERY: Duration = Duration::from_secs(10);
/// Samples that are refused before a loop gets its turn again.
const REFUSED_AT_ONCE: usize = 256;
/// Rest after a failure of the transport, so that a lasting one does not take a whole core.
const REST: Duration = Duration::from_millis(10);
/// A stamp further ahead of the node's clock is of the future (ns).
const AHEAD_NS: i128 = 1_000_000_000;

/// A kind of trouble.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Trouble {
    Malformed,
    Receiving,
    Sending,
    /// A covariate that a sample has no place for.
    Covariate,
}

/// One kind of trouble so far.
#[derive(Debug, Clone, PartialEq)]
struct Told {
    /// So many times.
    count: u64,
    /// When it was in the log last, and how many there had been then.
    said: (Instant, u64),
    /// The last one in words.
    words: String,
}

/// What went wrong so far.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Troubles {
    clock: Clock,
    told: BTreeMap<Trouble, Told>,
    /// Samples with a stamp ahead of the node's clock.
    ahead_of_clock: u64,
}

impl Troubles {
    /// None yet, in a node that goes by this clock.
    pub(super) fn by_clock(clock: Clock) -> Self {
        Self { clock, ..Self::default() }
    }

    /// Counts a trouble, and tells it where that is due.
    pub(super) fn note(&mut self, trouble: Trouble, words: impl Display) {
        let now = Instant::now();
        let (words, count) = (words.to_string(), self.count(trouble) + 1);
        let said = self.told.get(&trouble).map(|told| told.said);
        let due = said.is_none_or(|(when, _)| now.duration_since(when) >= SAY_EVERY);
        if due {
            let more = count - said.map_or(0, |(_, before)| before);
            tracing::warn!(
                count,
                "{words}{}",
                if more > 1 { format!(" ({more} since this was told last)") } else { String::new() }
            );
        }
        let said = if due { (now, count) } else { said.unwrap_or((now, count)) };
        self.told.insert(trouble, Told { count, said, words });
    }

    pub(super) fn count(&self, trouble: Trouble) -> u64 {
        self.told.get(&trouble).map_or(0, |told| told.count)
    }

    /// The last trouble of a kind.
    pub(super) fn words(&self, trouble: Trouble) -> &str {
        self.told.get(&trouble).map_or("", |told| &told.words)
    }

    pub(super) fn ahead_of_clock(&self) -> u64 {
        self.ahead_of_clock
    }
}

/// The next sample. What must not be used is passed over, and a transport that fails may have the next one.
pub(crate) fn take<M: Message>(
    subscriber: &mut dyn Subscribe<M>,
    within: Duration,
    summary: &mut NodeSummary,
) -> Option<M> {
    for _ in 0..REFUSED_AT_ONCE {
        match subscriber.take_within(within) {
            Ok(sample) => {
                let sample = sample?;
                summary.received += 1;
                summary.troubles.ahead_of_clock += u64::from(is_ahead_of_clock(&sample, &summary.troubles.clock));
                return Some(sample);
            }
            Err(error @ TransportError::Malformed { .. }) => {
                summary.malformed += 1;
                summary.troubles.note(Trouble::Malformed, error);
            }
            Err(error) => {
                summary.troubles.note(Trouble::Receiving, error);
                std::thread::sleep(REST.min(within));
                return None;
            }
        }
    }
    None
}

/// Hands a sample on. One that cannot be handed on is dropped; the next may go.
pub(super) fn send<M: Message>(publisher: &mut dyn Publish<M>, sample: &M, summary: &mut NodeSummary) {
    match publisher.send(sample) {
        Ok(()) => summary.sent += 1,
        Err(error) => summary.troubles.note(Trouble::Sending, error),
    }
}

fn is_ahead_of_clock<M: Message>(sample: &M, clock: &Clock) -> bool {
    // A clock before 1970 is a clock without a battery, and a /clock on which nothing has come knows no time either.
    let Some(now_ns) = clock.now_ns() else { return false };
    i128::from(sample.stamp().to_nanos()) > now_ns.saturating_add(AHEAD_NS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_msgs::{ScaleReading, Stamp};
    use abbe_runtime::TransportKind;

    const REASON: &str = "out of memory";

    /// Fails at every second call, in one of two ways by turns.
    #[derive(Default)]
    struct Fickle {
        calls: u64,
        sent: Vec<u64>,
    }

    impl Publish<ScaleReading> for Fickle {
        fn send(&mut self, sample: &ScaleReading) -> Result<(), TransportError> {
            self.calls += 1;
            if self.calls.is_multiple_of(2) {
                let (topic, reason) = ("scale/reading".to_owned(), REASON.to_owned());
                return Err(TransportError::Send { topic, kind: TransportKind::SharedMemory, reason });
            }
            self.sent.push(sample.sequence);
            Ok(())
        }

        fn dropped(&self) -> u64 {
            self.calls / 2
        }

        fn subscribers(&self) -> usize {
            1
        }
    }

    impl Subscribe<ScaleReading> for Fickle {
        fn try_take(&mut self) -> Result<Option<ScaleReading>, TransportError> {
            self.calls += 1;
            let (topic, reason) = ("scale/reading".to_owned(), REASON.to_owned());
            match self.calls % 4 {
                1 => Err(TransportError::Malformed { topic, reason }),
                3 => Err(TransportError::Receive { topic, kind: TransportKind::SharedMemory, reason }),
                _ => Ok(Some(ScaleReading { sequence: self.calls, ..ScaleReading::default() })),
            }
        }

        fn wait(&mut self, _timeout: Duration) -> Result<bool, TransportError> {
            Ok(false)
        }

        fn lost(&self) -> u64 {
            0
        }

        fn interleaved(&self) -> u64 {
            0
        }
    }

    #[test]
    fn regress_a_send_that_fails_is_counted_and_the_next_one_goes() {
        let (mut publisher, mut summary) = (Fickle::default(), NodeSummary::default());
        for sequence in 0..10 {
            send(&mut publisher, &ScaleReading { sequence, ..ScaleReading::default() }, &mut summary);
        }
        assert_eq!((publisher.sent, summary.sent), (vec![0, 2, 4, 6, 8], 5));
        assert_eq!(summary.troubles.count(Trouble::Sending), 5);
        assert!(summary.troubles.words(Trouble::Sending).contains(REASON));
    }

    #[test]
    fn regress_a_malformed_sample_and_a_transport_that_fails_end_nothing() {
        let (mut subscriber, mut summary) = (Fickle::default(), NodeSummary::default());
        let taken: Vec<u64> = (0..12)
            .filter_map(|_| take(&mut subscriber, Duration::ZERO, &mut summary).map(|sample| sample.sequence))
            .collect();
        // A malformed one is passed over at once, a failure gives the loop its turn.
        assert_eq!(taken, [2, 4, 6, 8, 10, 12, 14, 16]);
        assert_eq!((summary.received, summary.malformed), (taken.len() as u64, 4));
        assert_eq!(summary.troubles.count(Trouble::Receiving), 4);
    }

    #[test]
    fn regress_a_trouble_that_lasts_is_told_once_in_a_while() {
        let mut troubles = Troubles::default();
        troubles.note(Trouble::Malformed, "first");
        let first = troubles.told[&Trouble::Malformed].said;
        (0..60_000).for_each(|_| troubles.note(Trouble::Malformed, "more"));
        assert_eq!(troubles.told[&Trouble::Malformed].said, first, "told more than once in {SAY_EVERY:?}");
        assert_eq!((troubles.count(Trouble::Malformed), troubles.words(Trouble::Malformed)), (60_001, "more"));
    }

    #[test]
    fn stamps_of_the_future_are_told_from_those_of_a_recording() {
        let at = |seconds: i32| ScaleReading { stamp: Stamp::new(seconds, 0).unwrap(), ..ScaleReading::default() };
        let clock = Clock::of_system();
        let now = i32::try_from(clock.now_ns().unwrap() / 1_000_000_000).unwrap_or(i32::MAX);
        assert!(!is_ahead_of_clock(&at(0), &clock) && !is_ahead_of_clock(&at(now), &clock));
        assert!(is_ahead_of_clock(&at(now.saturating_add(3600)), &clock));
        assert!(!is_ahead_of_clock(&at(i32::MAX), &Clock::simulated()), "nothing has come on /clock");
    }
}
