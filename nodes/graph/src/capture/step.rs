//! What is captured of the streams of scales and tracer: one reading a point, held against those before it.
//!
//! Place in the flow: [`super::run`] hands over what the drivers give, in the order in which it comes, writes what is told into
//! the journal, and shows it. Pure: no clock, no file; the same streams give the same readings. A standstill gives one reading at
//! most, and the machine must have been away before the next one. SI, machine frame.

use super::average::Length;
use super::check::Checks;
use super::config::{BY_PLAN, CaptureConfig, Takes};
use super::planned::{Place, Planned, distance_m};
use crate::step::DerivedMotion;
use abbe_files::{Captured, JournalEntry, MachineFile};
use abbe_geometry::model::MachineModel;
use abbe_measurement::standstill::{Change, Rest, Scaled, Standstill};
use abbe_msgs::{ScaleReading, Stamp, TracerReading};
use std::collections::VecDeque;

/// Lengths that come later than this after the scales (s) are not waited for.
pub(super) const LATE_S: f64 = 1.0;
/// Lengths that are kept at most.
const MOST_LENGTHS: usize = 200_000;
/// So many standstills in a row at no point are told.
const MISSED_IN_A_ROW: u64 = 4;
/// A standstill this many times farther from a point than allowed is none of it.
const MISSED: f64 = 20.0;

/// What came of a reading of a driver.
#[derive(Debug, Clone, PartialEq)]
pub enum Told {
    /// A line of the journal.
    Entry(JournalEntry),
    /// Something to know.
    Note(String),
    /// Something that needs somebody.
    Warning(String),
    /// All points of this line are captured.
    LineDone(usize),
    /// All points of the set-up are captured: somebody moves tracer or reflector, and says so.
    Ask(String),
    /// All points are captured.
    AllDone,
}

/// A standstill, or a trigger, whose lengths are still coming.
pub(super) struct Pending {
    pub(super) rest: Rest,
    pub(super) window_s: (f64, f64),
    pub(super) scale: ScaleReading,
}

/// Takes streams, gives readings.
pub struct Capturer {
    pub(super) config: CaptureConfig,
    pub(super) planned: Planned,
    pub(super) checks: Checks,
    pub(super) base_ns: Option<i64>,
    pub(super) standstill: Standstill,
    motion: DerivedMotion,
    /// The newest reading while the machine stands.
    standing: Option<ScaleReading>,
    /// This standstill has had its reading.
    pub(super) is_held: bool,
    pub(super) newest_s: [Option<f64>; 2],
    /// Lengths so far, and how many there were when the machine moved last.
    pub(super) lengths_seen: (u64, u64),
    lengths: VecDeque<(Length, String)>,
    pending: Option<Pending>,
    pub(super) taken: Vec<Option<Captured>>,
    pub(super) doubted: Vec<Captured>,
    pub(super) zeros: Vec<u32>,
    /// The point at which it stood last.
    last: Option<usize>,
    /// Where that was, until the machine has been away (m).
    pub(super) here_m: Option<[f64; 3]>,
    pub(super) set_up: usize,
    pub(super) asked_for: Option<usize>,
    pub(super) last_words: String,
    /// Standstills in a row that were at no point.
    missed: u64,
}

impl Capturer {
    /// A capture that has not begun.
    pub fn new(config: &CaptureConfig, planned: Planned, machine: &MachineFile) -> Capturer {
        Capturer {
            checks: Checks::new(config.check, machine.clone()),
            base_ns: None,
            standstill: Standstill::new(config.standstill()),
            motion: DerivedMotion::new(config.motion.settings()),
            standing: None,
            is_held: false,
            newest_s: [None; 2],
            lengths_seen: (0, 0),
            lengths: VecDeque::new(),
            pending: None,
            taken: vec![None; planned.len()],
            doubted: Vec::new(),
            zeros: vec![0; planned.stations.len()],
            last: None,
            here_m: None,
            set_up: 0,
            asked_for: None,
            last_words: String::new(),
            missed: 0,
            config: config.clone(),
            planned,
        }
    }

