//! The readings that a diagnosis will want: tracer and scale of one instant, kept while the machine runs.
//!
//! Place in the flow: beside the monitor's step. Scale and tracer readings go in, in any order of arrival (m, machine
//! frame; covariates in the unit of their name's suffix); a [`Campaign`] of all of them, or of those since an instant,
//! comes out. It does not matter whether a model can predict a reading. Bounded: the oldest go, counted. A covariate
//! that is stale at its reading is kept as missing, as it is for the correction. Readings of another frame, of several
//! tracers under one name, or whose stamp does not follow are not kept, counted.

use super::geometric::is_fresh;
use super::pairs::Pairs;
use super::stream::{Mark, StationWatch, StreamWatch, Verdict};
use abbe_geometry::effects::TIME;
use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};
use abbe_msgs::{ScaleReading, Stamp, TracerReading};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Readings kept: a campaign of a whole day at one reading a second, some 40 MB.
pub const KEPT_READINGS: usize = 100_000;

/// Names of stations and lines from which those that no reading uses any more are forgotten.
const NAMES: usize = 4096;

/// What the scales say at an instant, without the room that a sample on the wire has.
#[derive(Clone)]
struct Latching {
    reading_m: [f64; 3],
    offset_m: [f64; 3],
    /// Values by the index of their name.
    covariates: Vec<(usize, f64)>,
}

/// A tracer reading with what the scales said.
struct Kept {
    stamp: Stamp,
    station: usize,
    line: usize,
    length_m: f64,
    scales: Latching,
}

/// Names in the order in which they came.
#[derive(Default)]
struct Names {
    all: Vec<String>,
    places: BTreeMap<String, usize>,
}

impl Names {
    /// Place of a name, added when it is new.
    fn index(&mut self, name: &str) -> usize {
        if let Some(place) = self.places.get(name) {
            return *place;
        }
        let place = self.all.len();
        self.all.push(name.to_owned());
        self.places.insert(name.to_owned(), place);
        place
    }

    /// Forgets all names but those of these uses, which get the new places; gives the new place of each old one.
    fn keep<'u>(&mut self, uses: impl Iterator<Item = &'u mut usize>) -> BTreeMap<usize, usize> {
        let (mut kept, mut moved) = (Names::default(), BTreeMap::new());
        for place in uses {
            *place = *moved.entry(*place).or_insert_with(|| kept.index(&self.all[*place]));
        }
        *self = kept;
        moved
    }
}

/// Keeps readings for a diagnosis.
pub struct ReadingBuffer {
    frame_id: String,
    max_covariate_age_s: f64,
    capacity: usize,
    pairs: Pairs<Latching>,
    kept: VecDeque<Kept>,
    stations: Names,
    lines: Names,
    covariates: Names,
    /// Names of stations and lines from which to look for unused ones.
    names: usize,
    /// Sequence and stamp of the last tracer reading of each station.
    last: BTreeMap<usize, (u64, Stamp)>,
    scales: StreamWatch,
    tracers: StationWatch,
    dropped: u64,
    unusable: u64,
}

impl ReadingBuffer {
    /// A buffer of [`KEPT_READINGS`] in the machine frame `frame_id`; stamps at most `match_within_s` (s) apart are one
    /// instant, covariates older than `max_covariate_age_s` (s) are missing.
    pub fn new(frame_id: &str, match_within_s: f64, max_covariate_age_s: f64) -> ReadingBuffer {
        ReadingBuffer::with_capacity(frame_id, match_within_s, max_covariate_age_s, KEPT_READINGS)
    }

    /// The same with room for so many readings.
    pub fn with_capacity(
        frame_id: &str,
        match_within_s: f64,
        max_covariate_age_s: f64,
        capacity: usize,
    ) -> ReadingBuffer {
        ReadingBuffer {
            frame_id: frame_id.to_owned(),
            max_covariate_age_s,
            capacity,
            pairs: Pairs::new(match_within_s),
            kept: VecDeque::new(),
            stations: Names::default(),
            lines: Names::default(),
            covariates: Names::default(),
            names: NAMES,
            last: BTreeMap::new(),
            scales: StreamWatch::default(),
            tracers: StationWatch::default(),
            dropped: 0,
            unusable: 0,
        }
    }

