//! The cell around a target: in each of the eight octants around it, the nearest calibrated point.
//!
//! Place in the flow: calibrated points (inputs in commensurable units: m for positions) once, then for each target its eight
//! vertices. Octants are those of the first three inputs, the position where there is one; the distance counts all. On a regular
//! lattice these are the corners of the hexahedron around the target (Liang 2025, chapter 3); on an incomplete or
//! scattered one they are still defined, everywhere. An octant without a point is stood in for by the nearest point of all.
//! In training the target is not among the calibrated points, and neither is a part of space around it.

use abbe_field::{corners, place_of};
use nalgebra::Vector3;
use std::ops::RangeInclusive;

/// Vertices of a cell.
pub const VERTICES: usize = 8;
/// Bins along an axis at most; keeps memory in bounds for points strewn along a line.
const MOST_BINS: usize = 64;

/// Vertices of the cell around a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertices {
    /// Index of the calibrated point of each octant; bit a of the octant is set where the point lies at or above the target
    /// along axis a.
    pub index: [usize; VERTICES],
    /// Octants that hold a point. With all eight, the target lies within the convex hull.
    pub occupied: [bool; VERTICES],
    /// The nearest of all.
    pub nearest: usize,
}

/// Calibrated points in bins of their first three inputs, for the search.
#[derive(Debug, Clone, PartialEq)]
pub struct Neighbourhood {
    low_m: Vector3<f64>,
    bin_m: f64,
    counts: [usize; 3],
    /// Points of bin b are `binned[start[b]..start[b + 1]]`, ascending.
    start: Vec<usize>,
    binned: Vec<(Vector3<f64>, usize)>,
    /// Inputs beyond the first three, and those of each of `binned`.
    further: usize,
    beyond: Vec<f64>,
}