    /// Goes on from what a journal holds.
    ///
    /// # Errors
    /// An entry that does not fit the plan, by its number from 1.
    pub fn restore(&mut self, entries: &[JournalEntry]) -> Result<(), String> {
        for (k, entry) in entries.iter().enumerate() {
            let fits = |point: &usize| *point < self.planned.len();
            let is_sound = match entry {
                JournalEntry::Taken(reading) | JournalEntry::Doubted { reading, .. } => fits(&reading.point),
                JournalEntry::Zero { station, points, .. } => {
                    points.iter().all(fits) && self.planned.station(station).is_some()
                }
                JournalEntry::Dismissed { points, .. } => points.iter().all(fits),
                JournalEntry::SetUp { set_up, .. } => *set_up < self.planned.set_ups.len(),
                JournalEntry::Begun(_) => k == 0,
            };
            if !is_sound {
                return Err(format!("line {} does not fit the plan", k + 1));
            }
            self.apply(entry);
        }
        Ok(())
    }

    /// The plan.
    pub fn planned(&self) -> &Planned {
        &self.planned
    }

    /// What is captured of each point.
    pub fn taken(&self) -> &[Option<Captured>] {
        &self.taken
    }

    /// Readings in doubt.
    pub fn doubted(&self) -> &[Captured] {
        &self.doubted
    }

    /// Whether a point is captured, or needs no reading of its own.
    pub fn is_done(&self, point: usize) -> bool {
        self.taken[point].is_some() || self.planned.is_spare(point)
    }

    /// How many readings there will be.
    pub fn wanted(&self) -> usize {
        (0..self.planned.len()).filter(|point| self.taken[*point].is_some() || !self.planned.is_spare(*point)).count()
    }

    /// Whether the driver of the scales tells where the tip is.
    pub(super) fn tells_offset(&self) -> bool {
        self.config.tells_offset()
    }

    /// How many points are captured.
    pub fn done(&self) -> usize {
        self.taken.iter().flatten().count()
    }

    /// From now on readings are held against this model of the machine.
    pub fn learn(&mut self, model: MachineModel) {
        self.checks.learn(model);
    }

    /// A journal's entry takes effect: the same way live and when going on.
    pub(super) fn apply(&mut self, entry: &JournalEntry) {
        match entry {
            JournalEntry::Taken(reading) => self.count(reading.clone()),
            JournalEntry::Doubted { reading, .. } => {
                // The same point again says nothing more of a jump.
                self.doubted.retain(|other| other.point != reading.point);
                self.doubted.push(reading.clone());
            }
            JournalEntry::Zero { station, zero, points, .. } => {
                if let Some(station) = self.planned.station(station) {
                    self.zeros[station] = *zero;
                }
                for point in points {
                    // Readings that were taken before the jump was found.
                    if let Some(reading) = self.taken[*point].as_mut() {
                        reading.zero = *zero;
                    } else if let Some(place) = self.doubted.iter().rposition(|reading| reading.point == *point) {
                        let reading = self.doubted.remove(place);
                        self.count(Captured { zero: *zero, ..reading });
                    }
                }
                self.doubted.clear();
                self.checks.forget();
                let mut readings: Vec<&Captured> = self.taken.iter().flatten().collect();
                readings.sort_by_key(|reading| reading.stamp_ns);
                for reading in readings {
                    self.checks.add(&self.planned, self.planned.line(reading.point).station, reading);
                }
            }
            JournalEntry::Dismissed { points, .. } => self.doubted.retain(|reading| !points.contains(&reading.point)),
            JournalEntry::SetUp { set_up, .. } => (self.set_up, self.asked_for) = (*set_up, None),
            JournalEntry::Begun(_) => {}
        }
    }