    /// Takes a scale reading.
    pub fn scale(&mut self, reading: &ScaleReading) {
        if reading.frame_id.as_str() != self.frame_id
            || self.scales.look(Mark::from(reading)) == Verdict::SeveralSources
        {
            return;
        }
        let fresh = reading.covariates.iter().filter(|entry| is_fresh(entry.age_s, self.max_covariate_age_s));
        let covariates = fresh.map(|covariate| (self.covariates.index(covariate.name.as_str()), covariate.value));
        let scales =
            Latching { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates: covariates.collect() };
        for (scales, waited) in self.pairs.sample(reading.stamp, scales) {
            self.keep(&waited, scales);
        }
    }

    /// From now on, stamps at most `match_within_s` (s) apart are one instant.
    pub fn within(&mut self, match_within_s: f64) {
        self.pairs.within(match_within_s);
    }

    /// From now on, a covariate of more than this age (s) is missing.
    pub fn set_max_covariate_age_s(&mut self, max_covariate_age_s: f64) {
        self.max_covariate_age_s = max_covariate_age_s;
    }

    /// At the end of the readings: keeps those that waited for a scale reading nearer than the nearest that came.
    pub fn finish(&mut self) {
        for (scales, waited) in self.pairs.finish() {
            self.keep(&waited, scales);
        }
    }

    /// Takes a tracer reading.
    pub fn tracer(&mut self, reading: &TracerReading) {
        if reading.frame_id.as_str() != self.frame_id {
            self.unusable += 1;
            return;
        }
        let verdict = self.tracers.look(reading);
        self.forget_unused_names();
        let station = self.stations.index(reading.station.as_str());
        if let Some((sequence, stamp)) = self.last.insert(station, (reading.sequence, reading.stamp)) {
            let before = self.kept.len();
            if reading.sequence < sequence {
                // The tracer has started again, and its lengths count from a new zero. One that does not count at all
                // says nothing about that.
                self.kept.retain(|kept| kept.station != station);
                self.dropped += self.pairs.forget(|waiting| waiting.station == reading.station);
            }
            if reading.stamp < stamp {
                // The clock was set back: what it comes to again is another instant than the one that is kept.
                self.kept.retain(|kept| kept.stamp < reading.stamp);
                self.dropped += self.pairs.forget(|waiting| waiting.stamp >= reading.stamp);
            }
            self.dropped += (before - self.kept.len()) as u64;
        }
        if verdict != Verdict::InOrder {
            self.unusable += 1;
            return;
        }
        if let Some(scales) = self.pairs.reading(reading) {
            self.keep(reading, scales);
        }
    }

    /// Readings kept.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether nothing is kept.
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    /// Readings given up for newer ones, because their tracer started again, or because the clock was set back.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Tracer readings without scale readings of their instant, with such that are no numbers, of another frame, of several
    /// tracers under one name, or whose stamp does not follow.
    pub fn unusable(&self) -> u64 {
        self.unusable + self.pairs.alone()
    }

    /// Readings from `since` on, at most `enough`; all without an instant.
    pub fn count_since(&self, since: Option<Stamp>, enough: usize) -> usize {
        let newest = self.kept.iter().rev().take_while(|kept| since.is_none_or(|since| kept.stamp >= since));
        newest.take(enough).count()
    }

