//! Convex hull of the measured points, by its distance from a target.
//!
//! Place in the flow: tells interpolation from extrapolation. The distance is found by Gilbert, Johnson and Keerthi's
//! descent over simplices of measured points, which needs no facets and so does not mind the many coplanar points of a
//! lattice. Source: Gilbert, Johnson, Keerthi 1988, IEEE J. Robotics and Automation 4(2).

use nalgebra::{DMatrix, DVector, Vector3};

/// Descents at most; each adds a point of the hull, so a few dozen are many.
const MOST_STEPS: usize = 200;
/// Relative gain of a step below which the distance has settled.
const SETTLED: f64 = 1e-12;

/// Where a target lies in relation to the measured points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Region {
    /// Among them (in their convex hull): interpolation.
    Inside,
    /// Beyond them: extrapolation.
    Outside {
        /// Distance from the convex hull (m).
        distance_m: f64,
    },
}

impl Region {
    /// Inside, if the distance from the hull is within the tolerance.
    pub(crate) fn at_distance(distance_m: f64, tolerance_m: f64) -> Region {
        if distance_m <= tolerance_m { Region::Inside } else { Region::Outside { distance_m } }
    }

    /// Whether the target lies among the measured points.
    pub fn is_inside(&self) -> bool {
        matches!(self, Region::Inside)
    }
}

/// Convex hull of points.
#[derive(Debug, Clone, PartialEq)]
pub struct Hull {
    points_m: Vec<Vector3<f64>>,
    tolerance_m: f64,
}

impl Hull {
    /// Hull of checked points; targets up to `tolerance_m` beyond it count as inside.
    pub(crate) fn new(points_m: &[Vector3<f64>], tolerance_m: f64) -> Hull {
        Hull { points_m: points_m.to_vec(), tolerance_m }
    }

    /// Where a finite target (m) lies.
    pub fn region(&self, target_m: &Vector3<f64>) -> Region {
        if is_surrounded(&self.points_m, target_m) {
            return Region::Inside;
        }
        Region::at_distance(distance_m(&self.points_m, target_m), self.tolerance_m)
    }
}

/// Whether each octant around a target holds a point: then the hull holds the target, as any plane through it has points on
/// both sides. Some 30 times as quick as the distance, and true for most targets that lie inside.
fn is_surrounded(points_m: &[Vector3<f64>], target_m: &Vector3<f64>) -> bool {
    let octant = |p: &Vector3<f64>| (0..3).map(|axis| u8::from(p[axis] >= target_m[axis]) << axis).sum::<u8>();
    let mut seen = 0_u8;
    points_m.iter().any(|point| {
        seen |= 1 << octant(point);
        seen == u8::MAX
    })
}

/// Distance (m) of a target from the convex hull of points; 0 inside.
pub(crate) fn distance_m(points_m: &[Vector3<f64>], target_m: &Vector3<f64>) -> f64 {
    let Some(first) = points_m.first() else { return f64::INFINITY };
    let scale = points_m.iter().map(|p| (p - target_m).norm_squared()).fold(0.0, f64::max);
    let mut simplex = vec![first - target_m];
    let mut nearest = simplex[0];
    for _ in 0..MOST_STEPS {
        let square = nearest.norm_squared();
        if square <= SETTLED * SETTLED * scale {
            return 0.0;
        }
        let Some(support) = support(points_m, target_m, &nearest) else { break };
        if square - nearest.dot(&support) <= SETTLED * scale || simplex.contains(&support) {
            break;
        }
        simplex.push(support);
        nearest = nearest_to_origin(&mut simplex);
    }
    nearest.norm()
}

