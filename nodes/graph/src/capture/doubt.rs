//! Whether a standstill counts: averaged, held against what was captured before, taken or kept in doubt.
//!
//! Place in the flow: the second half of [`Capturer`]. A reading that differs is written into the journal at once and does not count
//! until the next ones say what it was: a single one that is off, a jump of the tracer's zero, after which the station counts as
//! a new one, or a reflector that sits elsewhere than the plan says.

use super::average::{Averaged, Length, NoReading, average};
use super::check::{Judgement, same_jump};
use super::step::{Capturer, LATE_S, Pending, Told, mm};
use crate::step::is_fresh;
use abbe_files::{Captured, JournalEntry};
use std::collections::{BTreeMap, BTreeSet};

/// Doubted readings that agree with one another, from which the tracer's zero is a new one.
const A_NEW_ZERO: usize = 3;
/// Doubted readings that agree with nothing, from which something else is wrong.
const TOO_MANY: usize = 6;

impl Capturer {
    pub(super) fn average(&mut self, pending: &Pending, point: usize, lengths: &[Length], told: &mut Vec<Told>) {
        match average(&pending.rest, pending.window_s, lengths, &self.config.lengths) {
            Ok(averaged) => self.judge(pending, point, &averaged, told),
            Err(why) => {
                let words = format!("{} is not captured yet: {}{why}", self.planned.words(point), self.clocks(&why));
                self.warn(told, words);
                // Where the machine stands on, the next moments may be better.
                self.standstill.forget();
                self.is_held = false;
            }
        }
    }

    /// Lengths that come while the machine stands, but not at the time of the scales, say that the clocks differ.
    fn clocks(&self, why: &NoReading) -> String {
        let came = self.lengths_seen.0 - self.lengths_seen.1;
        match (why, self.newest_s) {
            (NoReading::NoLength | NoReading::Few(..), [Some(scale_s), Some(tracer_s)])
                if (scale_s - tracer_s).abs() > LATE_S && came >= self.config.lengths.fewest as u64 =>
            {
                format!(
                    "lengths come, but are stamped {:+.0} s beside the scales: the clocks differ; leave the column stamp_s out with \
                     \"-\", so that the instant of arrival counts; ",
                    tracer_s - scale_s
                )
            }
            _ => String::new(),
        }
    }

    fn judge(&mut self, pending: &Pending, point: usize, averaged: &Averaged, told: &mut Vec<Told>) {
        let station = self.planned.line(point).station;
        let reading = self.captured(pending, point, averaged);
        let before = self.taken.iter().flatten().chain(&self.doubted).map(|other| other.stamp_ns).max();
        if before.is_some_and(|before| before >= reading.stamp_ns) {
            let words = format!(
                "{} is not captured: its stamp is not after that of the reading before; set the clock right, and go on then",
                self.planned.words(point)
            );
            return self.warn(told, words);
        }
        self.here_m = Some(pending.rest.scales[pending.rest.scales.len() / 2].reading_m);
        if self.doubted.iter().any(|other| self.planned.line(other.point).station != station) {
            self.dismiss(told, "the tracer was moved before they were confirmed");
        }
        match self.checks.judge(&self.planned, station, &reading) {
            Judgement::First => self.take(reading, told),
            Judgement::Agrees(off_m, u_m) => {
                self.dismiss(told, "the next reading agrees with those before; they stand alone, and their points are to be measured again");
                self.take(Captured { off_m: Some((off_m, u_m)), ..reading }, told);
            }
            Judgement::Differs { off_m, u_m, offsets_m } => {
                self.doubt(Captured { off_m: Some((off_m, u_m)), ..reading }, &offsets_m, told);
            }
        }
    }

    fn captured(&self, pending: &Pending, point: usize, averaged: &Averaged) -> Captured {
        let (from_s, to_s) = pending.window_s;
        let middle_ns = self.base_ns.unwrap_or(0) + (0.5e9 * (from_s + to_s)).round() as i64;
        let fresh =
            pending.scale.covariates.iter().filter(|entry| is_fresh(entry.age_s, self.config.max_covariate_age_s));
        let covariates: BTreeMap<String, f64> =
            fresh.map(|entry| (entry.name.as_str().to_owned(), entry.value)).collect();
        Captured {
            point,
            zero: self.zeros[self.planned.line(point).station],
            stamp_ns: middle_ns,
            reading_m: averaged.reading_m,
            // That of the plan: the same to the last digit along a line.
            offset_m: self.planned.line(point).offset_m,
            length_m: averaged.length_m,
            u_reading_m: averaged.u_reading_m,
            u_length_m: averaged.u_length_m,
            scatter_m: averaged.scatter_m,
            lengths: averaged.lengths,
            effective: averaged.effective,
            stood_s: to_s - from_s,
            covariates,
            off_m: None,
        }
    }

