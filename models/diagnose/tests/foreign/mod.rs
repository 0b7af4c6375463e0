//! Campaigns of foreign machines: a second simulator that shares nothing with `models/`, and has causes that no list has.
//!
//! Place in the flow: judges the diagnosis. A tracer at several places follows a reflector in several holders along lines in
//! random order; all that is logged is noisy, and may have holes. Verification points are measured two hours later, within the
//! usual temperatures and loads, and beyond them. SI; plain arrays only.

#![allow(dead_code)] // each user takes its part

pub(crate) mod bench;
pub(crate) mod causes;
pub(crate) mod machine;
pub(crate) mod random;
pub(crate) mod score;
pub(crate) mod surroundings;
pub(crate) mod vector;

use causes::{Cause, Moment};
use machine::{Build, Slides};
use random::Random;
use surroundings::{Air, COLUMNS};
use vector::{Vector, add, length, minus, times};

/// Scatter of the tip along each axis (m).
pub(crate) const REPEATABILITY_M: f64 = 0.25e-6;
/// Standard uncertainty of a range: constant (m) and per metre.
pub(crate) const RANGE: (f64, f64) = (0.025e-6, 0.15e-6);
const POINTS_IN_LINE: usize = 11;
const VERIFIED: usize = 250;

/// One reading of the tracer.
pub(crate) struct Reading {
    pub(crate) station: usize,
    pub(crate) line: usize,
    pub(crate) time_s: f64,
    pub(crate) reading_m: Vector,
    pub(crate) offset_m: Vector,
    pub(crate) length_m: f64,
    pub(crate) logged: Vec<Option<f64>>,
}

/// A point whose actual place is known.
pub(crate) struct Verified {
    pub(crate) time_s: f64,
    pub(crate) reading_m: Vector,
    pub(crate) offset_m: Vector,
    pub(crate) logged: Vec<f64>,
    pub(crate) actual_m: Vector,
}

/// A campaign and its verification.
pub(crate) struct Foreign {
    pub(crate) build: Build,
    pub(crate) stroke_m: [(f64, f64); 3],
    pub(crate) stations: usize,
    pub(crate) lines: usize,
    pub(crate) readings: Vec<Reading>,
    pub(crate) inside: Vec<Verified>,
    pub(crate) beyond: Vec<Verified>,
}

/// Machine, tracer and surroundings while they are measured.
struct Workshop {
    stroke_m: [(f64, f64); 3],
    slides: Slides,
    air: Air,
    causes: Vec<Cause>,
    holders_m: Vec<Vector>,
    /// The reflector's holders are on; later a calibrated probe is.
    has_holders: bool,
    /// By how much the clock of the log is behind (s): what it logs as of now was measured so much later.
    log_s: f64,
    random: Random,
}

/// What happened at one stop.
struct Stop {
    time_s: f64,
    reading_m: Vector,
    offset_m: Vector,
    actual_m: Vector,
    logged: Vec<f64>,
}

impl Workshop {
    /// Goes to a place and stops there.
    fn stop(
        &mut self,
        time_s: f64,
        reading_m: Vector,
        last_m: Vector,
        holder: usize,
        (load_kg, more): (f64, f64),
    ) -> Stop {
        let approach: Vector = std::array::from_fn(|d| {
            let step = reading_m[d] - last_m[d];
            if step.abs() < 1e-9 { 0.0 } else { step.signum() }
        });
        let share: Vector = std::array::from_fn(|d| {
            let (low, high) = self.stroke_m[d];
            (reading_m[d] - low) / (high - low)
        });
        let offset_m = self.holders_m[holder];
        let wrong = self.causes.iter().filter(|_| self.has_holders).map(|cause| cause.holder_m(holder));
        let moved_m = wrong.fold(offset_m, add);
        let point_m = self.slides.tip_m(reading_m, moved_m);
        let air = &self.air;
        let moment = Moment { time_s, reading_m, share, point_m, approach, load_kg, air, more };
        let motions: Vec<Vector> = self.causes.iter_mut().map(|cause| cause.tip_m(&moment)).collect();
        let scatter: Vector = std::array::from_fn(|_| REPEATABILITY_M * self.random.normal());
        let actual_m = motions.into_iter().fold(add(point_m, scatter), add);
        let speed = [20.0, 60.0, 100.0][(self.random.share() * 3.0) as usize];
        let hurry: Vector = std::array::from_fn(|d| -approach[d] * self.random.between(200.0, 700.0));
        let log_s = time_s + self.log_s;
        let temperatures = self.air.logged(log_s, more, &mut self.random);
        let weather = [1010.0 + 3.0 * (log_s / 9000.0).sin(), 47.0 + 4.0 * (log_s / 6100.0).cos()];
        let mut logged = vec![approach[0], approach[1], approach[2], speed, hurry[0], hurry[1], hurry[2], load_kg];
        logged.extend(temperatures.iter().chain(&weather));
        Stop { time_s, reading_m, offset_m, actual_m, logged }
    }

    fn anywhere(&mut self) -> Vector {
        std::array::from_fn(|d| self.random.between(self.stroke_m[d].0, self.stroke_m[d].1))
    }

    /// Ends of a line: along an axis, across a face, or through the volume.
    fn line(&mut self, number: usize) -> (Vector, Vector) {
        let (mut from, mut to) = (self.anywhere(), self.anywhere());
        let free: &[usize] = match number % 8 {
            0 | 3 => &[0],
            1 | 4 => &[1],
            2 | 5 => &[2],
            6 => &[0, 1, 2],
            _ => [&[0, 1][..], &[1, 2], &[0, 2]][(number / 8) % 3],
        };
        for d in 0..3 {
            let (low, high) = self.stroke_m[d];
            if free.contains(&d) {
                (from[d], to[d]) = if self.random.share() < 0.5 { (low, high) } else { (high, low) };
            } else {
                to[d] = from[d];
            }
        }
        (from, to)
    }
}

