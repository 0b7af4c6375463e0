//! The generic plan builder: which kinds of lines, where, with which reflector offsets, how many points.
//!
//! Place in the flow: [`super::presets`] fill in a [`PlanRecipe`]; [`PlanRecipe::build`] makes the [`Plan`].
//! Lengths in m in the machine frame.

use rand::Rng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::{LinePlan, Plan, StationPlan};
use crate::error::{SimulationError, require_finite};
use crate::random::{Purpose, pick, stream, uniform};

/// A family of lines through the measured box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineKind {
    /// Parallel to X, at the grid of the other two axes.
    AlongX,
    /// Parallel to Y, at the grid of the other two axes.
    AlongY,
    /// Parallel to Z, at the grid of the other two axes.
    AlongZ,
    /// The four body diagonals.
    BodyDiagonal,
    /// The twelve diagonals of the six faces.
    FaceDiagonal,
}

/// Which lines of the families a station measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineSelection {
    /// Every line once in the order of the families.
    Every,
    /// Every line once in random order.
    EveryShuffled,
    /// That many lines drawn at random (a family first, then a line of it), with repetition.
    Drawn(u32),
}

/// What a plan is made from.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanRecipe {
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Measured box: lower and upper reading of X, Y, Z (m).
    pub box_m: [[f64; 2]; 3],
    /// Grid lines per axis at which lines along another axis lie; at least 1 (the lower side).
    pub levels: [u32; 3],
    /// Tracer stations (m, machine frame).
    pub stations_m: Vec<[f64; 3]>,
    /// Dead path of every station (m).
    pub dead_path_m: f64,
    /// Families of lines.
    pub kinds: Vec<LineKind>,
    /// Which of their lines are measured.
    pub selection: LineSelection,
    /// With `Every…`: each line is driven there and back. With `Drawn`: the direction is drawn.
    pub both_directions: bool,
    /// Reflector offsets (m, ram frame), taken in turn from line to line.
    pub offsets_m: Vec<[f64; 3]>,
    /// Fewest and most points a line.
    pub points: [u32; 2],
    /// Jitter of the inner points, see [`LinePlan::jitter`].
    pub jitter: f64,
    /// Feeds to draw from (m/s).
    pub feeds_m_s: Vec<f64>,
    /// Range of the acceleration before a stop (m/s²).
    pub acceleration_m_s2: [f64; 2],
    /// Table loads to draw from (kg).
    pub loads_kg: Vec<f64>,
    /// Draws a load for every line; otherwise one serves a whole station, and whatever it does to all points of the
    /// station alike cannot be told from the station's place.
    pub load_by_line: bool,
    /// Range of the pause before a line (s).
    pub pause_s: [f64; 2],
    /// Ends each station with its very first point again and one near it, to see drift.
    pub close_station: bool,
}

impl PlanRecipe {
    /// Makes the plan.
    ///
    /// # Errors
    /// Names the key of the recipe that makes no sense.
    pub fn build(&self) -> Result<Plan, SimulationError> {
        self.check().map_err(|e| e.under("recipe"))?;
        let mut generator = stream(self.seed, Purpose::Plan);
        let mut stations = Vec::new();
        for (place, position_m) in self.stations_m.iter().enumerate() {
            let name = format!("S{}", place + 1);
            let lines = self.lines(&name, &mut generator)?;
            stations.push(StationPlan { name, position_m: *position_m, dead_path_m: self.dead_path_m, lines });
        }
        Ok(Plan {
            seed: self.seed,
            home_m: self.box_m.map(|[low, _]| low),
            dwell_s: 3.0,
            station_change_s: 900.0,
            stations,
        })
    }

    fn check(&self) -> Result<(), SimulationError> {
        let empty = |key: &str| SimulationError::new(key, "empty list", "give at least one entry");
        for (key, length) in [
            ("stations_m", self.stations_m.len()),
            ("kinds", self.kinds.len()),
            ("offsets_m", self.offsets_m.len()),
            ("feeds_m_s", self.feeds_m_s.len()),
            ("loads_kg", self.loads_kg.len()),
        ] {
            if length == 0 {
                return Err(empty(key));
            }
        }
        if self.levels.contains(&0) || self.points[0] == 0 {
            return Err(SimulationError::new("levels, points", "0", "give 1 or more"));
        }
        let points = self.points.map(f64::from);
        for (key, [low, high]) in [
            ("box_m.X", self.box_m[0]),
            ("box_m.Y", self.box_m[1]),
            ("box_m.Z", self.box_m[2]),
            ("points", points),
            ("acceleration_m_s2", self.acceleration_m_s2),
            ("pause_s", self.pause_s),
        ] {
            require_finite(key, &[low, high])?;
            if low > high {
                return Err(SimulationError::new(key, format!("{low} is above {high}"), "give [lower, upper]"));
            }
        }
        Ok(())
    }

