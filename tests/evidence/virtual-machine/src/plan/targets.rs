//! The points of a plan one by one: where the axes go, when they stand still and how they got there.
//!
//! Place in the flow: [`super::Plan::targets`] makes the iterator, [`crate::simulate`] consumes it.

use rand_chacha::ChaCha8Rng;

use super::{LinePlan, Plan};
use crate::random::{Purpose, stream, uniform};

/// One planned standstill.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Index of the station.
    pub station: u32,
    /// Index of the line, counted through the whole plan.
    pub line: u32,
    /// True at the station's first point, from which lengths count.
    pub first_of_station: bool,
    /// Time of latching (s since the campaign began).
    pub time_s: f64,
    /// Axis readings (m).
    pub reading_m: [f64; 3],
    /// Reflector offset (m, ram frame).
    pub offset_m: [f64; 3],
    /// Sign of the last move of each axis: −1, 0 or 1.
    pub direction: [f64; 3],
    /// Feed of the last move (m/s).
    pub feed_m_s: f64,
    /// Last acceleration of each axis (m/s²).
    pub acceleration_m_s2: [f64; 3],
    /// Load on the table (kg).
    pub load_kg: f64,
}

/// Iterator over the [`Target`]s of a plan; see [`Plan::targets`].
#[derive(Debug, Clone)]
pub struct Targets<'a> {
    plan: &'a Plan,
    spacing: ChaCha8Rng,
    station: usize,
    line_in_station: usize,
    line_in_plan: u32,
    point: u32,
    at_m: [f64; 3],
    direction: [f64; 3],
    time_s: f64,
}

impl<'a> Targets<'a> {
    pub(super) fn new(plan: &'a Plan) -> Self {
        Self {
            plan,
            spacing: stream(plan.seed, Purpose::Spacing),
            station: 0,
            line_in_station: 0,
            line_in_plan: 0,
            point: 0,
            at_m: plan.home_m,
            direction: [0.0; 3],
            time_s: 0.0,
        }
    }

    /// Moves on to the line that holds the next point; `None` at the plan's end.
    fn current_line(&mut self) -> Option<&'a LinePlan> {
        loop {
            let station = self.plan.stations.get(self.station)?;
            match station.lines.get(self.line_in_station) {
                Some(line) if self.point < line.points => return Some(line),
                Some(_) => {
                    self.line_in_station += 1;
                    self.line_in_plan += 1;
                    self.point = 0;
                }
                None => {
                    self.station += 1;
                    self.line_in_station = 0;
                    self.time_s += self.plan.station_change_s;
                }
            }
        }
    }

    /// Axis readings at a point of a line; inner points may be jittered, the ends never.
    fn place_m(&mut self, line: &LinePlan) -> [f64; 3] {
        let steps = line.points.saturating_sub(1);
        // The ends are taken as given, not computed, so that a closing point equals its opening one to the bit.
        if self.point == 0 {
            return line.from_m;
        }
        if self.point == steps {
            return line.to_m;
        }
        let shift = if line.jitter > 0.0 { uniform(&mut self.spacing, -0.5, 0.5) * line.jitter } else { 0.0 };
        let fraction = (f64::from(self.point) + shift) / f64::from(steps);
        let mut out = line.from_m;
        for axis in 0..3 {
            out[axis] += fraction * (line.to_m[axis] - line.from_m[axis]);
        }
        out
    }
}

impl Iterator for Targets<'_> {
    type Item = Target;

    fn next(&mut self) -> Option<Target> {
        let line = self.current_line()?;
        let reading_m = self.place_m(line);
        let mut moved = [0.0; 3];
        for axis in 0..3 {
            moved[axis] = reading_m[axis] - self.at_m[axis];
        }
        let distance_m = moved.iter().map(|v| v * v).sum::<f64>().sqrt();
        let mut acceleration_m_s2 = [0.0; 3];
        if distance_m > 0.0 {
            // A standstill keeps the direction of the last real move: that is the side the axis leans on.
            self.direction = moved.map(|v| if v == 0.0 { 0.0 } else { v.signum() });
            acceleration_m_s2 = moved.map(|v| line.acceleration_m_s2 * v / distance_m);
        }
        if self.point == 0 {
            self.time_s += line.pause_s;
        }
        self.time_s += distance_m / line.feed_m_s + self.plan.dwell_s;
        let first_of_station = self.point == 0 && self.line_in_station == 0;
        self.point += 1;
        self.at_m = reading_m;
        Some(Target {
            station: u32::try_from(self.station).ok()?,
            line: self.line_in_plan,
            first_of_station,
            time_s: self.time_s,
            reading_m,
            offset_m: line.offset_m,
            direction: self.direction,
            feed_m_s: line.feed_m_s,
            acceleration_m_s2,
            load_kg: line.load_kg,
        })
    }
}
