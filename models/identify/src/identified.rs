//! What a fit of a campaign comes to.
//!
//! Place in the flow: [`crate::solve`] makes it; whatever asks a settled fit for more takes it. Lengths in m.

use crate::evidence::Evidence;
use crate::range_correlation::RangeCorrelation;
use crate::smoothing::Smoothness;
use abbe_geometry::model::MachineModel;

/// A model and what was found out on the way.
#[derive(Debug, Clone)]
pub struct Identified {
    /// The model, ready to correct.
    pub model: MachineModel,
    /// What the fit says about itself.
    pub evidence: Evidence,
    /// Measured minus predicted length of every reading (m), rejected ones included.
    pub residuals_m: Vec<f64>,
    /// Declared standard uncertainty of every reading (m).
    pub u_m: Vec<f64>,
    /// Robust weight of every reading, 0 for rejected ones.
    pub weights: Vec<f64>,
    /// How the noise is correlated; `None` where it is white for all that the data say.
    pub correlation: Option<RangeCorrelation>,
    pub(crate) ended: Ended,
}

impl Identified {
    /// The same fit, of these readings alone; neighbours among them are none of the campaign, so its noise counts as white.
    pub fn of_readings(&self, indices: &[usize]) -> Identified {
        let of = |all: &[f64]| indices.iter().filter_map(|k| all.get(*k)).copied().collect();
        Identified {
            residuals_m: of(&self.residuals_m),
            u_m: of(&self.u_m),
            weights: of(&self.weights),
            correlation: None,
            ..self.clone()
        }
    }
}

/// What a fit ended with beside its model.
#[derive(Debug, Clone)]
pub(crate) struct Ended {
    /// Parameters that were free.
    pub(crate) free: Vec<usize>,
    /// Smoothness that it chose.
    pub(crate) smoothness: Smoothness,
    /// χ² per degree of freedom at which it chose that.
    pub(crate) noise_factor: f64,
}