impl Neighbourhood {
    /// Bins of finite points of `size` inputs.
    pub fn new<'a>(size: usize, points: impl Iterator<Item = &'a [f64]> + Clone) -> Neighbourhood {
        let places: Vec<Vector3<f64>> = points.clone().map(place_of).collect();
        let first = || places.iter().map(|place| place.as_slice());
        let [low_m, high_m] = <[Vec<f64>; 2]>::from(corners(3, first())).map(|corner| place_of(&corner));
        let longest = (high_m - low_m).max();
        let bin_m = spacing(3, first()).max(longest / MOST_BINS as f64).max(f64::MIN_POSITIVE);
        let count = |axis: usize| (((high_m[axis] - low_m[axis]) / bin_m) as usize + 1).min(MOST_BINS + 1);
        let counts = if places.is_empty() { [1; 3] } else { std::array::from_fn(count) };
        let mut found = Neighbourhood {
            low_m,
            bin_m,
            counts,
            start: vec![0; counts.iter().product::<usize>() + 1],
            binned: places.iter().copied().zip(0..).collect(),
            further: size.saturating_sub(3),
            beyond: Vec::new(),
        };
        let bins: Vec<usize> = places.iter().map(|place| found.flat(found.bin(place))).collect();
        found.binned.sort_by_key(|(_, k)| (bins[*k], *k));
        bins.iter().for_each(|bin| found.start[bin + 1] += 1);
        for b in 1..found.start.len() {
            found.start[b] += found.start[b - 1];
        }
        let points: Vec<&[f64]> = points.collect();
        found.beyond = found.binned.iter().flat_map(|(_, k)| points[*k].iter().skip(3)).copied().collect();
        found
    }

    fn bin(&self, point_m: &Vector3<f64>) -> [usize; 3] {
        std::array::from_fn(|axis| {
            let place = (point_m[axis] - self.low_m[axis]) / self.bin_m;
            (place.max(0.0) as usize).min(self.counts[axis] - 1) // the saturating cast also takes what is no number
        })
    }

    fn flat(&self, bin: [usize; 3]) -> usize {
        (bin[0] * self.counts[1] + bin[1]) * self.counts[2] + bin[2]
    }

    /// Vertices of the cell around a target; `None` without points, or if the target is no number. Of equally distant points the
    /// first counts.
    pub fn vertices(&self, target: &[f64]) -> Option<Vertices> {
        let target = &Target { place_m: place_of(target), beyond: target.get(3..).unwrap_or_default() };
        let target_m = &target.place_m;
        let centre = self.bin(target_m);
        let mut search = Search { squares: [f64::INFINITY; VERTICES], index: [usize::MAX; VERTICES] };
        let most = self.counts.iter().max().copied().unwrap_or(1);
        // The first shell is the whole block of bins around the target.
        for shell in 1..=most {
            let low = centre.map(|c| c.saturating_sub(shell));
            let high: [usize; 3] = std::array::from_fn(|axis| (centre[axis] + shell).min(self.counts[axis] - 1));
            for i in low[0]..=high[0] {
                for j in low[1]..=high[1] {
                    let gap_m2 = self.gap_m(0, i, target_m).powi(2) + self.gap_m(1, j, target_m).powi(2);
                    if search.is_beyond(gap_m2) {
                        continue;
                    }
                    let is_new = shell == 1 || i.abs_diff(centre[0]) == shell || j.abs_diff(centre[1]) == shell;
                    if is_new {
                        self.offer_row([i, j], low[2]..=high[2], target, &mut search);
                        continue;
                    }
                    // Inside the shell only the two end bins of a row are new.
                    for k in [centre[2].checked_sub(shell), Some(centre[2] + shell)].into_iter().flatten() {
                        self.offer_row([i, j], k..=k.min(high[2]), target, &mut search);
                    }
                }
            }
            if self.is_settled(target_m, &search, &low, &high) {
                break;
            }
        }
        search.vertices()
    }

    /// Offers the points of bins that follow each other along the third input.
    fn offer_row(&self, [i, j]: [usize; 2], along_z: RangeInclusive<usize>, target: &Target, to: &mut Search) {
        if along_z.is_empty() {
            return;
        }
        let (first, last) = (self.flat([i, j, *along_z.start()]), self.flat([i, j, *along_z.end()]));
        for k in self.start[first]..self.start[last + 1] {
            let (place_m, index) = &self.binned[k];
            let beyond = self.beyond[k * self.further..(k + 1) * self.further].iter().zip(target.beyond);
            to.offer(*index, &(place_m - target.place_m), beyond.map(|(at, target)| (at - target).powi(2)).sum());
        }
    }

    /// Distance (m) of a target from the nearest plane of a layer of bins across an axis; zero within it.
    fn gap_m(&self, axis: usize, layer: usize, target_m: &Vector3<f64>) -> f64 {
        let edge = self.low_m[axis] + layer as f64 * self.bin_m;
        // The last layer holds what rounding puts on its far side.
        let is_last = layer + 1 == self.counts[axis];
        let above = if is_last { 0.0 } else { target_m[axis] - (edge + self.bin_m) };
        (edge - target_m[axis]).max(above).max(0.0)
    }

    /// Whether no bin left out can hold a nearer point of any octant.
    fn is_settled(&self, target_m: &Vector3<f64>, search: &Search, low: &[usize; 3], high: &[usize; 3]) -> bool {
        let below: [f64; 3] = std::array::from_fn(|a| {
            let edge = self.low_m[a] + low[a] as f64 * self.bin_m;
            if low[a] == 0 { f64::INFINITY } else { target_m[a] - edge }
        });
        let above: [f64; 3] = std::array::from_fn(|a| {
            let edge = self.low_m[a] + (high[a] + 1) as f64 * self.bin_m;
            if high[a] + 1 == self.counts[a] { f64::INFINITY } else { edge - target_m[a] }
        });
        (0..VERTICES).all(|octant| {
            let reach = (0..3).map(|a| if octant >> a & 1 == 1 { above[a] } else { below[a] });
            let reach = reach.fold(f64::INFINITY, f64::min);
            // An octant whose bins are all seen is settled even if it is empty.
            reach == f64::INFINITY || (reach > 0.0 && search.squares[octant] < reach * reach)
        })
    }
}

/// A target: its first three inputs and the others.
struct Target<'a> {
    place_m: Vector3<f64>,
    beyond: &'a [f64],
}

/// The nearest point of each octant so far.
struct Search {
    squares: [f64; VERTICES],
    index: [usize; VERTICES],
}

/// Share of a distance between bins that rounding leaves of it at least.
const ROUNDED: f64 = 1.0 - 1e-9;

impl Search {
    /// Whether points at this square distance (m²) and beyond are in nobody's place.
    #[inline]
    fn is_beyond(&self, square_m2: f64) -> bool {
        self.squares.iter().all(|held| *held < square_m2 * ROUNDED)
    }

    /// Offers a point by its place relative to the target, and the square of its distance in the other inputs.
    #[inline]
    fn offer(&mut self, index: usize, relative: &Vector3<f64>, beyond: f64) {
        let octant = (0..3).map(|a| usize::from(relative[a] >= 0.0) << a).sum::<usize>();
        let square = relative.norm_squared() + beyond;
        let held = self.squares[octant];
        if square < held || (square == held && index < self.index[octant]) {
            self.squares[octant] = square;
            self.index[octant] = index;
        }
    }

    fn vertices(self) -> Option<Vertices> {
        let mut best = 0;
        for octant in 1..VERTICES {
            let (square, index) = (self.squares[octant], self.index[octant]);
            if square < self.squares[best] || (square == self.squares[best] && index < self.index[best]) {
                best = octant;
            }
        }
        let nearest = self.index[best];
        let occupied = self.index.map(|index| index != usize::MAX);
        let index = self.index.map(|index| if index == usize::MAX { nearest } else { index });
        occupied[best].then_some(Vertices { index, occupied, nearest })
    }
}

