//! Geometry of a foreign machine: three slides, each carried by the one before, and how each strays from its straight line.
//!
//! A slide at r strays by three translations and three rotations, sums of a cubic and a few waves longer than a third of the
//! stroke. SI. Nothing here is shared with `models/`.

use super::random::Random;
use super::vector::{Vector, add, turned};

/// A smooth function over a stroke.
struct Smooth {
    low: f64,
    span: f64,
    cubic: [f64; 4],
    waves: Vec<(f64, f64, f64)>,
}

impl Smooth {
    fn new((low, high): (f64, f64), size: f64, random: &mut Random) -> Smooth {
        let cubic = std::array::from_fn(|_| size * 0.6 * random.normal());
        let wave = |k: usize| (size * 0.4 * random.normal() / k as f64, 0.7 * k as f64, random.between(0.0, 6.0));
        Smooth { low, span: high - low, cubic, waves: (1..=3).map(wave).collect() }
    }

    fn at(&self, r: f64) -> f64 {
        let s = 2.0 * (r - self.low) / self.span - 1.0;
        let cubic = self.cubic[0] + s * (self.cubic[1] + s * (self.cubic[2] + s * self.cubic[3]));
        let wave = |(size, cycles, phase): &(f64, f64, f64)| size * (std::f64::consts::PI * cycles * s + phase).sin();
        cubic + self.waves.iter().map(wave).sum::<f64>()
    }
}

/// What carries what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Build {
    /// X carries Y carries Z carries the tip.
    Bridge,
    /// The workpiece travels along X, the tip along Y and Z.
    Table,
}

/// The three slides.
pub(crate) struct Slides {
    build: Build,
    strays: [[Smooth; 6]; 3],
}

impl Slides {
    pub(crate) fn new(build: Build, stroke_m: [(f64, f64); 3], random: &mut Random) -> Slides {
        let strays = stroke_m
            .map(|stroke| std::array::from_fn(|k| Smooth::new(stroke, if k < 3 { 4e-6 } else { 9e-6 }, random)));
        Slides { build, strays }
    }

    /// Where an offset from the end of the ram lies at these readings.
    pub(crate) fn tip_m(&self, reading_m: Vector, offset_m: Vector) -> Vector {
        let mut point = offset_m;
        for axis in (0..3).rev() {
            let at = |k: usize| self.strays[axis][k].at(reading_m[axis]);
            let (stray, turn) = ([at(0), at(1), at(2)], [at(3), at(4), at(5)]);
            let mut travel = [0.0; 3];
            travel[axis] = reading_m[axis];
            point = match (self.build, axis) {
                (Build::Table, 0) => add(turned(add(point, travel), turn), stray),
                _ => add(add(turned(point, turn), travel), stray),
            };
        }
        point
    }
}
