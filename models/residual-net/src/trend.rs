//! Networks on the position as the trend below kriging.
//!
//! Place in the flow: trained parameters in; live and offline the trend of the residual (m) at any point (m, machine frame), and
//! what it leaves at the calibrated points, which is what kriging is solved for. Kriging of fixed smoothness rounds off what is
//! sharp in the residual and rings beside it; a network bends there, and kriging then has only what is smooth. Known as residual
//! kriging or regression kriging (Hengl et al. 2007, Computers & Geosciences 33), here with a network as the regression.

use crate::neighbourhood::corners_m;
use crate::network::ParametersError;
use crate::network::position::{POSITION_SIZE, PositionConfig, PositionConfigError, PositionNetwork};
use abbe_field::{FieldError, MeasuredField};
use nalgebra::Vector3;
use thiserror::Error;

/// An ensemble of networks on the position, of one configuration: plain parts.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionEnsemble {
    /// Sizes.
    pub config: PositionConfig,
    /// Lower corner of the box that is ±1 for the network (m).
    pub low_m: Vector3<f64>,
    /// Upper corner (m).
    pub high_m: Vector3<f64>,
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
        let has_extent = is_finite(&self.low_m) && (self.high_m - self.low_m).iter().all(|e| e.is_finite() && *e > 0.0);
        has_extent.then_some(()).ok_or(TrendError::Box)?;
        let is_scale = is_finite(&self.mean_m) && self.scale_m.iter().all(|s| s.is_finite() && *s > 0.0);
        is_scale.then_some(()).ok_or(TrendError::Scale)?;
        (!self.members.is_empty()).then_some(()).ok_or(TrendError::Empty)?;
        let expected = self.config.parameters();
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

    /// A point (m) in ±1 over the box.
    pub fn place(&self, point_m: &Vector3<f64>) -> [f32; POSITION_SIZE] {
        place(point_m, &self.low_m, &self.high_m)
    }
}

/// A point (m) in ±1 over a box.
pub fn place(point_m: &Vector3<f64>, low_m: &Vector3<f64>, high_m: &Vector3<f64>) -> [f32; POSITION_SIZE] {
    std::array::from_fn(|axis| ((point_m[axis] - low_m[axis]) / (high_m[axis] - low_m[axis]) * 2.0 - 1.0) as f32)
}

/// Corners (m) of the box that is ±1 for a network of these points; along an axis on which they do not differ it reaches a metre
/// either way.
pub fn place_box_m(points_m: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let (low, high) = corners_m(points_m);
    let margin = (high - low).map(|extent| if extent > 0.0 { 0.0 } else { 1.0 });
    (low - margin, high + margin)
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
        let networks = parts.members.iter().map(|member| PositionNetwork::new(&parts.config, member)).collect();
        Ok(Trend { parts, networks })
    }

    /// What it is made of.
    pub fn parts(&self) -> &PositionEnsemble {
        &self.parts
    }

    /// Mean of the members (m) at a point (m, machine frame).
    pub fn at(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        let place = self.parts.place(point_m);
        let sum: Vector3<f64> = self.networks.iter().map(|network| network.evaluate(&place)).sum();
        (sum / self.networks.len() as f64).component_mul(&self.parts.scale_m) + self.parts.mean_m
    }

    /// What it leaves of a field at its points.
    pub fn left(&self, field: &MeasuredField) -> Result<MeasuredField, FieldError> {
        let left = field.points_m().iter().zip(field.errors_m()).map(|(point, error)| error - self.at(point)).collect();
        field.with_errors(left)
    }
}
