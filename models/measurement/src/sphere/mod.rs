//! Gaussian sphere through measured points: centre, radius and their covariance.
//!
//! Place in the flow: probing test of ISO 10360-5, centres of a scanned reference sphere (Zhang 2016, step 5). Points in,
//! centre and radius out, all in metres in the frame of the points. The squared distances of the points from the surface,
//! (|p − c| − r)², are minimised by Gauss-Newton with Levenberg's damping, from an algebraic start; the radius is free or
//! known. [`SphereFit::without_strays`] leaves out what contradicts all others; [`SphereFit::contradicting`] holds a known radius
//! against what the points tell. Source: Forbes 1991, Least-squares best-fit
//! geometric elements, NPL DITC 140/89.

mod check;
mod error;
mod stray;
mod told;

pub use error::SphereError;
pub use stray::Stray;
pub use told::ToldRadius;

use crate::claim::Claim;
use crate::least_squares;
use nalgebra::{DMatrix, DVector, Matrix4, Vector3, Vector4};

/// Passes after which a fit has not settled.
const MOST_PASSES: usize = 100;
/// What a step changes of the residuals (rms), relative to the distances they are the difference of, from which a fit counts as
/// settled.
const SETTLED: f64 = 1e-14;
/// By how much rounding changes the residuals (rms), relative to the same: no step is turned down for less.
const ROUNDING: f64 = 1e-15;
/// Damping beyond which no smaller step could still reduce the residuals: they are at their least to rounding.
const MOST_DAMPING: f64 = 1e16;

/// What is known of the radius beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SphereRadius {
    /// Nothing: it is fitted.
    Free,
    /// It is calibrated.
    Known {
        /// Calibrated radius (m).
        radius_m: f64,
        /// Its standard uncertainty (m, k = 1), which the centre inherits; 0 for exact.
        u_m: f64,
    },
}

/// A fitted sphere.
#[derive(Debug, Clone, PartialEq)]
pub struct SphereFit {
    /// Centre (m, frame of the points).
    pub centre_m: Vector3<f64>,
    /// Radius, fitted or as given (m).
    pub radius_m: f64,
    /// Distance of each point from the centre less the radius (m), in the order of the points.
    pub residuals_m: Vec<f64>,
    /// Points less unknowns.
    pub degrees_of_freedom: usize,
    /// Standard deviation of the points along the radius from the residuals (m); `None` without degrees of freedom.
    pub scatter_m: Option<f64>,
    /// Covariance of x, y, z, radius (m²), such that ±2u holds the truth with 95.45 %: from the declared uncertainty of a
    /// point, otherwise from the scatter, widened as [`SphereFit::claim`] says; `None` where there is neither.
    pub covariance_m2: Option<Matrix4<f64>>,
    /// What the uncertainty rests on, and by how much it was widened.
    pub claim: Option<Claim>,
    /// Largest over smallest singular value of the design: 1 for points spread evenly over the whole sphere, about 1/θ² for a
    /// cap of half angle θ (rad).
    pub condition: f64,
}

impl SphereFit {
    /// Fits a sphere to points (m). `u_point_m` is the standard uncertainty of a point along the radius where it is known.
    ///
    /// # Errors
    /// Fewer than four points, figures that are not finite, a point given twice, points in a plane or in a cap so flat that a
    /// plane fits them nearly as well, points on no sphere, a radius or an uncertainty that is not positive, a fit that does not settle.
    pub fn new(
        points_m: &[Vector3<f64>],
        radius: SphereRadius,
        u_point_m: Option<f64>,
    ) -> Result<SphereFit, SphereError> {
        check::options(radius, u_point_m)?;
        let fit = |radius| {
            let (cloud, settled) = loose(points_m, radius)?;
            let problem = check::is_sphere(rms(&settled.residuals), settled.sphere.radius, cloud.size_m);
            problem.map(|()| (cloud, settled)).map_err(|problem| named(problem, points_m, radius))
        };
        match (fit(radius), radius) {
            (Ok((cloud, settled)), _) => Ok(outcome(&cloud, &settled, radius, u_point_m)),
            (Err(problem), SphereRadius::Free) => Err(problem),
            // Points that are a sphere, but not of this radius, say so.
            (Err(problem), SphereRadius::Known { radius_m, .. }) => {
                Err(fit(SphereRadius::Free).map_or(problem, |(cloud, free)| {
                    let fitted_mm = free.sphere.radius * cloud.size_m * 1e3;
                    SphereError::OtherRadius { fitted_mm, known_mm: radius_m * 1e3 }
                }))
            }
        }
    }

    /// Largest less smallest distance from the centre (m): form of the sphere as ISO 10360-5 takes it.
    pub fn form_m(&self) -> f64 {
        let (low, high) =
            self.residuals_m.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), r| (l.min(*r), h.max(*r)));
        high - low
    }

    /// Standard uncertainties of x, y, z and radius (m, k = 1).
    pub fn u_m(&self) -> Option<[f64; 4]> {
        let covariance = self.covariance_m2?;
        Some(std::array::from_fn(|k| covariance[(k, k)].max(0.0).sqrt()))
    }
}

