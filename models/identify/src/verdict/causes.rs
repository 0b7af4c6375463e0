//! What may be behind rejected readings and a misfit: patterns over lines, stations, offsets and time.
//!
//! Place in the flow: residuals of a fit in, likely causes out, likeliest first; [`super::words`] says them.

use super::resolution::coarsest_step;
use super::step::{self, Seen, Step};
use abbe_geometry::Vector3;
use abbe_geometry::chain::nominal_point_m;
use abbe_measurement::campaign::{Campaign, RangeReading};
use std::collections::BTreeMap;

/// Share of a group's readings that are rejected, from which the group is suspect.
const MOSTLY: f64 = 0.5;
/// Share of all rejected readings that suspects must hold before they explain them.
const NEARLY_ALL: f64 = 0.8;
/// Lines that are suspected at most: more are no matter of single lines.
const MOST_LINES: usize = 8;
/// Suspect lines of a station that one side of an instant must hold before the station is said to have moved there: of two, the half of all
/// pairs lies on one side.
const FEWEST_LINES: usize = 3;
/// Lines of the station on the other side, none of them suspect, at least.
const FEWEST_BESIDE: usize = 2;
/// Rejected readings below which there is nothing to group.
const FEWEST: usize = 6;
/// Range of the 90 % point of the residual, in steps of a column, in which rounding to the step explains it: three rounded
/// axes along one line of sight make at most 0.87, one of them at an angle makes a tenth.
const ROUNDED: std::ops::RangeInclusive<f64> = 0.05..=0.9;

/// A likely cause.
#[derive(Debug, Clone, PartialEq)]
pub enum Cause {
    /// A tracer moved, or its beam was interrupted, between two readings.
    Step {
        /// Name of the station.
        station: String,
        /// Lines of the last reading before and the first after.
        lines: (String, String),
        /// Their numbers, from 1.
        readings: (usize, usize),
        /// Their times (s).
        times_s: (f64, f64),
        /// How far the station moved (m); `None` where an interrupted beam explains it as well.
        moved_m: Option<Vector3<f64>>,
        /// Change of the dead path (m).
        dead_path_m: f64,
        /// Rejected readings that it explains.
        explains: usize,
    },
    /// The suspect lines of a station lie on one side of an instant.
    OneSide {
        /// Name of the station.
        station: String,
        /// Lines of the last reading before and the first after.
        lines: (String, String),
        /// Their numbers, from 1.
        readings: (usize, usize),
        /// Their times (s).
        times_s: (f64, f64),
        /// Suspect lines of this station, and of all.
        suspects: (usize, usize),
        /// Whether they are those after it.
        is_after: bool,
    },
    /// Nearly all rejected readings belong to these lines.
    Lines {
        /// Line, its station, rejected, all.
        lines: Vec<(String, String, usize, usize)>,
    },
    /// Nearly all rejected readings have this offset.
    Offset {
        /// The offset (m).
        offset_m: [f64; 3],
        /// Rejected.
        rejected: usize,
        /// All with this offset.
        all: usize,
    },
    /// Nearly all rejected readings belong to this station.
    Station {
        /// Its name.
        station: String,
        /// Rejected.
        rejected: usize,
        /// All of this station.
        all: usize,
    },
    /// Columns were rounded to a step that is as large as the residual.
    Rounded {
        /// Names of the columns.
        columns: Vec<&'static str>,
        /// The step (m).
        step_m: f64,
    },
    /// All values are in another unit than their column says.
    Unit {
        /// The unit.
        unit: &'static str,
    },
    /// The data belong to another machine than the machine file.
    OtherMachine {
        /// Name of the machine.
        machine: String,
    },
    /// Only a part of the stroke was driven.
    PartOfStroke,
    /// The plan goes to places at equal distances.
    EqualSteps,
    /// Repeated readings of points from single stations differ.
    Pairs {
        /// How many, by how much, and what to do.
        says: String,
    },
    /// Gross errors all over.
    Scattered,
    /// The machine file holds at zero what the readings ask for.
    Held {
        /// Names of the error functions.
        errors: Vec<String>,
        /// Mean square of normalised residuals with them held, and free.
        squares: (f64, f64),
    },
    /// The model lacks an effect.
    Lacks,
    /// One of several offsets is not what the campaign says of it.
    Offsets {
        /// How many there are.
        count: usize,
    },
    /// The declared uncertainties are too small.
    Understated,
    /// The declared uncertainties are too large.
    Overstated,
    /// The values were computed, smoothed or averaged.
    Computed,
}

