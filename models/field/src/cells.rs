//! Cells into which the measured points cut the volume: eight points around any target.
//!
//! Place in the flow: points (m, machine frame) once, then for each target the indices of eight points around it, and
//! whether it lies among the measured points. Used by the interpolation over the smallest enclosing hexahedron (Chen 2020,
//! section 2.2). The residual network has vertices of its own, among inputs of any kind (`neighbourhood.rs` of `models/residual-net`).
//!
//! Points may be a regular lattice, one with nodes missing, or a scatter. What counts as around:
//! 1. the corners of the smallest box of measured points that contains the target (or, beyond the lattice, of the cell
//!    nearest to it);
//! 2. where no such box exists, the nearest point in each of the eight octants about the target;
//! 3. where octants are empty, their places are taken by the nearest points not yet used.
//!
//! Ties go to the lower index, so the same points always give the same answer.

use crate::error::FieldError;
use crate::hull::{self, Region};
use crate::lattice::Lattice;
use crate::measured::{MeasuredField, check_points, lifted};
use nalgebra::Vector3;
use thiserror::Error;

/// Coordinates of points of one lattice plane differ by less than this (m): a machine stops within tens of micrometres of
/// where it is sent, while the steps of a lattice are millimetres at least.
pub const PLANE_TOLERANCE_M: f64 = 1e-4;

/// How the points are arranged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrangement {
    /// A lattice with a point at every node.
    Regular,
    /// A lattice with nodes missing.
    Incomplete,
    /// No lattice.
    Scattered,
}

/// What the eight points are to the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Enclosure {
    /// Corners of a box along the axes.
    Hexahedron,
    /// One point in each octant about the target; the target lies in their convex hull.
    Octants,
    /// The nearest points of some octants, and others where octants are empty.
    Nearest,
}

/// Eight different measured points around a target; four of a plane, each twice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbours {
    /// Indices of the points: x fastest, lower first. Bit 0 of the place is upper x, bit 1 upper y, bit 2 upper z; only
    /// for [`Enclosure::Nearest`] a point may stand in a place that it does not lie in.
    pub vertices: [usize; 8],
    /// What they are to the target.
    pub enclosure: Enclosure,
    /// Whether the target lies among all measured points.
    pub region: Region,
}

/// A target that is no point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a coordinate of the target is not a finite number")]
pub struct TargetNotFinite;

/// Cells of the measured volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Cells {
    points_m: Vec<Vector3<f64>>,
    /// The points that surround a target: of a plane those on either side of it, else all.
    around_m: Vec<Vector3<f64>>,
    lattice: Option<Lattice>,
}

impl Cells {
    /// Cells of at least eight different points (m, machine frame) that fill a volume.
    pub fn new(points_m: &[Vector3<f64>]) -> Result<Cells, FieldError> {
        check_points(points_m)?;
        Ok(Cells::checked(points_m.to_vec(), points_m.to_vec()))
    }

    /// Cells of the points of a field.
    ///
    /// Of a plane each of four points around a target in it stands twice.
    pub fn of(field: &MeasuredField) -> Cells {
        let points_m = field.points_m().to_vec();
        let around_m = field.plane().map_or_else(|| points_m.clone(), |plane| lifted(&points_m, plane));
        Cells::checked(points_m, around_m)
    }

    fn checked(points_m: Vec<Vector3<f64>>, around_m: Vec<Vector3<f64>>) -> Cells {
        let lattice = Lattice::of(&around_m, PLANE_TOLERANCE_M);
        Cells { points_m, around_m, lattice }
    }

    /// How the points are arranged.
    pub fn arrangement(&self) -> Arrangement {
        match &self.lattice {
            Some(lattice) if lattice.is_complete => Arrangement::Regular,
            Some(_) => Arrangement::Incomplete,
            None => Arrangement::Scattered,
        }
    }

    /// The points (m, machine frame), as they were given.
    pub fn points_m(&self) -> &[Vector3<f64>] {
        &self.points_m
    }

    /// Coordinates of the lattice planes of each axis, ascending (m), where the points are a lattice.
    pub fn axes_m(&self) -> Option<&[Vec<f64>; 3]> {
        self.lattice.as_ref().map(|lattice| &lattice.axes_m)
    }

    /// The eight points around a target (m, machine frame), wherever it lies.
    pub fn around(&self, target_m: &Vector3<f64>) -> Result<Neighbours, TargetNotFinite> {
        if !target_m.iter().all(|v| v.is_finite()) {
            return Err(TargetNotFinite);
        }
        if let Some(lattice) = &self.lattice
            && let Some(vertices) = lattice.around(target_m)
        {
            // The point of the lattice's box nearest to the target lies in a measured box, so its distance is the hull's.
            let region = Region::at_distance(lattice.distance_m(target_m), PLANE_TOLERANCE_M);
            return Ok(self.neighbours(vertices, Enclosure::Hexahedron, region));
        }
        let nearest = self.nearest_of_octants(target_m);
        if let [Some(a), Some(b), Some(c), Some(d), Some(e), Some(f), Some(g), Some(h)] = nearest {
            // Were the target beyond the hull, the octant opposite to the way out would be empty.
            let vertices = [a, b, c, d, e, f, g, h];
            return Ok(self.neighbours(vertices, Enclosure::Octants, Region::Inside));
        }
        let vertices = self.filled(nearest, target_m);
        Ok(self.neighbours(vertices, Enclosure::Nearest, self.region(target_m)))
    }