    fn take(&mut self, reading: Captured, told: &mut Vec<Told>) {
        let (line, zero) = (self.planned.points_line(reading.point), reading.zero);
        let entry = JournalEntry::Taken(reading);
        self.apply(&entry);
        told.push(Told::Entry(entry));
        let station = self.planned.lines[line].station;
        if let Some((points, jump_m)) = self.checks.jump(station, zero) {
            self.begin_zero(station, points, jump_m, told);
        }
        self.note_done(line, told);
        self.last_words.clear();
    }

    fn note_done(&mut self, line: usize, told: &mut Vec<Told>) {
        let is_done = |mut points: std::ops::Range<usize>| points.all(|point| self.is_done(point));
        if is_done(self.planned.lines[line].points.clone()) {
            told.push(Told::LineDone(line));
        }
        if is_done(0..self.planned.len()) {
            told.push(Told::AllDone);
            return;
        }
        let asks = !self.config.tells_station() || !self.config.tells_offset();
        let next = self.set_up + 1;
        if asks
            && self.asked_for != Some(next)
            && next < self.planned.set_ups.len()
            && is_done(self.planned.set_ups[self.set_up].points.clone())
        {
            self.asked_for = Some(next);
            told.push(Told::Ask(self.set_up_words(next)));
        }
    }

    fn doubt(&mut self, reading: Captured, offsets_m: &[[f64; 3]], told: &mut Vec<Told>) {
        let (point, station) = (reading.point, self.planned.line(reading.point).station);
        let (off_m, u_m) = reading.off_m.unwrap_or_default();
        let mut why = format!(
            "{} differs by {:+.1} µm from what the readings before say (standard uncertainty {:.1} µm)",
            self.planned.words(point),
            off_m * 1e6,
            u_m * 1e6
        );
        let explained: Vec<String> = offsets_m.iter().map(mm).collect();
        if !explained.is_empty() {
            why += &format!(
                "; it would agree with the reflector at {} mm instead of {} mm: see that it sits where the plan says",
                explained.join(" or at "),
                mm(&reading.offset_m)
            );
        }
        let entry = JournalEntry::Doubted { reading, why: why.clone() };
        self.apply(&entry);
        told.push(Told::Entry(entry));
        let off: Vec<(f64, f64)> = self.doubted.iter().filter_map(|reading| reading.off_m).collect();
        let count = self.doubted.len();
        match same_jump(&off) {
            Some(jump_m) if count >= A_NEW_ZERO && explained.is_empty() => {
                let points: Vec<usize> = self.doubted.iter().map(|reading| reading.point).collect();
                self.begin_zero(station, points.clone(), jump_m, told);
                let lines: BTreeSet<usize> = points.iter().map(|point| self.planned.points_line(*point)).collect();
                lines.into_iter().for_each(|line| self.note_done(line, told));
            }
            _ if count >= TOO_MANY && explained.is_empty() => told.push(Told::Warning(format!(
                "{why}. {count} readings in a row agree neither with those before nor with one another as after a jump of the zero: \
                 stop the machine; see that x, y, z, offset and length belong together and that tracer and reflector sit \
                 firmly. If the machine errs by more than {} µm, write it into check.raw_error_um",
                self.config.check.raw_error_um
            ))),
            _ => told.push(Told::Warning(format!(
                "{why}. It is kept, and does not count until the next readings say what it was"
            ))),
        }
    }

    /// These readings, and all that follow from this station, count from another zero of the tracer.
    fn begin_zero(&mut self, station: usize, points: Vec<usize>, jump_m: f64, told: &mut Vec<Told>) {
        let why = format!(
            "the zero of the tracer jumped by {:+.1} µm at {}: the beam was broken, or the tracer moved; what follows is kept as a \
             station of its own",
            jump_m * 1e6,
            self.planned.words(points.first().copied().unwrap_or_default())
        );
        let name = self.planned.stations[station].name.clone();
        let entry = JournalEntry::Zero { station: name, zero: self.zeros[station] + 1, points, why: why.clone() };
        self.apply(&entry);
        told.push(Told::Entry(entry));
        told.push(Told::Warning(why));
    }

    /// Readings in doubt do not count.
    pub(super) fn dismiss(&mut self, told: &mut Vec<Told>, why: &str) {
        if self.doubted.is_empty() {
            return;
        }
        let points: Vec<usize> = self.doubted.iter().map(|reading| reading.point).collect();
        let words: Vec<String> = points.iter().map(|point| self.planned.words(*point)).collect();
        let entry = JournalEntry::Dismissed { points, why: why.to_owned() };
        self.apply(&entry);
        told.push(Told::Entry(entry));
        told.push(Told::Warning(format!("{}: not captured; {why}", words.join(", "))));
    }
}