    fn lines(&self, station: &str, generator: &mut ChaCha8Rng) -> Result<Vec<LinePlan>, SimulationError> {
        let paths = self.paths(generator);
        let station_load_kg = pick(generator, &self.loads_kg).copied();
        let mut lines = Vec::new();
        for (place, [from_m, to_m]) in paths.into_iter().enumerate() {
            let feed_m_s = pick(generator, &self.feeds_m_s).copied();
            let offset_m = self.offsets_m.get(place % self.offsets_m.len()).copied();
            let load_kg = if self.load_by_line { pick(generator, &self.loads_kg).copied() } else { station_load_kg };
            // `check` refused empty lists; a missing entry is still an error here, not a default.
            let (Some(feed_m_s), Some(offset_m), Some(load_kg)) = (feed_m_s, offset_m, load_kg) else {
                return Err(SimulationError::new(
                    "recipe.feeds_m_s, offsets_m, loads_kg",
                    "empty list",
                    "give at least one entry",
                ));
            };
            let [low, high] = self.acceleration_m_s2;
            lines.push(LinePlan {
                name: format!("{station}-{place:02}"),
                from_m,
                to_m,
                points: generator.random_range(self.points[0]..=self.points[1]),
                jitter: self.jitter,
                offset_m,
                feed_m_s,
                acceleration_m_s2: uniform(generator, low, high),
                load_kg,
                pause_s: uniform(generator, self.pause_s[0], self.pause_s[1]),
            });
        }
        if self.close_station
            && let Some(first) = lines.first()
        {
            let closing = closing_line(first, format!("{station}-{:02}", lines.len()));
            lines.push(closing);
        }
        Ok(lines)
    }

    fn paths(&self, generator: &mut ChaCha8Rng) -> Vec<[[f64; 3]; 2]> {
        let families: Vec<_> = self.kinds.iter().map(|kind| self.family(*kind)).collect();
        if let LineSelection::Drawn(count) = self.selection {
            let mut paths = Vec::new();
            for _ in 0..count {
                let family = pick(generator, &families).map(Vec::as_slice);
                let Some(path) = pick(generator, family.unwrap_or_default()).copied() else {
                    continue;
                };
                let backwards = self.both_directions && generator.random::<bool>();
                paths.push(if backwards { [path[1], path[0]] } else { path });
            }
            return paths;
        }
        let mut paths = Vec::new();
        for path in families.into_iter().flatten() {
            paths.push(path);
            if self.both_directions {
                paths.push([path[1], path[0]]);
            }
        }
        if self.selection == LineSelection::EveryShuffled {
            paths.shuffle(generator);
        }
        paths
    }

    fn family(&self, kind: LineKind) -> Vec<[[f64; 3]; 2]> {
        match kind {
            LineKind::AlongX => self.parallels(0),
            LineKind::AlongY => self.parallels(1),
            LineKind::AlongZ => self.parallels(2),
            LineKind::BodyDiagonal => [[0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1]]
                .map(|ends| [self.corner(ends), self.corner(ends.map(|e| 1 - e))])
                .to_vec(),
            LineKind::FaceDiagonal => self.face_diagonals(),
        }
    }

    fn parallels(&self, along: usize) -> Vec<[[f64; 3]; 2]> {
        let (across, other) = ((along + 1) % 3, (along + 2) % 3);
        let mut paths = Vec::new();
        for i in 0..self.levels[across] {
            for j in 0..self.levels[other] {
                let mut from = self.corner([0; 3]);
                from[across] = self.level(across, i);
                from[other] = self.level(other, j);
                let mut to = from;
                to[along] = self.box_m[along][1];
                paths.push([from, to]);
            }
        }
        paths
    }

    fn face_diagonals(&self) -> Vec<[[f64; 3]; 2]> {
        let mut paths = Vec::new();
        for normal in 0..3 {
            for side in [0, 1] {
                for rising in [0, 1] {
                    let mut ends = [0; 3];
                    ends[normal] = side;
                    ends[(normal + 2) % 3] = rising;
                    let mut far = ends.map(|e| 1 - e);
                    far[normal] = side;
                    paths.push([self.corner(ends), self.corner(far)]);
                }
            }
        }
        paths
    }

    fn level(&self, axis: usize, step: u32) -> f64 {
        let [low, high] = self.box_m[axis];
        let last = self.levels[axis] - 1;
        if step == 0 {
            low
        } else if step == last {
            high
        } else {
            low + (high - low) * f64::from(step) / f64::from(last)
        }
    }

    fn corner(&self, ends: [usize; 3]) -> [f64; 3] {
        [self.box_m[0][ends[0]], self.box_m[1][ends[1]], self.box_m[2][ends[2]]]
    }
}

/// The first point of a line and one a sixth of the way along, under a new name.
fn closing_line(first: &LinePlan, name: String) -> LinePlan {
    let mut closing = first.clone();
    closing.name = name;
    closing.points = 2;
    for axis in 0..3 {
        closing.to_m[axis] = first.from_m[axis] + (first.to_m[axis] - first.from_m[axis]) / 6.0;
    }
    closing
}