/// Typical distance of neighbouring points in commensurable inputs (m for positions): the edge of the cube that each has to itself in
/// the box around them all. Directions in which the box is flat do not count.
pub fn spacing<'a>(size: usize, points: impl Iterator<Item = &'a [f64]> + Clone) -> f64 {
    let (low, high) = corners(size, points.clone());
    let extent = || high.iter().zip(&low).map(|(high, low)| high - low);
    let longest = extent().fold(f64::NEG_INFINITY, f64::max);
    let wide: Vec<f64> = extent().filter(|e| *e > longest * 1e-6).collect();
    let count = points.count();
    if count == 0 || wide.is_empty() {
        return 0.0;
    }
    // A lattice of n³ points has n − 1 steps along an edge.
    let per_axis = (count as f64).powf(1.0 / wide.len() as f64);
    (wide.iter().product::<f64>()).powf(1.0 / wide.len() as f64) / (per_axis - 1.0).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn lattice(n: usize, step_m: f64) -> Vec<Vector3<f64>> {
        let place = |k: usize| Vector3::new((k / n / n) as f64, (k / n % n) as f64, (k % n) as f64) * step_m;
        (0..n * n * n).map(place).collect()
    }

    fn scattered(n: usize, seed: u64) -> Vec<Vector3<f64>> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| Vector3::from_fn(|axis, _| random.random::<f64>() * [0.8, 0.6, 0.05][axis])).collect()
    }

    /// The definition, word by word; `further` inputs of each point and of the target beside the place.
    fn by_trying_all(points: &[Vec<f64>], target: &[f64]) -> Option<Vertices> {
        let mut search = Search { squares: [f64::INFINITY; VERTICES], index: [usize::MAX; VERTICES] };
        for (k, point) in points.iter().enumerate() {
            let beyond = point.iter().zip(target).skip(3).map(|(a, b)| (a - b).powi(2)).sum();
            search.offer(k, &(place_of(point) - place_of(target)), beyond);
        }
        search.vertices()
    }

    fn of(points: &[Vector3<f64>]) -> Neighbourhood {
        Neighbourhood::new(3, points.iter().map(|point| point.as_slice()))
    }

    #[test]
    fn vertices_of_a_regular_lattice_are_the_corners_of_the_cell() {
        let points = lattice(5, 0.1);
        let target = Vector3::new(0.13, 0.28, 0.31);
        let found = of(&points).vertices(target.as_slice()).unwrap();
        for (octant, index) in found.index.iter().enumerate() {
            let corner = Vector3::from_fn(|a, _| [0.1, 0.2, 0.3][a] + 0.1 * (octant >> a & 1) as f64);
            assert!((points[*index] - corner).norm() < 1e-12, "{octant}: {}", points[*index]);
        }
        assert_eq!(found.occupied, [true; 8]);
    }

    #[test]
    fn the_quick_search_finds_what_trying_all_points_finds() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let cases = [(lattice(6, 0.1), 1), (scattered(300, 1), 2), (scattered(40, 2), 3), (scattered(1, 4), 4)];
        for ((points, seed), size) in
            cases.into_iter().flat_map(|case| [(case.clone(), 2), (case.clone(), 3), (case, 6)])
        {
            let mut more = || (0..3).map(|_| random.random::<f64>()).collect::<Vec<_>>();
            let mut with = |place: &Vector3<f64>| [place.as_slice(), &more()].concat()[..size].to_vec();
            let points: Vec<Vec<f64>> = points.iter().map(&mut with).collect();
            let search = Neighbourhood::new(size, points.iter().map(Vec::as_slice));
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            for _ in 0..500 {
                let target: Vec<f64> = (0..size).map(|_| random.random::<f64>() * 1.2 - 0.2).collect();
                let expected = by_trying_all(&points, &target);
                assert_eq!(search.vertices(&target), expected, "case {seed}, {size} inputs, {target:?}");
            }
        }
    }

    #[test]
    fn an_empty_octant_is_stood_in_for_by_the_nearest_point() {
        let points = lattice(3, 0.1);
        let found = of(&points).vertices(&[0.25, 0.11, 0.12]).unwrap();
        assert_eq!(found.occupied, [true, false, true, false, true, false, true, false]);
        assert!((points[found.nearest] - Vector3::new(0.2, 0.1, 0.1)).norm() < 1e-12);
        assert_eq!(found.index[1], found.nearest);
    }

    #[test]
    fn without_points_there_are_no_vertices() {
        assert_eq!(of(&[]).vertices(&[0.0; 3]), None);
    }

    #[test]
    fn targets_that_are_no_numbers_do_not_panic() {
        let search = of(&lattice(3, 0.1));
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
            let _ = search.vertices(&[bad; 3]);
        }
    }
}
