//! Residual vectors: what any calibration, of whatever software, leaves at a measured point.
//!
//! Place in the flow: files and bags are read into [`ResidualVector`]s; diagnosis, interpolation and training share that one form.

use std::collections::BTreeMap;

/// One residual.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ResidualVector {
    /// Indicated position (m, machine frame).
    pub position_m: [f64; 3],
    /// Actual less predicted (m).
    pub residual_m: [f64; 3],
    /// Standard uncertainty (k = 1) of each component (m).
    pub u_m: Option<[f64; 3]>,
    /// Time (s).
    pub time_s: Option<f64>,
    /// Name of what was measured together.
    pub block: Option<String>,
    /// Joints and further logged quantities by name, in the unit of their name.
    pub covariates: BTreeMap<String, f64>,
    /// Placing of a plate on the table in which it was measured; where it lay is unknown.
    pub pose: Option<String>,
    /// Name of the point on the plate: the same in all poses.
    pub point: Option<String>,
    /// Standard uncertainty (k = 1) of the plate's calibrated coordinates there (m).
    pub u_plate_m: Option<f64>,
    /// Coordinates of the position that nobody gave, one at most; the figure there means nothing.
    pub position_lacks: [bool; 3],
    /// Components of the residual that nobody measured; the figures there mean nothing.
    pub residual_lacks: [bool; 3],
}
