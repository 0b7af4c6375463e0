//! A tracer plan: stations one after the other, each with lines of points, delivered point by point.
//!
//! Place in the flow: [`recipe`] and [`presets`] make a [`Plan`], [`crate::simulate`] drives the machine along
//! its [`Target`]s. Positions in m in the machine frame, times in s since the campaign began. Only the lines
//! are held in memory, never the points, so that a plan of a million readings stays small.

pub mod presets;
pub mod recipe;
mod targets;

use crate::error::{SimulationError, require_finite, require_not_negative, require_positive};
pub use recipe::{LineKind, LineSelection, PlanRecipe};
pub use targets::{Target, Targets};

/// Points measured in one go on a straight path.
#[derive(Debug, Clone, PartialEq)]
pub struct LinePlan {
    /// Name, unique in the plan.
    pub name: String,
    /// Axis readings at the first point (m).
    pub from_m: [f64; 3],
    /// Axis readings at the last point (m).
    pub to_m: [f64; 3],
    /// Number of points, at least 1.
    pub points: u32,
    /// Moves each inner point by up to this fraction of half a step, in [0, 1); 0 spaces them evenly.
    pub jitter: f64,
    /// Reflector relative to the ram reference point (m, ram frame).
    pub offset_m: [f64; 3],
    /// Feed before each stop (m/s).
    pub feed_m_s: f64,
    /// Last acceleration before each stop along the move (m/s²).
    pub acceleration_m_s2: f64,
    /// Load on the table (kg).
    pub load_kg: f64,
    /// Wait before the first point, for clamping the reflector and the like (s).
    pub pause_s: f64,
}

/// One tracer station and the lines measured from it.
#[derive(Debug, Clone, PartialEq)]
pub struct StationPlan {
    /// Name, unique in the plan.
    pub name: String,
    /// Centre of the tracer's reference sphere (m, machine frame: the workpiece side).
    pub position_m: [f64; 3],
    /// Path in the instrument that no counter sees and the air acts on (m).
    pub dead_path_m: f64,
    /// Lines in the order in which they are measured.
    pub lines: Vec<LinePlan>,
}

/// A campaign as planned.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Seed of the jittered points.
    pub seed: u64,
    /// Axis readings before the first move (m).
    pub home_m: [f64; 3],
    /// Standstill at each point (s).
    pub dwell_s: f64,
    /// Time to move the tracer to the next station (s).
    pub station_change_s: f64,
    /// Stations in the order in which they are used.
    pub stations: Vec<StationPlan>,
}

impl Plan {
    /// Number of readings in the whole plan.
    pub fn readings(&self) -> u64 {
        let lines = self.stations.iter().flat_map(|s| &s.lines);
        lines.map(|line| u64::from(line.points)).sum()
    }

    /// Mean offset of all readings (m, ram frame): a [`crate::machine::RamTurn`] about it leaves the frame where
    /// identification puts it.
    pub fn mean_offset_m(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for line in self.stations.iter().flat_map(|station| &station.lines) {
            for d in 0..3 {
                sum[d] += f64::from(line.points) * line.offset_m[d];
            }
        }
        let readings = self.readings().max(1) as f64;
        sum.map(|total| total / readings)
    }