    /// Neighbours among the points given, where those around a target are these twice.
    fn neighbours(&self, vertices: [usize; 8], enclosure: Enclosure, region: Region) -> Neighbours {
        Neighbours { vertices: vertices.map(|k| k % self.points_m.len()), enclosure, region }
    }

    /// Whether a finite target (m, machine frame) lies in the convex hull of the points.
    pub fn region(&self, target_m: &Vector3<f64>) -> Region {
        Region::at_distance(hull::distance_m(&self.points_m, target_m), PLANE_TOLERANCE_M)
    }

    /// The nearest point in each octant about the target; a coordinate equal to the target's counts as upper.
    fn nearest_of_octants(&self, target_m: &Vector3<f64>) -> [Option<usize>; 8] {
        let mut nearest: [Option<(f64, usize)>; 8] = [None; 8];
        for (index, point) in self.around_m.iter().enumerate() {
            let from_target = point - target_m;
            let octant = (0..3).map(|d| usize::from(from_target[d] >= 0.0) << d).sum::<usize>();
            let square = from_target.norm_squared();
            if nearest[octant].is_none_or(|(least, _)| square < least) {
                nearest[octant] = Some((square, index));
            }
        }
        nearest.map(|found| found.map(|(_, index)| index))
    }

    /// Puts the nearest points not yet used into the empty places, nearest first. Allocates nothing: it may run live.
    fn filled(&self, places: [Option<usize>; 8], target_m: &Vector3<f64>) -> [usize; 8] {
        let mut nearest = [(f64::INFINITY, usize::MAX); 8];
        for (index, point) in self.around_m.iter().enumerate().filter(|(index, _)| !places.contains(&Some(*index))) {
            let square = (point - target_m).norm_squared();
            if square < nearest[7].0 {
                // Those as near as this one came earlier and stay before it.
                let place = nearest.partition_point(|(other, _)| *other <= square);
                nearest[place..].rotate_right(1);
                nearest[place] = (square, index);
            }
        }
        let mut rest = nearest.into_iter().map(|(_, index)| index);
        // There are at least eight points, so there is one for every place.
        places.map(|place| place.or_else(|| rest.next()).unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measured::tests::lattice;
    use std::collections::BTreeSet;

    fn waves(k: usize) -> Vector3<f64> {
        let k = k as f64;
        Vector3::new((k * 0.71).sin(), (k * 1.31).cos(), (k * 0.37).sin())
    }

    /// All measured boxes around a target, the slow way: the least volume.
    fn least_volume(points: &[Vector3<f64>], target: &Vector3<f64>) -> Option<f64> {
        let has = |p: Vector3<f64>| points.iter().any(|q| (p - q).norm() < 1e-9);
        let mut least: Option<f64> = None;
        for low in points.iter().filter(|p| (0..3).all(|d| p[d] <= target[d] + 1e-12)) {
            for high in points.iter().filter(|p| (0..3).all(|d| p[d] >= target[d] - 1e-12 && p[d] > low[d])) {
                let corner = |k: usize, d: usize| if k >> d & 1 == 1 { high[d] } else { low[d] };
                if (0..8).all(|k| has(Vector3::new(corner(k, 0), corner(k, 1), corner(k, 2)))) {
                    let volume = (high - low).product();
                    least = Some(least.map_or(volume, |v: f64| v.min(volume)));
                }
            }
        }
        least
    }

    fn volume_of(cells: &Cells, vertices: [usize; 8]) -> f64 {
        (cells.points_m[vertices[7]] - cells.points_m[vertices[0]]).product()
    }

    fn assert_eight_different(neighbours: &Neighbours) {
        assert_eq!(neighbours.vertices.iter().collect::<BTreeSet<_>>().len(), 8);
    }

    #[test]
    fn a_regular_lattice_gives_the_unit_cell_with_x_fastest() {
        let cells = Cells::new(&lattice([4, 3, 3], 0.1)).unwrap();
        assert_eq!(cells.arrangement(), Arrangement::Regular);
        let found = cells.around(&Vector3::new(0.25, 0.05, 0.15)).unwrap();
        assert_eq!(found.vertices, [14, 15, 18, 19, 26, 27, 30, 31]);
        assert_eq!((found.enclosure, found.region), (Enclosure::Hexahedron, Region::Inside));
    }

    #[test]
    fn beyond_a_lattice_the_nearest_cell_answers_and_says_so() {
        let cells = Cells::new(&lattice([4, 3, 3], 0.1)).unwrap();
        let found = cells.around(&Vector3::new(0.33, 0.05, -0.04)).unwrap();
        assert_eq!(found.vertices, [2, 3, 6, 7, 14, 15, 18, 19]);
        assert_eq!(found.enclosure, Enclosure::Hexahedron);
        let Region::Outside { distance_m } = found.region else { panic!("{found:?}") };
        assert!((distance_m - 0.05).abs() < 1e-12);
    }

    #[test]
    fn positions_within_the_tolerance_of_a_plane_are_one_lattice() {
        let jittered: Vec<_> = lattice([5, 4, 3], 0.1).iter().enumerate().map(|(k, p)| p + waves(k) * 2e-5).collect();
        assert_eq!(Cells::new(&jittered).unwrap().arrangement(), Arrangement::Regular);
        let scattered: Vec<_> = lattice([5, 4, 3], 0.1).iter().enumerate().map(|(k, p)| p + waves(k) * 0.02).collect();
        assert_eq!(Cells::new(&scattered).unwrap().arrangement(), Arrangement::Scattered);
    }

    #[test]
    fn with_nodes_missing_the_smallest_box_of_measured_corners_is_found() {
        let all = lattice([6, 5, 4], 0.1);
        let left: Vec<_> = all.iter().enumerate().filter(|(k, _)| k * 7 % 10 > 2).map(|(_, p)| *p).collect();
        let cells = Cells::new(&left).unwrap();
        assert_eq!(cells.arrangement(), Arrangement::Incomplete);
        let (mut boxes, mut larger) = (0, 0);
        for k in 0..400 {
            let target = Vector3::new(0.25, 0.2, 0.15) + waves(k).component_mul(&Vector3::new(0.25, 0.2, 0.15));
            let found = cells.around(&target).unwrap();
            assert_eight_different(&found);
            match least_volume(&left, &target) {
                Some(least) => {
                    assert_eq!((found.enclosure, found.region), (Enclosure::Hexahedron, Region::Inside), "{target}");
                    assert!((volume_of(&cells, found.vertices) - least).abs() < 1e-12, "{target}");
                    boxes += 1;
                    larger += usize::from(least > 1.1e-3);
                }
                None => assert_ne!(found.enclosure, Enclosure::Hexahedron, "{target}"),
            }
        }
        assert!(boxes > 100 && larger > 50, "{boxes} {larger}: the case must not be trivial");
    }

    #[test]
    fn in_a_scatter_each_octant_gives_its_nearest_point() {
        let points: Vec<_> = (0..200).map(waves).collect();
        let cells = Cells::new(&points).unwrap();
        assert_eq!(cells.arrangement(), Arrangement::Scattered);
        let found = cells.around(&Vector3::new(0.1, -0.05, 0.02)).unwrap();
        assert_eq!((found.enclosure, found.region), (Enclosure::Octants, Region::Inside));
        for (place, index) in found.vertices.iter().enumerate() {
            let from_target = points[*index] - Vector3::new(0.1, -0.05, 0.02);
            for d in 0..3 {
                assert_eq!(from_target[d] >= 0.0, place >> d & 1 == 1);
            }
        }
    }

    #[test]
    fn empty_octants_are_filled_with_the_nearest_points_and_far_targets_are_outside() {
        let points: Vec<_> = (0..200).map(waves).collect();
        let cells = Cells::new(&points).unwrap();
        let target = Vector3::new(5.0, 5.0, 5.0);
        let found = cells.around(&target).unwrap();
        assert_eq!(found.enclosure, Enclosure::Nearest);
        assert!(!found.region.is_inside());
        assert_eight_different(&found);
        let mut order: Vec<usize> = (0..200).collect();
        order.sort_by(|a, b| (points[*a] - target).norm().total_cmp(&(points[*b] - target).norm()));
        assert_eq!(found.vertices.iter().collect::<BTreeSet<_>>(), order[..8].iter().collect::<BTreeSet<_>>());
    }

    #[test]
    fn what_is_equally_near_is_taken_in_the_order_of_the_points() {
        // Eight corners, and three points beyond that are equally far from the diagonal.
        let mut points = lattice([2, 2, 2], 1.0);
        points.extend([Vector3::new(0.5, 0.5, 3.0), Vector3::new(0.5, 3.0, 0.5), Vector3::new(3.0, 0.5, 0.5)]);
        let cells = Cells::new(&points).unwrap();
        let far = Vector3::new(50.0, 50.0, 50.0);
        // The three beyond are equally far and nearest; the corner towards the target follows.
        assert_eq!(cells.around(&far).unwrap().vertices[..4], [8, 9, 10, 7]);
    }

    #[test]
    fn a_target_that_is_no_number_is_refused() {
        let cells = Cells::new(&lattice([2, 2, 2], 1.0)).unwrap();
        assert_eq!(cells.around(&Vector3::new(0.0, f64::NAN, 0.0)), Err(TargetNotFinite));
        assert_eq!(cells.around(&Vector3::new(0.0, f64::INFINITY, 0.0)), Err(TargetNotFinite));
    }
}