    fn count(&mut self, reading: Captured) {
        let point = reading.point;
        self.last = Some(point);
        let station = self.planned.line(point).station;
        self.checks.add(&self.planned, station, &reading);
        if self.config.tells_station()
            && let Some(set_up) = self.planned.set_ups.iter().position(|set_up| set_up.points.contains(&point))
        {
            self.set_up = set_up;
        }
        self.taken[point] = Some(reading);
    }

    /// Nobody saw how the machine moved before the next reading of the scales.
    pub fn forget_motion(&mut self) {
        self.motion.forget();
    }

    /// Takes a reading of the scales.
    pub fn scale(&mut self, mut reading: ScaleReading) -> Vec<Told> {
        let mut told = Vec::new();
        let time_s = self.time_s(reading.stamp);
        for refused in self.motion.fill(&mut reading) {
            self.warn(&mut told, format!("what the motion tells was left out: {refused}"));
        }
        if self.here_m.is_some_and(|here_m| distance_m(&here_m, &reading.reading_m) > self.planned.within_m()) {
            self.here_m = None;
        }
        match self.config.points.takes {
            Takes::Trigger => self.trigger(time_s, reading, &mut told),
            Takes::Standstill => self.stand(time_s, reading, &mut told),
        }
        self.newest_s[0] = Some(self.newest_s[0].map_or(time_s, |newest_s| newest_s.max(time_s)));
        self.finish(&mut told);
        told
    }

    /// Takes a length.
    pub fn tracer(&mut self, reading: &TracerReading) -> Vec<Told> {
        let mut told = Vec::new();
        let time_s = self.time_s(reading.stamp);
        let length = Length { time_s, length_m: reading.length_m };
        if self.lengths.back().is_some_and(|(last, _)| last.time_s - time_s > LATE_S) {
            self.lengths.clear();
            self.warn(&mut told, "the stamps of the tracer go back; lengths before that are not used".to_owned());
        }
        // The same stamp again is the same reading, and one that was overtaken on the way is left out.
        if reading.length_m.is_finite() && self.lengths.back().is_none_or(|(last, _)| time_s > last.time_s) {
            self.lengths.push_back((length, reading.station.as_str().to_owned()));
            self.lengths_seen.0 += 1;
        }
        let kept_s = self.config.standstill.longest_s.max(self.config.points.trigger_s) + 10.0 * LATE_S;
        while self.lengths.len() > MOST_LENGTHS
            || self.lengths.front().is_some_and(|(first, _)| time_s - first.time_s > kept_s)
        {
            self.lengths.pop_front();
        }
        self.newest_s[1] = Some(time_s);
        self.finish(&mut told);
        told
    }

    /// Somebody says that tracer or reflector stand as the next set-up wants it.
    pub fn confirm(&mut self, stamp: Stamp) -> Vec<Told> {
        let mut told = Vec::new();
        let is_open = |set_up: &usize| {
            *set_up > self.set_up && self.planned.set_ups[*set_up].points.clone().any(|point| !self.is_done(point))
        };
        let Some(next) = (0..self.planned.set_ups.len()).find(is_open) else {
            told.push(Told::Note("no further set-up is open".to_owned()));
            return told;
        };
        self.dismiss(&mut told, "tracer or reflector was moved before they were confirmed");
        let entry = JournalEntry::SetUp { set_up: next, stamp_ns: stamp.to_nanos() };
        self.apply(&entry);
        told.push(Told::Entry(entry));
        told.push(Told::Note(format!("now {}", self.set_up_words(next))));
        (self.pending, self.here_m) = (None, None);
        self.standstill.forget();
        told
    }

    /// A set-up in words.
    pub fn set_up_words(&self, number: usize) -> String {
        let set_up = &self.planned.set_ups[number];
        let station = &self.planned.stations[set_up.station];
        format!(
            "station {} at {} mm, reflector at offset {} mm",
            station.name,
            mm(&station.position_m),
            mm(&set_up.offset_m)
        )
    }

    /// The set-up that is measured.
    pub fn set_up(&self) -> usize {
        self.set_up
    }

