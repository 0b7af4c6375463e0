//! Networks on the inputs, the position above all, as the trend below kriging.
//!
//! Place in the flow: trained parameters in; live and offline the trend of the residual (m) at any point, and
//! what it leaves at the calibrated points, which is what kriging is solved for. Kriging of fixed smoothness rounds off what is
//! sharp in the residual and rings beside it; a network bends there, and kriging then has only what is smooth. Known as residual
//! kriging or regression kriging (Hengl et al. 2007, Computers & Geosciences 33), here with a network as the regression.

use crate::network::ParametersError;
use crate::network::position::{PositionConfig, PositionConfigError, PositionNetwork};
use abbe_field::{FieldError, MOST_INPUTS, Samples, corners};
use nalgebra::Vector3;
use thiserror::Error;

/// An ensemble of networks on the position, of one configuration: plain parts.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionEnsemble {
    /// Sizes.
    pub config: PositionConfig,
    /// Lower corner of the box that is ±1 for the network, in the unit of each input.
    pub low: Vec<f64>,
    /// Upper corner.
    pub high: Vec<f64>,
    /// Mean of the residuals (m).
    pub mean_m: Vector3<f64>,
    /// Their standard deviation (m), above zero.
    pub scale_m: Vector3<f64>,
    /// Parameters of each member.
    pub members: Vec<Vec<f32>>,
}

/// Parts that make no trend.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TrendError {
    /// Sizes out of range.
    #[error(transparent)]
    Config(#[from] PositionConfigError),
    /// No member at all.
    #[error("a trend without a network; train it again")]
    Empty,
    /// A box without extent.
    #[error("the box of the calibrated points has no extent along some axis")]
    Box,
    /// A scale that is none.
    #[error("a mean or a scale of the residuals is not a finite number, or the scale is not above zero")]
    Scale,
    /// Parameters do not fit.
    #[error("member {member}: {source}")]
    Parameters {
        /// Which.
        member: usize,
        /// Why.
        source: ParametersError,
    },
}

impl PositionEnsemble {
    fn check(&self) -> Result<(), TrendError> {
        self.config.check()?;
        let is_finite = |v: &Vector3<f64>| v.iter().all(|c| c.is_finite());
        let has_size = self.low.len() == self.high.len() && (1..=MOST_INPUTS).contains(&self.low.len());
        let extent = |(low, high): (&f64, &f64)| low.is_finite() && (high - low).is_finite() && high > low;
        let has_extent = has_size && self.low.iter().zip(&self.high).all(extent);
        has_extent.then_some(()).ok_or(TrendError::Box)?;
        let is_scale = is_finite(&self.mean_m) && self.scale_m.iter().all(|s| s.is_finite() && *s > 0.0);
        is_scale.then_some(()).ok_or(TrendError::Scale)?;
        (!self.members.is_empty()).then_some(()).ok_or(TrendError::Empty)?;
        let expected = self.config.parameters(self.low.len());
        for (member, parameters) in self.members.iter().enumerate() {
            let found = parameters.len();
            let length = ParametersError::Length { found, expected, width: self.config.width };
            (found == expected).then_some(()).ok_or(TrendError::Parameters { member, source: length })?;
            if let Some(place) = parameters.iter().position(|p| !p.is_finite()) {
                return Err(TrendError::Parameters { member, source: ParametersError::NotFinite(place) });
            }
        }
        Ok(())
    }

    /// A point in ±1 over the box.
    pub fn place(&self, point: &[f64]) -> Place {
        place(point, &self.low, &self.high)
    }
}

/// A point in ±1 over a box; zero beyond its inputs.
pub type Place = [f32; MOST_INPUTS];

/// A point in ±1 over a box.
pub fn place(point: &[f64], low: &[f64], high: &[f64]) -> Place {
    let mut place = [0.0; MOST_INPUTS];
    for (place, (at, (low, high))) in place.iter_mut().zip(point.iter().zip(low.iter().zip(high))) {
        *place = ((at - low) / (high - low) * 2.0 - 1.0) as f32;
    }
    place
}

/// Corners of the box that is ±1 for a network of these points; along an input in which they do not differ it reaches one either way.
pub fn place_box(samples: &Samples) -> (Vec<f64>, Vec<f64>) {
    let (mut low, mut high) = corners(samples.size(), samples.points());
    for (low, high) in low.iter_mut().zip(&mut high).filter(|(low, high)| low == high) {
        (*low, *high) = (*low - 1.0, *high + 1.0);
    }
    (low, high)
}

/// A checked trend, ready to be evaluated.
#[derive(Debug, Clone)]
pub struct Trend {
    parts: PositionEnsemble,
    networks: Vec<PositionNetwork>,
}

impl Trend {
    /// Checks the parts.
    pub fn new(parts: PositionEnsemble) -> Result<Trend, TrendError> {
        parts.check()?;
        let networks =
            parts.members.iter().map(|member| PositionNetwork::new(&parts.config, parts.low.len(), member)).collect();
        Ok(Trend { parts, networks })
    }

    /// What it is made of.
    pub fn parts(&self) -> &PositionEnsemble {
        &self.parts
    }

    /// Mean of the members (m) at a point.
    pub fn at(&self, point: &[f64]) -> Vector3<f64> {
        let place = self.parts.place(point);
        let place = &place[..self.parts.low.len()];
        let sum: Vector3<f64> = self.networks.iter().map(|network| network.evaluate(place)).sum();
        (sum / self.networks.len() as f64).component_mul(&self.parts.scale_m) + self.parts.mean_m
    }

    /// What it leaves of a field at its points.
    pub fn left(&self, field: &Samples) -> Result<Samples, FieldError> {
        let left = field.points().zip(field.errors_m()).map(|(point, error)| error - self.at(point)).collect();
        field.with_errors(left)
    }
}