    /// The readings from `since` on, all without an instant, as a campaign that a file can hold: each station in the
    /// order of time without a doubled instant, lines that keep their station and their offset.
    pub fn campaign(&self, since: Option<Stamp>) -> Campaign {
        let wanted = self.kept.iter().filter(|kept| since.is_none_or(|since| kept.stamp >= since));
        let mut rows: Vec<&Kept> = wanted.collect();
        rows.sort_by_key(|kept| kept.stamp);
        let mut instants = BTreeSet::new();
        rows.retain(|kept| instants.insert((kept.station, kept.stamp)));
        let mut campaign = Campaign::default();
        let (mut stations, mut lines) = (BTreeMap::new(), Lines::default());
        let used: BTreeSet<usize> =
            rows.iter().flat_map(|kept| kept.scales.covariates.iter().map(|(k, _)| *k)).collect();
        for (kept, time_s) in rows.iter().zip(self.times_s(&rows)) {
            let name = &self.stations.all[kept.station];
            let station = *stations.entry(kept.station).or_insert_with(|| {
                campaign.stations.push(name.clone());
                campaign.stations.len() as u32 - 1
            });
            let line = lines.index(kept, name, &self.lines.all[kept.line]);
            campaign.readings.push(RangeReading {
                station,
                line,
                time_s,
                reading_m: kept.scales.reading_m,
                offset_m: kept.scales.offset_m,
                length_m: kept.length_m,
            });
        }
        campaign.lines = lines.names;
        let logged = used.into_iter().filter(|k| self.covariates.all[*k] != TIME);
        campaign.covariates = logged.map(|k| self.covariate(k, &rows)).collect();
        campaign
    }

    /// Time of each row (s since the campaign began). Effects read it from live samples as the covariate `time_s`: where all
    /// of these carry it and it goes on at every station, it is the campaign's time too, or a model made from the campaign
    /// would correct the same samples by another clock. Else it is the time since the first stamp.
    fn times_s(&self, rows: &[&Kept]) -> Vec<f64> {
        let start_ns = rows.first().map_or(0, |kept| kept.stamp.to_nanos());
        let by_stamp = || rows.iter().map(|kept| (kept.stamp.to_nanos() - start_ns) as f64 / 1e9).collect();
        let Some(clock) = self.covariates.all.iter().position(|name| name == TIME) else { return by_stamp() };
        let told: Option<Vec<f64>> = self.covariate(clock, rows).values.into_iter().collect();
        let mut latest: BTreeMap<usize, f64> = BTreeMap::new();
        let mut goes_on =
            |(kept, time_s): (&&Kept, &f64)| latest.insert(kept.station, *time_s).is_none_or(|before| before < *time_s);
        told.filter(|told| rows.iter().zip(told).all(&mut goes_on)).unwrap_or_else(by_stamp)
    }

    fn covariate(&self, index: usize, rows: &[&Kept]) -> Covariate {
        let value = |kept: &&Kept| kept.scales.covariates.iter().find(|(k, _)| *k == index).map(|(_, value)| *value);
        Covariate { name: self.covariates.all[index].clone(), values: rows.iter().map(value).collect() }
    }

    /// A tracer that numbers its lines adds a name a reading.
    fn forget_unused_names(&mut self) {
        if self.stations.all.len() + self.lines.all.len() < self.names {
            return;
        }
        self.lines.keep(self.kept.iter_mut().map(|kept| &mut kept.line));
        let moved = self.stations.keep(self.kept.iter_mut().map(|kept| &mut kept.station));
        let last = std::mem::take(&mut self.last).into_iter();
        self.last = last.filter_map(|(station, last)| Some((*moved.get(&station)?, last))).collect();
        self.names = NAMES.max(2 * (self.stations.all.len() + self.lines.all.len()));
    }

    fn keep(&mut self, reading: &TracerReading, scales: Latching) {
        let numbers = scales.reading_m.iter().chain(&scales.offset_m).chain([&reading.length_m]);
        if !numbers.into_iter().all(|number| number.is_finite()) {
            self.unusable += 1;
            return;
        }
        let (station, line) = (self.stations.index(reading.station.as_str()), self.lines.index(reading.line.as_str()));
        self.kept.push_back(Kept { stamp: reading.stamp, station, line, length_m: reading.length_m, scales });
        if self.kept.len() > self.capacity {
            self.kept.pop_front();
            self.dropped += 1;
        }
    }
}

/// Lines of the campaign: a run of readings of one name, one station and one offset.
#[derive(Default)]
struct Lines {
    names: Vec<String>,
    indices: BTreeMap<(usize, usize, [u64; 3]), u32>,
}