    fn time_s(&mut self, stamp: Stamp) -> f64 {
        let ns = stamp.to_nanos();
        (ns - *self.base_ns.get_or_insert(ns)) as f64 * 1e-9
    }

    pub(super) fn warn(&mut self, told: &mut Vec<Told>, words: String) {
        // The same words again and again hide what is new.
        if words != self.last_words {
            self.last_words.clone_from(&words);
            told.push(Told::Warning(words));
        }
    }

    fn trigger(&mut self, time_s: f64, reading: ScaleReading, told: &mut Vec<Told>) {
        if let Some(before) = self.pending.take() {
            self.process(&before, told);
        }
        let half_s = self.config.points.trigger_s;
        let scaled = Scaled { time_s, reading_m: reading.reading_m };
        self.here_m = None;
        let rest = Rest { scales: vec![scaled] };
        self.pending = Some(Pending { rest, window_s: (time_s - half_s, time_s + half_s), scale: reading });
    }

    fn stand(&mut self, time_s: f64, reading: ScaleReading, told: &mut Vec<Told>) {
        match self.standstill.push(Scaled { time_s, reading_m: reading.reading_m }) {
            Change::NotLater => {
                if self.newest_s[0].is_some_and(|newest_s| newest_s - time_s > LATE_S) {
                    self.warn(told, "the stamps of the scales go back; the standstill begins anew".to_owned());
                    self.standstill.forget();
                    (self.pending, self.newest_s[0]) = (None, None);
                }
            }
            Change::Moving => (self.is_held, self.lengths_seen.1) = (false, self.lengths_seen.0),
            Change::Standing => {
                self.standing = Some(reading);
                let lasts_s = self.standstill.lasts_s().unwrap_or(0.0);
                if lasts_s >= self.config.standstill.longest_s
                    && !self.is_held
                    && let Some(rest) = self.standstill.rest()
                {
                    self.hold(rest, told);
                }
            }
            Change::Left(rest) => {
                if !self.is_held {
                    self.hold(rest, told);
                }
                self.is_held = false;
            }
        }
    }

    /// A standstill is over, or long enough.
    fn hold(&mut self, rest: Rest, told: &mut Vec<Told>) {
        self.is_held = true;
        // The next standstill does not wait for lengths of the one before.
        if let Some(before) = self.pending.take() {
            self.process(&before, told);
        }
        // It has not been away since its last reading.
        if self.here_m.is_some() {
            return;
        }
        let Some(scale) = self.standing else { return };
        let (from_s, to_s) = rest.ends_s();
        let margin_s = self.config.standstill.margin_s;
        self.pending = Some(Pending { rest, window_s: (from_s + margin_s, to_s - margin_s), scale });
    }

    /// Takes what is pending, once its lengths are there or are not waited for any more.
    fn finish(&mut self, told: &mut Vec<Told>) {
        let Some(pending) = &self.pending else { return };
        let end_s = pending.window_s.1;
        let [scale_s, tracer_s] = self.newest_s;
        let has_all = tracer_s.is_some_and(|tracer_s| tracer_s >= end_s);
        let is_late = scale_s.is_some_and(|scale_s| scale_s > end_s + LATE_S);
        if (has_all || is_late)
            && let Some(pending) = self.pending.take()
        {
            self.process(&pending, told);
        }
    }