    /// The points in the order in which they are measured, made one by one.
    pub fn targets(&self) -> Targets<'_> {
        Targets::new(self)
    }

    /// The same plan driven so often that it has at least `readings`, every second pass backwards.
    ///
    /// # Errors
    /// The plan has no reading to repeat.
    pub fn repeated_to(&self, readings: u64) -> Result<Self, SimulationError> {
        let once = self.readings();
        if once == 0 {
            return Err(SimulationError::new("plan.stations", "no reading to repeat", "add lines with points"));
        }
        let passes = readings.div_ceil(once).max(1);
        let mut out = self.clone();
        for (station, source) in out.stations.iter_mut().zip(&self.stations) {
            for pass in 1..passes {
                let copies = source.lines.iter().map(|line| repeated(line, pass));
                station.lines.extend(copies);
            }
        }
        Ok(out)
    }

    /// Refuses a plan that cannot be driven within the strokes (m).
    ///
    /// # Errors
    /// Names the key of the first setting that makes no sense.
    pub fn check(&self, stroke_m: &[[f64; 2]; 3]) -> Result<(), SimulationError> {
        self.check_values(stroke_m).map_err(|e| e.under("plan"))
    }

    fn check_values(&self, stroke_m: &[[f64; 2]; 3]) -> Result<(), SimulationError> {
        require_not_negative("dwell_s", self.dwell_s)?;
        require_not_negative("station_change_s", self.station_change_s)?;
        require_finite("home_m", &self.home_m)?;
        if self.stations.is_empty() {
            return Err(SimulationError::new("stations", "none", "add at least one station"));
        }
        let mut names = std::collections::BTreeSet::new();
        for (place, station) in self.stations.iter().enumerate() {
            let key = format!("stations[{place}]");
            require_unique(&mut names, &station.name).map_err(|e| e.under(&key))?;
            station.check(stroke_m).map_err(|e| e.under(&key))?;
        }
        names.clear();
        for (place, station) in self.stations.iter().enumerate() {
            for (row, line) in station.lines.iter().enumerate() {
                require_unique(&mut names, &line.name)
                    .map_err(|e| e.under(&format!("stations[{place}].lines[{row}]")))?;
            }
        }
        Ok(())
    }
}

impl StationPlan {
    fn check(&self, stroke_m: &[[f64; 2]; 3]) -> Result<(), SimulationError> {
        require_finite("position_m", &self.position_m)?;
        require_not_negative("dead_path_m", self.dead_path_m)?;
        if self.lines.is_empty() {
            return Err(SimulationError::new("lines", "none", "add a line or drop the station"));
        }
        for (place, line) in self.lines.iter().enumerate() {
            line.check(stroke_m).map_err(|e| e.under(&format!("lines[{place}]")))?;
        }
        Ok(())
    }
}

impl LinePlan {
    fn check(&self, stroke_m: &[[f64; 2]; 3]) -> Result<(), SimulationError> {
        for (key, end) in [("from_m", &self.from_m), ("to_m", &self.to_m)] {
            require_finite(key, end)?;
            for axis in 0..3 {
                let [low, high] = stroke_m[axis];
                if !(low..=high).contains(&end[axis]) {
                    return Err(SimulationError::new(
                        key,
                        format!("{:?} is outside the stroke [{low}, {high}]", end),
                        "keep both ends of the line within the machine's stroke_m",
                    ));
                }
            }
        }
        require_finite("offset_m", &self.offset_m)?;
        require_positive("feed_m_s", self.feed_m_s)?;
        require_not_negative("acceleration_m_s2", self.acceleration_m_s2)?;
        require_not_negative("load_kg", self.load_kg)?;
        require_not_negative("pause_s", self.pause_s)?;
        if self.points == 0 {
            return Err(SimulationError::new("points", "0", "give at least 1"));
        }
        if !(0.0..1.0).contains(&self.jitter) {
            return Err(SimulationError::new(
                "jitter",
                format!("{} is not in [0, 1)", self.jitter),
                "give 0 for even points, 0.8 for uneven ones",
            ));
        }
        Ok(())
    }
}

fn require_unique(seen: &mut std::collections::BTreeSet<String>, name: &str) -> Result<(), SimulationError> {
    if name.is_empty() || !seen.insert(name.to_owned()) {
        return Err(SimulationError::new(
            "name",
            format!("{name:?} is empty or already taken"),
            "give every station and every line its own name",
        ));
    }
    Ok(())
}

/// The line as driven in pass `pass`: odd passes backwards, under a name of their own.
fn repeated(line: &LinePlan, pass: u64) -> LinePlan {
    let mut copy = line.clone();
    copy.name = format!("{}-p{pass}", line.name);
    if pass % 2 == 1 {
        (copy.from_m, copy.to_m) = (line.to_m, line.from_m);
    }
    copy
}
