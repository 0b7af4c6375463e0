//! A stream of samples as it comes: does each follow the one before, and is it one stream or several mixed?
//!
//! Place in the flow: before the geometric and the residual step, and in the monitor; replay runs it over what was
//! recorded. It sees stamps, sequences and positions and nothing else, so that live and replay say the same. What it finds
//! stands in the status of the sample ([`Verdict::apply`]) or in its counts, which the nodes tell on `/diagnostics`.
//!
//! Several publishers of one topic are told by their sequences: a source counts on, so a stream that goes back and then
//! goes on where it had been before holds two of them. A source that starts again goes back once and stays; a counter that
//! stands still goes on nowhere. Once may be chance (a sample lost just there); twice within [`MEMORY`] samples is none.

use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, ScaleReading, Sha256, Stamp, TracerReading};
use std::collections::{BTreeMap, VecDeque};

/// Samples after which a source that was left counts as gone.
const MEMORY: u64 = 10_000;
/// Samples that a mixed stream stays mixed after the last sign of it.
const HOLD: u64 = 32;
/// Sources that are told apart at a time.
const SOURCES: usize = 4;
/// Tracer stations that are watched at a time.
const STATIONS: usize = 64;
/// A step of the stamps beyond this is remarked (s): a pause of the source, or a clock that was set.
pub const REMARKED_STEP_S: f64 = 60.0;

/// What tells a sample from the others of its stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mark {
    stamp: Stamp,
    sequence: u64,
    /// Bits of what was measured; the same instant may be sent again, another position at that instant may not.
    measured: [u64; 6],
    /// Who made something of it: two correctors answer the same reading with different models.
    model_sha256: Sha256,
}

impl Mark {
    /// The scale reading that a corrected sample answers.
    pub fn of_reading(sample: &CorrectedCoordinates) -> Mark {
        Mark::positions(sample.stamp, sample.sequence, sample.reading_m, sample.offset_m)
    }

    fn positions(stamp: Stamp, sequence: u64, reading_m: [f64; 3], offset_m: [f64; 3]) -> Mark {
        let [x, y, z] = reading_m.map(f64::to_bits);
        let [u, v, w] = offset_m.map(f64::to_bits);
        Mark { stamp, sequence, measured: [x, y, z, u, v, w], model_sha256: Sha256::NONE }
    }
}

impl From<&ScaleReading> for Mark {
    fn from(reading: &ScaleReading) -> Mark {
        Mark::positions(reading.stamp, reading.sequence, reading.reading_m, reading.offset_m)
    }
}

impl From<&CorrectedCoordinates> for Mark {
    fn from(sample: &CorrectedCoordinates) -> Mark {
        Mark { model_sha256: sample.model_sha256, ..Mark::of_reading(sample) }
    }
}

impl From<&TracerReading> for Mark {
    fn from(reading: &TracerReading) -> Mark {
        let measured = [reading.length_m.to_bits(), 0, 0, 0, 0, 0];
        Mark { stamp: reading.stamp, sequence: reading.sequence, measured, model_sha256: Sha256::NONE }
    }
}

/// What a stream makes of one of its samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It follows the one before.
    InOrder,
    /// Its stamp does not: earlier, or the same with another position.
    OutOfOrder,
    /// Samples of several publishers are mixed, and this is one of them.
    SeveralSources,
}

impl Verdict {
    /// The corrected sample with what the stream makes of it; what was not corrected says why already, and what is worse of a position than
    /// its instant stays.
    pub fn apply(self, corrected: CorrectedCoordinates) -> CorrectedCoordinates {
        match self {
            Verdict::SeveralSources if corrected.corrected_valid => {
                corrected.withheld(CorrectionStatus::SeveralSources)
            }
            Verdict::OutOfOrder => {
                let status = corrected.status.worse_of(CorrectionStatus::OutOfOrder);
                CorrectedCoordinates { status, ..corrected }
            }
            _ => corrected,
        }
    }
}

