//! The calibrated points as a network sees them.
//!
//! Place in the flow: points (m, machine frame) and residuals (m) once, then for each target its cell and its tokens; the same
//! in training and live. A network on kriging sees, at each calibrated point, what kriging leaves of the residual there.

use crate::kriging::{Kriging, KrigingMean};
use crate::model::Kind;
use crate::neighbourhood::{Neighbourhood, VERTICES, Vertices};
use crate::network::NetworkConfig;
use crate::network::tokens::{Normaliser, Token, tokens};
use abbe_field::MeasuredField;
use nalgebra::Vector3;

/// Calibrated points, prepared.
#[derive(Debug, Clone)]
pub struct CalibratedPoints {
    kind: Kind,
    search: Neighbourhood,
    kriging: KrigingMean,
    /// What the network sees at each point, in its own units; empty for a kind without one.
    normalised: Vec<Vector3<f64>>,
}

impl CalibratedPoints {
    /// Prepares the points of a field for a kind of model; the kriging is the one solved for this field.
    pub fn new(
        kind: Kind,
        field: &MeasuredField,
        kriging: &Kriging,
        normaliser: Option<Normaliser>,
    ) -> CalibratedPoints {
        let mean = KrigingMean::new(kriging, field);
        let search = Neighbourhood::new(field.points_m());
        let mut calibrated = CalibratedPoints { kind, search, kriging: mean, normalised: Vec::new() };
        if let Some(normaliser) = normaliser {
            let one = |(point, residual): (&Vector3<f64>, &Vector3<f64>)| {
                normaliser.normalise(&(residual - calibrated.below_m(point)))
            };
            calibrated.normalised = field.points_m().iter().zip(field.errors_m()).map(one).collect();
        }
        calibrated
    }

    /// The cell around a target (m); `None` for a target that is no number.
    pub fn vertices(&self, target_m: &Vector3<f64>) -> Option<Vertices> {
        self.search.vertices(target_m)
    }

    /// Kriging at a point (m).
    pub fn kriging_m(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.kriging.at(point_m)
    }

    /// What stands below the network at a point (m): kriging, or nothing.
    pub fn below_m(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        if self.kind == Kind::KrigingNetwork { self.kriging_m(point_m) } else { Vector3::zeros() }
    }

    /// Tokens of a target (m) in its cell.
    pub fn tokens(
        &self,
        config: &NetworkConfig,
        normaliser: &Normaliser,
        target_m: &Vector3<f64>,
        vertices: &Vertices,
    ) -> [Token; VERTICES] {
        tokens(config, normaliser, target_m, vertices, self.search.points_m(), &self.normalised)
    }
}
