//! Six errors of a linear axis from targets on its table, measured by a laser tracker at each position.
//!
//! Place in the flow: points of three or more targets at each indicated position (m) in; EXX, EYX, EZX (m) and EAX, EBX, ECX
//! (rad) by position with covariance out, names after ISO 230-1 for whatever axis. A target at p relative to the reference
//! point is displaced by Δ = δ + ε × p (Zhang 2011, eq. 9), nine equations and more for six unknowns (eq. 15), solved by
//! weighted least squares. Errors are relative to the lowest position, where all are zero; actual less indicated; right-handed
//! angles; machine frame.

mod arrangement;
mod check;
mod error;
mod frame;
mod solve;
mod stray;

pub use arrangement::{ArrangedTarget, arrangement_covariance};
pub use error::GuidewayError;
pub use stray::StrayTarget;

use crate::claim::Claim;
use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3, Vector6};

/// The axis that moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GuidewayAxis {
    /// Along x.
    X,
    /// Along y.
    Y,
    /// Along z.
    Z,
}

impl GuidewayAxis {
    /// Place among x, y, z.
    pub fn index(self) -> usize {
        match self {
            GuidewayAxis::X => 0,
            GuidewayAxis::Y => 1,
            GuidewayAxis::Z => 2,
        }
    }

    /// Its letter.
    pub fn name(self) -> &'static str {
        ["X", "Y", "Z"][self.index()]
    }

    /// Unit vector of its motion (machine frame).
    pub fn unit(self) -> Vector3<f64> {
        Vector3::ith(self.index(), 1.0)
    }

    /// The six errors after ISO 230-1: displacements along x, y, z, then rotations about them, such as EXX … ECX.
    pub fn error_names(self) -> [String; 6] {
        let axis = self.name();
        ["X", "Y", "Z", "A", "B", "C"].map(|of| format!("E{of}{axis}"))
    }
}

/// Frame of the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GuidewayFrame {
    /// They are in the machine frame already: slopes of straightness stay in. So does their cosine in the error of position, which
    /// is refused where it is no small part of its uncertainty.
    Given,
    /// They are the tracker's own: the smallest rotation that brings the mean direction of motion on the axis is applied. Slopes
    /// of straightness then vanish, and about the axis the tracker's frame is taken as it stands.
    AlongMotion,
}

/// How rotations enter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GuidewayRotation {
    /// δ + ε × p, as published: linear.
    SmallAngle,
    /// The rotation vector ε through the exponential map.
    Exact,
}

/// What is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuidewayOptions {
    /// The axis that moves.
    pub axis: GuidewayAxis,
    /// Frame of the points.
    pub frame: GuidewayFrame,
    /// How rotations enter.
    pub rotation: GuidewayRotation,
    /// Point of the table whose displacement is δ, at the lowest position (m, frame of the points); `None` for the centroid of
    /// the targets, where δ is most certain.
    pub reference_m: Option<Vector3<f64>>,
}

/// A target at a position.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetPoint {
    /// Indicated position of the axis (m).
    pub position_m: f64,
    /// Name of the target.
    pub target: String,
    /// Measured point (m).
    pub point_m: Vector3<f64>,
    /// Its covariance (m², k = 1); `None` where it is not known.
    pub covariance_m2: Option<Matrix3<f64>>,
}

/// The six errors at one position.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionErrors {
    /// Indicated position (m).
    pub position_m: f64,
    /// Displacement of the reference point along x, y, z (m), then rotation about x, y, z (rad), machine frame.
    pub errors: Vector6<f64>,
    /// Their covariance (m, rad), of this position against the lowest, such that ±2u holds the truth with 95.45 %: from the
    /// declared covariances, otherwise from the scatter, widened; `None` at the lowest position, where the errors are zero by
    /// definition.
    pub covariance: Option<Matrix6<f64>>,
    /// Factor by which u was widened, at least that of [`Guideway::claim`]: more where the targets of this position contradict
    /// each other more than those of the others; `None` at the lowest.
    pub widening: Option<f64>,
    /// Targets used.
    pub targets: usize,
    /// Root mean square of what a rigid table does not explain, over coordinates (m).
    pub residual_rms_m: f64,
}

/// Errors of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Guideway {
    /// What was computed.
    pub options: GuidewayOptions,
    /// From the frame of the points to the machine.
    pub machine_from_points: Rotation3<f64>,
    /// Reference point at the lowest position (m, frame of the points).
    pub reference_m: Vector3<f64>,
    /// By position, ascending.
    pub positions: Vec<PositionErrors>,
    /// Smaller over larger extent of the targets across and along their longest direction, the least of all positions: 0 for
    /// targets on a line.
    pub spread_ratio: f64,
    /// Standard deviation of a coordinate from the residuals (m).
    pub scatter_m: f64,
    /// χ² per degree of freedom with the declared covariances; `None` where not all are declared.
    pub chi2_per_dof: Option<f64>,
    /// What the uncertainties rest on, and by how much all of them were widened.
    pub claim: Claim,
}

impl Guideway {
    /// Solves every position against the lowest. [`Guideway::without_strays`] leaves out what contradicts all others.
    ///
    /// # Errors
    /// Figures that are not finite, a target given twice at a position, fewer than three targets in common with the lowest
    /// position, targets on a line or at one place, points that do not move as the positions say (unit, axis, frame), a given
    /// frame so far off the motion that its cosine shows in the error of position, a table that is not rigid.
    pub fn new(points: &[TargetPoint], options: GuidewayOptions) -> Result<Guideway, GuidewayError> {
        let runs = check::by_position(points)?;
        let machine_from_points = frame::machine_from_points(&runs, &options)?;
        let solved = solve::all(&runs, machine_from_points, options)?;
        frame::along_enough(&runs, &solved)?;
        Ok(solved)
    }

    /// Standard uncertainties at each position (m, rad; k = 1).
    pub fn u(position: &PositionErrors) -> Option<[f64; 6]> {
        let covariance = position.covariance?;
        Some(std::array::from_fn(|k| covariance[(k, k)].max(0.0).sqrt()))
    }
}

#[cfg(test)]
mod tests;
