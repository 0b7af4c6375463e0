//! Least-squares sphere: the one with the smallest sum of squared distances of the points from its surface.
//!
//! Place in the flow: for [`super::evaluate`]. Points in any Cartesian frame (m); centre and radius (m) out. A linear fit
//! of |p|² = 2 p·c + k gives the start, Gauss-Newton on |p − c| − r the Gaussian associated feature of ISO 10360-6.

use crate::error::ConformityError;
use nalgebra::{Matrix4, SymmetricEigen, Vector3, Vector4};

/// A sphere needs four points; one more leaves something to judge.
const LEAST_POINTS: usize = 5;
/// Smallest eigenvalue of the normal matrix of unit normals, as a share of the number of points: below, the points lie on
/// so small a cap (or a plane, or a line) that centre and radius cannot be told apart. A cap of 20° has 1e-4.
const LEAST_EIGENVALUE: f64 = 1e-5;
/// Gauss-Newton settles in a handful of steps from the linear start.
const MOST_STEPS: usize = 50;
/// A step below this share of the radius is none.
const SETTLED: f64 = 1e-14;

/// A sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre (m).
    pub centre_m: Vector3<f64>,
    /// Radius (m).
    pub radius_m: f64,
}

/// The least-squares sphere of some points (m).
///
/// # Errors
/// Fewer than five points, points that are no numbers, on a line, in a plane or on one side only; a fit that does not
/// settle.
pub fn fit_sphere(points_m: &[Vector3<f64>]) -> Result<Sphere, ConformityError> {
    let wrong = |problem: &str, remedy: &str| Err(ConformityError::new("test sphere", problem, remedy));
    if points_m.len() < LEAST_POINTS {
        let problem = format!("{} points do not show the form of a sphere", points_m.len());
        return wrong(&problem, "probe 25 points over a hemisphere");
    }
    if points_m.iter().any(|p| p.iter().any(|v| !v.is_finite())) {
        return wrong("a coordinate is not a finite number", "correct or remove that point");
    }
    let mut sphere = linear(points_m)?;
    for _ in 0..MOST_STEPS {
        let step = gauss_newton_step(points_m, &sphere)?;
        sphere.centre_m += step.xyz();
        sphere.radius_m += step.w;
        if step.amax() <= SETTLED * sphere.radius_m.abs().max(sphere.centre_m.amax()) {
            return Ok(sphere);
        }
    }
    wrong("the fit does not settle", "check the points: are they on one sphere?")
}

/// Solves |p − m|² = 2 (p − m)·c + k around the mean m, in units of the points' size.
fn linear(points_m: &[Vector3<f64>]) -> Result<Sphere, ConformityError> {
    let mean_m = points_m.iter().sum::<Vector3<f64>>() / points_m.len() as f64;
    let size_m = points_m.iter().map(|p| (p - mean_m).norm()).fold(0.0, f64::max);
    if size_m == 0.0 {
        return Err(flat());
    }
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for point in points_m {
        let q = (point - mean_m) / size_m;
        let row = Vector4::new(2.0 * q.x, 2.0 * q.y, 2.0 * q.z, 1.0);
        normal += row * row.transpose();
        right += row * q.norm_squared();
    }
    // Points in a plane leave the centre free across it: no curvature is seen in that direction.
    let eigen = SymmetricEigen::new(normal / points_m.len() as f64);
    if eigen.eigenvalues.min() < LEAST_EIGENVALUE * eigen.eigenvalues.max() {
        return Err(flat());
    }
    let solution = normal.cholesky().ok_or_else(flat)?.solve(&right);
    let centre = solution.xyz();
    let squared = solution.w + centre.norm_squared();
    if !(squared.is_finite() && squared > 0.0) {
        return Err(flat());
    }
    Ok(Sphere { centre_m: mean_m + centre * size_m, radius_m: squared.sqrt() * size_m })
}

fn gauss_newton_step(points_m: &[Vector3<f64>], sphere: &Sphere) -> Result<Vector4<f64>, ConformityError> {
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for point in points_m {
        let from = point - sphere.centre_m;
        let distance_m = from.norm();
        if distance_m == 0.0 {
            return Err(flat());
        }
        // A centre that moves towards the point brings it nearer, a larger radius too.
        let row = (from / distance_m).push(1.0);
        normal += row * row.transpose();
        right += row * (distance_m - sphere.radius_m);
    }
    let eigen = SymmetricEigen::new(normal / points_m.len() as f64);
    if eigen.eigenvalues.min() < LEAST_EIGENVALUE {
        return Err(flat());
    }
    Ok(normal.cholesky().ok_or_else(flat)?.solve(&right))
}

fn flat() -> ConformityError {
    ConformityError::new(
        "test sphere",
        "the points lie on a line, in a plane or on so small a cap that centre and radius cannot be told apart",
        "probe points over a hemisphere",
    )
}