/// What was found so far.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StreamCounts {
    /// Samples of another frame; they are none of the stream.
    pub other_frame: u64,
    /// Samples while several sources were mixed.
    pub several_sources: u64,
    /// Sequence numbers left out.
    pub missing: u64,
    /// The same sample once more.
    pub repeated: u64,
    /// Sequences that went back: a source that started again.
    pub restarts: u64,
    /// Sequences that stood still while the rest of the sample changed.
    pub sequences_standing: u64,
    /// Stamps earlier than the one before.
    pub stamps_back: u64,
    /// Stamps equal to the one before, with another position.
    pub stamps_standing: u64,
    /// Stamps more than [`REMARKED_STEP_S`] after the one before.
    pub stamp_jumps: u64,
}

impl StreamCounts {
    /// These and those of another stream.
    fn and(self, other: StreamCounts) -> StreamCounts {
        StreamCounts {
            other_frame: self.other_frame + other.other_frame,
            several_sources: self.several_sources + other.several_sources,
            missing: self.missing.saturating_add(other.missing),
            repeated: self.repeated + other.repeated,
            restarts: self.restarts + other.restarts,
            sequences_standing: self.sequences_standing + other.sequences_standing,
            stamps_back: self.stamps_back + other.stamps_back,
            stamps_standing: self.stamps_standing + other.stamps_standing,
            stamp_jumps: self.stamp_jumps + other.stamp_jumps,
        }
    }
}

/// A source by where it counted last.
#[derive(Debug, Clone, Copy)]
struct Source {
    sequence: u64,
    /// Number of its last sample among all.
    heard: u64,
    /// Whether the stream has gone back since.
    is_behind: bool,
}

/// Watches one stream.
#[derive(Debug, Clone, Default)]
pub struct StreamWatch {
    /// The one heard last at the end.
    sources: VecDeque<Source>,
    last: Option<Mark>,
    /// Samples so far.
    samples: u64,
    /// Number of the last sample that went back to a source left before.
    returned: Option<u64>,
    /// Number of the last sample of a mixed stream.
    mixed_until: u64,
    counts: StreamCounts,
}

impl StreamWatch {
    /// What the stream makes of its next sample.
    pub fn look(&mut self, mark: Mark) -> Verdict {
        self.samples += 1;
        let last = self.last.replace(mark);
        let stamp_follows = self.compare_stamps(last, mark);
        if last == Some(mark) {
            self.counts.repeated += 1;
        } else {
            self.follow(last, mark);
        }
        if self.samples <= self.mixed_until {
            self.counts.several_sources += 1;
            Verdict::SeveralSources
        } else if stamp_follows {
            Verdict::InOrder
        } else {
            Verdict::OutOfOrder
        }
    }

    /// What the stream makes of a corrected sample; a sample of another frame passes beside it.
    pub fn pass(&mut self, mark: Mark, corrected: CorrectedCoordinates) -> CorrectedCoordinates {
        if corrected.status == CorrectionStatus::OtherFrame {
            self.counts.other_frame += 1;
            return corrected;
        }
        self.look(mark).apply(corrected)
    }

    /// What was found so far.
    pub fn counts(&self) -> StreamCounts {
        self.counts
    }

    /// Whether the stamp follows the one before; the same instant with the same position may come again.
    fn compare_stamps(&mut self, last: Option<Mark>, mark: Mark) -> bool {
        let Some(last) = last else { return true };
        let step_ns = mark.stamp.to_nanos() - last.stamp.to_nanos();
        let stands = step_ns == 0 && mark.measured != last.measured;
        self.counts.stamps_back += u64::from(step_ns < 0);
        self.counts.stamps_standing += u64::from(stands);
        self.counts.stamp_jumps += u64::from(step_ns as f64 * 1e-9 > REMARKED_STEP_S);
        step_ns >= 0 && !stands
    }