/// The best sphere of curved points, whether they lie on one or not.
fn loose(points_m: &[Vector3<f64>], radius: SphereRadius) -> Result<(check::Cloud, Settled), SphereError> {
    let cloud = check::Cloud::new(points_m)?;
    let start = algebraic(&cloud.scaled)?;
    let known = match radius {
        SphereRadius::Free => None,
        SphereRadius::Known { radius_m, .. } => Some(radius_m / cloud.size_m),
    };
    let settled = Geometric { cloud: &cloud, points: &cloud.scaled, known }.settle(start)?;
    cloud.check_curved(rms(&settled.residuals))?;
    Ok((cloud, settled))
}

/// The same problem with the point that makes it, where it is single points.
fn named(problem: SphereError, points_m: &[Vector3<f64>], radius: SphereRadius) -> SphereError {
    let strays = stray::strays(points_m, radius);
    let worst = strays.iter().max_by(|a, b| a.off_m.abs().total_cmp(&b.off_m.abs()));
    worst.map_or(problem, |worst| SphereError::Stray {
        point: worst.point + 1,
        off_mm: worst.off_m * 1e3,
        strays: strays.len(),
    })
}

/// Centre and radius in units of the cloud.
#[derive(Debug, Clone, Copy)]
struct Sphere {
    centre: Vector3<f64>,
    radius: f64,
}

impl Sphere {
    fn residuals(&self, points: &[Vector3<f64>]) -> Vec<f64> {
        points.iter().map(|p| (p - self.centre).norm() - self.radius).collect()
    }
}

/// A fit that has settled, in units of the cloud.
struct Settled {
    sphere: Sphere,
    residuals: Vec<f64>,
    /// (JᵀJ)⁻¹ of the unknowns: centre, and the radius where it is free.
    cofactor: DMatrix<f64>,
    /// Centre by radius, where the radius is known.
    by_radius: Option<Vector3<f64>>,
    condition: f64,
}

/// |p|² = 2 c·p + (r² − |c|²): linear in c and the bracket.
fn algebraic(points: &[Vector3<f64>]) -> Result<Sphere, SphereError> {
    let matrix = DMatrix::from_fn(points.len(), 4, |i, j| if j < 3 { 2.0 * points[i][j] } else { 1.0 });
    let right = DVector::from_fn(points.len(), |i, _| points[i].norm_squared());
    let found = least_squares::solve(&matrix, &right).map_err(|_| SphereError::Coplanar)?.unknowns;
    let centre = Vector3::new(found[0], found[1], found[2]);
    let square = found[3] + centre.norm_squared();
    if square > 0.0 && square.is_finite() {
        Ok(Sphere { centre, radius: square.sqrt() })
    } else {
        Err(SphereError::Coplanar)
    }
}

/// Minimises the squared distances from the surface.
struct Geometric<'a> {
    cloud: &'a check::Cloud,
    points: &'a [Vector3<f64>],
    known: Option<f64>,
}

