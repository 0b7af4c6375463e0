//! The points of a plan, and which of them a machine stands at.
//!
//! Place in the flow: `abbe plan` writes the path, [`super::Capturer`] asks here. A point is told by its place, by the station and
//! by where the reflector sits. Where several are at the same place, as where lines cross, the one that follows the last point
//! on its line is meant, then the next in the plan. Points that are not at the same place and too near to each other to be told
//! apart are refused before anything is measured. A line that begins where the one before ends has its first point already: the
//! machine does not move between, and the same standstill twice would be no second reading. Machine frame, m.

use abbe_files::PathStation;
use abbe_geometry::machine::Machine;
use std::collections::BTreeSet;

/// Places this near are the same (m): rounding of a file.
const SAME_M: f64 = 1e-6;
/// Offsets this near are the same (m).
const SAME_OFFSET_M: f64 = 1e-6;
/// How far along its line the next point may be: one that was left out does not make it another line.
const NEXT: usize = 2;

/// A station of the plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedStation {
    /// Its name.
    pub name: String,
    /// Where it was planned (m).
    pub position_m: [f64; 3],
}

/// A line of the plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedLine {
    /// Its name.
    pub name: String,
    /// Number of its station.
    pub station: usize,
    /// Reflector (m, ram frame).
    pub offset_m: [f64; 3],
    /// Its points.
    pub points: std::ops::Range<usize>,
}

/// Lines that follow one another with tracer and reflector left as they are.
#[derive(Debug, Clone, PartialEq)]
pub struct SetUp {
    /// Number of the station.
    pub station: usize,
    /// Reflector (m, ram frame).
    pub offset_m: [f64; 3],
    /// All points of it.
    pub points: std::ops::Range<usize>,
}

/// A plan to be captured.
#[derive(Debug, Clone, PartialEq)]
pub struct Planned {
    /// Stations in order.
    pub stations: Vec<PlannedStation>,
    /// Lines in order.
    pub lines: Vec<PlannedLine>,
    /// Set-ups in order.
    pub set_ups: Vec<SetUp>,
    /// Line and reading (m) of each point.
    points: Vec<(usize, [f64; 3])>,
    within_m: f64,
}

/// Where a machine stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// At this point.
    At(usize),
    /// At none; the nearest of this station and offset, and how far it is (m).
    Near(usize, f64),
    /// At a point (its number) that is measured with the reflector elsewhere.
    OtherOffset(usize),
    /// The plan has nothing from this station with the reflector there.
    Nowhere,
}

