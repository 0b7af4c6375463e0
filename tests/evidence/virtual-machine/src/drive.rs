//! A campaign as it happens: the machine on its way from point to point, standing, and what scales and tracer show at any moment.
//!
//! Place in the flow: the readings of a [`ReadingStream`] in, scales and length at any time out, so that a capture can be
//! rehearsed against the very campaign that `abbe simulate` would have written. At a point both are those of that campaign but for
//! the noise of single samples; on the way the machine follows a trapezoid of feed, and the length a straight line between the
//! ends beside the geometric distance. Machine frame, SI.

mod obedient;

use crate::error::SimulationError;
use crate::plan::Target;
use crate::random::{Purpose, normal, stream};
use crate::simulate::{ReadingStream, SimulatedReading, SimulationConfig};
use rand_chacha::ChaCha8Rng;

pub use obedient::Obedient;

/// Noise of a single reading of the scales (m, k = 1).
const SCALES_M: f64 = 10e-9;
/// Noise of a single length (m, k = 1).
const LENGTH_M: f64 = 50e-9;
/// Slowest feed (m/s) and acceleration (m/s²): a path that tells none still ends.
const SLOWEST_M_S: f64 = 1e-4;

/// How fast it all goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// Time at each point (s).
    pub dwell_s: f64,
    /// Time to move the tracer to the next station, or the reflector to the next place (s).
    pub change_s: f64,
    /// So many times faster than the plan's feeds and accelerations.
    pub faster: f64,
}

/// What is seen at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Scales (m).
    pub reading_m: [f64; 3],
    /// Length (m); nothing while the tracer or the reflector is moved.
    pub length_m: Option<f64>,
    /// Number of the station.
    pub station: usize,
    /// Reflector (m, ram frame).
    pub offset_m: [f64; 3],
    /// Number of the point that it stands at.
    pub standing: Option<usize>,
}

/// A stay at a point and the way to it.
#[derive(Debug, Clone, Copy)]
struct Stay {
    reading: SimulatedReading,
    from_m: [f64; 3],
    begins_s: f64,
    moves_s: f64,
    arrives_s: f64,
    leaves_s: f64,
    feed_m_s: f64,
    acceleration_m_s2: f64,
    /// Somebody moves tracer or reflector before the way.
    is_changed: bool,
}

/// A campaign in time.
#[derive(Debug)]
pub struct Drive {
    stays: Vec<Stay>,
    stations_m: Vec<[f64; 3]>,
    names: Vec<String>,
    scales: ChaCha8Rng,
    lengths: ChaCha8Rng,
}

impl Drive {
    /// A campaign at this pace.
    ///
    /// # Errors
    /// The key of the first setting that makes no sense.
    pub fn new(config: &SimulationConfig, pace: Pace) -> Result<Drive, SimulationError> {
        let mut stays: Vec<Stay> = Vec::new();
        let mut before: Option<Target> = None;
        let mut now_s = 0.0;
        for (reading, target) in ReadingStream::new(config)?.zip(config.plan.targets()) {
            let from_m = before.map_or(config.plan.home_m, |before| before.reading_m);
            let is_changed = before.is_none_or(|b| b.station != target.station || b.offset_m != target.offset_m);
            let feed_m_s = (target.feed_m_s * pace.faster).max(SLOWEST_M_S);
            // From the way of each axis to that along the path.
            let size = target.acceleration_m_s2.iter().map(|a| a * a).sum::<f64>().sqrt();
            let acceleration_m_s2 = (size * pace.faster).max(SLOWEST_M_S);
            let moves_s = now_s + if is_changed { pace.change_s } else { 0.0 };
            let way_m = distance_m(&from_m, &target.reading_m);
            let arrives_s = moves_s + lasts_s(way_m, feed_m_s, acceleration_m_s2);
            let leaves_s = arrives_s + pace.dwell_s;
            let reading = reading?;
            stays.push(Stay {
                reading,
                from_m,
                begins_s: now_s,
                moves_s,
                arrives_s,
                leaves_s,
                feed_m_s,
                acceleration_m_s2,
                is_changed,
            });
            (before, now_s) = (Some(target), leaves_s);
        }
        Ok(Drive {
            stays,
            stations_m: config.plan.stations.iter().map(|station| station.position_m).collect(),
            names: config.plan.stations.iter().map(|station| station.name.clone()).collect(),
            scales: stream(config.seed, Purpose::Repeatability),
            lengths: stream(config.seed, Purpose::RangeNoise),
        })
    }

    /// When the last point is left (s).
    pub fn ends_s(&self) -> f64 {
        self.stays.last().map_or(0.0, |stay| stay.leaves_s)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.stays.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.stays.is_empty()
    }

    /// Name of a station.
    pub fn station(&self, number: usize) -> &str {
        self.names.get(number).map_or("", String::as_str)
    }

