//! Pose of a laser probe on the fork head of a five-axis machine, from sphere centres in several poses of A and C.
//!
//! Place in the flow: sphere centres (m; each fitted to indicated X, Y, Z scanned at fixed A, C and distance reading d) in;
//! sphere centre S0, beam direction R_p, probe zero T_p with covariance out; from then on [`ProbePose::point_m`] measures.
//! A probed point is q = R_C·R_A·(d·R_p + T_p) + Q, so S0 = S1 + R_C·R_A·(d·R_p + T_p): nine unknowns, linear (Zhang 2016,
//! eq. 3–7). Beyond the paper: R_p of length one or free, and an offset of the A axis from the C axis,
//! S0 = S1 + R_C·(o + R_A·(d·R_p + T_p)). Of o only the component along y of the frame that C turns can be found: x cannot
//! be told from T_p, z not from S0. Machine frame, right-handed angles, metres and radians.

mod check;
mod design;
mod error;
mod held_out;
mod offset;
mod same;
mod solve;
mod table;
mod undetermined;

pub use design::{centre_rows, head_in_machine};
pub use error::ProbePoseError;
pub use held_out::{LeftOutCentre, LeftOutPose, leave_one_centre_out, leave_one_pose_out};
pub use offset::ToldOffset;
pub use same::{near_poses, poses};
pub use table::{Compensation, CompensationTable, TableEntry};
pub use undetermined::Undetermined;

use crate::claim::Claim;
use design::c_in_machine;
use nalgebra::{DMatrix, Vector3};

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

/// What is assumed of the length of R_p.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BeamLength {
    /// Fitted: it is the scale of the distance reading.
    Free,
    /// One: the distance reading is taken to be true, and the other unknowns adjust to that.
    One,
}

/// Which unknowns are fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ProbePoseModel {
    /// Length of R_p.
    pub beam: BeamLength,
    /// Whether the A axis may lie off the C axis, along y of the frame that C turns.
    pub axis_offset: bool,
}

impl ProbePoseModel {
    /// The nine unknowns of the paper.
    pub const NINE: ProbePoseModel = ProbePoseModel { beam: BeamLength::Free, axis_offset: false };
}

/// Scatter of the centres about the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatter {
    /// Standard deviation of a coordinate within a pose (m); `None` where no pose was measured more than once.
    pub within_m: Option<f64>,
    /// Standard deviation of what is common to a pose (m), what the model lacks; zero where the scatter within explains all;
    /// `None` where too few poses are left to judge it.
    pub between_m: Option<f64>,
    /// χ² per degree of freedom with the declared uncertainties; `None` where none are declared or no freedom is left.
    pub chi2_per_dof: Option<f64>,
    /// The part of it within poses, which is the noise alone, and its degrees of freedom; `None` where none are declared or no
    /// pose was measured more than once.
    pub chi2_per_dof_within: Option<(f64, usize)>,
}

/// The probe's pose.
#[derive(Debug, Clone, PartialEq)]
pub struct ProbePose {
    /// What was fitted.
    pub model: ProbePoseModel,
    /// S0: the sphere's centre (m, machine frame).
    pub centre_m: Vector3<f64>,
    /// R_p: the beam's direction (head frame at A = C = 0), of the fitted length.
    pub direction: Vector3<f64>,
    /// T_p: the probe's zero (m, head frame).
    pub zero_m: Vector3<f64>,
    /// Offset of the A axis from the C axis along y of the frame that C turns (m), where it was fitted.
    pub axis_offset_m: Option<f64>,
    /// Residuals of the centres (m): measured less predicted, in the order of the centres.
    pub residuals_m: Vec<Vector3<f64>>,
    /// Coordinates less unknowns.
    pub degrees_of_freedom: usize,
    /// Largest over smallest singular value of the design, columns of length one.
    pub condition: f64,
    /// Scatter within and between poses.
    pub scatter: Scatter,
    /// Covariance of S0 (m), R_p (1), T_p (m) and, where fitted, the axis offset (m), in this order, such that ±2u holds the truth
    /// with 95.45 %. From the scatter within and between poses, otherwise from the declared uncertainties, widened as
    /// [`ProbePose::claim`] says; `None` where neither is there.
    pub covariance: Option<DMatrix<f64>>,
    /// What the uncertainty rests on, and by how much it was widened.
    pub claim: Option<Claim>,
}

impl ProbePose {
    /// Least-squares fit; rows are weighted by 1/u² where every centre declares its uncertainty.
    ///
    /// # Errors
    /// Figures that are not finite, a centre given twice, poses that do not determine the unknowns (named), a beam far from
    /// length one, columns that fit far better when they are read in another way, centres that no head could leave.
    pub fn fit(centres: &[SphereCentre], model: ProbePoseModel) -> Result<ProbePose, ProbePoseError> {
        check::centres(centres)?;
        let pose = solve::fit(centres, model)?;
        check::readings(centres, &pose)?;
        check::beam(&pose)?;
        check::size(centres, &pose)?;
        Ok(pose)
    }

    /// The probed point (m, machine frame) at indicated angles, distance reading and X, Y, Z (eq. 3).
    pub fn point_m(&self, a_rad: f64, c_rad: f64, distance_m: f64, reading_m: &Vector3<f64>) -> Vector3<f64> {
        let head = head_in_machine(a_rad, c_rad) * (self.direction * distance_m + self.zero_m);
        let offset = c_in_machine(c_rad) * Vector3::new(0.0, self.axis_offset_m.unwrap_or(0.0), 0.0);
        reading_m + offset + head
    }

    /// Where this centre puts the sphere (m, machine frame): S0^(k) of eq. 13.
    pub fn seen_m(&self, centre: &SphereCentre) -> Vector3<f64> {
        self.point_m(centre.a_rad, centre.c_rad, centre.distance_m, &Vector3::from(centre.centre_m))
    }

    /// Root mean square of the residual vectors' lengths (m).
    pub fn rms_m(&self) -> f64 {
        let count = self.residuals_m.len().max(1) as f64;
        (self.residuals_m.iter().map(Vector3::norm_squared).sum::<f64>() / count).sqrt()
    }

    /// Standard uncertainties in the order of the covariance.
    pub fn u(&self) -> Option<Vec<f64>> {
        let covariance = self.covariance.as_ref()?;
        Some((0..covariance.nrows()).map(|k| covariance[(k, k)].max(0.0).sqrt()).collect())
    }

    /// Standard uncertainty of the length of R_p, the scale of the distance reading; zero by definition where it is one.
    pub fn u_beam_length(&self) -> Option<f64> {
        let covariance = self.covariance.as_ref()?;
        let along = self.direction.normalize();
        let block = covariance.fixed_view::<3, 3>(3, 3);
        Some((block * along).dot(&along).max(0.0).sqrt())
    }
}

#[cfg(test)]
mod tests;
