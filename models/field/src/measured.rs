//! Error vectors at measured points, checked once.
//!
//! Place in the flow: what every interpolator is made of. Points (m, machine frame), errors = actual − indicated (m) and,
//! where it is known, the standard uncertainty of each component (m, k = 1). A set that no method could use is refused here,
//! with the points named by their index. Points may lie in a plane across one axis, if that is asked for: a plate.

use crate::error::{FieldError, LEAST_POINTS};
use nalgebra::{Matrix3, Vector3};

/// Points nearer to each other than this (m) are the same point: no field changes within a micrometre.
pub const SAME_POINT_M: f64 = 1e-6;
/// Smallest extent of the points over their largest below which they lie in a plane.
const FLAT: f64 = 1e-4;
/// The same for a plate across one axis: what the third coordinate does there is no third dimension.
const PLATE: f64 = 0.01;
/// How far beyond the measured ones a target may lie across the plane (m): a machine stops within tens of micrometres.
const ACROSS_M: f64 = 1e-4;

/// Measured errors of the volume.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredField {
    points_m: Vec<Vector3<f64>>,
    errors_m: Vec<Vector3<f64>>,
    u_m: Option<Vec<Vector3<f64>>>,
    plane: Option<Plane>,
}

/// The plane of a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Axis across it: 0, 1 or 2.
    pub normal: usize,
    /// Smallest and largest coordinate of the points there (m).
    pub across_m: (f64, f64),
}

impl Plane {
    /// Where the points are taken to lie (m).
    pub fn at_m(&self) -> f64 {
        0.5 * (self.across_m.0 + self.across_m.1)
    }

    /// A target in the plane; the distance (m) where it lies beyond.
    pub fn within(&self, target_m: &Vector3<f64>) -> Result<Vector3<f64>, f64> {
        let beyond = |m: f64| (self.across_m.0 - m).max(m - self.across_m.1);
        match beyond(target_m[self.normal]) {
            distance_m if distance_m > ACROSS_M => Err(distance_m),
            _ => {
                let mut within = *target_m;
                within[self.normal] = self.at_m();
                Ok(within)
            }
        }
    }
}

impl MeasuredField {
    /// The same as [`MeasuredField::new`] for points that may also lie in a plane across one axis; they are taken to lie
    /// exactly in it.
    pub fn volume_or_plane(
        mut points_m: Vec<Vector3<f64>>,
        errors_m: Vec<Vector3<f64>>,
        u_m: Option<Vec<Vector3<f64>>>,
    ) -> Result<MeasuredField, FieldError> {
        let Some(plane) = plane_of(&points_m) else { return MeasuredField::new(points_m, errors_m, u_m) };
        points_m.iter_mut().for_each(|point| point[plane.normal] = plane.at_m());
        MeasuredField::checked(points_m, errors_m, u_m, Some(plane))
    }

    /// Points (m, machine frame) with their errors, actual − indicated (m), and the standard uncertainty of each component
    /// (m, k = 1) where it is known.
    pub fn new(
        points_m: Vec<Vector3<f64>>,
        errors_m: Vec<Vector3<f64>>,
        u_m: Option<Vec<Vector3<f64>>>,
    ) -> Result<MeasuredField, FieldError> {
        MeasuredField::checked(points_m, errors_m, u_m, None)
    }

    fn checked(
        points_m: Vec<Vector3<f64>>,
        errors_m: Vec<Vector3<f64>>,
        u_m: Option<Vec<Vector3<f64>>>,
        plane: Option<Plane>,
    ) -> Result<MeasuredField, FieldError> {
        let lengths = |values: usize, what| FieldError::Lengths { points: points_m.len(), values, what };
        if errors_m.len() != points_m.len() {
            return Err(lengths(errors_m.len(), "errors"));
        }
        if let Some(u_m) = &u_m
            && u_m.len() != points_m.len()
        {
            return Err(lengths(u_m.len(), "uncertainties"));
        }
        match plane {
            None => check_points(&points_m)?,
            Some(plane) => check_in_plane(&points_m, plane)?,
        }
        check_finite(&errors_m, "the error")?;
        for (index, u) in u_m.iter().flatten().enumerate() {
            if !u.iter().all(|v| v.is_finite() && *v > 0.0) {
                return Err(FieldError::Uncertainty(index));
            }
        }
        Ok(MeasuredField { points_m, errors_m, u_m, plane })
    }

