//! Causes that a foreign machine may suffer from, each written down without regard to what any program has in its list.
//!
//! A cause moves the tip (m, machine frame) or the range (m). What remembers (friction, random walks, noise) keeps a state and
//! is asked in the order of measurement.

use super::random::Random;
use super::surroundings::Air;
use super::vector::{Vector, add, cross, dot, minus, times};
use std::f64::consts::{PI, TAU};

/// Everything that a cause may depend on.
pub(crate) struct Moment<'a> {
    pub(crate) time_s: f64,
    pub(crate) reading_m: Vector,
    /// Share of each stroke.
    pub(crate) share: Vector,
    pub(crate) point_m: Vector,
    pub(crate) approach: Vector,
    pub(crate) load_kg: f64,
    pub(crate) air: &'a Air,
    /// Kelvin above the usual.
    pub(crate) more: f64,
}

/// When a step happens (s): in the middle of a station's lines, past the middle of the campaign.
pub(crate) const STEPS_AT_S: f64 = 9100.0;

/// What a form does, with figures drawn from the seed.
pub(crate) struct Cause {
    form: String,
    a: Vec<f64>,
    /// Positions that friction holds, and the last reading of each axis.
    memory: Vec<f64>,
    walk: Vector,
    last_s: f64,
    random: Random,
}

impl Cause {
    pub(crate) fn new(form: &str, mut random: Random) -> Cause {
        let a = (0..12).map(|_| random.share()).collect();
        Cause { form: form.to_owned(), a, memory: vec![0.0; 8], walk: [0.0; 3], last_s: 0.0, random }
    }

    fn drawn(&self, k: usize, low: f64, high: f64) -> f64 {
        low + (high - low) * self.a[k]
    }

    /// A rotation of all that stands on the bed about a pivot.
    fn lever(&self, moment: &Moment, turn: Vector) -> Vector {
        let pivot = [self.drawn(8, -0.2, 0.9), self.drawn(9, -0.4, 0.8), self.drawn(10, -0.9, -0.3)];
        cross(turn, minus(moment.point_m, pivot))
    }

    /// Motion of the tip (m).
    pub(crate) fn tip_m(&mut self, m: &Moment) -> Vector {
        let [u, v, w] = m.share;
        let lagged = |lag: f64| m.air.lagged(m.time_s, lag, m.more) - 20.4;
        match self.form.as_str() {
            "lever-cycle" => {
                let phase = TAU * m.time_s / self.drawn(0, 2200.0, 5200.0) + TAU * self.a[1];
                self.lever(m, [3.0e-6 * phase.sin(), 0.0, 1.2e-6 * phase.cos()])
            }
            "saw-tilt" => {
                let along = (m.time_s / self.drawn(0, 1100.0, 2600.0) + self.a[1]).fract();
                let saw = if along < 0.3 { along / 0.3 } else { (1.0 - along) / 0.7 } - 0.5;
                add(self.lever(m, [0.0, 5.0e-6 * saw, 2.0e-6 * saw]), [1.0e-6 * saw, 0.0, 0.0])
            }
            "bend-lag" => {
                let k = lagged(self.drawn(0, 2500.0, 6000.0));
                let arch = 4.0 * v * (1.0 - v);
                [1.5e-6 * k * w * (1.0 - 2.0 * v), 0.0, 4.5e-6 * k * arch]
            }
            "torsion-lag" => {
                let k = lagged(self.drawn(0, 900.0, 2500.0)) - lagged(7000.0);
                let turn = [9.0e-6 * k * (u - 0.3), 0.0, 0.0];
                cross(turn, [0.0, m.point_m[1] - 0.3, m.point_m[2] + self.drawn(1, 0.2, 0.7)])
            }
            "load-twist" => {
                let load = (m.load_kg / 10.0).max(0.0).powf(0.7);
                let turn = [0.0, 1.1e-6 * load * (1.0 + u * u), 0.9e-6 * load * (PI * u).sin()];
                cross(turn, [m.point_m[0] - 0.4, 0.0, m.point_m[2] + 0.4])
            }
            "load-leg" => {
                let load = m.load_kg / 10.0;
                [0.0, 0.9e-6 * load * w * (u - 0.5), -0.8e-6 * load * (-((v - 0.2) / 0.25).powi(2)).exp()]
            }
            "wear" => {
                let place = self.drawn(0, 0.3, 0.7);
                [0.0, 0.0, -2.5e-6 * (-0.5 * ((u - place) / 0.04).powi(2)).exp()]
            }
            "ridge" => {
                let place = self.drawn(0, 0.25, 0.75);
                [1.2e-6 * ((v - place) / 0.015).tanh(), 0.0, 0.0]
            }
            "settling" => {
                // The bed gives way between its feet, a micrometre in an hour.
                [0.0, 0.0, -1e-6 * m.time_s / 3600.0 * 4.0 * u * (1.0 - u)]
            }
            "play" => self.play(m),
            "dahl" => self.dahl(m),
            "walk" => self.walk(m),
            "reversal" => [0.0, 0.5 * 1.6e-6 * m.approach[1], 0.0],
            "reversal-z" => [0.0, 0.0, 0.5 * 1.4e-6 * m.approach[2]],
            "expansion" | "holes" => {
                let k = m.air.parts(m.time_s, m.more)[0] - 20.0;
                [9e-6 * k * m.reading_m[0], 0.0, 0.0]
            }
            "expansion-y" => {
                let k = m.air.parts(m.time_s, m.more)[1] - 20.0;
                [0.0, 10e-6 * k * (m.reading_m[1] - 0.1), 0.0]
            }
            form => match form.strip_prefix("creep:").map(|tau| tau.parse().unwrap()) {
                Some(tau_s) => self.creep(tau_s, m),
                None => step(form, m),
            },
        }
    }

