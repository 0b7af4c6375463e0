//! What points a sphere can be fitted to.
//!
//! Place in the flow: before and after the fit of [`super::SphereFit`]. Points (m) in, the same about their centroid and in
//! units of their extent out.

use super::{SphereError, SphereRadius};
use nalgebra::{DMatrix, Vector3};

const FEWEST: usize = 4;
/// Thickness of the cloud, relative to its extent, below which the points lie in a plane to rounding.
const FLAT: f64 = 1e-9;
/// How much worse than the sphere a plane must fit: below, radius and centre along the normal are guesses.
const CURVED: f64 = 2.0;
/// Root mean square distance from the sphere, in radii, beyond which the points are on none: a column in another unit, another
/// body. The roughest scan of a ball of 25 mm leaves a tenth of a millimetre, 0.8 %.
const NO_SPHERE: f64 = 0.02;

/// Points about their centroid in units of their extent.
pub(super) struct Cloud {
    pub(super) centroid_m: Vector3<f64>,
    /// Root mean square distance from the centroid (m).
    pub(super) size_m: f64,
    pub(super) scaled: Vec<Vector3<f64>>,
    /// Root mean square distance from the best plane, in units of the extent.
    from_plane: f64,
}

impl Cloud {
    pub(super) fn new(points_m: &[Vector3<f64>]) -> Result<Cloud, SphereError> {
        if points_m.len() < FEWEST {
            return Err(SphereError::TooFew(points_m.len()));
        }
        if let Some(k) = points_m.iter().position(|p| p.iter().any(|v| !v.is_finite())) {
            return Err(SphereError::NotFinite(k + 1));
        }
        if let Some((first, second)) = duplicates(points_m) {
            return Err(SphereError::Duplicate { first: first + 1, second: second + 1 });
        }
        let count = points_m.len() as f64;
        let centroid_m = points_m.iter().sum::<Vector3<f64>>() / count;
        let size_m = (points_m.iter().map(|p| (p - centroid_m).norm_squared()).sum::<f64>() / count).sqrt();
        if !(size_m > 0.0 && size_m.is_finite()) {
            return Err(SphereError::Coplanar);
        }
        let scaled: Vec<Vector3<f64>> = points_m.iter().map(|p| (p - centroid_m) / size_m).collect();
        // Singular values of the points themselves: those of their squares would lose half of the digits.
        let spread = DMatrix::from_fn(scaled.len(), 3, |i, d| scaled[i][d]).qr().r().singular_values();
        let from_plane = spread.min() / count.sqrt();
        if from_plane < FLAT {
            Err(SphereError::Coplanar)
        } else {
            Ok(Cloud { centroid_m, size_m, scaled, from_plane })
        }
    }

    /// Refuses points that a plane fits nearly as well as the sphere; `rms` is what the sphere leaves, in units of the extent.
    pub(super) fn check_curved(&self, rms: f64) -> Result<(), SphereError> {
        if self.from_plane > CURVED * rms {
            return Ok(());
        }
        Err(SphereError::Flat { plane_um: self.from_plane * self.size_m * 1e6, sphere_um: rms * self.size_m * 1e6 })
    }
}

/// Refuses points that no sphere fits; both in the same unit.
pub(super) fn is_sphere(rms: f64, radius: f64, size_m: f64) -> Result<(), SphereError> {
    if rms <= NO_SPHERE * radius {
        return Ok(());
    }
    Err(SphereError::NoSphere { rms_mm: rms * size_m * 1e3, radius_mm: radius * size_m * 1e3 })
}

/// Two points with the same coordinates; copied rows, not measurements.
fn duplicates(points_m: &[Vector3<f64>]) -> Option<(usize, usize)> {
    let mut order: Vec<usize> = (0..points_m.len()).collect();
    // −0 and 0 are one coordinate, but not to a total order.
    let key = |k: usize| points_m[k].map(|v| v + 0.0);
    order.sort_by(|a, b| {
        let (p, q) = (key(*a), key(*b));
        p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).then(p.z.total_cmp(&q.z)).then(a.cmp(b))
    });
    order.windows(2).find(|pair| points_m[pair[0]] == points_m[pair[1]]).map(|pair| (pair[0], pair[1]))
}

/// Refuses a radius or an uncertainty that cannot be.
pub(super) fn options(radius: SphereRadius, u_point_m: Option<f64>) -> Result<(), SphereError> {
    if let SphereRadius::Known { radius_m, u_m } = radius {
        let is_length = radius_m.is_finite() && radius_m > 0.0;
        let is_uncertainty = u_m.is_finite() && u_m >= 0.0;
        if !(is_length && is_uncertainty) {
            return Err(SphereError::Radius);
        }
    }
    match u_point_m {
        Some(u_m) if !(u_m.is_finite() && u_m > 0.0) => Err(SphereError::Uncertainty),
        _ => Ok(()),
    }
}