    /// Measured points (m, machine frame).
    pub fn points_m(&self) -> &[Vector3<f64>] {
        &self.points_m
    }

    /// Error at each point, actual − indicated (m).
    pub fn errors_m(&self) -> &[Vector3<f64>] {
        &self.errors_m
    }

    /// Standard uncertainty of each error (m, k = 1), where it is known.
    pub fn u_m(&self) -> Option<&[Vector3<f64>]> {
        self.u_m.as_deref()
    }

    /// The plane that the points lie in, where they are those of a plate.
    pub fn plane(&self) -> Option<Plane> {
        self.plane
    }

    /// The same points with other errors (m).
    pub fn with_errors(&self, errors_m: Vec<Vector3<f64>>) -> Result<MeasuredField, FieldError> {
        MeasuredField::checked(self.points_m.clone(), errors_m, self.u_m.clone(), self.plane)
    }

    /// Points with their errors (m) at these indices, which must be those of points.
    pub fn pairs(&self, indices: &[usize]) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let pair = |k: &usize| self.points_m.get(*k).copied().zip(self.errors_m.get(*k).copied());
        indices.iter().filter_map(pair).collect()
    }

    /// The points at these indices as a field of their own; indices must be those of points.
    pub fn part(&self, indices: &[usize]) -> Result<MeasuredField, FieldError> {
        let pick = |list: &[Vector3<f64>]| indices.iter().filter_map(|k| list.get(*k)).copied().collect::<Vec<_>>();
        let u_m = self.u_m.as_deref().map(pick);
        MeasuredField::checked(pick(&self.points_m), pick(&self.errors_m), u_m, self.plane)
    }
}

/// The plane across one axis in which all points lie, if they do.
fn plane_of(points_m: &[Vector3<f64>]) -> Option<Plane> {
    let first = points_m.first()?;
    let fold = |pick: fn(f64, f64) -> f64| points_m.iter().fold(*first, |e, p| e.zip_map(p, pick));
    let (lower, upper) = (fold(f64::min), fold(f64::max));
    let extent = upper - lower;
    let normal = (0..3).min_by(|a, b| extent[*a].total_cmp(&extent[*b]))?;
    let is_flat = extent.iter().all(|m| m.is_finite()) && extent[normal] <= PLATE * extent.max();
    is_flat.then_some(Plane { normal, across_m: (lower[normal], upper[normal]) })
}

/// Refuses points of a plane that are too few, no numbers, the same, or on a line.
fn check_in_plane(points_m: &[Vector3<f64>], plane: Plane) -> Result<(), FieldError> {
    check_list(points_m)?;
    // Beside themselves at another height they fill a volume, unless they lie on a line.
    let lifted = lifted(points_m, plane);
    if is_flat(&lifted) { Err(FieldError::Line) } else { Ok(()) }
}

/// The points of a plane twice, on either side of it and as far from it as they extend.
pub(crate) fn lifted(points_m: &[Vector3<f64>], plane: Plane) -> Vec<Vector3<f64>> {
    let at = |axis: usize| points_m.iter().map(move |p| p[axis]);
    let extent = |axis: usize| at(axis).fold(f64::NEG_INFINITY, f64::max) - at(axis).fold(f64::INFINITY, f64::min);
    let height_m = (0..3).filter(|axis| *axis != plane.normal).map(extent).fold(0.0, f64::max);
    let moved = |by_m: f64| {
        points_m.iter().map(move |p| {
            let mut moved = *p;
            moved[plane.normal] = plane.at_m() + by_m;
            moved
        })
    };
    moved(-height_m).chain(moved(height_m)).collect()
}

