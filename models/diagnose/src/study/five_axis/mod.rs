//! Five-axis machine: which flaw of head or axes moves a sphere's centre with the pose it is measured in.
//!
//! Place in the flow: fitted sphere centres in (indicated A, C, probe distance, X, Y, Z; rad and m), diagnosis out. Base
//! model: sphere centre S0, probe direction R_p and probe zero T_p, nine unknowns, linear (Zhang 2016, eq. 3–7):
//! S0 = S1 + R_C·R_A·(d·R_p + T_p), with S1 the centre fitted to the indicated positions. Candidates stand in
//! `effects`; blocks are poses: all centres measured at the same angles are left out together.

mod chain;
mod effects;
mod pairs;
mod problem;

use super::assemble;
use super::diagnosis::StudyDiagnosis;
use super::search::Options;
use crate::error::DiagnoseError;
use abbe_geometry::Vector3;
use problem::Spheres;

/// A sphere's centre fitted in one pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereCentre {
    /// Indicated angle of A (rad), right-handed about X.
    pub a_rad: f64,
    /// Indicated angle of C (rad), right-handed about Z.
    pub c_rad: f64,
    /// Reading of the distance probe, held constant while scanning (m).
    pub distance_m: f64,
    /// Centre fitted to the indicated X, Y, Z (m).
    pub centre_m: [f64; 3],
    /// Standard uncertainty of each coordinate (k = 1, m); `None` where it is not known.
    pub u_m: Option<f64>,
}

/// The base model's own nine unknowns.
#[derive(Debug, Clone, PartialEq)]
pub struct ProbePose {
    /// S0: the sphere's centre (m, machine frame).
    pub centre_m: Vector3<f64>,
    /// R_p: the beam's direction as fitted, not normalised: its length is the scale of the distance reading.
    pub direction: Vector3<f64>,
    /// T_p: the probe's zero (m, head frame).
    pub zero_m: Vector3<f64>,
    /// Residuals of the centres (m): measured less predicted.
    pub residuals_m: Vec<Vector3<f64>>,
}

impl ProbePose {
    /// The nine unknowns by least squares.
    ///
    /// # Errors
    /// Poses that do not determine them.
    pub fn fit(centres: &[SphereCentre]) -> Result<ProbePose, DiagnoseError> {
        Spheres::new(centres)?.probe_pose()
    }

    /// Root mean square of the residual vectors' lengths (m).
    pub fn rms_m(&self) -> f64 {
        let count = self.residuals_m.len().max(1) as f64;
        (self.residuals_m.iter().map(Vector3::norm_squared).sum::<f64>() / count).sqrt()
    }
}

/// Diagnoses the residual of the nine-unknown model.
///
/// # Errors
/// Fewer than four poses, angles that do not determine the base model, figures that are not finite.
pub fn diagnose(centres: &[SphereCentre], options: &Options) -> Result<StudyDiagnosis, DiagnoseError> {
    let mut spheres = Spheres::new(centres)?;
    let mut diagnosis = assemble::diagnose(&mut spheres, options)?;
    diagnosis.alternatives = pairs::alternatives(&spheres)?;
    pairs::name_aliases(&spheres, &mut diagnosis)?;
    Ok(diagnosis)
}