impl Lines {
    fn index(&mut self, kept: &Kept, station: &str, line: &str) -> u32 {
        let key = (kept.station, kept.line, kept.scales.offset_m.map(f64::to_bits));
        if let Some(index) = self.indices.get(&key) {
            return *index;
        }
        // A reading that belongs to no line counts as one of its station.
        let wanted = if line.is_empty() { station } else { line };
        let taken = |name: &String| self.names.contains(name);
        let numbered = (2..).map(|number| format!("{wanted}-{number}"));
        let name = std::iter::once(wanted.to_owned()).chain(numbered).find(|name| !taken(name));
        self.names.extend(name);
        let index = self.names.len() as u32 - 1;
        self.indices.insert(key, index);
        index
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_msgs::Text;

    const FRAME: &str = "machine";

    fn scale(millis: i64, offset_z_m: f64) -> ScaleReading {
        let mut reading = ScaleReading {
            stamp: Stamp::from_nanos(millis * 1_000_000).unwrap(),
            reading_m: [millis as f64 * 1e-3, 0.2, 0.3],
            offset_m: [0.0, 0.0, offset_z_m],
            frame_id: Text::new(FRAME).unwrap(),
            ..ScaleReading::default()
        };
        reading.covariates.push("temp_scale_x_c", 20.0 + millis as f64, 0.5).unwrap();
        if millis % 2 == 0 {
            reading.covariates.push("load_kg", 7.0, 0.5).unwrap();
        }
        reading
    }

    fn tracer(millis: i64, station: &str, line: &str) -> TracerReading {
        TracerReading {
            stamp: Stamp::from_nanos(millis * 1_000_000).unwrap(),
            sequence: millis as u64,
            length_m: millis as f64,
            station: Text::new(station).unwrap(),
            line: Text::new(line).unwrap(),
            frame_id: Text::new(FRAME).unwrap(),
            ..TracerReading::default()
        }
    }

    fn buffer() -> ReadingBuffer {
        ReadingBuffer::with_capacity(FRAME, 0.0002, 1.0, 6)
    }

    #[test]
    fn a_campaign_comes_out_with_everything_of_its_instants() {
        let mut buffer = buffer();
        for millis in 1..=4 {
            buffer.scale(&scale(millis, -0.1));
            buffer.tracer(&tracer(millis, "S1", "a"));
        }
        let campaign = buffer.campaign(None);
        assert_eq!((campaign.stations.as_slice(), campaign.lines.as_slice()), (&["S1".into()][..], &["a".into()][..]));
        let second = campaign.readings[1];
        assert_eq!((second.time_s, second.length_m, second.reading_m[0]), (1e-3, 2.0, 2e-3));
        assert_eq!(second.offset_m, [0.0, 0.0, -0.1]);
        let [temperature, load] = &campaign.covariates[..] else { panic!("{:?}", campaign.covariates) };
        assert_eq!(temperature.values, [Some(21.0), Some(22.0), Some(23.0), Some(24.0)]);
        assert_eq!(load.values, [None, Some(7.0), None, Some(7.0)]);
    }

    #[test]
    fn regress_the_clock_that_samples_carry_is_that_of_the_campaign() {
        let times = |told: &[Option<f64>]| {
            let mut buffer = buffer();
            for (millis, time_s) in (1..).zip(told) {
                let mut scale = scale(millis, -0.1);
                time_s.iter().for_each(|time_s| scale.covariates.push(TIME, *time_s, 0.0).unwrap());
                buffer.scale(&scale);
                buffer.tracer(&tracer(millis, "S1", "a"));
            }
            let campaign = buffer.campaign(None);
            assert!(campaign.covariate(TIME).is_none(), "a campaign has one time");
            campaign.readings.iter().map(|reading| reading.time_s).collect::<Vec<f64>>()
        };
        assert_eq!(times(&[Some(500.0), Some(500.5), Some(501.0)]), [500.0, 500.5, 501.0]);
        // One that is missing or goes back is no clock.
        assert_eq!(times(&[Some(500.0), None, Some(501.0)]), [0.0, 1e-3, 2e-3]);
        assert_eq!(times(&[Some(500.0), Some(0.0), Some(0.5)]), [0.0, 1e-3, 2e-3]);
    }

    #[test]
    fn the_order_of_arrival_changes_nothing() {
        let (mut scale_first, mut tracer_first) = (buffer(), buffer());
        (1..=4).for_each(|millis| scale_first.scale(&scale(millis, -0.1)));
        for millis in 1..=4 {
            scale_first.tracer(&tracer(millis, "S1", "a"));
            tracer_first.tracer(&tracer(millis, "S1", "a"));
        }
        (1..=4).rev().for_each(|millis| tracer_first.scale(&scale(millis, -0.1)));
        assert_eq!(scale_first.campaign(None).readings, tracer_first.campaign(None).readings);
    }

    #[test]
    fn only_readings_since_an_instant_are_given_where_one_is_named() {
        let mut buffer = buffer();
        for millis in 1..=5 {
            buffer.scale(&scale(millis, -0.1));
            buffer.tracer(&tracer(millis, "S1", "a"));
        }
        let since = Some(tracer(4, "S1", "a").stamp);
        assert_eq!(
            (buffer.count_since(since, 10), buffer.count_since(since, 1), buffer.count_since(None, 10)),
            (2, 1, 5)
        );
        assert_eq!(buffer.campaign(since).readings.iter().map(|r| r.length_m).collect::<Vec<_>>(), [4.0, 5.0]);
    }

    #[test]
    fn the_oldest_go_and_are_counted() {
        let mut buffer = buffer();
        for millis in 1..=9 {
            buffer.scale(&scale(millis, -0.1));
            buffer.tracer(&tracer(millis, "S1", "a"));
        }
        assert_eq!((buffer.len(), buffer.dropped()), (6, 3));
        assert_eq!(buffer.campaign(None).readings[0].length_m, 4.0);
    }

    #[test]
    fn a_tracer_that_starts_again_takes_its_earlier_lengths_with_it() {
        let mut buffer = buffer();
        for (millis, station) in [(1, "S1"), (2, "S2"), (3, "S1")] {
            buffer.scale(&scale(millis, -0.1));
            buffer.tracer(&tracer(millis, station, "a"));
        }
        buffer.scale(&scale(4, -0.1));
        buffer.tracer(&TracerReading { sequence: 0, ..tracer(4, "S1", "a") });
        let lengths: Vec<f64> = buffer.campaign(None).readings.iter().map(|r| r.length_m).collect();
        assert_eq!((lengths, buffer.dropped()), (vec![2.0, 4.0], 2));
    }

    /// A length whose sample was not yet known was kept beside those of the new zero.
    #[test]
    fn a_tracer_that_starts_again_takes_those_that_wait_with_it() {
        let mut buffer = buffer();
        let late = |millis: i64, sequence: u64| {
            let stamp = Stamp::from_nanos(millis * 1_000_000 + 100_000).unwrap();
            TracerReading { stamp, sequence, ..tracer(millis, "S1", "a") }
        };
        for (millis, sequence) in [(1, 1), (2, 2), (3, 0), (4, 1)] {
            buffer.tracer(&late(millis, sequence));
            buffer.scale(&scale(millis, -0.1));
        }
        buffer.finish();
        let lengths: Vec<f64> = buffer.campaign(None).readings.iter().map(|r| r.length_m).collect();
        assert_eq!((lengths, buffer.dropped()), (vec![3.0, 4.0], 2));
    }

    #[test]
    fn regress_a_tracer_that_does_not_count_keeps_its_readings() {
        let mut buffer = buffer();
        for millis in 1..=5 {
            buffer.scale(&scale(millis, -0.1));
            buffer.tracer(&TracerReading { sequence: 0, ..tracer(millis, "S1", "a") });
        }
        assert_eq!((buffer.len(), buffer.dropped(), buffer.unusable()), (5, 0, 0));
    }

    #[test]
    fn regress_a_clock_set_back_leaves_readings_in_the_order_of_time_and_new_ones_to_diagnose() {
        let mut buffer = buffer();
        for (sequence, millis) in [(1, 5001), (2, 5002), (3, 9000), (4, 6000), (5, 6001), (6, 6002)] {
            buffer.scale(&scale(millis, -0.1));
            buffer.tracer(&TracerReading { sequence, ..tracer(millis, "S1", "a") });
        }
        // The first after the step may be of either time; those of the time that comes again are gone.
        let lengths: Vec<f64> = buffer.campaign(None).readings.iter().map(|r| r.length_m).collect();
        assert_eq!((lengths, buffer.dropped(), buffer.unusable()), (vec![5001.0, 5002.0, 6001.0, 6002.0], 1, 1));
        assert_eq!(buffer.count_since(Some(tracer(6001, "S1", "a").stamp), 10), 2);
    }

    #[test]
    fn regress_readings_of_another_frame_and_of_two_tracers_under_one_name_are_not_kept() {
        let mut buffer = ReadingBuffer::with_capacity(FRAME, 0.0002, 1.0, 1000);
        for frame_id in ["", "other"] {
            let frame_id = Text::new(frame_id).unwrap();
            buffer.scale(&ScaleReading { frame_id, ..scale(1, -0.1) });
            buffer.tracer(&TracerReading { frame_id, ..tracer(1, "S1", "a") });
        }
        assert_eq!((buffer.len(), buffer.unusable()), (0, 2));
        for millis in 10..110 {
            buffer.scale(&scale(millis, -0.1));
            let sequence = if millis % 2 == 0 { 500 + millis } else { millis } as u64;
            buffer.tracer(&TracerReading { sequence, ..tracer(millis, "S1", "a") });
        }
        assert!(buffer.len() <= 1, "{} readings of two zeros are kept", buffer.len());
        assert!(buffer.unusable() > 90, "{}", buffer.unusable());
    }

    #[test]
    fn lines_keep_their_station_and_their_offset() {
        let mut buffer = buffer();
        let rows = [
            (1, "S1", "a", -0.1),
            (2, "S1", "a", -0.2),
            (3, "S2", "a", -0.2),
            (4, "S2", "", -0.2),
            (5, "S1", "a", -0.1),
        ];
        for (millis, station, line, offset_z_m) in rows {
            buffer.scale(&scale(millis, offset_z_m));
            buffer.tracer(&tracer(millis, station, line));
        }
        let campaign = buffer.campaign(None);
        assert_eq!(campaign.lines, ["a", "a-2", "a-3", "S2"]);
        assert_eq!(campaign.readings.iter().map(|r| r.line).collect::<Vec<_>>(), [0, 1, 2, 3, 0]);
    }

    #[test]
    fn what_is_stale_is_missing_and_what_is_no_number_is_counted() {
        let mut buffer = buffer();
        let mut stale = scale(1, -0.1);
        stale.covariates = Default::default();
        stale.covariates.push("temp_scale_x_c", 20.0, 1.5).unwrap();
        buffer.scale(&stale);
        buffer.tracer(&tracer(1, "S1", "a"));
        assert_eq!(buffer.campaign(None).covariates, []);
        buffer.scale(&ScaleReading { reading_m: [f64::NAN, 0.0, 0.0], ..scale(2, -0.1) });
        buffer.tracer(&tracer(2, "S1", "a"));
        assert_eq!((buffer.len(), buffer.unusable()), (1, 1));
    }

    /// Names were never forgotten, and each new one was held against all of them.
    #[test]
    fn regress_a_tracer_that_numbers_its_lines_leaves_no_names_behind() {
        let mut buffer = buffer();
        for millis in 1..=20_000 {
            buffer.scale(&scale(millis, -0.1));
            buffer.tracer(&tracer(millis, "S1", &millis.to_string()));
        }
        assert!(buffer.lines.all.len() <= NAMES, "{}", buffer.lines.all.len());
        let campaign = buffer.campaign(None);
        assert_eq!(campaign.lines, ["19995", "19996", "19997", "19998", "19999", "20000"]);
        assert_eq!((campaign.stations, buffer.dropped()), (vec!["S1".to_owned()], 19_994));
    }
}