    /// What is seen at this time (s since the beginning); the machine stays at its last point.
    pub fn at(&mut self, time_s: f64) -> Option<Seen> {
        let place = self.stays.partition_point(|stay| stay.leaves_s <= time_s).min(self.stays.len().checked_sub(1)?);
        let stay = self.stays[place];
        let reading = stay.reading.reading;
        let way_m = distance_m(&stay.from_m, &reading.reading_m);
        let gone_m = gone_m(time_s - stay.moves_s, way_m, stay.feed_m_s, stay.acceleration_m_s2);
        let share = if way_m > 0.0 && time_s < stay.arrives_s { gone_m / way_m } else { 1.0 };
        let at_m: [f64; 3] = std::array::from_fn(|d| stay.from_m[d] + share * (reading.reading_m[d] - stay.from_m[d]));
        let is_away = stay.is_changed && time_s < stay.moves_s && time_s >= stay.begins_s;
        let station = reading.station as usize;
        let length_m = (!is_away).then(|| {
            let centre_m = self.stations_m[station];
            let range_m = |at_m: &[f64; 3]| {
                let tip_m: [f64; 3] = std::array::from_fn(|d| at_m[d] + reading.offset_m[d]);
                distance_m(&tip_m, &centre_m)
            };
            // What machine and noise make of the distance, at this point and at the one before.
            let shown =
                |reading: &abbe_measurement::campaign::RangeReading| reading.length_m - range_m(&reading.reading_m);
            let here = shown(&reading);
            let before = match place.checked_sub(1).map(|before| self.stays[before].reading.reading) {
                Some(before) if !stay.is_changed => shown(&before),
                _ => here,
            };
            range_m(&at_m) + before + share * (here - before) + LENGTH_M * normal(&mut self.lengths)
        });
        let reading_m = at_m.map(|m| m + SCALES_M * normal(&mut self.scales));
        let standing = (time_s >= stay.arrives_s).then_some(place);
        Some(Seen { reading_m, length_m, station, offset_m: reading.offset_m, standing })
    }
}

fn distance_m(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|d| (a[d] - b[d]).powi(2)).sum::<f64>().sqrt()
}

/// How long a way takes (s).
fn lasts_s(way_m: f64, feed_m_s: f64, acceleration_m_s2: f64) -> f64 {
    match way_m * acceleration_m_s2 >= feed_m_s * feed_m_s {
        true => way_m / feed_m_s + feed_m_s / acceleration_m_s2,
        false => 2.0 * (way_m / acceleration_m_s2).sqrt(),
    }
}

/// How far it is after this time (m).
fn gone_m(time_s: f64, way_m: f64, feed_m_s: f64, acceleration_m_s2: f64) -> f64 {
    let whole_s = lasts_s(way_m, feed_m_s, acceleration_m_s2);
    let ramp_s = (feed_m_s / acceleration_m_s2).min(0.5 * whole_s);
    let ramp_m = |s: f64| 0.5 * acceleration_m_s2 * s * s;
    match time_s {
        s if s <= 0.0 => 0.0,
        s if s < ramp_s => ramp_m(s),
        s if s < whole_s - ramp_s => ramp_m(ramp_s) + feed_m_s * (s - ramp_s),
        s if s < whole_s => way_m - ramp_m(whole_s - s),
        _ => way_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped::{Declared, shipped_bridge};
    use crate::simulate_campaign;
    use abbe_measurement::instrument::RangeUncertainty;

    pub(super) const PACE: Pace = Pace { dwell_s: 1.0, change_s: 10.0, faster: 1.0 };

    pub(super) fn config() -> SimulationConfig {
        let range = RangeUncertainty { constant_m: 0.025e-6, per_metre: 0.15e-6, common_per_metre: 0.0 };
        let declared =
            Declared { stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)], repeatability_m: [0.25e-6; 3], range };
        shipped_bridge(7, 20e-6, &declared).unwrap()
    }

    #[test]
    fn where_it_stands_it_shows_the_campaign_but_for_the_noise_of_samples() {
        let config = config();
        let campaign = simulate_campaign(&config).unwrap().campaign;
        let mut drive = Drive::new(&config, PACE).unwrap();
        assert_eq!(drive.len(), campaign.readings.len());
        let (mut squares, mut stood) = (0.0, 0);
        for k in 0..20_000 {
            let seen = drive.at(0.1 * f64::from(k)).unwrap();
            let Some(point) = seen.standing else { continue };
            let reading = campaign.readings[point];
            assert!(distance_m(&seen.reading_m, &reading.reading_m) < 1e-7);
            assert_eq!((seen.station, seen.offset_m), (reading.station as usize, reading.offset_m));
            squares += (seen.length_m.unwrap() - reading.length_m).powi(2);
            stood += 1;
        }
        assert!(
            stood > 2000 && ((squares / f64::from(stood)).sqrt() / LENGTH_M - 1.0).abs() < 0.05,
            "{stood} {squares}"
        );
    }

    #[test]
    fn on_the_way_nothing_jumps_and_the_feed_is_kept() {
        let mut drive = Drive::new(&config(), PACE).unwrap();
        let feed_m_s = drive.stays.iter().map(|stay| stay.feed_m_s).fold(0.0, f64::max);
        let mut before: Option<Seen> = None;
        for k in 0..100_000 {
            let seen = drive.at(1e-3 * f64::from(k)).unwrap();
            if let Some(before) = before {
                assert!(distance_m(&seen.reading_m, &before.reading_m) < feed_m_s * 1e-3 + 1e-7);
                if let (Some(now_m), Some(before_m)) = (seen.length_m, before.length_m) {
                    assert!((now_m - before_m).abs() < feed_m_s * 1e-3 + 1e-6);
                }
            }
            before = Some(seen);
        }
        assert!(drive.at(0.0).unwrap().length_m.is_none(), "the tracer is set up first");
        let (ends_s, last) = (drive.ends_s(), drive.len() - 1);
        assert_eq!(drive.at(ends_s + 1e6).unwrap().standing, Some(last));
    }
}
