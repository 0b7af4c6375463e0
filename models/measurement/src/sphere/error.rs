//! Why no sphere is fitted, and what to do.
//!
//! Place in the flow: returned by [`super::SphereFit::new`]. Points are counted from 1.

use thiserror::Error;

/// Points without a sphere.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum SphereError {
    /// Four points fix a sphere.
    #[error("{0} points do not fix a sphere; measure at least 4 that are not in one plane")]
    TooFew(usize),
    /// A coordinate is not finite.
    #[error("point {0} holds a coordinate that is not a finite number; correct or remove it")]
    NotFinite(usize),
    /// A point given twice.
    #[error("points {first} and {second} have the same coordinates; remove the copy")]
    Duplicate {
        /// The earlier one.
        first: usize,
        /// The later one.
        second: usize,
    },
    /// All points in one plane.
    #[error("the points lie in one plane and fix no sphere; measure around the sphere and at its pole")]
    Coplanar,
    /// A cap so flat that the scatter hides its curvature.
    #[error(
        "the points are {plane_um:.3} µm rms from a plane and {sphere_um:.3} µm rms from the sphere: too flat a cap to tell \
         its radius; measure a larger part of the sphere"
    )]
    Flat {
        /// What a plane leaves (µm).
        plane_um: f64,
        /// What the sphere leaves (µm).
        sphere_um: f64,
    },
    /// No sphere at all.
    #[error(
        "the points lie {rms_mm:.4} mm rms from the best sphere, of radius {radius_mm:.4} mm: that is none; check that x_mm, y_mm and \
         z_mm have one unit, and that all points are of one sphere"
    )]
    NoSphere {
        /// What the best sphere leaves (mm).
        rms_mm: f64,
        /// Its radius (mm).
        radius_mm: f64,
    },
    /// A sphere but for single points.
    #[error(
        "point {point} lies {off_mm:.4} mm off the sphere of the others ({strays} of the points do not lie on it); measure again, or \
         remove what is no part of it"
    )]
    Stray {
        /// The point that is furthest off, from 1.
        point: usize,
        /// Its distance from the sphere, positive outside (mm).
        off_mm: f64,
        /// How many such points there are.
        strays: usize,
    },
    /// A sphere, but not of the radius that is said to be known.
    #[error(
        "the points lie on a sphere of radius {fitted_mm:.4} mm, not of the known {known_mm:.4} mm; correct the radius and its \
         unit"
    )]
    OtherRadius {
        /// Radius that fits (mm).
        fitted_mm: f64,
        /// Radius as given (mm).
        known_mm: f64,
    },
    /// A radius that cannot be.
    #[error("the known radius must be above zero, its uncertainty zero or more; correct them")]
    Radius,
    /// An uncertainty that cannot be.
    #[error("the uncertainty of a point must be above zero; correct it, or leave it out to take the scatter")]
    Uncertainty,
    /// Gauss-Newton did not settle.
    #[error("the fit did not settle in {0} passes; look for points that are not on the sphere")]
    NotSettled(usize),
}
