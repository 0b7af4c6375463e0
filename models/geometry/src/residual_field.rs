//! The place for a residual field: what is left after geometry and effects, learnt from data.
//!
//! Place in the flow: the residual node and `abbe correct` add it after the geometric part through
//! [`crate::correct::add_residual`]. Any field (network, kriging, table) implements this trait.

use crate::effects::{CovariateProblem, CovariateSource};
use nalgebra::{Matrix3, Vector3};

/// What a residual field says about one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResidualPrediction {
    /// Residual error (actual − corrected so far) at tip or reflector (m, machine frame).
    pub residual_m: Vector3<f64>,
    /// Its covariance (m²).
    pub covariance_m2: Matrix3<f64>,
    /// False where the point lies outside what the field was made from.
    pub inside: bool,
}

/// A residual field over the working volume, and over whatever else it was made from.
pub trait ResidualField: Send + Sync {
    /// Names of the covariates that it asks of a sample; none for a field of position alone.
    fn covariates(&self) -> &[String] {
        &[]
    }

    /// Residual at a geometrically corrected point (m, machine frame) of a sample with these covariates.
    ///
    /// # Errors
    /// A covariate that the sample lacks, or whose value is too old.
    fn predict(
        &self,
        point_in_machine_m: &Vector3<f64>,
        covariates: &dyn CovariateSource,
    ) -> Result<ResidualPrediction, CovariateProblem>;

    /// Covariance (m²) of what is left at a sample without a residual, as its covariates are not known.
    fn unknown_m2(&self) -> Matrix3<f64> {
        Matrix3::zeros()
    }

    /// SHA-256 of the artifact the field was loaded from.
    fn sha256(&self) -> [u8; 32];
}