impl Planned {
    /// The points of a path; a machine stands at one within this distance (m).
    ///
    /// # Errors
    /// What cannot be captured, in words with what to do.
    pub fn new(path: &[PathStation], machine: &Machine, within_m: f64) -> Result<Planned, String> {
        let mut planned =
            Planned { stations: Vec::new(), lines: Vec::new(), set_ups: Vec::new(), points: Vec::new(), within_m };
        let (mut stations, mut lines) = (BTreeSet::new(), BTreeSet::new());
        for own in path {
            if !stations.insert(&own.name) {
                return Err(format!(
                    "station {} is left and comes again; a tracer that was moved counts from another zero: give the second time \
                     a name of its own",
                    own.name
                ));
            }
            planned.stations.push(PlannedStation { name: own.name.clone(), position_m: own.position_m });
            for line in &own.lines {
                if !lines.insert(&line.name) {
                    return Err(format!("line {} stands twice; give each line a name of its own", line.name));
                }
                let first = planned.points.len();
                let number = planned.lines.len();
                planned.points.extend(line.points_m.iter().map(|at_m| (number, *at_m)));
                let points = first..planned.points.len();
                let station = planned.stations.len() - 1;
                planned.lines.push(PlannedLine {
                    name: line.name.clone(),
                    station,
                    offset_m: line.offset_m,
                    points: points.clone(),
                });
                match planned.set_ups.last_mut() {
                    Some(last) if last.station == station && is_same(&last.offset_m, &line.offset_m, SAME_OFFSET_M) => {
                        last.points.end = points.end;
                    }
                    _ => planned.set_ups.push(SetUp { station, offset_m: line.offset_m, points }),
                }
            }
        }
        planned.check_strokes(machine)?;
        planned.check_distances()?;
        Ok(planned)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The line of a point.
    pub fn line(&self, point: usize) -> &PlannedLine {
        &self.lines[self.points[point].0]
    }

    /// Number of the line of a point.
    pub fn points_line(&self, point: usize) -> usize {
        self.points[point].0
    }

    /// Whether the machine has not moved since the point before: its reading is there already.
    pub fn is_spare(&self, point: usize) -> bool {
        let Some((before, line)) = point.checked_sub(1).map(|before| (before, self.line(point))) else { return false };
        let other = self.line(before);
        point == line.points.start
            && other.station == line.station
            && is_same(&other.offset_m, &line.offset_m, SAME_OFFSET_M)
            && distance_m(&self.points[before].1, &self.points[point].1) <= SAME_M
    }

    /// Where a point is read (m).
    pub fn reading_m(&self, point: usize) -> [f64; 3] {
        self.points[point].1
    }

    /// A point in words: `point 3 of 12 of line A`.
    pub fn words(&self, point: usize) -> String {
        let line = self.line(point);
        format!("point {} of {} of line {}", point - line.points.start + 1, line.points.len(), line.name)
    }

    /// Number of the station of this name.
    pub fn station(&self, name: &str) -> Option<usize> {
        self.stations.iter().position(|station| station.name == name)
    }

    /// Which point the machine stands at. `last` is the point it stood at before.
    pub fn at(
        &self,
        (station, offset_m): (usize, &[f64; 3]),
        reading_m: &[f64; 3],
        is_taken: impl Fn(usize) -> bool,
        last: Option<usize>,
    ) -> Place {
        let of_station = |point: &usize| self.line(*point).station == station;
        let of_offset = |point: &usize| is_same(&self.line(*point).offset_m, offset_m, SAME_OFFSET_M);
        let away_m = |point: usize| distance_m(&self.points[point].1, reading_m);
        let all = || (0..self.points.len()).filter(of_station);
        let here: Vec<usize> = all().filter(of_offset).filter(|point| away_m(*point) <= self.within_m).collect();
        let follows = |point: &&usize| {
            last.is_some_and(|last| self.points[last].0 == self.points[**point].0 && last.abs_diff(**point) <= NEXT)
        };
        let open = |point: &&usize| !is_taken(**point);
        let later = |point: &&usize| open(point) && last.is_none_or(|last| **point >= last);
        let found = here.iter().find(follows).or_else(|| here.iter().find(later));
        if let Some(point) = found.or_else(|| here.iter().find(open)).or_else(|| here.first()) {
            return Place::At(*point);
        }
        if let Some(point) = all().find(|point| away_m(*point) <= self.within_m) {
            return Place::OtherOffset(point);
        }
        let nearest = all().filter(of_offset).min_by(|a, b| away_m(*a).total_cmp(&away_m(*b)));
        nearest.map_or(Place::Nowhere, |point| Place::Near(point, away_m(point)))
    }

    /// How near the machine must be to a point (m).
    pub fn within_m(&self) -> f64 {
        self.within_m
    }

    fn check_strokes(&self, machine: &Machine) -> Result<(), String> {
        for (point, (_, at_m)) in self.points.iter().enumerate() {
            for (d, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
                let (low_m, high_m) = machine.stroke_m[d];
                if !(low_m - SAME_M..=high_m + SAME_M).contains(&at_m[d]) {
                    return Err(format!(
                        "{} lies at {axis} = {:.3} mm, outside of the stroke of machine {} ({:.3} to {:.3} mm); it is of another \
                         machine: plan with the machine file of this one",
                        self.words(point),
                        at_m[d] * 1e3,
                        machine.name,
                        low_m * 1e3,
                        high_m * 1e3
                    ));
                }
            }
        }
        Ok(())
    }

    /// Two points that a machine could stand at together are the same place, or cannot be told apart.
    fn check_distances(&self) -> Result<(), String> {
        for set_up in &self.set_ups {
            let all: Vec<usize> = set_up.points.clone().collect();
            for (k, first) in all.iter().enumerate() {
                for second in &all[k + 1..] {
                    let away_m = distance_m(&self.points[*first].1, &self.points[*second].1);
                    if away_m > SAME_M && away_m < 2.0 * self.within_m {
                        return Err(format!(
                            "{} and {} are {:.3} mm apart, too near to be told apart within {:.3} mm; set points.within_mm to less \
                             than {:.3}",
                            self.words(*first),
                            self.words(*second),
                            away_m * 1e3,
                            self.within_m * 1e3,
                            away_m * 0.5e3
                        ));
                    }
                }
            }
        }
        Ok(())
    }
}

/// Distance of two readings (m).
pub(super) fn distance_m(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|d| (a[d] - b[d]).powi(2)).sum::<f64>().sqrt()
}

fn is_same(a: &[f64; 3], b: &[f64; 3], within_m: f64) -> bool {
    (0..3).all(|d| (a[d] - b[d]).abs() <= within_m)
}