    /// An arm whose root gives way for minutes after the carriage went out on it: a turn about X that follows the place of Y late.
    fn creep(&mut self, tau_s: f64, m: &Moment) -> Vector {
        let gap_s = m.time_s - self.last_s;
        self.last_s = m.time_s;
        let stood_at = self.memory[5];
        self.memory[6] += (stood_at - self.memory[6]) * (1.0 - (-gap_s / tau_s).exp());
        self.memory[5] = m.share[1];
        cross([-30e-6 * (self.memory[6] - 0.5), 0.0, 0.0], [0.0, m.reading_m[1], m.reading_m[2]])
    }

    /// Play of two widths in series along X, as Prandtl has it.
    fn play(&mut self, m: &Moment) -> Vector {
        let mut sum = 0.0;
        for (k, (width, size)) in [(0.012, 0.9e-6), (0.05, 1.1e-6)].into_iter().enumerate() {
            let held = &mut self.memory[k];
            *held = held.clamp(m.reading_m[0] - width, m.reading_m[0] + width);
            sum += size * (m.reading_m[0] - *held) / width;
        }
        [sum, 0.0, 0.0]
    }

    /// Friction of Y after Dahl: dF/dx = σ (1 − F sign v).
    fn dahl(&mut self, m: &Moment) -> Vector {
        let step = m.reading_m[1] - self.memory[2];
        self.memory[2] = m.reading_m[1];
        let end = if step >= 0.0 { 1.0 } else { -1.0 };
        self.memory[3] = end + (self.memory[3] - end) * (-step.abs() / 0.03).exp();
        [0.3e-6 * self.memory[3], 1.1e-6 * self.memory[3], 0.0]
    }

    /// A random walk that is pulled back over an hour.
    fn walk(&mut self, m: &Moment) -> Vector {
        let gap = (m.time_s - self.last_s).abs().min(1e5);
        self.last_s = m.time_s;
        let kept = (-gap / 3000.0_f64).exp();
        let size = 0.9e-6 * (1.0 - kept * kept).sqrt();
        self.walk = std::array::from_fn(|d| kept * self.walk[d] + size * self.random.normal());
        self.walk
    }

