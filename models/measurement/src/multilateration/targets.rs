//! Readings of a campaign dealt to the points they were taken at.
//!
//! Place in the flow: readings (m, machine frame) in; points in the order of their first reading, and the point of each
//! reading, out.

use crate::campaign::RangeReading;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A measured point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Mean indicated axis positions (m, machine frame).
    pub reading_m: Vector3<f64>,
    /// Reflector relative to the ram reference point (m, ram frame).
    pub offset_m: Vector3<f64>,
}

impl Target {
    /// Indicated position of the reflector (m, machine frame).
    pub fn indicated_m(&self) -> Vector3<f64> {
        self.reading_m + self.offset_m
    }
}

/// Where the machine indicated the reflector (m, machine frame).
pub(super) fn indicated_m(reading: &RangeReading) -> Vector3<f64> {
    Vector3::from(reading.reading_m) + Vector3::from(reading.offset_m)
}

/// Readings of one target so far: the first one's place and offset, the sum of all places, and their number.
struct Gathered {
    first_m: Vector3<f64>,
    offset_m: Vector3<f64>,
    sum_m: Vector3<f64>,
    readings: f64,
}

/// Targets in the order of their first reading, and the target of each reading.
///
/// Readings are dealt into boxes as wide as the tolerance, so that only neighbouring boxes need a look. The same point with
/// another reflector offset is another target: the error of a machine depends on the offset.
pub(super) fn group(readings: &[RangeReading], tolerance_m: f64) -> (Vec<Target>, Vec<usize>) {
    let box_of = |p: &Vector3<f64>| [0, 1, 2].map(|d| (p[d] / tolerance_m).floor() as i64);
    let mut boxes: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    let mut gathered: Vec<Gathered> = Vec::new();
    let mut target_of = Vec::with_capacity(readings.len());
    for reading in readings {
        let (axes_m, offset_m) = (Vector3::from(reading.reading_m), Vector3::from(reading.offset_m));
        let own = box_of(&axes_m);
        let near = |target: &usize| {
            let Gathered { first_m, offset_m: its_offset_m, .. } = &gathered[*target];
            (first_m - axes_m).norm() <= tolerance_m && (its_offset_m - offset_m).norm() <= tolerance_m
        };
        let beside = |k: i64| [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1];
        let neighbours = (0..27).map(|k| [0, 1, 2].map(|d| own[d].saturating_add(beside(k)[d])));
        let known = neighbours.flat_map(|key| boxes.get(&key).into_iter().flatten()).copied().find(near);
        let target = known.unwrap_or_else(|| {
            boxes.entry(own).or_default().push(gathered.len());
            gathered.push(Gathered { first_m: axes_m, offset_m, sum_m: Vector3::zeros(), readings: 0.0 });
            gathered.len() - 1
        });
        gathered[target].sum_m += axes_m;
        gathered[target].readings += 1.0;
        target_of.push(target);
    }
    let targets = gathered.iter().map(|g| Target { reading_m: g.sum_m / g.readings, offset_m: g.offset_m });
    (targets.collect(), target_of)
}
