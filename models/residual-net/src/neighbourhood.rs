//! The cell around a target: in each of the eight octants around it, the nearest calibrated point.
//!
//! Place in the flow: calibrated points (m, machine frame) once, then for each target its eight vertices. On a regular
//! lattice these are the corners of the hexahedron around the target (Liang 2025, chapter 3); on an incomplete or
//! scattered one they are still defined, everywhere. An octant without a point is stood in for by the nearest point of all.
//! In training the target is not among the calibrated points, and neither is a part of space around it.

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

/// Calibrated points in bins, for the search.
#[derive(Debug, Clone, PartialEq)]
pub struct Neighbourhood {
    points_m: Vec<Vector3<f64>>,
    low_m: Vector3<f64>,
    bin_m: f64,
    counts: [usize; 3],
    /// Points of bin b are `binned[start[b]..start[b + 1]]`, ascending.
    start: Vec<usize>,
    binned: Vec<(Vector3<f64>, usize)>,
}

impl Neighbourhood {
    /// Bins of finite points (m).
    pub fn new(points_m: &[Vector3<f64>]) -> Neighbourhood {
        let (low_m, high_m) = corners_m(points_m);
        let longest = (high_m - low_m).max();
        let bin_m = spacing_m(points_m).max(longest / MOST_BINS as f64).max(f64::MIN_POSITIVE);
        let count = |axis: usize| (((high_m[axis] - low_m[axis]) / bin_m) as usize + 1).min(MOST_BINS + 1);
        let counts = if points_m.is_empty() { [1; 3] } else { std::array::from_fn(count) };
        let mut found = Neighbourhood {
            points_m: points_m.to_vec(),
            low_m,
            bin_m,
            counts,
            start: vec![0; counts.iter().product::<usize>() + 1],
            binned: points_m.iter().copied().zip(0..).collect(),
        };
        let bins: Vec<usize> = points_m.iter().map(|point| found.flat(found.bin(point))).collect();
        found.binned.sort_by_key(|(_, k)| (bins[*k], *k));
        bins.iter().for_each(|bin| found.start[bin + 1] += 1);
        for b in 1..found.start.len() {
            found.start[b] += found.start[b - 1];
        }
        found
    }

    /// Calibrated points (m, machine frame).
    pub fn points_m(&self) -> &[Vector3<f64>] {
        &self.points_m
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

    /// Vertices of the cell around a target (m); `None` without points, or if the target is no number. Of equally distant
    /// points the first counts.
    pub fn vertices(&self, target_m: &Vector3<f64>) -> Option<Vertices> {
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
                        self.offer_row([i, j], low[2]..=high[2], target_m, &mut search);
                        continue;
                    }
                    // Inside the shell only the two end bins of a row are new.
                    for k in [centre[2].checked_sub(shell), Some(centre[2] + shell)].into_iter().flatten() {
                        self.offer_row([i, j], k..=k.min(high[2]), target_m, &mut search);
                    }
                }
            }
            if self.is_settled(target_m, &search, &low, &high) {
                break;
            }
        }
        search.vertices()
    }

    /// Offers the points of bins that follow each other along z.
    fn offer_row(&self, [i, j]: [usize; 2], along_z: RangeInclusive<usize>, target_m: &Vector3<f64>, to: &mut Search) {
        if along_z.is_empty() {
            return;
        }
        let (first, last) = (self.flat([i, j, *along_z.start()]), self.flat([i, j, *along_z.end()]));
        for (point_m, index) in &self.binned[self.start[first]..self.start[last + 1]] {
            to.offer(*index, &(point_m - target_m));
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

    #[inline]
    fn offer(&mut self, index: usize, relative: &Vector3<f64>) {
        let octant = (0..3).map(|a| usize::from(relative[a] >= 0.0) << a).sum::<usize>();
        let square = relative.norm_squared();
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

/// Lower and upper corner of the box around some points (m); infinite the wrong way round without any.
pub fn corners_m(points_m: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let low = points_m.iter().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(p));
    let high = points_m.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |high, p| high.sup(p));
    (low, high)
}

/// Typical distance of neighbouring points (m): the edge of the cube that each has to itself in the box around them all.
/// Directions in which the box is flat do not count.
pub fn spacing_m(points_m: &[Vector3<f64>]) -> f64 {
    let (low, high) = corners_m(points_m);
    let extent = high - low;
    let longest = extent.max();
    let wide: Vec<f64> = extent.iter().copied().filter(|e| *e > longest * 1e-6).collect();
    if points_m.is_empty() || wide.is_empty() {
        return 0.0;
    }
    // A lattice of n³ points has n − 1 steps along an edge.
    let per_axis = (points_m.len() as f64).powf(1.0 / wide.len() as f64);
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

    /// The definition, word by word.
    fn by_trying_all(points: &[Vector3<f64>], target: &Vector3<f64>) -> Option<Vertices> {
        let mut search = Search { squares: [f64::INFINITY; VERTICES], index: [usize::MAX; VERTICES] };
        (0..points.len()).for_each(|k| search.offer(k, &(points[k] - target)));
        search.vertices()
    }

    #[test]
    fn vertices_of_a_regular_lattice_are_the_corners_of_the_cell() {
        let points = lattice(5, 0.1);
        let target = Vector3::new(0.13, 0.28, 0.31);
        let found = Neighbourhood::new(&points).vertices(&target).unwrap();
        for (octant, index) in found.index.iter().enumerate() {
            let corner = Vector3::from_fn(|a, _| [0.1, 0.2, 0.3][a] + 0.1 * (octant >> a & 1) as f64);
            assert!((points[*index] - corner).norm() < 1e-12, "{octant}: {}", points[*index]);
        }
        assert_eq!(found.occupied, [true; 8]);
    }

    #[test]
    fn the_quick_search_finds_what_trying_all_points_finds() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for (points, seed) in
            [(lattice(6, 0.1), 1), (scattered(300, 1), 2), (scattered(40, 2), 3), (scattered(1, 4), 4)]
        {
            let search = Neighbourhood::new(&points);
            for _ in 0..500 {
                let target = Vector3::from_fn(|_, _| random.random::<f64>() * 1.2 - 0.2);
                let expected = by_trying_all(&points, &target);
                assert_eq!(search.vertices(&target), expected, "case {seed}, {target}");
            }
        }
    }

    #[test]
    fn an_empty_octant_is_stood_in_for_by_the_nearest_point() {
        let points = lattice(3, 0.1);
        let found = Neighbourhood::new(&points).vertices(&Vector3::new(0.25, 0.11, 0.12)).unwrap();
        assert_eq!(found.occupied, [true, false, true, false, true, false, true, false]);
        assert!((points[found.nearest] - Vector3::new(0.2, 0.1, 0.1)).norm() < 1e-12);
        assert_eq!(found.index[1], found.nearest);
    }

    #[test]
    fn without_points_there_are_no_vertices() {
        assert_eq!(Neighbourhood::new(&[]).vertices(&Vector3::zeros()), None);
    }

    #[test]
    fn targets_that_are_no_numbers_do_not_panic() {
        let search = Neighbourhood::new(&lattice(3, 0.1));
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
            let _ = search.vertices(&Vector3::repeat(bad));
        }
    }
}
