//! Two streams as pairs of one instant: tracer readings, and what else is known of the machine then.
//!
//! Place in the flow: under the monitor's step, once for corrected samples and once for scale readings. Either side may
//! come first; a tracer reading belongs to the nearest sample within a tolerance, so the order of arrival changes nothing.
//! Samples come in the order of their stamps: a reading waits until none that is still to come can be nearer. What waits is
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
    /// Latest stamp (ns) before the last sample, where that went back.
    went_back: Option<i64>,
    alone: u64,
}

impl<S: Clone> Pairs<S> {
    /// Stamps at most `within_s` seconds apart are the same instant.
    pub(super) fn new(within_s: f64) -> Pairs<S> {
        let mut pairs = Pairs {
            within_ns: 0,
            samples: Waiting::default(),
            readings: Waiting::default(),
            went_back: None,
            alone: 0,
        };
        pairs.within(within_s);
        pairs
    }

    /// From now on, stamps at most `within_s` seconds apart are the same instant.
    pub(super) fn within(&mut self, within_s: f64) {
        self.within_ns = (within_s * 1e9) as i64;
    }

    /// Takes a sample; gives the tracer readings whose sample is now known, each with it.
    pub(super) fn sample(&mut self, stamp: Stamp, sample: S) -> Vec<(S, TracerReading)> {
        let nanos = stamp.to_nanos();
        let mut before = self.samples.latest();
        // One sample may be late. Where the next is back as well, the clock was set, and what waits is of the time before.
        if self.went_back.take().is_some_and(|ahead| nanos < ahead) {
            let from_before = self.readings.forget_from(nanos.saturating_add(self.within_ns).saturating_add(1));
            self.alone += from_before.map(|readings| readings.len() as u64).sum::<u64>();
        }
        if before.is_some_and(|latest| nanos < latest) {
            self.went_back = before;
            drop(self.samples.forget_from(nanos));
            before = self.samples.latest();
        }
        // A sample that is given up may have had its readings.
        drop(self.samples.keep(nanos, sample));
        // Readings after the sample before this one may still wait for a nearer one than that.
        let from = before.map_or(i64::MIN, |before| before.saturating_add(1)).min(nanos.saturating_sub(self.within_ns));
        let open = self.readings.between(from, nanos.saturating_add(self.within_ns)).map(|(stamp, _)| stamp).collect();
        self.decided(open, |pairs, at| pairs.is_decided(at))
    }

    /// Takes a tracer reading; gives the sample of its instant if it is there and none can be nearer.
    pub(super) fn reading(&mut self, reading: &TracerReading) -> Option<S> {
        let nanos = reading.stamp.to_nanos();
        if self.is_decided(nanos)
            && let Some((_, sample)) = self.nearest(nanos)
        {
            return Some(sample.clone());
        }
        let mut together = self.readings.take(nanos).unwrap_or_default();
        together.push(*reading);
        let given_up = self.readings.keep(nanos, together);
        self.alone += given_up.map_or(0, |readings| readings.len() as u64);
        None
    }

    /// At the end: tracer readings that waited for a nearer sample, each with the nearest that came.
    pub(super) fn finish(&mut self) -> Vec<(S, TracerReading)> {
        let Some(latest) = self.samples.latest() else { return Vec::new() };
        let open = self.readings.between(latest, latest.saturating_add(self.within_ns));
        let open = open.map(|(stamp, _)| stamp).collect();
        self.decided(open, |_, _| true)
    }

    /// Takes the readings of these instants for which a sample is there and which are decided.
    fn decided(&mut self, open: Vec<i64>, is_decided: impl Fn(&Self, i64) -> bool) -> Vec<(S, TracerReading)> {
        let mut pairs = Vec::new();
        for at in open {
            let Some((_, sample)) = self.nearest(at).filter(|_| is_decided(self, at)) else { continue };
            let sample = sample.clone();
            let readings = self.readings.take(at).into_iter().flatten();
            pairs.extend(readings.map(|reading| (sample.clone(), reading)));
        }
        pairs
    }

    /// The nearest sample within the tolerance; of two as near, the earlier one.
    fn nearest(&self, at: i64) -> Option<(i64, &S)> {
        let around = self.samples.between(at.saturating_sub(self.within_ns), at.saturating_add(self.within_ns));
        around.min_by_key(|(stamp, _)| (*stamp - at).abs())
    }

    /// Whether no sample that is still to come can be nearer than the nearest that is there.
    fn is_decided(&self, at: i64) -> bool {
        let nearest = self.nearest(at).map(|(stamp, _)| (stamp - at).abs());
        let latest = self.samples.latest();
        nearest.is_some_and(|away| away == 0 || latest.is_some_and(|latest| latest >= at.saturating_add(away)))
    }

