//! The calibrated points as a network sees them.
//!
//! Place in the flow: points (their inputs) and residuals (m) once, then for each target its cell and its tokens; the same in
//! training and live. Neighbours are those in scaled inputs, each over a scale of its own, which is 1 for positions alone. A network on kriging sees, at each calibrated point, what kriging leaves of the residual there.

use crate::kind::ResidualMethod;
use crate::kriging::{Kriging, KrigingMean};
use crate::neighbourhood::{Neighbourhood, VERTICES, Vertices};
use crate::network::NetworkConfig;
use crate::network::tokens::{Normaliser, Token, tokens};
use abbe_field::{MOST_INPUTS, Samples};
use nalgebra::Vector3;

/// Calibrated points, prepared.
#[derive(Debug, Clone)]
pub struct CalibratedPoints {
    kind: ResidualMethod,
    /// Scale of each input, in its unit.
    scale: Vec<f64>,
    /// Points in scaled inputs, one after the other.
    scaled: Vec<f64>,
    search: Neighbourhood,
    kriging: KrigingMean,
    /// What the network sees at each point, in its own units; empty for a kind without one.
    normalised: Vec<Vector3<f64>>,
}

impl CalibratedPoints {
    /// Prepares the points of a field for a kind of model; the kriging is the one solved for this field.
    pub fn new(
        kind: ResidualMethod,
        field: &Samples,
        scale: &[f64],
        kriging: &Kriging,
        normaliser: Option<Normaliser>,
    ) -> CalibratedPoints {
        let mean = KrigingMean::new(kriging, field);
        let scaled: Vec<f64> = field.points().flat_map(|p| p.iter().zip(scale).map(|(at, scale)| at / scale)).collect();
        let search = Neighbourhood::new(field.size(), scaled.chunks_exact(field.size()));
        let (scale, normalised) = (scale.to_vec(), Vec::new());
        let mut calibrated = CalibratedPoints { kind, scale, scaled, search, kriging: mean, normalised };
        if let Some(normaliser) = normaliser {
            let one = |(point, residual): (&[f64], &Vector3<f64>)| {
                normaliser.normalise(&(residual - calibrated.below_m(point)))
            };
            calibrated.normalised = field.points().zip(field.errors_m()).map(one).collect();
        }
        calibrated
    }

    /// The cell around a target; `None` for a target that is no number.
    pub fn vertices(&self, target: &[f64]) -> Option<Vertices> {
        self.search.vertices(self.scaled(target, &mut [0.0; MOST_INPUTS]))
    }

    /// A target in scaled inputs.
    fn scaled<'a>(&self, target: &[f64], to: &'a mut [f64; MOST_INPUTS]) -> &'a [f64] {
        for (to, (at, scale)) in to.iter_mut().zip(target.iter().zip(&self.scale)) {
            *to = at / scale;
        }
        &to[..self.scale.len()]
    }

    /// Kriging at a point (m).
    pub fn kriging_m(&self, point: &[f64]) -> Vector3<f64> {
        self.kriging.at(point)
    }

    /// What stands below the network at a point (m): kriging, or nothing.
    pub fn below_m(&self, point: &[f64]) -> Vector3<f64> {
        if self.kind == ResidualMethod::KrigingNetwork { self.kriging_m(point) } else { Vector3::zeros() }
    }

    /// Tokens of a target in its cell.
    pub fn tokens(
        &self,
        config: &NetworkConfig,
        normaliser: &Normaliser,
        target: &[f64],
        vertices: &Vertices,
    ) -> [Token; VERTICES] {
        let mut scaled = [0.0; MOST_INPUTS];
        let target = self.scaled(target, &mut scaled);
        tokens(config, normaliser, target, vertices, &self.scaled, &self.normalised)
    }
}
