//! The readings that a diagnosis will want: tracer and scale of one instant, kept while the machine runs.
//!
//! Place in the flow: beside the monitor's step. Scale and tracer readings go in, in any order of arrival (m, machine
//! frame; covariates in the unit of their name's suffix); a [`Campaign`] of all of them, or of those since an instant,
//! comes out. It does not matter whether a model can predict a reading. Bounded: the oldest go, counted. A covariate
//! that is stale at its reading is kept as missing, as it is for the correction.

use super::pairs::Pairs;
use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};
use abbe_msgs::{ScaleReading, Stamp, TracerReading};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Readings kept: a campaign of a whole day at one reading a second, some 40 MB.
pub const KEPT_READINGS: usize = 100_000;

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
struct Names(Vec<String>);

impl Names {
    /// Place of a name, added when it is new. The last one is the likeliest, so it is looked for from the end.
    fn index(&mut self, name: &str) -> usize {
        self.0.iter().rposition(|known| known == name).unwrap_or_else(|| {
            self.0.push(name.to_owned());
            self.0.len() - 1
        })
    }
}

/// Keeps readings for a diagnosis.
pub struct ReadingBuffer {
    max_covariate_age_s: f64,
    capacity: usize,
    pairs: Pairs<Latching>,
    kept: VecDeque<Kept>,
    stations: Names,
    lines: Names,
    covariates: Names,
    /// Sequence of the last tracer reading of each station.
    sequences: BTreeMap<usize, u64>,
    dropped: u64,
    unusable: u64,
}

impl ReadingBuffer {
    /// A buffer of [`KEPT_READINGS`]; stamps at most `match_within_s` (s) apart are one instant, covariates older than
    /// `max_covariate_age_s` (s) are missing.
    pub fn new(match_within_s: f64, max_covariate_age_s: f64) -> ReadingBuffer {
        ReadingBuffer::with_capacity(match_within_s, max_covariate_age_s, KEPT_READINGS)
    }

    /// The same with room for so many readings.
    pub fn with_capacity(match_within_s: f64, max_covariate_age_s: f64, capacity: usize) -> ReadingBuffer {
        ReadingBuffer {
            max_covariate_age_s,
            capacity,
            pairs: Pairs::new(match_within_s),
            kept: VecDeque::new(),
            stations: Names::default(),
            lines: Names::default(),
            covariates: Names::default(),
            sequences: BTreeMap::new(),
            dropped: 0,
            unusable: 0,
        }
    }

    /// Takes a scale reading.
    pub fn scale(&mut self, reading: &ScaleReading) {
        let fresh = reading.covariates.iter().filter(|covariate| covariate.age_s <= self.max_covariate_age_s);
        let covariates = fresh.map(|covariate| (self.covariates.index(covariate.name.as_str()), covariate.value));
        let scales =
            Latching { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates: covariates.collect() };
        for waited in self.pairs.sample(reading.stamp, scales.clone()) {
            self.keep(&waited, scales.clone());
        }
    }

    /// Takes a tracer reading.
    pub fn tracer(&mut self, reading: &TracerReading) {
        let station = self.stations.index(reading.station.as_str());
        if self.sequences.insert(station, reading.sequence).is_some_and(|before| reading.sequence <= before) {
            // The tracer has started again, and its lengths count from a new zero.
            let before = self.kept.len();
            self.kept.retain(|kept| kept.station != station);
            self.dropped += (before - self.kept.len()) as u64;
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

    /// Readings given up for newer ones, or because their tracer started again.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Tracer readings without scale readings of their instant, or with such that are no numbers.
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
        let start_ns = rows.first().map_or(0, |kept| kept.stamp.to_nanos());
        let used: BTreeSet<usize> =
            rows.iter().flat_map(|kept| kept.scales.covariates.iter().map(|(k, _)| *k)).collect();
        for kept in &rows {
            let name = &self.stations.0[kept.station];
            let station = *stations.entry(kept.station).or_insert_with(|| {
                campaign.stations.push(name.clone());
                campaign.stations.len() as u32 - 1
            });
            let line = lines.index(kept, name, &self.lines.0[kept.line]);
            campaign.readings.push(RangeReading {
                station,
                line,
                time_s: (kept.stamp.to_nanos() - start_ns) as f64 * 1e-9,
                reading_m: kept.scales.reading_m,
                offset_m: kept.scales.offset_m,
                length_m: kept.length_m,
            });
        }
        campaign.lines = lines.names;
        campaign.covariates = used.into_iter().map(|k| self.covariate(k, &rows)).collect();
        campaign
    }

    fn covariate(&self, index: usize, rows: &[&Kept]) -> Covariate {
        let value = |kept: &&Kept| kept.scales.covariates.iter().find(|(k, _)| *k == index).map(|(_, value)| *value);
        Covariate { name: self.covariates.0[index].clone(), values: rows.iter().map(value).collect() }
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

    fn scale(millis: i64, offset_z_m: f64) -> ScaleReading {
        let mut reading = ScaleReading {
            stamp: Stamp::from_nanos(millis * 1_000_000).unwrap(),
            reading_m: [millis as f64 * 1e-3, 0.2, 0.3],
            offset_m: [0.0, 0.0, offset_z_m],
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
            ..TracerReading::default()
        }
    }

    fn buffer() -> ReadingBuffer {
        ReadingBuffer::with_capacity(0.0002, 1.0, 6)
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
}
