//! Radial basis functions with a linear polynomial.
//!
//! Place in the flow: measured errors in, the smoothest field of its kind through them out: Σ w_i φ(|p − p_i|) + linear,
//! with Σ w_i = 0 and Σ w_i p_i = 0. Smoothing adds to the diagonal and lets the field pass beside noisy errors. Lengths are
//! in extents of the points. Source: Wendland 2005, Scattered Data Approximation, ch. 8; Wahba 1990 for smoothing.

use crate::cells::PLANE_TOLERANCE_M;
use crate::hull::Hull;
use crate::interpolator::{Estimate, Interpolator, Unanswered, finite};
use crate::measured::MeasuredField;
use faer::Mat;
use faer::linalg::solvers::Solve;
use nalgebra::Vector3;
use thiserror::Error;

/// Functions of the linear polynomial.
const POLYNOMIAL: usize = 4;
/// How far the solution may miss its equations, relative to the errors.
const RESIDUAL: f64 = 1e-6;

/// Radial function of distance r; both are conditionally positive definite beside a linear polynomial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Radial {
    /// r² ln r: thin plate.
    ThinPlate,
    /// r³: the cubic spline's counterpart in space.
    Cubic,
}

impl Radial {
    fn value(self, r: f64) -> f64 {
        match self {
            Radial::ThinPlate if r == 0.0 => 0.0,
            Radial::ThinPlate => r * r * r.ln(),
            Radial::Cubic => r * r * r,
        }
    }
}

/// Why there is no such field; the text says what to do.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum RbfError {
    /// A smoothing that is none.
    #[error("the smoothing {0} is not zero or above")]
    Smoothing(f64),
    /// No accurate solution.
    #[error("the equations of the radial functions have no accurate solution; remove points that nearly coincide")]
    Singular,
}

/// A field by radial basis functions.
#[derive(Debug, Clone)]
pub struct Rbf {
    points: Vec<Vector3<f64>>,
    weights_m: Vec<Vector3<f64>>,
    polynomial_m: [Vector3<f64>; POLYNOMIAL],
    radial: Radial,
    middle_m: Vector3<f64>,
    extent_m: f64,
    hull: Hull,
}

impl Rbf {
    /// Field through the measured errors, or beside them with a smoothing above zero.
    pub fn new(field: &MeasuredField, radial: Radial, smoothing: f64) -> Result<Rbf, RbfError> {
        if !(smoothing.is_finite() && smoothing >= 0.0) {
            return Err(RbfError::Smoothing(smoothing));
        }
        let points_m = field.points_m();
        let extreme = |pick: fn(f64, f64) -> f64| points_m.iter().skip(1).fold(points_m[0], |e, p| e.zip_map(p, pick));
        let (lower, upper) = (extreme(f64::min), extreme(f64::max));
        let (middle_m, extent_m) = ((lower + upper) / 2.0, (upper - lower).max() / 2.0);
        // (lower + upper)/2 of equal coordinates is that coordinate, so that across a plane all points are at zero.
        let points: Vec<_> = points_m.iter().map(|p| (p - middle_m) / extent_m).collect();
        let solution = solve(&points, field.errors_m(), radial, smoothing)?;
        let row = |k: usize| Vector3::new(solution[(k, 0)], solution[(k, 1)], solution[(k, 2)]);
        let count = points.len();
        Ok(Rbf {
            weights_m: (0..count).map(row).collect(),
            polynomial_m: [0, 1, 2, 3].map(|k| row(count + k)),
            points,
            radial,
            middle_m,
            extent_m,
            hull: Hull::new(points_m, PLANE_TOLERANCE_M),
        })
    }
}

impl Interpolator for Rbf {
    fn at(&self, point_m: &Vector3<f64>) -> Result<Estimate, Unanswered> {
        finite(point_m)?;
        let point = (point_m - self.middle_m) / self.extent_m;
        let [constant, x, y, z] = self.polynomial_m;
        let mut error_m = constant + x * point.x + y * point.y + z * point.z;
        for (other, weight) in self.points.iter().zip(&self.weights_m) {
            error_m += weight * self.radial.value((point - other).norm());
        }
        Ok(Estimate { error_m, u_m: None, region: self.hull.region(point_m) })
    }
}