/// Refuses points that are too few, no numbers, the same, or without volume.
pub(crate) fn check_points(points_m: &[Vector3<f64>]) -> Result<(), FieldError> {
    check_list(points_m)?;
    if is_flat(points_m) { Err(FieldError::Flat) } else { Ok(()) }
}

fn check_list(points_m: &[Vector3<f64>]) -> Result<(), FieldError> {
    if points_m.len() < LEAST_POINTS {
        return Err(FieldError::TooFew(points_m.len()));
    }
    check_finite(points_m, "a coordinate")?;
    if let Some((first, second)) = duplicate(points_m) {
        return Err(FieldError::Duplicate { first, second });
    }
    Ok(())
}

fn check_finite(list: &[Vector3<f64>], what: &'static str) -> Result<(), FieldError> {
    match list.iter().position(|v| v.iter().any(|c| !c.is_finite())) {
        Some(index) => Err(FieldError::NotFinite { index, what }),
        None => Ok(()),
    }
}

/// Two points that are the same; sorted by x, only neighbours in x are compared.
fn duplicate(points_m: &[Vector3<f64>]) -> Option<(usize, usize)> {
    let mut order: Vec<usize> = (0..points_m.len()).collect();
    order.sort_by(|a, b| points_m[*a].x.total_cmp(&points_m[*b].x).then(a.cmp(b)));
    for (place, one) in order.iter().enumerate() {
        let near = order[place + 1..].iter().take_while(|k| points_m[**k].x - points_m[*one].x < SAME_POINT_M);
        for other in near {
            if (points_m[*one] - points_m[*other]).norm() < SAME_POINT_M {
                return Some((*one.min(other), *one.max(other)));
            }
        }
    }
    None
}

/// Whether the smallest principal extent vanishes beside the largest.
fn is_flat(points_m: &[Vector3<f64>]) -> bool {
    let mean = points_m.iter().sum::<Vector3<f64>>() / points_m.len() as f64;
    let spread: Matrix3<f64> = points_m.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    let eigen = spread.symmetric_eigenvalues();
    eigen.min() <= FLAT * FLAT * eigen.max()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A lattice of that many points an axis and that step (m), x fastest.
    pub(crate) fn lattice(counts: [usize; 3], step_m: f64) -> Vec<Vector3<f64>> {
        let [nx, ny, nz] = counts;
        let at = |k: usize| Vector3::new((k % nx) as f64, (k / nx % ny) as f64, (k / nx / ny) as f64) * step_m;
        (0..nx * ny * nz).map(at).collect()
    }

    #[test]
    fn points_that_make_no_field_are_refused_by_name() {
        let good = lattice([3, 3, 3], 0.1);
        let zeros = |n: usize| vec![Vector3::zeros(); n];
        assert_eq!(check_points(&good[..7]), Err(FieldError::TooFew(7)));
        assert_eq!(check_points(&good[..9]), Err(FieldError::Flat));
        let line: Vec<_> = (0..10).map(|k| Vector3::new(f64::from(k), 2.0 * f64::from(k), 0.0)).collect();
        assert_eq!(check_points(&line), Err(FieldError::Flat));
        let mut twice = good.clone();
        twice[20] = twice[4] + Vector3::new(0.0, 0.5e-6, 0.0);
        assert_eq!(check_points(&twice), Err(FieldError::Duplicate { first: 4, second: 20 }));
        let mut broken = good.clone();
        broken[5].z = f64::NAN;
        assert_eq!(check_points(&broken), Err(FieldError::NotFinite { index: 5, what: "a coordinate" }));
        let lengths = FieldError::Lengths { points: 27, values: 26, what: "errors" };
        assert_eq!(MeasuredField::new(good.clone(), zeros(26), None), Err(lengths));
        let mut errors = zeros(27);
        errors[3].x = f64::INFINITY;
        let infinite = FieldError::NotFinite { index: 3, what: "the error" };
        assert_eq!(MeasuredField::new(good.clone(), errors, None), Err(infinite));
        assert_eq!(MeasuredField::new(good, zeros(27), Some(zeros(27))), Err(FieldError::Uncertainty(0)));
    }
}
