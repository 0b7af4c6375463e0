//! Two streams as pairs of one instant: tracer readings, and what else is known of the machine then.
//!
//! Place in the flow: under the monitor's step, once for corrected samples and once for scale readings. Either side may
//! come first; instants are matched by stamp within a tolerance, so the order of arrival changes nothing.

use abbe_msgs::{Stamp, TracerReading};
use std::collections::BTreeMap;

/// Samples, and tracer readings, kept while their counterpart is awaited.
const WAITING: usize = 20_000;

/// What waits for its counterpart, by stamp (ns).
pub(super) struct Pairs<S> {
    within_ns: i64,
    samples: BTreeMap<i64, S>,
    readings: BTreeMap<i64, Vec<TracerReading>>,
    alone: u64,
}

impl<S: Clone> Pairs<S> {
    /// Stamps at most `within_s` seconds apart are the same instant.
    pub(super) fn new(within_s: f64) -> Pairs<S> {
        Pairs { within_ns: (within_s * 1e9) as i64, samples: BTreeMap::new(), readings: BTreeMap::new(), alone: 0 }
    }

    /// Takes a sample; gives the tracer readings that waited for it.
    pub(super) fn sample(&mut self, stamp: Stamp, sample: S) -> Vec<TracerReading> {
        let nanos = stamp.to_nanos();
        let stamps: Vec<i64> = self.readings.range(self.around(nanos)).map(|(stamp, _)| *stamp).collect();
        let readings = stamps.iter().filter_map(|stamp| self.readings.remove(stamp)).flatten().collect();
        self.samples.insert(nanos, sample);
        if self.samples.len() > WAITING {
            self.samples.pop_first();
        }
        readings
    }

    /// Takes a tracer reading; gives the sample of its instant if it is there already.
    pub(super) fn reading(&mut self, reading: &TracerReading) -> Option<S> {
        let nanos = reading.stamp.to_nanos();
        let nearest = self.samples.range(self.around(nanos)).min_by_key(|(stamp, _)| (*stamp - nanos).abs());
        if let Some((_, sample)) = nearest {
            return Some(sample.clone());
        }
        self.readings.entry(nanos).or_default().push(*reading);
        if self.readings.len() > WAITING {
            self.alone += self.readings.pop_first().map_or(0, |(_, readings)| readings.len() as u64);
        }
        None
    }

    /// Tracer readings given up because no sample of their instant came.
    pub(super) fn alone(&self) -> u64 {
        self.alone
    }

    fn around(&self, nanos: i64) -> std::ops::RangeInclusive<i64> {
        nanos.saturating_sub(self.within_ns)..=nanos.saturating_add(self.within_ns)
    }
}