/// Weights and polynomial (n + 4 rows, one column a component).
fn solve(
    points: &[Vector3<f64>],
    errors_m: &[Vector3<f64>],
    radial: Radial,
    smoothing: f64,
) -> Result<Mat<f64>, RbfError> {
    let count = points.len();
    let polynomial = |k: usize, j: usize| if j == 0 { 1.0 } else { points[k][j - 1] };
    let matrix = Mat::from_fn(count + POLYNOMIAL, count + POLYNOMIAL, |i, j| match (i < count, j < count) {
        (true, true) if i == j => smoothing,
        (true, true) => radial.value((points[i] - points[j]).norm()),
        (true, false) => polynomial(i, j - count),
        (false, true) => polynomial(j, i - count),
        // Across a plane all points are the same: no slope.
        (false, false) if i == j && i > count && points.iter().all(|p| p[i - count - 1] == 0.0) => 1.0,
        (false, false) => 0.0,
    });
    let right = Mat::from_fn(count + POLYNOMIAL, 3, |i, d| if i < count { errors_m[i][d] } else { 0.0 });
    let solution = matrix.partial_piv_lu().solve(&right);
    // Row by row: a product of matrices leaves the vector registers in a state in which logarithms take twenty times as long.
    let largest = errors_m.iter().map(|e| e.amax()).fold(0.0, f64::max);
    let missed = |i: usize, d: usize| {
        let sum: f64 = (0..count + POLYNOMIAL).map(|j| matrix[(j, i)] * solution[(j, d)]).sum(); // it is symmetric
        (sum - right[(i, d)]).abs()
    };
    let solved = (0..count + POLYNOMIAL).all(|i| (0..3).all(|d| missed(i, d) <= RESIDUAL * largest));
    if solved { Ok(solution) } else { Err(RbfError::Singular) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::Region;
    use crate::measured::tests::lattice;

    fn scatter(count: usize) -> Vec<Vector3<f64>> {
        let wave = |k: usize, f: f64| (k as f64 * f).sin() * 0.5;
        (0..count).map(|k| Vector3::new(wave(k, 1.1), wave(k, 2.3), wave(k, 3.7))).collect()
    }

    /// A smooth field (m).
    fn smooth(p: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new((3.0 * p.x).sin(), p.y * p.z, (2.0 * p.z).cos() * p.x) * 5e-6
    }

    fn of(points: Vec<Vector3<f64>>, radial: Radial, smoothing: f64, f: fn(&Vector3<f64>) -> Vector3<f64>) -> Rbf {
        let errors = points.iter().map(f).collect();
        Rbf::new(&MeasuredField::new(points, errors, None).unwrap(), radial, smoothing).unwrap()
    }

    #[test]
    fn measured_errors_are_met_and_a_linear_field_everywhere() {
        let linear = |p: &Vector3<f64>| Vector3::new(1.0 + p.x, p.y - 2.0 * p.z, p.x + p.y + p.z) * 1e-6;
        for radial in [Radial::ThinPlate, Radial::Cubic] {
            let field = of(scatter(60), radial, 0.0, smooth);
            for point in scatter(60) {
                assert!((field.at(&point).unwrap().error_m - smooth(&point)).norm() < 1e-14);
            }
            let field = of(scatter(60), radial, 0.0, linear);
            let far = Vector3::new(3.0, -2.0, 1.0);
            let found = field.at(&far).unwrap();
            assert!((found.error_m - linear(&far)).norm() < 1e-14 && !found.region.is_inside());
        }
    }

    #[test]
    fn a_smooth_field_is_met_between_its_points() {
        let inside = Vector3::new(0.05, -0.13, 0.11);
        let field =
            of(lattice([6, 6, 6], 0.2).iter().map(|p| p - Vector3::repeat(0.5)).collect(), Radial::Cubic, 0.0, smooth);
        let found = field.at(&inside).unwrap();
        assert_eq!(found.region, Region::Inside);
        assert!((found.error_m - smooth(&inside)).norm() < 0.05e-6, "{}", found.error_m - smooth(&inside));
    }

    #[test]
    fn a_large_smoothing_leaves_the_linear_part() {
        let bumpy = |p: &Vector3<f64>| Vector3::repeat(2.0 * p.x + 0.1 * (40.0 * p.y).sin()) * 1e-6;
        let field = of(scatter(200), Radial::Cubic, 1e6, bumpy);
        let slope = field.at(&Vector3::new(0.4, 0.0, 0.0)).unwrap().error_m.x
            - field.at(&Vector3::new(-0.4, 0.0, 0.0)).unwrap().error_m.x;
        assert!((slope - 1.6e-6).abs() < 0.05e-6, "{slope}");
    }

    #[test]
    fn what_makes_no_field_is_refused() {
        let points = scatter(20);
        let errors = points.iter().map(smooth).collect();
        let field = MeasuredField::new(points, errors, None).unwrap();
        assert_eq!(Rbf::new(&field, Radial::Cubic, -1.0).unwrap_err(), RbfError::Smoothing(-1.0));
        let none = of(scatter(20), Radial::Cubic, 0.0, smooth).at(&Vector3::new(f64::NAN, 0.0, 0.0));
        assert_eq!(none, Err(Unanswered::NotFinite));
    }
}