impl Cause {
    /// Whether it is what the readings that it explains have in common, and not just that they are off.
    pub(super) fn is_in_common(&self) -> bool {
        !matches!(
            self,
            Cause::Scattered
                | Cause::Lacks
                | Cause::Offsets { .. }
                | Cause::Understated
                | Cause::Overstated
                | Cause::Computed
        )
    }
}

/// Residuals of a campaign after a fit.
pub(super) struct Residuals<'a> {
    pub(super) campaign: &'a Campaign,
    /// Station centres (m, machine frame).
    pub(super) stations_m: Vec<Vector3<f64>>,
    pub(super) residuals_m: &'a [f64],
    /// Expected standard deviations (m): declared ones, widened by what the fit found.
    pub(super) u_m: Vec<f64>,
    pub(super) is_rejected: Vec<bool>,
}

impl Residuals<'_> {
    /// What explains the rejected readings.
    pub(super) fn of_rejected(&self) -> Vec<Cause> {
        let rejected = self.is_rejected.iter().filter(|is| **is).count();
        if rejected < FEWEST {
            return Vec::new();
        }
        let mut causes: Vec<Cause> = self.rounded().into_iter().collect();
        let steps = self.steps();
        let by_steps: usize = steps.iter().map(|(_, step)| step.explains).sum();
        causes.extend(steps.iter().map(|(station, step)| self.step(*station, step)));
        if by_steps as f64 >= NEARLY_ALL * rejected as f64 {
            return causes;
        }
        let lines = self.lines(rejected);
        let has_step = |station: usize| steps.iter().any(|(own, _)| *own == station);
        causes.extend(if lines.is_empty() { None } else { self.one_side(has_step) });
        let groups = if lines.is_empty() { self.offset(rejected).or_else(|| self.station(rejected)) } else { None };
        causes.extend((!lines.is_empty()).then_some(Cause::Lines { lines }));
        causes.extend(groups);
        if causes.is_empty() {
            causes.push(Cause::Lacks);
            causes.extend(self.offsets());
            causes.push(Cause::Scattered);
        }
        causes
    }

    /// Columns whose rounding is as large as the residual.
    pub(super) fn rounded(&self) -> Option<Cause> {
        let mut sizes: Vec<f64> = self.residuals_m.iter().map(|residual_m| residual_m.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let large_m = sizes.get(sizes.len() * 9 / 10).copied()?;
        type Column = (&'static str, fn(&RangeReading) -> f64);
        let columns: [Column; 4] = [
            ("x_mm", |reading| reading.reading_m[0]),
            ("y_mm", |reading| reading.reading_m[1]),
            ("z_mm", |reading| reading.reading_m[2]),
            ("length_mm", |reading| reading.length_m),
        ];
        let steps = columns.into_iter().filter_map(|(name, of)| {
            let values_m: Vec<f64> = self.campaign.readings.iter().map(of).collect();
            Some((name, coarsest_step(&values_m)?))
        });
        let coarse: Vec<(&'static str, f64)> =
            steps.filter(|(_, step_m)| ROUNDED.contains(&(large_m / step_m))).collect();
        let step_m = coarse.iter().map(|(_, step_m)| *step_m).reduce(f64::max)?;
        Some(Cause::Rounded { columns: coarse.into_iter().map(|(name, _)| name).collect(), step_m })
    }

    /// Steps of the stations that have enough rejected readings, by station.
    fn steps(&self) -> Vec<(usize, Step)> {
        let of = |station: usize| {
            let own = |reading: &usize| self.campaign.readings[*reading].station as usize == station;
            let mut places: Vec<usize> = (0..self.campaign.readings.len()).filter(own).collect();
            if places.iter().filter(|place| self.is_rejected[**place]).count() < FEWEST {
                return None;
            }
            places.sort_by(|a, b| {
                let time_s = |place: usize| self.campaign.readings[place].time_s;
                time_s(*a).total_cmp(&time_s(*b)).then(a.cmp(b))
            });
            let seen: Vec<Seen> = places.into_iter().map(|place| self.seen(place)).collect();
            Some((station, step::find(&seen)?))
        };
        (0..self.campaign.stations.len()).filter_map(of).collect()
    }

    fn seen(&self, place: usize) -> Seen {
        let reading = &self.campaign.readings[place];
        let point_m = nominal_point_m(reading.reading_m, reading.offset_m);
        let sight = (point_m - self.stations_m[reading.station as usize]).normalize();
        Seen { reading: place, sight, residual_m: self.residuals_m[place], u_m: self.u_m[place] }
    }

    fn step(&self, station: usize, step: &Step) -> Cause {
        let (before, after) = step.readings;
        let reading = |place: usize| &self.campaign.readings[place];
        let line = |place: usize| self.campaign.lines[reading(place).line as usize].clone();
        Cause::Step {
            station: self.campaign.stations[station].clone(),
            lines: (line(before), line(after)),
            readings: (before + 1, after + 1),
            times_s: (reading(before).time_s, reading(after).time_s),
            moved_m: step.moved_m,
            dead_path_m: step.dead_path_m,
            explains: step.explains,
        }
    }

    /// Rejected and all readings by a key.
    fn by<K: Ord>(&self, key: impl Fn(&RangeReading) -> K) -> BTreeMap<K, (usize, usize)> {
        let mut counts = BTreeMap::new();
        for (reading, is_rejected) in self.campaign.readings.iter().zip(&self.is_rejected) {
            let (rejected, all): &mut (usize, usize) = counts.entry(key(reading)).or_default();
            *rejected += usize::from(*is_rejected);
            *all += 1;
        }
        counts
    }

    /// Lines that hold nearly all rejected readings, most rejected first.
    fn lines(&self, rejected: usize) -> Vec<(String, String, usize, usize)> {
        let counts = self.by(|reading| (reading.line, reading.station));
        let mut suspects: Vec<_> = counts.into_iter().filter(|(_, counts)| is_suspect(*counts)).collect();
        suspects.sort_by_key(|(_, (rejected, _))| std::cmp::Reverse(*rejected));
        let held: usize = suspects.iter().map(|(_, (rejected, _))| rejected).sum();
        if suspects.len() > MOST_LINES || (held as f64) < NEARLY_ALL * rejected as f64 {
            return Vec::new();
        }
        let named = |((line, station), (rejected, all)): ((u32, u32), (usize, usize))| {
            let name = |names: &[String], index: u32| names[index as usize].clone();
            (name(&self.campaign.lines, line), name(&self.campaign.stations, station), rejected, all)
        };
        suspects.into_iter().map(named).collect()
    }

    /// The instant on one side of which the suspect lines lie, where most are of one station that has no step: a motion that the fit has
    /// taken up in part rejects some lines on the smaller side, and looks like trouble of theirs.
    fn one_side(&self, has_step: impl Fn(usize) -> bool) -> Option<Cause> {
        let counts = self.by(|reading| (reading.station, reading.line));
        let suspect = |station: u32| {
            let own = counts.iter().filter(move |((own, _), _)| *own == station);
            own.filter(|(_, counts)| is_suspect(**counts)).count()
        };
        let all = counts.values().filter(|counts| is_suspect(**counts)).count();
        let stations = (0..self.campaign.stations.len() as u32).filter(|station| !has_step(*station as usize));
        let (own, station) = stations.map(|station| (suspect(station), station)).max()?;
        if own < FEWEST_LINES || 2 * own <= all {
            return None;
        }
        let lines = self.in_time(station);
        let is_bad: Vec<bool> =
            lines.iter().map(|line| counts.get(&(station, line.line)).is_some_and(|c| is_suspect(*c))).collect();
        let (first, last) = (is_bad.iter().position(|is| *is)?, is_bad.iter().rposition(|is| *is)?);
        let beside = lines.len() - last - 1;
        // Of the lines on the side of the suspects half are suspect, or it is not the side that they have in common.
        let (at, is_after) = match (2 * own >= lines.len() - first, 2 * own > last) {
            (true, _) if first >= FEWEST_BESIDE => (first, true),
            (_, true) if beside >= FEWEST_BESIDE => (last + 1, false),
            _ => return None,
        };
        let (before, after) = (&lines[at - 1], &lines[at]);
        let name = |line: &InTime| self.campaign.lines[line.line as usize].clone();
        let time_s = |place: usize| self.campaign.readings[place].time_s;
        Some(Cause::OneSide {
            station: self.campaign.stations[station as usize].clone(),
            lines: (name(before), name(after)),
            readings: (before.last + 1, after.first + 1),
            times_s: (time_s(before.last), time_s(after.first)),
            suspects: (own, all),
            is_after,
        })
    }

    /// The lines of a station in the order of time.
    fn in_time(&self, station: u32) -> Vec<InTime> {
        let mut places: Vec<usize> = (0..self.campaign.readings.len()).collect();
        places.retain(|place| self.campaign.readings[*place].station == station);
        places.sort_by(|a, b| self.campaign.readings[*a].time_s.total_cmp(&self.campaign.readings[*b].time_s));
        let mut lines: Vec<InTime> = Vec::new();
        for place in places {
            let line = self.campaign.readings[place].line;
            match lines.iter_mut().find(|known| known.line == line) {
                Some(known) => known.last = place,
                None => lines.push(InTime { line, first: place, last: place }),
            }
        }
        lines
    }

    /// That an offset may be wrong, where there are several: with one alone, a wrong one fits as well.
    pub(super) fn offsets(&self) -> Option<Cause> {
        let count = self.by(|reading| reading.offset_m.map(|value| (value + 0.0).to_bits())).len();
        (count > 1).then_some(Cause::Offsets { count })
    }

    fn offset(&self, rejected: usize) -> Option<Cause> {
        let counts = self.by(|reading| reading.offset_m.map(|value| (value + 0.0).to_bits()));
        let several = counts.len() > 1;
        let (offset, (own, all)) =
            counts.into_iter().filter(|(_, counts)| is_suspect(*counts)).max_by_key(|(_, c)| c.0)?;
        let explains = several && own as f64 >= NEARLY_ALL * rejected as f64;
        explains.then(|| Cause::Offset { offset_m: offset.map(f64::from_bits), rejected: own, all })
    }

    fn station(&self, rejected: usize) -> Option<Cause> {
        let counts = self.by(|reading| reading.station);
        let (station, (own, all)) = counts.into_iter().max_by_key(|(_, counts)| counts.0)?;
        let station = self.campaign.stations[station as usize].clone();
        (own as f64 >= NEARLY_ALL * rejected as f64).then_some(Cause::Station { station, rejected: own, all })
    }
}

/// A line of a station, with its first and last reading in time.
struct InTime {
    line: u32,
    first: usize,
    last: usize,
}

fn is_suspect((rejected, all): (usize, usize)) -> bool {
    rejected as f64 >= MOSTLY * all as f64
}
