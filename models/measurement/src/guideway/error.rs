//! Why no errors of an axis are given, and what to do.
//!
//! Place in the flow: returned by [`super::Guideway::new`]. Points are counted from 1; positions in mm for reading.

use thiserror::Error;

/// Points that give no errors.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum GuidewayError {
    /// A figure is not finite.
    #[error("point {0} holds a figure that is not finite; correct or remove it")]
    NotFinite(usize),
    /// A covariance that is none.
    #[error("point {0} has a covariance that is not positive definite; correct it")]
    Covariance(usize),
    /// A target twice at one position.
    #[error(
        "target {target:?} stands twice at position {position_mm} mm, in points {first} and {second}; remove one (positions up to \
         1 µm apart are one)"
    )]
    Twice {
        /// Target.
        target: String,
        /// Position (mm).
        position_mm: f64,
        /// Earlier point.
        first: usize,
        /// Later point.
        second: usize,
    },
    /// One position shows no motion.
    #[error("the points come from {0} position; errors need at least 2")]
    OnePosition(usize),
    /// Three targets fix a body.
    #[error(
        "position {position_mm} mm has {count} targets in common with the lowest position; at least 3 that are not on a line are \
         needed. Positions up to 1 µm apart are one: where its targets were read at positions further apart, give them the position that \
         they were read at together"
    )]
    TooFew {
        /// Position (mm).
        position_mm: f64,
        /// Targets in common.
        count: usize,
    },
    /// Targets on a line.
    #[error(
        "the targets at position {position_mm} mm lie on a line (extent across it {ratio:.1e} of that along it), so the rotation \
         about that line cannot be told; put a target aside of it"
    )]
    Collinear {
        /// Position (mm).
        position_mm: f64,
        /// Extent across over extent along.
        ratio: f64,
    },
    /// Two targets at one place.
    #[error("targets {first:?} and {second:?} have the same coordinates; remove the copy")]
    Coincident {
        /// One target.
        first: String,
        /// The other.
        second: String,
    },
    /// Points move by another amount than the positions.
    #[error(
        "the targets move by {ratio:.4} of what the positions say; it must be near 1: check the units of positions and points"
    )]
    Unit {
        /// Motion over indicated motion.
        ratio: f64,
    },
    /// Points move in another direction.
    #[error(
        "the targets move {angle_deg:.1} degrees off the {axis} axis; give points in the machine frame, name the axis that moves, \
         or have the frame turned along the motion (--frame along-motion)"
    )]
    Direction {
        /// Name of the axis.
        axis: &'static str,
        /// Angle (degrees).
        angle_deg: f64,
    },
    /// Points move a little in another direction.
    #[error(
        "the targets move {angle_deg:.2} degrees off the {axis} axis of the frame of the points, so that {error} would be {cosine_um:.1} µm too \
         small at {position_mm} mm by the cosine alone, at an uncertainty of {expanded_um:.1} µm: that frame is not the machine's; have it \
         turned along the motion (--frame along-motion), or give points in the machine frame"
    )]
    Cosine {
        /// Name of the error of position.
        error: String,
        /// Name of the axis.
        axis: &'static str,
        /// Angle (degrees).
        angle_deg: f64,
        /// Position (mm).
        position_mm: f64,
        /// What the cosine takes off there (µm).
        cosine_um: f64,
        /// Expanded uncertainty of the error of position there (µm, k = 2).
        expanded_um: f64,
    },
    /// Targets that do not keep their distances.
    #[error(
        "the distance of targets {first:?} and {second:?} at position {position_mm} mm differs by {change_um:.1} µm from that at \
         the lowest: no rigid table; look for exchanged names, a moved target or a wrong unit"
    )]
    NotRigid {
        /// One target.
        first: String,
        /// The other.
        second: String,
        /// Position (mm).
        position_mm: f64,
        /// Change of their distance (µm).
        change_um: f64,
    },
    /// Iteration of the exact rotation.
    #[error("the errors at position {position_mm} mm did not settle; check its points")]
    NotSettled {
        /// Position (mm).
        position_mm: f64,
    },
    /// Weights of such different size that the equations lose their rank.
    #[error("the covariances of the points at position {position_mm} mm leave an error undetermined; correct them")]
    Undetermined {
        /// Position (mm).
        position_mm: f64,
    },
}