/// The point, relative to the target, that lies farthest against a direction; the first of equals.
fn support(points_m: &[Vector3<f64>], target_m: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Vector3<f64>> {
    let relative = points_m.iter().map(|p| p - target_m);
    relative.min_by(|a, b| direction.dot(a).total_cmp(&direction.dot(b)))
}

/// The point of a simplex nearest to the origin; the simplex shrinks to the corners that carry it.
///
/// All subsets are tried: at most 15 of four corners, and none of the special cases of the usual case distinction.
fn nearest_to_origin(simplex: &mut Vec<Vector3<f64>>) -> Vector3<f64> {
    let mut best: Option<(f64, Vector3<f64>, Vec<Vector3<f64>>)> = None;
    for chosen in 1_usize..1 << simplex.len() {
        let corners: Vec<_> = (0..simplex.len()).filter(|k| chosen >> k & 1 == 1).map(|k| simplex[k]).collect();
        let Some(point) = nearest_of_flat(&corners) else { continue };
        let square = point.norm_squared();
        if best.as_ref().is_none_or(|(least, ..)| square < *least) {
            best = Some((square, point, corners));
        }
    }
    match best {
        Some((_, point, corners)) => {
            *simplex = corners;
            point
        }
        None => Vector3::zeros(), // not reached: a single corner always has a nearest point
    }
}

/// The point of the flat through the corners nearest to the origin, if it lies between them.
fn nearest_of_flat(corners: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let (origin, rest) = corners.split_first()?;
    if rest.is_empty() {
        return Some(*origin);
    }
    let edges: Vec<_> = rest.iter().map(|corner| corner - origin).collect();
    let gram = DMatrix::from_fn(edges.len(), edges.len(), |i, j| edges[i].dot(&edges[j]));
    let right = DVector::from_fn(edges.len(), |i, _| -edges[i].dot(origin));
    let weights = gram.cholesky()?.solve(&right);
    let between = weights.iter().all(|w| *w >= 0.0) && weights.sum() <= 1.0;
    between.then(|| edges.iter().zip(weights.iter()).fold(*origin, |sum, (edge, w)| sum + edge * *w))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measured::tests::lattice;

    #[test]
    fn distances_from_a_lattice_are_those_from_its_box() {
        let points = lattice([4, 4, 4], 0.1);
        let box_distance = |t: &Vector3<f64>| (t - t.map(|c| c.clamp(0.0, 0.3))).norm();
        for k in 0..500 {
            let k = f64::from(k);
            let target = Vector3::new((k * 0.7).sin(), (k * 1.3).cos(), (k * 0.37).sin()) * 0.4;
            let found = distance_m(&points, &target);
            assert!((found - box_distance(&target)).abs() < 1e-9, "{target} {found} {}", box_distance(&target));
        }
        for point in &points {
            assert!(distance_m(&points, point) < 1e-12);
        }
    }

    #[test]
    fn distances_from_a_tetrahedron_are_those_from_its_face() {
        let e = Vector3::ith;
        let points = [Vector3::zeros(), e(0, 1.0), e(1, 1.0), e(2, 1.0)];
        let outward = Vector3::new(1.0, 1.0, 1.0) / 3.0_f64.sqrt();
        let target = Vector3::new(1.0, 1.0, 1.0) / 3.0 + outward * 0.25;
        assert!((distance_m(&points, &target) - 0.25).abs() < 1e-12);
        assert_eq!(distance_m(&points, &Vector3::new(0.1, 0.2, 0.3)), 0.0);
        // Nearest is a corner.
        assert!((distance_m(&points, &Vector3::new(3.0, 0.0, 0.0)) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_scatter_holds_all_mixtures_of_its_points_and_no_point_beyond_its_extremes() {
        let points: Vec<Vector3<f64>> = (0..80)
            .map(|k| Vector3::new((f64::from(k) * 1.1).sin(), (f64::from(k) * 2.3).sin(), (f64::from(k) * 3.7).cos()))
            .collect();
        let hull = Hull::new(&points, 1e-9);
        for k in 0..60 {
            let mixture = points[k] * 0.5 + points[(k + 11) % 80] * 0.2 + points[(k * 7 + 3) % 80] * 0.3;
            assert!(distance_m(&points, &mixture) < 1e-9);
            assert!(hull.region(&mixture).is_inside());
            let direction = points[k].normalize();
            let extreme = points.iter().map(|p| p.dot(&direction)).fold(f64::NEG_INFINITY, f64::max);
            // The hull lies behind the plane at `extreme`, so the distance is at least that from the plane.
            assert!(distance_m(&points, &(direction * (extreme + 0.1))) >= 0.1 - 1e-9);
            assert!(!hull.region(&(direction * (extreme + 0.1))).is_inside());
        }
    }
}