    /// Finds the source that the sample goes on from, or takes it for a new one.
    fn follow(&mut self, last: Option<Mark>, mark: Mark) {
        if let Some(last) = last.filter(|last| mark.sequence <= last.sequence) {
            self.sources.iter_mut().for_each(|source| source.is_behind = true);
            let stands = mark.sequence == last.sequence;
            *(if stands { &mut self.counts.sequences_standing } else { &mut self.counts.restarts }) += 1;
        }
        let oldest = self.samples.saturating_sub(MEMORY);
        self.sources.retain(|source| source.heard >= oldest);
        // The one it follows most closely; of equals the one heard last.
        let before = (0..self.sources.len()).rev().filter(|place| self.sources[*place].sequence < mark.sequence);
        let Some(place) = before.min_by_key(|place| mark.sequence - self.sources[*place].sequence) else {
            self.sources.push_back(Source { sequence: mark.sequence, heard: self.samples, is_behind: false });
            if self.sources.len() > SOURCES {
                self.sources.pop_front();
            }
            return;
        };
        let is_current = place + 1 == self.sources.len();
        let Some(source) = self.sources.remove(place) else { return };
        if is_current {
            self.counts.missing = self.counts.missing.saturating_add(mark.sequence - source.sequence - 1);
        } else if source.is_behind {
            let again = self.returned.replace(self.samples).is_some_and(|returned| returned >= oldest);
            if again {
                self.mixed_until = self.samples + HOLD;
            }
        }
        self.sources.push_back(Source { sequence: mark.sequence, heard: self.samples, is_behind: false });
    }
}

/// Watches tracer readings, each station as a stream of its own: several tracers may share a topic.
#[derive(Debug, Clone, Default)]
pub(super) struct StationWatch {
    stations: BTreeMap<String, StreamWatch>,
    /// Counts of stations that were forgotten for others.
    forgotten: StreamCounts,
}

impl StationWatch {
    /// What its station's stream makes of a reading.
    pub(super) fn look(&mut self, reading: &TracerReading) -> Verdict {
        let station = reading.station.as_str();
        if let Some(watch) = self.stations.get_mut(station) {
            return watch.look(Mark::from(reading));
        }
        if self.stations.len() >= STATIONS
            && let Some((_, watch)) = self.stations.pop_first()
        {
            self.forgotten = self.forgotten.and(watch.counts());
        }
        self.stations.entry(station.to_owned()).or_default().look(Mark::from(reading))
    }

