//! What every interpolation method answers.
//!
//! Place in the flow: one trait before inverse distances, trilinear, radial functions, kriging and tables, so that they can
//! be scored and used alike. Points in m in the machine frame; errors are actual − indicated (m).

use crate::hull::Region;
use crate::kriging::Kriging;
use nalgebra::Vector3;
use thiserror::Error;

/// The error at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Error = actual − indicated (m).
    pub error_m: Vector3<f64>,
    /// Standard uncertainty of each component (m, k = 1), where the method knows one.
    pub u_m: Option<Vector3<f64>>,
    /// Whether the point lies among the measured ones; beyond them the error is extrapolated.
    pub region: Region,
}

/// Why a method has no error at a point.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum Unanswered {
    /// The point is none.
    #[error("a coordinate of the point is not a finite number")]
    NotFinite,
    /// Nothing measured is near.
    #[error("no measured point within {} mm", radius_m * 1e3)]
    NoPointWithin {
        /// Search radius (m).
        radius_m: f64,
    },
    /// The measured points lie in a plane, and this one does not.
    #[error("the point lies {} mm off the plane of the measured ones", distance_m * 1e3)]
    OffPlane {
        /// Distance from it (m).
        distance_m: f64,
    },
    /// The measured points have no box around it.
    #[error("no box of eight measured points along the axes contains the point")]
    NoHexahedron,
}

/// A field that can be asked anywhere.
pub trait Interpolator: Sync {
    /// The error at a point (m, machine frame).
    fn at(&self, point_m: &Vector3<f64>) -> Result<Estimate, Unanswered>;
}

impl Interpolator for Kriging {
    fn at(&self, point_m: &Vector3<f64>) -> Result<Estimate, Unanswered> {
        finite(point_m)?;
        let predicted = self.predict(point_m);
        Ok(Estimate { error_m: predicted.error_m, u_m: Some(predicted.u_m), region: predicted.region })
    }
}

/// Refuses a point that is none.
pub(crate) fn finite(point_m: &Vector3<f64>) -> Result<(), Unanswered> {
    if point_m.iter().all(|v| v.is_finite()) { Ok(()) } else { Err(Unanswered::NotFinite) }
}