    /// What the instrument says too much (m) of a sight in this unit direction.
    pub(crate) fn range_m(&mut self, time_s: f64, station: usize, sight: Vector) -> f64 {
        if let Some(size) = self.form.strip_prefix("bump:").filter(|_| time_s >= STEPS_AT_S) {
            // Somebody runs into the stand. To the stations after it, which stand elsewhere anyway, it is nothing.
            return -dot(times([0.7, -0.5, 0.5], size.parse::<f64>().unwrap() * 1e-6), sight);
        }
        let yaw = TAU * self.a[2] + 1.9 * station as f64;
        match self.form.as_str() {
            "sight-bump" => {
                let axis = [yaw.cos() * 0.8, yaw.sin() * 0.8, 0.6];
                1.2e-6 * ((dot(axis, sight) - 1.0) / 0.12).exp()
            }
            "elevation" => {
                let sine = sight[2].abs();
                (1.0 + 0.4 * yaw.sin()) * 1.1e-6 * sine.powi(3) + 0.4e-6 * (3.0 * sight[1].atan2(sight[0]) + yaw).sin()
            }
            "ar-0.5" => self.correlated(0.5, 0.3e-6),
            "ar-0.9" => self.correlated(0.9, 0.3e-6),
            "ar-0.8" => self.correlated(0.8, 0.25e-6),
            "ar-0.97" => self.correlated(0.97, 0.35e-6),
            _ => 0.0,
        }
    }

    fn correlated(&mut self, kept: f64, size: f64) -> f64 {
        self.memory[4] = kept * self.memory[4] + size * (1.0_f64 - kept * kept).sqrt() * self.random.normal();
        self.memory[4]
    }

    /// How far the reflector sits from where its holder's number says (m).
    pub(crate) fn holder_m(&self, holder: usize) -> Vector {
        let size = match (self.form.as_str(), holder) {
            ("holder", 1) => 6e-6,
            ("holder-two", 1) => 9e-6,
            ("holder-two", 2) => 4e-6,
            _ => return [0.0; 3],
        };
        let angle = TAU * self.a[3 + holder];
        times([angle.cos(), 0.5 * angle.sin(), 0.9 * (2.0 * angle).cos()], size)
    }

    /// Share of the cells of the scales' temperatures that are empty.
    pub(crate) fn holes(&self) -> f64 {
        if self.form == "holes" { 0.03 } else { 0.0 }
    }
}

fn settled(from_rad: f64, m: &Moment) -> Vector {
    [from_rad * (-m.time_s / 4000.0).exp() * m.reading_m[1], 0.0, 0.0]
}

/// A machine that is another one from an instant on, as `step-KIND:SIZE` (µm or µrad); a squareness that settles, by 14 µrad or
/// `settles:SIZE`; a column that leans in cycles, as `lean-cycle:PERIOD` (s);
/// a scale of Z that slips, as `slip:SIZE@INSTANT` (µm/m, s).
fn step(form: &str, m: &Moment) -> Vector {
    if form == "squareness-settles" {
        return settled(14e-6, m);
    }
    if let Some(size) = form.strip_prefix("settles:") {
        return settled(size.parse::<f64>().unwrap() * 1e-6, m);
    }
    if let Some(period) = form.strip_prefix("lean-cycle:") {
        let course = (TAU * m.time_s / period.parse::<f64>().unwrap()).sin();
        return [2e-6 * m.share[2] * course, 0.0, 0.0];
    }
    if let Some((size, at_s)) = form.strip_prefix("slip:").and_then(|form| form.split_once('@')) {
        let slipped = m.time_s >= at_s.parse::<f64>().unwrap();
        return [0.0, 0.0, if slipped { size.parse::<f64>().unwrap() * 1e-6 * m.reading_m[2] } else { 0.0 }];
    }
    let Some((kind, size)) = form.strip_prefix("step-").and_then(|form| form.split_once(':')) else { return [0.0; 3] };
    if m.time_s < STEPS_AT_S {
        return [0.0; 3];
    }
    let size = size.parse::<f64>().unwrap() * 1e-6;
    let holder = minus(m.point_m, m.reading_m);
    match kind {
        // Y stands askew to X; all that it carries goes along.
        "square" => cross([0.0, 0.0, size], [0.0, m.reading_m[1] - 0.1, 0.0]),
        // The ram leans, and with it what hangs on it.
        "lean" => cross([size, 0.0, 0.0], [0.0, 0.0, m.reading_m[2] - 0.8]),
        // The beam rolls about its own axis: Z leans and all holders turn.
        "roll" => cross([0.0, size, 0.0], [holder[0], holder[1], m.reading_m[2] + holder[2] - 0.3]),
        // The guide of X is pushed aside.
        "straight" => [0.0, 0.8 * size, 0.6 * size],
        // The scale of X counts on from another place.
        "zero" => [size, 0.0, 0.0],
        // Somebody switches the compensation of the scale of Y: size in µm/m.
        "scale" => [0.0, size * m.reading_m[1], 0.0],
        _ => [0.0; 3],
    }
}