    fn process(&mut self, pending: &Pending, told: &mut Vec<Told>) {
        let (from_s, to_s) = pending.window_s;
        let own = self.lengths.iter().filter(|(length, _)| (from_s..=to_s).contains(&length.time_s));
        let (lengths, names): (Vec<Length>, Vec<&String>) = own.map(|(length, name)| (*length, name)).unzip();
        let station = match self.station(&names) {
            Ok(station) => station,
            Err(words) => return self.warn(told, words),
        };
        if self.config.tells_station()
            && !self.config.tells_offset()
            && self.planned.set_ups[self.set_up].station != station
        {
            // The reflector stays where it was planned for the station that the tracer tells.
            self.set_up =
                self.planned.set_ups.iter().position(|set_up| set_up.station == station).unwrap_or(self.set_up);
        }
        let offset_m = match self.config.tells_offset() {
            true => pending.scale.offset_m,
            false => self.planned.set_ups[self.set_up].offset_m,
        };
        let scales: Vec<[f64; 3]> = pending.rest.scales.iter().map(|scaled| scaled.reading_m).collect();
        let middle_m = scales[scales.len() / 2];
        let is_taken = |point: usize| self.taken[point].is_some();
        let name = &self.planned.stations[station].name;
        match self.planned.at((station, &offset_m), &middle_m, is_taken, self.last) {
            Place::At(point) if is_taken(point) => {
                (self.last, self.here_m) = (Some(point), Some(middle_m));
            }
            Place::At(point) => {
                self.missed = 0;
                self.average(pending, point, &lengths, told);
            }
            Place::OtherOffset(point) => {
                let line = self.planned.line(point);
                let words = format!(
                    "the machine stands at {}, which is measured with the reflector at {} mm, and the scale driver says {} mm; change \
                     the reflector, or correct the offset of this tool",
                    self.planned.words(point),
                    mm(&line.offset_m),
                    mm(&offset_m)
                );
                self.warn(told, words);
            }
            Place::Near(point, away_m) if away_m < MISSED * self.planned.within_m() => {
                let words = format!(
                    "the machine stands {:.3} mm from {}, and {:.3} mm are allowed (points.within_mm); at X, Y, Z = {} mm no point \
                     is captured",
                    away_m * 1e3,
                    self.planned.words(point),
                    self.planned.within_m() * 1e3,
                    mm(&middle_m)
                );
                self.warn(told, words);
            }
            Place::Near(point, away_m) => self.miss(point, away_m, &middle_m, told),
            Place::Nowhere => {
                let words = format!(
                    "the plan has no line from station {name} with the reflector at {} mm; see that station and offset are those \
                     of the plan",
                    mm(&offset_m)
                );
                self.warn(told, words);
            }
        }
    }

    /// A machine may stand anywhere on its way; one that never stands at a point is not the one of the plan, or not in its unit.
    fn miss(&mut self, point: usize, away_m: f64, at_m: &[f64; 3], told: &mut Vec<Told>) {
        self.missed += 1;
        if self.missed >= MISSED_IN_A_ROW && self.missed.is_power_of_two() {
            let words = format!(
                "{} standstills in a row were at no point of the plan; the last was at X, Y, Z = {} mm, {:.1} mm from {}: see that the \
                 scales have the unit and the frame of the plan, and that the machine drives this plan",
                self.missed,
                mm(at_m),
                away_m * 1e3,
                self.planned.words(point)
            );
            self.warn(told, words);
        }
    }

    /// Number of the station that these lengths are from.
    fn station(&self, names: &[&String]) -> Result<usize, String> {
        if !self.config.tells_station() {
            return Ok(self.planned.set_ups[self.set_up].station);
        }
        // Without a length it is where it was: that there is none is told for its point.
        let Some(name) = names.first().copied().or_else(|| self.lengths.back().map(|(_, name)| name)) else {
            return Ok(self.planned.set_ups[self.set_up].station);
        };
        if names.iter().any(|other| *other != name) {
            return Err("the tracer names two stations while the machine stood; nothing is captured there".to_owned());
        }
        self.planned.station(name).ok_or_else(|| match name == BY_PLAN {
            true => "the tracer names no station".to_owned(),
            false => {
                let known: Vec<&str> = self.planned.stations.iter().map(|station| station.name.as_str()).collect();
                format!(
                    "the tracer names station {name}, which is not in the plan ({}); correct the name",
                    known.join(", ")
                )
            }
        })
    }
}

/// A place in millimetres.
pub(super) fn mm(at_m: &[f64; 3]) -> String {
    at_m.map(|m| format!("{:.3}", m * 1e3)).join(", ")
}