impl Geometric<'_> {
    fn settle(&self, start: Sphere) -> Result<Settled, SphereError> {
        let mut at = match self.known {
            Some(radius) => self.on_the_same_side(start, radius),
            None => start,
        };
        let (mut residuals, mut damping) = (at.residuals(self.points), 0.0);
        for _ in 0..MOST_PASSES {
            let (matrix, right) = self.linearised(&at, &residuals, damping)?;
            let step = least_squares::solve(&matrix, &right).map_err(|_| SphereError::Coplanar)?.unknowns;
            let next = self.moved(&at, &step);
            let new_residuals = next.residuals(self.points);
            let changed = (&matrix * &step).norm() / (self.points.len() as f64).sqrt();
            if changed <= SETTLED * (1.0 + at.radius) || damping > MOST_DAMPING {
                return self.settled(at, residuals);
            }
            if next.radius > 0.0 && rms(&new_residuals) <= rms(&residuals) + ROUNDING * (1.0 + at.radius) {
                (at, residuals) = (next, new_residuals);
                damping = if damping < 1e-9 { 0.0 } else { damping / 10.0 };
            } else {
                damping = if damping > 0.0 { damping * 10.0 } else { 1e-6 };
            }
        }
        // Points in a plane but for their scatter send the centre ever further away.
        self.cloud.check_curved(rms(&residuals))?;
        Err(SphereError::NotSettled(MOST_PASSES))
    }

    /// The sphere of the known radius that touches the start where the points are.
    fn on_the_same_side(&self, start: Sphere, radius: f64) -> Sphere {
        // The points' centroid is the origin; a whole sphere has it at its own centre, where no direction matters.
        let towards = if start.centre.norm() > 0.0 { start.centre.normalize() } else { Vector3::zeros() };
        let near = start.centre.norm() - start.radius;
        let moved = near + radius;
        let centre = if start.centre.norm() > 0.5 * start.radius { towards * moved } else { start.centre };
        Sphere { centre, radius }
    }

    fn unknowns(&self) -> usize {
        if self.known.is_some() { 3 } else { 4 }
    }

    /// Rows of the step, with damping as further rows.
    fn linearised(
        &self,
        at: &Sphere,
        residuals: &[f64],
        damping: f64,
    ) -> Result<(DMatrix<f64>, DVector<f64>), SphereError> {
        let (count, unknowns) = (self.points.len(), self.unknowns());
        let extra = if damping > 0.0 { unknowns } else { 0 };
        let mut matrix = DMatrix::zeros(count + extra, unknowns);
        let mut right = DVector::zeros(count + extra);
        for (i, point) in self.points.iter().enumerate() {
            let arm = point - at.centre;
            // A point at the centre itself has no direction; its row would be no number.
            let normal = arm.try_normalize(0.0).ok_or(SphereError::NotSettled(MOST_PASSES))?;
            for d in 0..3 {
                matrix[(i, d)] = normal[d];
            }
            if self.known.is_none() {
                matrix[(i, 3)] = 1.0;
            }
            right[i] = residuals[i];
        }
        for k in 0..extra {
            matrix[(count + k, k)] = (damping * count as f64).sqrt();
        }
        Ok((matrix, right))
    }

    fn moved(&self, at: &Sphere, step: &DVector<f64>) -> Sphere {
        let centre = at.centre + Vector3::new(step[0], step[1], step[2]);
        Sphere { centre, radius: self.known.unwrap_or_else(|| at.radius + step[3]) }
    }

    fn settled(&self, sphere: Sphere, residuals: Vec<f64>) -> Result<Settled, SphereError> {
        let (mut matrix, _) = self.linearised(&sphere, &residuals, 0.0)?;
        let ones = DVector::from_element(self.points.len(), -1.0);
        let found = least_squares::solve(&matrix, &ones).map_err(|_| SphereError::Coplanar)?;
        if self.known.is_none() {
            // Evenly spread normals have columns of length √(n/3), the radius one of √n.
            matrix.column_mut(3).scale_mut(3f64.sqrt().recip());
        }
        let values = matrix.qr().r().singular_values();
        let by_radius = self.known.map(|_| found.unknowns.fixed_rows::<3>(0).into_owned());
        let condition = values.max() / values.min();
        Ok(Settled { sphere, residuals, cofactor: found.cofactor, by_radius, condition })
    }
}

fn outcome(cloud: &check::Cloud, settled: &Settled, radius: SphereRadius, u_point_m: Option<f64>) -> SphereFit {
    let size_m = cloud.size_m;
    let residuals_m: Vec<f64> = settled.residuals.iter().map(|r| r * size_m).collect();
    let degrees_of_freedom = residuals_m.len() - settled.cofactor.nrows();
    let scatter_m = (degrees_of_freedom > 0).then(|| (sum(&residuals_m) / degrees_of_freedom as f64).sqrt());
    let claimed = claimed(u_point_m, scatter_m, degrees_of_freedom);
    let covariance_m2 = claimed.map(|(sigma_m, _)| {
        let cofactor = &settled.cofactor;
        let part = |i, j| {
            if i < cofactor.nrows() && j < cofactor.nrows() { cofactor[(i, j)] * sigma_m * sigma_m } else { 0.0 }
        };
        let fitted = Matrix4::from_fn(part);
        match (radius, settled.by_radius) {
            (SphereRadius::Known { u_m, .. }, Some(by)) => {
                let reach = Vector4::new(by.x, by.y, by.z, 1.0) * u_m;
                fitted + reach * reach.transpose()
            }
            _ => fitted,
        }
    });
    let radius_m = match radius {
        SphereRadius::Free => settled.sphere.radius * size_m,
        SphereRadius::Known { radius_m, .. } => radius_m,
    };
    SphereFit {
        centre_m: cloud.centroid_m + settled.sphere.centre * size_m,
        radius_m,
        residuals_m,
        degrees_of_freedom,
        scatter_m,
        covariance_m2,
        claim: claimed.map(|(_, claim)| claim),
        condition: settled.condition,
    }
}

/// Noise of a point (m) that the covariance is computed with.
fn claimed(u_point_m: Option<f64>, scatter_m: Option<f64>, degrees: usize) -> Option<(f64, Claim)> {
    let (noise_m, claim) = match (u_point_m, scatter_m) {
        (Some(u_m), scatter_m) => {
            let chi2_per_dof = scatter_m.map_or(0.0, |scatter_m| (scatter_m / u_m).powi(2));
            (u_m, Claim::declared(chi2_per_dof, degrees))
        }
        (None, Some(scatter_m)) => (scatter_m, Claim::estimated(degrees)?),
        (None, None) => return None,
    };
    Some((noise_m * claim.widening, claim))
}

fn sum(residuals: &[f64]) -> f64 {
    residuals.iter().map(|r| r * r).sum()
}

fn rms(residuals: &[f64]) -> f64 {
    (sum(residuals) / residuals.len() as f64).sqrt()
}

#[cfg(test)]
mod tests;