    /// Forgets waiting tracer readings that are none any more; gives how many.
    pub(super) fn forget(&mut self, is_gone: impl Fn(&TracerReading) -> bool) -> u64 {
        let mut forgotten = 0;
        self.readings.by_stamp.retain(|_, (_, together)| {
            let before = together.len();
            together.retain(|reading| !is_gone(reading));
            forgotten += (before - together.len()) as u64;
            !together.is_empty()
        });
        forgotten
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

    /// Forgets what has this stamp or a later one, and gives it.
    fn forget_from(&mut self, stamp_ns: i64) -> impl Iterator<Item = T> + use<T> {
        self.by_stamp.split_off(&stamp_ns).into_values().map(|(_, thing)| thing)
    }

    /// Those from one stamp to another, both included.
    fn between(&self, from_ns: i64, to_ns: i64) -> impl Iterator<Item = (i64, &T)> {
        let range = (from_ns <= to_ns).then(|| self.by_stamp.range(from_ns..=to_ns));
        range.into_iter().flatten().map(|(stamp, (_, thing))| (*stamp, thing))
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
        assert_eq!(pairs.sample(stamp(7), 7), [(7, reading(7))]);
    }

    #[test]
    fn regress_an_instant_that_a_clock_comes_to_again_is_not_matched_with_what_was_then() {
        let mut pairs = Pairs::new(0.0005);
        (0..50).for_each(|millis| assert!(pairs.sample(stamp(millis), millis).is_empty()));
        // 30 ms back; the tracer is ahead of the corrected samples.
        assert!(pairs.sample(stamp(20), 120).is_empty());
        assert_eq!(pairs.reading(&reading(21)), None);
        assert_eq!(pairs.sample(stamp(21), 121), [(121, reading(21))]);
        assert_eq!(pairs.reading(&reading(10)), Some(10), "before the instant it was set back to");
    }

    /// With a tolerance wider than half the samples' distance, a reading that came early was given to the first of several samples.
    #[test]
    fn regress_a_reading_belongs_to_the_nearest_sample_whatever_came_first() {
        // Samples every 10 ms; a reading that a box stamps 4 ms late, and one of exactly the instant.
        for (at, nearest) in [(24, 20), (26, 30), (30, 30), (25, 20)] {
            let samples = [10, 20, 30, 40];
            for before in 0..=samples.len() {
                let mut pairs = Pairs::new(0.012);
                let mut found = Vec::new();
                for (k, millis) in samples.into_iter().enumerate() {
                    if k == before {
                        found.extend(pairs.reading(&reading(at)).map(|sample| (sample, reading(at))));
                    }
                    found.extend(pairs.sample(stamp(millis), millis));
                }
                if before == samples.len() {
                    found.extend(pairs.reading(&reading(at)).map(|sample| (sample, reading(at))));
                }
                assert_eq!(found, [(nearest, reading(at))], "{at} before sample {before}");
            }
        }
    }

    #[test]
    fn the_last_reading_gets_the_nearest_sample_that_came() {
        let mut pairs = Pairs::new(0.012);
        assert!(pairs.sample(stamp(10), 10).is_empty());
        assert_eq!(pairs.reading(&reading(14)), None, "one at 15 ms may come");
        assert_eq!(pairs.reading(&reading(30)), None);
        assert_eq!(pairs.finish(), [(10, reading(14))]);
        assert_eq!(pairs.finish(), []);
    }

    /// A reading whose sample was lost was paired when the clock came to its instant once more.
    #[test]
    fn regress_a_reading_from_before_a_clock_was_set_back_is_forgotten() {
        let mut pairs = Pairs::new(0.0005);
        assert!(pairs.sample(stamp(40), 40).is_empty());
        assert_eq!(pairs.reading(&reading(45)), None, "its sample is lost");
        assert!(pairs.sample(stamp(50), 50).is_empty());
        for millis in 20..=60 {
            assert_eq!(pairs.sample(stamp(millis), -millis), [], "{millis}");
        }
        assert_eq!(pairs.alone(), 1);
    }

    #[test]
    fn one_late_sample_takes_no_reading_from_those_to_come() {
        let mut pairs = Pairs::new(0.0005);
        assert!(pairs.sample(stamp(40), 40).is_empty());
        assert_eq!(pairs.reading(&reading(45)), None);
        assert!(pairs.sample(stamp(39), 39).is_empty());
        assert_eq!(pairs.sample(stamp(45), 45), [(45, reading(45))]);
        assert_eq!(pairs.alone(), 0);
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
