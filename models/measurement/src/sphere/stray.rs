//! Points that contradict the sphere on which all others lie.
//!
//! Place in the flow: before a sphere is used as a position. Squares give one point that is a millimetre off a 25th of the
//! result. So the point that its own fit without it explains worst is taken out, again and again, and those count as strays that
//! lie clearly off the sphere of the rest. A rough surface has none.

use super::{Settled, SphereError, SphereFit, SphereRadius, loose};
use nalgebra::{DVector, Vector3};

/// Expected deviations of a point left out from which it is a stray. With [`FEWEST_LEFT`] degrees of freedom a sound point is as
/// far off with a probability of 2·10⁻⁴ (Student), with more of them never.
const CLEAR: f64 = 10.0;
/// Degrees of freedom that must be left, to know the deviation of the rest.
const FEWEST_LEFT: usize = 5;
/// Strays at most, and at most a fifth of the points: more of them are no strays.
const MOST: usize = 10;
const MOST_SHARE: usize = 5;
/// What lies nearer than this is on the sphere (m): no coordinate resolves it.
const RESOLVED_M: f64 = 1e-9;

/// A point that is not on the sphere of the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stray {
    /// Its place among the points, from 0.
    pub point: usize,
    /// Its distance from that sphere, positive outside (m).
    pub off_m: f64,
}

impl SphereFit {
    /// The sphere without the points that contradict it, and these points in their order; residuals are of the others.
    ///
    /// # Errors
    /// As for [`SphereFit::new`].
    pub fn without_strays(
        points_m: &[Vector3<f64>],
        radius: SphereRadius,
        u_point_m: Option<f64>,
    ) -> Result<(SphereFit, Vec<Stray>), SphereError> {
        let strays = strays(points_m, radius);
        if strays.is_empty() {
            return Ok((SphereFit::new(points_m, radius, u_point_m)?, strays));
        }
        let is_kept = |k: &usize| strays.iter().all(|stray| stray.point != *k);
        let kept: Vec<Vector3<f64>> = (0..points_m.len()).filter(is_kept).map(|k| points_m[k]).collect();
        Ok((SphereFit::new(&kept, radius, u_point_m)?, strays))
    }
}

/// The strays among these points, in their order.
pub(super) fn strays(points_m: &[Vector3<f64>], radius: SphereRadius) -> Vec<Stray> {
    let unknowns = if radius == SphereRadius::Free { 4 } else { 3 };
    let most = MOST.min(points_m.len() / MOST_SHARE).min(points_m.len().saturating_sub(unknowns + FEWEST_LEFT));
    let mut kept: Vec<usize> = (0..points_m.len()).collect();
    let (mut removed, mut found) = (Vec::new(), Vec::new());
    let fit = |kept: &[usize]| Left::new(&kept.iter().map(|k| points_m[*k]).collect::<Vec<_>>(), radius);
    let mut left = if most > 0 { fit(&kept) } else { None };
    while let Some(sphere) = left.filter(|_| removed.len() < most) {
        let badness = |k: usize| sphere.badness(&points_m[kept[k]]);
        let worst = (0..kept.len()).max_by(|a, b| badness(*a).total_cmp(&badness(*b)));
        removed.extend(worst.map(|worst| kept.remove(worst)));
        left = fit(&kept);
        let Some(rest) = &left else { break };
        let strays: Option<Vec<Stray>> = removed.iter().map(|k| rest.stray(*k, &points_m[*k])).collect();
        found = strays.unwrap_or(found);
    }
    found.sort_by_key(|stray| stray.point);
    found
}

/// The sphere of some of the points, in units of their cloud.
struct Left {
    settled: Settled,
    centroid_m: Vector3<f64>,
    size_m: f64,
    /// Mean square of the residuals by degrees of freedom.
    variance: f64,
}

impl Left {
    fn new(points_m: &[Vector3<f64>], radius: SphereRadius) -> Option<Left> {
        let (cloud, settled) = loose(points_m, radius).ok()?;
        let freedom = points_m.len().checked_sub(settled.cofactor.nrows()).filter(|freedom| *freedom > 0)?;
        let variance = super::sum(&settled.residuals) / freedom as f64;
        Some(Left { settled, centroid_m: cloud.centroid_m, size_m: cloud.size_m, variance })
    }

    /// Distance of a point from the sphere, and how much of the noise in it the fit has to itself.
    fn off(&self, point_m: &Vector3<f64>) -> (f64, f64) {
        let arm = (point_m - self.centroid_m) / self.size_m - self.settled.sphere.centre;
        let distance = arm.norm();
        let cofactor = &self.settled.cofactor;
        let row = DVector::from_fn(cofactor.nrows(), |k, _| if k < 3 { arm[k] / distance } else { 1.0 });
        (distance - self.settled.sphere.radius, row.dot(&(cofactor * &row)))
    }

    /// What leaving a point of the fit out takes off the sum of squares.
    fn badness(&self, point_m: &Vector3<f64>) -> f64 {
        let (off, leverage) = self.off(point_m);
        off * off / (1.0 - leverage).max(f64::EPSILON)
    }

    /// A point that was left out, where it is clearly off the sphere.
    fn stray(&self, point: usize, point_m: &Vector3<f64>) -> Option<Stray> {
        let (off, leverage) = self.off(point_m);
        let off_m = off * self.size_m;
        let clear = off * off > CLEAR * CLEAR * self.variance * (1.0 + leverage) && off_m.abs() > RESOLVED_M;
        clear.then_some(Stray { point, off_m })
    }
}
