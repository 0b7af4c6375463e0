//! Two streams as pairs of one instant: tracer readings, and what else is known of the machine then.
//!
//! Place in the flow: under the monitor's step, once for corrected samples and once for scale readings. Either side may
//! come first; instants are matched by stamp within a tolerance, so the order of arrival changes nothing. What waits is
//! given up in the order of arrival, whatever its stamp: a clock that was set back makes every new sample the earliest.
//! Stamps that such a clock comes to once more are those of what comes now, and what waits from before is forgotten.

use abbe_msgs::{Stamp, TracerReading};
use std::collections::{BTreeMap, VecDeque};

/// Samples, and tracer readings, kept while their counterpart is awaited.
const WAITING: usize = 20_000;

/// What waits for its counterpart, by stamp (ns).
pub(super) struct Pairs<S> {
    within_ns: i64,
    samples: Waiting<S>,
    readings: Waiting<Vec<TracerReading>>,
    alone: u64,
}

impl<S: Clone> Pairs<S> {
    /// Stamps at most `within_s` seconds apart are the same instant.
    pub(super) fn new(within_s: f64) -> Pairs<S> {
        let mut pairs = Pairs { within_ns: 0, samples: Waiting::default(), readings: Waiting::default(), alone: 0 };
        pairs.within(within_s);
        pairs
    }

    /// From now on, stamps at most `within_s` seconds apart are the same instant.
    pub(super) fn within(&mut self, within_s: f64) {
        self.within_ns = (within_s * 1e9) as i64;
    }

    /// Takes a sample; gives the tracer readings that waited for it.
    pub(super) fn sample(&mut self, stamp: Stamp, sample: S) -> Vec<TracerReading> {
        let nanos = stamp.to_nanos();
        let stamps: Vec<i64> = self.readings.around(nanos, self.within_ns).map(|(stamp, _)| stamp).collect();
        let readings = stamps.into_iter().filter_map(|stamp| self.readings.take(stamp)).flatten().collect();
        // The sample that came last has the latest stamp.
        if self.samples.latest().is_some_and(|latest| nanos < latest) {
            self.samples.forget_from(nanos);
        }
        // A sample that is given up may have had its readings.
        drop(self.samples.keep(nanos, sample));
        readings
    }

    /// Takes a tracer reading; gives the sample of its instant if it is there already.
    pub(super) fn reading(&mut self, reading: &TracerReading) -> Option<S> {
        let nanos = reading.stamp.to_nanos();
        let around = self.samples.around(nanos, self.within_ns);
        if let Some((_, sample)) = around.min_by_key(|(stamp, _)| (*stamp - nanos).abs()) {
            return Some(sample.clone());
        }
        let mut together = self.readings.take(nanos).unwrap_or_default();
        together.push(*reading);
        let given_up = self.readings.keep(nanos, together);
        self.alone += given_up.map_or(0, |readings| readings.len() as u64);
        None
    }

    /// Tracer readings given up because no sample of their instant came.
    pub(super) fn alone(&self) -> u64 {
        self.alone
    }
}

/// Things by stamp (ns), of which the one that came first is given up when there are too many.
struct Waiting<T> {
    by_stamp: BTreeMap<i64, (u64, T)>,
    /// Number and stamp in the order of arrival; those that are not in the map any more are passed over.
    arrived: VecDeque<(u64, i64)>,
    next: u64,
}

impl<T> Default for Waiting<T> {
    fn default() -> Waiting<T> {
        Waiting { by_stamp: BTreeMap::new(), arrived: VecDeque::new(), next: 0 }
    }
}

impl<T> Waiting<T> {
    /// Keeps a thing in the place of one with the same stamp; gives the one that is given up for it.
    fn keep(&mut self, stamp_ns: i64, thing: T) -> Option<T> {
        self.by_stamp.insert(stamp_ns, (self.next, thing));
        self.arrived.push_back((self.next, stamp_ns));
        self.next += 1;
        if self.arrived.len() <= WAITING {
            return None;
        }
        let (number, stamp_ns) = self.arrived.pop_front()?;
        let is_there = self.by_stamp.get(&stamp_ns).is_some_and(|(kept, _)| *kept == number);
        if is_there { self.take(stamp_ns) } else { None }
    }

    fn take(&mut self, stamp_ns: i64) -> Option<T> {
        self.by_stamp.remove(&stamp_ns).map(|(_, thing)| thing)
    }

    /// The latest stamp (ns).
    fn latest(&self) -> Option<i64> {
        self.by_stamp.last_key_value().map(|(stamp, _)| *stamp)
    }

    /// Forgets what has this stamp or a later one.
    fn forget_from(&mut self, stamp_ns: i64) {
        self.by_stamp.split_off(&stamp_ns);
    }

    fn around(&self, nanos: i64, within_ns: i64) -> impl Iterator<Item = (i64, &T)> {
        let range = nanos.saturating_sub(within_ns)..=nanos.saturating_add(within_ns);
        self.by_stamp.range(range).map(|(stamp, (_, thing))| (*stamp, thing))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(millis: i64) -> Stamp {
        Stamp::from_nanos(millis * 1_000_000).unwrap()
    }

    fn reading(millis: i64) -> TracerReading {
        TracerReading { stamp: stamp(millis), ..TracerReading::default() }
    }

    #[test]
    fn regress_a_clock_set_back_after_many_samples_does_not_end_the_matching() {
        let mut pairs = Pairs::new(0.0005);
        let many = 2 * WAITING as i64;
        (0..many).for_each(|millis| assert!(pairs.sample(stamp(5_000_000 + millis), millis).is_empty()));
        for millis in 0..100 {
            assert!(pairs.sample(stamp(millis), -millis).is_empty());
            assert_eq!(pairs.reading(&reading(millis)), Some(-millis));
        }
        // The other way round: readings wait, and the oldest of them are given up.
        let mut pairs = Pairs::new(0.0005);
        (0..many).for_each(|millis| assert_eq!(pairs.reading(&reading(5_000_000 + millis)), None));
        assert_eq!(pairs.alone(), many as u64 - WAITING as u64);
        assert_eq!(pairs.reading(&reading(7)), None);
        assert_eq!(pairs.sample(stamp(7), 7), [reading(7)]);
    }

    #[test]
    fn regress_an_instant_that_a_clock_comes_to_again_is_not_matched_with_what_was_then() {
        let mut pairs = Pairs::new(0.0005);
        (0..50).for_each(|millis| assert!(pairs.sample(stamp(millis), millis).is_empty()));
        // 30 ms back; the tracer is ahead of the corrected samples.
        assert!(pairs.sample(stamp(20), 120).is_empty());
        assert_eq!(pairs.reading(&reading(21)), None);
        assert_eq!(pairs.sample(stamp(21), 121), [reading(21)]);
        assert_eq!(pairs.reading(&reading(10)), Some(10), "before the instant it was set back to");
    }

    #[test]
    fn memory_stays_bounded_where_everything_finds_its_counterpart() {
        let mut pairs = Pairs::new(0.0005);
        for millis in 0..3 * WAITING as i64 {
            assert_eq!(pairs.reading(&reading(millis)), None);
            assert_eq!(pairs.sample(stamp(millis), ()).len(), 1);
        }
        assert!(pairs.samples.arrived.len() <= WAITING && pairs.samples.by_stamp.len() <= WAITING);
        assert!(pairs.readings.arrived.len() <= WAITING && pairs.readings.by_stamp.is_empty());
        assert_eq!(pairs.alone(), 0);
    }
}