    /// What was found so far. A tracer that goes from station to station counts on, so numbers left out say nothing here.
    pub(super) fn counts(&self) -> StreamCounts {
        let all = self.stations.values().fold(self.forgotten, |sum, watch| sum.and(watch.counts()));
        StreamCounts { missing: 0, ..all }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sample of a source at `millis`, numbered `sequence`, that is at a place of its own.
    fn mark(millis: i64, sequence: u64, x_m: f64) -> Mark {
        let stamp = Stamp::from_nanos(millis * 1_000_000).unwrap();
        Mark::positions(stamp, sequence, [x_m + millis as f64 * 1e-6, 0.2, 0.3], [0.0; 3])
    }

    /// Verdicts on samples given as stamp (ms), sequence and source (m).
    fn verdicts(watch: &mut StreamWatch, samples: impl IntoIterator<Item = (i64, u64, f64)>) -> Vec<Verdict> {
        samples.into_iter().map(|(millis, sequence, x_m)| watch.look(mark(millis, sequence, x_m))).collect()
    }

    fn all(verdicts: &[Verdict], expected: Verdict) -> bool {
        verdicts.iter().all(|verdict| *verdict == expected)
    }

    #[test]
    fn a_source_that_loses_samples_stops_and_starts_again_is_in_order() {
        let mut watch = StreamWatch::default();
        let first = (0..500).filter(|k| k % 7 != 3).map(|k| (k, k as u64, 0.0));
        // Starts again twice, first after few samples; loses some just where it had ended before.
        let second = (0..40).map(|k| (1000 + k, k as u64, 0.0));
        let third = (0..600).filter(|k| !(490..505).contains(k)).map(|k| (2000 + k, k as u64, 0.0));
        let found = verdicts(&mut watch, first.chain(second).chain(third));
        assert!(all(&found, Verdict::InOrder), "{found:?}");
        let counts = watch.counts();
        assert_eq!((counts.restarts, counts.several_sources, counts.stamps_back), (2, 0, 0));
        assert!(counts.missing >= 71, "{counts:?}");
    }

    #[test]
    fn regress_two_sources_on_one_topic_are_told_within_a_few_samples_and_forgotten_when_one_goes() {
        // Sequences apart, behind one another, and in step; the second source ten times as slow.
        for (ahead, every) in [(700_i64, 1), (-300, 1), (0, 1), (700, 10), (-300, 10)] {
            let mut watch = StreamWatch::default();
            let one = |k: i64| (10 * k, (1000 + k) as u64, 0.0);
            let other = |k: i64| (10 * k + 3, (1000 + ahead + k / every) as u64, 0.5);
            assert!(all(&verdicts(&mut watch, (0..100).map(one)), Verdict::InOrder));
            let mixed = (100..400).flat_map(|k| [Some(one(k)), (k % every == 0).then(|| other(k))]).flatten();
            let found = verdicts(&mut watch, mixed);
            let told = found.iter().position(|verdict| *verdict == Verdict::SeveralSources).unwrap();
            assert!(told <= 2 * every as usize + 4, "sequences {ahead} ahead, every {every}: told after {told}");
            assert!(all(&found[told..], Verdict::SeveralSources), "{ahead} {every} {found:?}");
            let found = verdicts(&mut watch, (400..600).map(one));
            assert!(all(&found[HOLD as usize + 1..], Verdict::InOrder), "{ahead} {every}");
        }
    }

    #[test]
    fn a_driver_that_does_not_count_is_one_source() {
        let mut watch = StreamWatch::default();
        let found = verdicts(&mut watch, (0..200).map(|k| (k, 0, 0.0)));
        assert!(all(&found, Verdict::InOrder));
        assert_eq!(watch.counts().sequences_standing, 199);
    }

    #[test]
    fn regress_stamps_that_go_back_or_stand_still_are_told_and_the_stream_goes_on() {
        let mut watch = StreamWatch::default();
        verdicts(&mut watch, (0..10).map(|k| (5_000_000 + k, k as u64, 0.0)));
        // An hour back, then on from there; then a stamp that stands still while the machine moves.
        let found = verdicts(&mut watch, (10..13).map(|k| (1_400_000 + k, k as u64, 0.0)));
        assert_eq!(found, [Verdict::OutOfOrder, Verdict::InOrder, Verdict::InOrder]);
        let found = verdicts(&mut watch, [(1_400_012, 13, 0.1), (1_400_012, 14, 0.1), (1_400_013, 15, 0.1)]);
        assert_eq!(found, [Verdict::OutOfOrder, Verdict::InOrder, Verdict::InOrder]);
        // An hour on: the instant may be right, and it is remarked.
        assert_eq!(verdicts(&mut watch, [(5_000_100, 16, 0.0)]), [Verdict::InOrder]);
        let counts = watch.counts();
        assert_eq!((counts.stamps_back, counts.stamps_standing, counts.stamp_jumps), (1, 1, 1));
    }

    #[test]
    fn the_same_sample_and_the_same_instant_may_come_again() {
        let mut watch = StreamWatch::default();
        let twice = (0..50).flat_map(|k| [(k, k as u64, 0.0); 2]);
        assert!(all(&verdicts(&mut watch, twice), Verdict::InOrder));
        assert_eq!(watch.counts(), StreamCounts { repeated: 50, ..StreamCounts::default() });
        // Several stations of a campaign: one instant, a row each.
        let rows = (0..50).flat_map(|k| (0..4).map(move |row| (1000 + k, 100 + 4 * k as u64 + row, 0.0)));
        assert!(all(&verdicts(&mut watch, rows), Verdict::InOrder));
    }
}
