//! Whether a point lies among the calibrated ones.
//!
//! Place in the flow: the `inside` flag of a prediction. A point with a calibrated point in each octant around it lies in
//! their convex hull (any plane through it has one on either side): the search of the cell says so for most points. For
//! the others the hull is bounded by its supporting planes in many directions, the axes among them: exact for a box,
//! and at an oblique edge outside by a few thousandths of the volume at most. (The hull of `abbe_field` is exact everywhere; it
//! searches, and takes memory, which a live node must not.)

use nalgebra::Vector3;

/// Directions beside the axes, spread over the half sphere.
const DIRECTIONS: usize = 125;
/// Distance beyond a plane that still counts as inside (m): a machine stops within tens of micrometres of where it is sent.
const TOLERANCE_M: f64 = 1e-4;

/// Supporting planes of the calibrated points.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SupportingPlanes {
    /// Direction, least and largest coordinate along it (m).
    planes: Vec<(Vector3<f64>, f64, f64)>,
}

impl SupportingPlanes {
    pub(crate) fn new(points_m: &[Vector3<f64>]) -> SupportingPlanes {
        let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
        let spread = |k: usize| {
            let z = (k as f64 + 0.5) / DIRECTIONS as f64;
            let (angle, radius) = (2.0 * std::f64::consts::PI * k as f64 / golden, (1.0 - z * z).sqrt());
            Vector3::new(radius * angle.cos(), radius * angle.sin(), z)
        };
        let axes = (0..3).map(|axis| Vector3::ith(axis, 1.0));
        let plane = |direction: Vector3<f64>| {
            let along = points_m.iter().map(|p| direction.dot(p));
            let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), a| (l.min(a), h.max(a)));
            (direction, low - TOLERANCE_M, high + TOLERANCE_M)
        };
        SupportingPlanes { planes: axes.chain((0..DIRECTIONS).map(spread)).map(plane).collect() }
    }

    /// Whether no supporting plane separates the point (m) from the calibrated ones; false for what is no number.
    pub(crate) fn holds(&self, point_m: &Vector3<f64>) -> bool {
        self.planes.iter().all(|(direction, low, high)| (*low..=*high).contains(&direction.dot(point_m)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_holds_its_faces_and_nothing_beyond() {
        let corner = |k: usize| Vector3::from_fn(|a, _| [0.8, 0.6, 0.4][a] * (k >> a & 1) as f64);
        let planes = SupportingPlanes::new(&(0..8).map(corner).collect::<Vec<_>>());
        for inside in [[0.0, 0.0, 0.0], [0.8, 0.3, 0.4], [0.4, 0.3, 0.2]] {
            assert!(planes.holds(&Vector3::from(inside)), "{inside:?}");
        }
        for outside in [[-0.001, 0.3, 0.2], [0.4, 0.601, 0.2], [0.4, 0.3, 0.41], [f64::NAN, 0.3, 0.2]] {
            assert!(!planes.holds(&Vector3::from(outside)), "{outside:?}");
        }
    }

    #[test]
    fn beyond_the_oblique_face_of_a_tetrahedron_is_outside() {
        let planes = SupportingPlanes::new(&[Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z()]);
        assert!(planes.holds(&Vector3::repeat(0.33)));
        assert!(!planes.holds(&Vector3::repeat(0.36)));
    }
}