/// Strokes (m) and build by name.
fn built(name: &str) -> (Build, [(f64, f64); 3]) {
    match name {
        "gantry" => (Build::Bridge, [(0.0, 1.6), (-0.5, 0.5), (-0.7, 0.0)]),
        "table" => (Build::Table, [(0.0, 0.5), (0.0, 0.45), (-0.4, 0.0)]),
        _ => (Build::Bridge, [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)]),
    }
}

/// A campaign of a machine (`bridge`, `gantry`, `table`) that suffers from these causes.
pub(crate) fn foreign(machine: &str, forms: &[&str], seed: u64) -> Foreign {
    let (build, stroke_m) = built(machine);
    let mut random = Random::new(seed, 1);
    let slides = Slides::new(build, stroke_m, &mut random);
    let air = Air::new(0.02, &mut random);
    let causes = forms.iter().zip(10..).map(|(form, k)| Cause::new(form, Random::new(seed, k))).collect();
    let log_s = forms.iter().find_map(|form| form.strip_prefix("clock:")).map_or(0.0, |s| s.parse().unwrap());
    let holders_m = vec![[0.0, 0.0, -0.06], [0.09, 0.03, -0.06], [-0.04, 0.07, -0.13]];
    let mut shop =
        Workshop { stroke_m, slides, air, causes, holders_m, has_holders: true, log_s, random: Random::new(seed, 2) };
    let places = [[-0.25, -0.3, -0.2], [1.2, -0.2, -0.3], [1.25, 1.3, -0.25], [-0.2, 1.2, -0.3], [0.5, -0.4, 1.3]];
    let mut out = Foreign {
        build,
        stroke_m,
        stations: places.len(),
        lines: 0,
        readings: Vec::new(),
        inside: Vec::new(),
        beyond: Vec::new(),
    };
    let mut time_s = 0.0;
    for (station, place) in places.iter().enumerate() {
        let at_m = std::array::from_fn(|d| stroke_m[d].0 + place[d] * (stroke_m[d].1 - stroke_m[d].0));
        time_s = measure(&mut shop, &mut out, (station, at_m), time_s + 600.0);
    }
    shop.has_holders = false;
    out.inside = verify(&mut shop, time_s + 7200.0, 0.0);
    out.beyond = verify(&mut shop, time_s + 14_400.0, 1.5);
    out
}

/// Lines of one station; the time at the end (s).
fn measure(shop: &mut Workshop, out: &mut Foreign, (station, at_m): (usize, Vector), mut time_s: f64) -> f64 {
    let (mut zero_m, mut last_m) = (None, [0.0; 3]);
    for number in shop.random.order(32) {
        let (from, to) = shop.line(number);
        let holder = (shop.random.share() * shop.holders_m.len() as f64) as usize;
        let load_kg = [0.0, 10.0, 25.0, 40.0][(shop.random.share() * 4.0) as usize];
        time_s += 20.0;
        for k in 0..POINTS_IN_LINE {
            let bend = 0.02 * (k as f64).sin();
            let along = (k as f64 / (POINTS_IN_LINE - 1) as f64 + bend).clamp(0.0, 1.0);
            let reading_m = add(from, times(minus(to, from), along));
            time_s += shop.random.between(4.0, 7.0);
            let stop = shop.stop(time_s, reading_m, last_m, holder, (load_kg, 0.0));
            last_m = reading_m;
            let to_m = minus(stop.actual_m, at_m);
            let range_m = length(to_m);
            let sight = times(to_m, 1.0 / range_m);
            let instrument: f64 = shop.causes.iter_mut().map(|cause| cause.range_m(time_s, station, sight)).sum();
            let noise = (RANGE.0 + RANGE.1 * range_m) * shop.random.normal();
            let length_m = range_m + instrument + noise;
            let zero_m = *zero_m.get_or_insert(length_m);
            let holes: f64 = shop.causes.iter().map(Cause::holes).sum();
            let cell = |(name, value): (&&str, &f64)| {
                let empty = name.starts_with("temp_scale") && shop.random.share() < holes;
                (!empty).then_some(*value)
            };
            let logged = COLUMNS.iter().zip(&stop.logged).map(cell).collect();
            let length_m = length_m - zero_m;
            let Stop { time_s, reading_m, offset_m, .. } = stop;
            out.readings.push(Reading { station, line: out.lines, time_s, reading_m, offset_m, length_m, logged });
        }
        out.lines += 1;
    }
    time_s
}

/// Random points from some time on, in surroundings warmer and loads heavier by so much.
fn verify(shop: &mut Workshop, start_s: f64, more: f64) -> Vec<Verified> {
    let mut last_m = [0.0; 3];
    let one = |k: usize| {
        let reading_m = shop.anywhere();
        let holder = (shop.random.share() * shop.holders_m.len() as f64) as usize;
        let load_kg = [0.0, 10.0, 25.0, 40.0][(shop.random.share() * 4.0) as usize] + 15.0 * more;
        let stop = shop.stop(start_s + 20.0 * k as f64, reading_m, last_m, holder, (load_kg, more));
        last_m = reading_m;
        let Stop { time_s, reading_m, offset_m, actual_m, logged } = stop;
        Verified { time_s, reading_m, offset_m, logged, actual_m }
    };
    (0..VERIFIED).map(one).collect()
}
