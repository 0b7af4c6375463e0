//! A residual model: calibrated points, kriging, the network's members, and how far its statements hold.
//!
//! Place in the flow: made of plain parts by training or by reading an artifact, checked once; then one function, live and
//! offline alike. Point (m, machine frame) in, residual = actual − corrected so far (m) with covariance (m²) out. Nothing is
//! allocated in a prediction.
//!
//! | kind | residual |
//! |---|---|
//! | kriging | kriging of the calibrated residuals |
//! | network | mean of the members on the calibrated residuals around the point |
//! | kriging-network | kriging, and the mean of the members on what kriging leaves at the calibrated points around |
//! | perceptron-kriging | mean of networks on the position, and kriging of what it leaves at the calibrated points |
//!
//! Variance of a component: calibration² · (variance of kriging at the point + variance of the members' mean about it + σ²) + what
//! is common. Kriging's variance stands under every kind, as it knows how far the point lies from what was measured. Beyond the
//! calibrated points a network says nothing reliable: there the square of its difference to kriging is added. σ² is what
//! neighbours do not share beyond their declared uncertainty: the machine's repeatability and field finer than the points, both
//! of which will be there again. What is declared and not seen as scatter is common to neighbours, so no number of them takes it away.

use crate::calibrated_points::CalibratedPoints;
use crate::calibration::Calibration;
use crate::kriging::{Kriging, KrigingVariance};
use crate::neighbourhood::{VERTICES, Vertices};
use crate::network::tokens::Normaliser;
use crate::network::{ConfigError, Folded, NetworkConfig, Parameters, ParametersError};
use crate::supporting_planes::SupportingPlanes;
use crate::trend::{PositionEnsemble, Trend, TrendError};
use abbe_field::MeasuredField;
use abbe_geometry::residual_field::ResidualPrediction;
use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// What predicts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Kriging alone.
    Kriging,
    /// The network alone.
    Network,
    /// Kriging, and the network on what it leaves.
    KrigingNetwork,
    /// A network on the position, and kriging of what it leaves.
    PerceptronKriging,
}

impl Kind {
    /// All of them, the simplest first.
    pub const ALL: [Kind; 4] = [Kind::Kriging, Kind::Network, Kind::KrigingNetwork, Kind::PerceptronKriging];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Kriging => "kriging",
            Kind::Network => "network",
            Kind::KrigingNetwork => "kriging-network",
            Kind::PerceptronKriging => "perceptron-kriging",
        }
    }

    /// Whether it has networks on the neighbourhood.
    pub fn has_attention(self) -> bool {
        matches!(self, Kind::Network | Kind::KrigingNetwork)
    }

    /// Whether it has networks on the position.
    pub fn has_trend(self) -> bool {
        self == Kind::PerceptronKriging
    }

    /// Whether it has any network.
    pub fn has_network(self) -> bool {
        self.has_attention() || self.has_trend()
    }
}

/// An ensemble of networks on the neighbourhood, of one configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Ensemble {
    /// Sizes and switches.
    pub config: NetworkConfig,
    /// Units of the network.
    pub normaliser: Normaliser,
    /// Parameters of each member.
    pub members: Vec<Parameters>,
}

/// Everything a model is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Parts {
    /// What predicts.
    pub kind: Kind,
    /// Calibrated points (m, machine frame), residuals and, where known, their standard uncertainty (m).
    pub field: MeasuredField,
    /// Kriging of the calibrated residuals, or of what the trend leaves of them.
    pub kriging: Kriging,
    /// Networks on the neighbourhood, for the kinds that have them.
    pub ensemble: Option<Ensemble>,
    /// Networks on the position, for the kind that has them.
    pub trend: Option<PositionEnsemble>,
    /// Factors on the deviations.
    pub calibration: Calibration,
}

/// A prediction with its variance in two parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Apart {
    /// Residual (m).
    pub residual_m: Vector3<f64>,
    /// Variance (m²) of what the machine does at the point about the prediction, as far as neighbouring points can show it.
    pub own_m2: Vector3<f64>,
    /// Variance (m²) that the calibrated points have in common and that none of them shows.
    pub common_m2: Vector3<f64>,
    /// Whether the point lies among the calibrated ones.
    pub inside: bool,
}

/// A checked model, ready to predict.
#[derive(Debug, Clone)]
pub struct ResidualModel {
    parts: Parts,
    calibrated: CalibratedPoints,
    planes: SupportingPlanes,
    variance: KrigingVariance,
    members: Vec<Folded>,
    trend: Option<Trend>,
}

impl ResidualModel {
    /// Checks the parts against each other and prepares the evaluation.
    pub fn new(parts: Parts) -> Result<ResidualModel, ModelError> {
        check(&parts)?;
        let variance = KrigingVariance::new(&parts.kriging, &parts.field).ok_or(ModelError::NotPositiveDefinite)?;
        let mut members = Vec::new();
        if let Some(ensemble) = &parts.ensemble {
            members = ensemble.members.iter().map(|member| Folded::new(&ensemble.config, member)).collect();
        }
        let normaliser = parts.ensemble.as_ref().map(|ensemble| ensemble.normaliser);
        let calibrated = CalibratedPoints::new(parts.kind, &parts.field, &parts.kriging, normaliser);
        let planes = SupportingPlanes::new(parts.field.points_m());
        let trend = parts.trend.clone().map(Trend::new).transpose()?;
        Ok(ResidualModel { calibrated, planes, variance, members, trend, parts })
    }

    /// What it is made of.
    pub fn parts(&self) -> &Parts {
        &self.parts
    }

    /// What predicts.
    pub fn kind(&self) -> Kind {
        self.parts.kind
    }

    /// Residual at a geometrically corrected point (m, machine frame). For a point that is no number, or so far away that it has
    /// none, the residual is zero, its covariance infinite and the point not inside.
    pub fn predict(&self, point_in_machine_m: &Vector3<f64>) -> ResidualPrediction {
        let Some(apart) = self.predict_apart(point_in_machine_m) else {
            let covariance_m2 = Matrix3::from_diagonal(&Vector3::repeat(f64::INFINITY));
            return ResidualPrediction { residual_m: Vector3::zeros(), covariance_m2, inside: false };
        };
        let covariance_m2 = Matrix3::from_diagonal(&(apart.own_m2 + apart.common_m2));
        ResidualPrediction { residual_m: apart.residual_m, covariance_m2, inside: apart.inside }
    }

    /// The same with its variance in two parts; `None` where there is no number.
    pub fn predict_apart(&self, point_in_machine_m: &Vector3<f64>) -> Option<Apart> {
        let is_finite = |vector: &Vector3<f64>| vector.iter().all(|value| value.is_finite());
        let vertices = self.calibrated.vertices(point_in_machine_m).filter(|_| is_finite(point_in_machine_m))?;
        let inside = vertices.occupied == [true; VERTICES] || self.planes.holds(point_in_machine_m);
        let (residual_m, variance_m2) = self.mean_and_variance(point_in_machine_m, &vertices, inside);
        let Parts { kriging, field, calibration: Calibration { scale }, .. } = &self.parts;
        let own_m2 = (variance_m2 + kriging.unshared_m2()).component_mul(&scale.component_mul(scale));
        let common_m2 = kriging.common_m2(field, vertices.nearest);
        let has_number = is_finite(&residual_m) && is_finite(&own_m2);
        has_number.then_some(Apart { residual_m, own_m2, common_m2, inside })
    }

    fn mean_and_variance(
        &self,
        point_m: &Vector3<f64>,
        vertices: &Vertices,
        inside: bool,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let variance_m2 = self.variance.at(point_m, vertices.nearest);
        if let Some(trend) = &self.trend {
            let trend_m = trend.at(point_m);
            let beyond_m = if inside {
                Vector3::zeros()
            } else {
                trend_m - trend.at(&self.parts.field.points_m()[vertices.nearest])
            };
            return (trend_m + self.calibrated.kriging_m(point_m), variance_m2 + beyond_m.component_mul(&beyond_m));
        }
        let Some(ensemble) = &self.parts.ensemble else {
            return (self.calibrated.kriging_m(point_m), variance_m2);
        };
        let (network_m, scatter_m2) = self.evaluate(ensemble, point_m, vertices);
        let on_kriging = self.parts.kind == Kind::KrigingNetwork;
        // Kriging is the dear part: left out where nothing needs it.
        let kriging_m = if on_kriging || !inside { self.calibrated.kriging_m(point_m) } else { Vector3::zeros() };
        let residual_m = if on_kriging { kriging_m + network_m } else { network_m };
        let beyond_m = if inside { Vector3::zeros() } else { residual_m - kriging_m };
        (residual_m, variance_m2 + scatter_m2 + beyond_m.component_mul(&beyond_m))
    }

    /// Mean of the members (m) and the variance of a single one about it (m²).
    fn evaluate(
        &self,
        ensemble: &Ensemble,
        point_m: &Vector3<f64>,
        vertices: &Vertices,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let tokens = self.calibrated.tokens(&ensemble.config, &ensemble.normaliser, point_m, vertices);
        let count = self.members.len() as f64;
        let (mut sum, mut squares) = (Vector3::zeros(), Vector3::zeros());
        for member in &self.members {
            let output = member.evaluate(&tokens);
            sum += output;
            squares += output.component_mul(&output);
        }
        let mean = sum / count;
        let scatter = (squares / count - mean.component_mul(&mean)) * (count / (count - 1.0).max(1.0));
        let scale = ensemble.normaliser.scale_m;
        let scatter_m2 = scatter.map(|s| s.max(0.0)).component_mul(&scale).component_mul(&scale);
        (ensemble.normaliser.restore(&mean), scatter_m2)
    }
}

/// Parts that make no model; the text says what to do.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ModelError {
    /// The configuration does not hold.
    #[error("network: {0}")]
    Config(#[from] ConfigError),
    /// Parameters do not fit it.
    #[error("network, member {member}: {source}")]
    Parameters {
        /// Which.
        member: usize,
        /// Why.
        source: ParametersError,
    },
    /// Kind and parts disagree.
    #[error("a model of kind {kind} {} {what}; train it again", if *.needed { "needs" } else { "has no use for" })]
    Ensemble {
        /// Kind.
        kind: &'static str,
        /// What.
        what: &'static str,
        /// Whether it should have one.
        needed: bool,
    },
    /// Networks on the position do not hold.
    #[error("networks on the position: {0}")]
    Trend(#[from] TrendError),
    /// A scale that is none.
    #[error("{0} is not a finite number above zero")]
    Scale(&'static str),
    /// A share that is none.
    #[error("the share of the declared uncertainty that is seen as scatter is not between 0 and 1")]
    Share,
    /// Lists of different lengths.
    #[error("{weights} kriging weights for {points} calibrated points; the parts are from different fits")]
    Weights {
        /// Weights.
        weights: usize,
        /// Points.
        points: usize,
    },
    /// A number that is none.
    #[error("{0} is not a finite number")]
    NotFinite(&'static str),
    /// Covariance without an inverse.
    #[error("the covariance of neighbouring calibrated points is not positive definite; fit kriging with more noise")]
    NotPositiveDefinite,
    /// Residuals that no machine has.
    #[error(
        "a residual of {largest_m} m: residuals are in metres, and above {LARGEST_RESIDUAL_M} m they are no residuals"
    )]
    Unit {
        /// Largest component (m).
        largest_m: f64,
    },
    /// Points that no machine has.
    #[error("a coordinate of {largest_m} m: points are in metres, and no machine is longer than {LARGEST_POINT_M} m")]
    PointUnit {
        /// Largest coordinate (m).
        largest_m: f64,
    },
}

/// Residuals above this (m) are taken for micrometres or millimetres.
const LARGEST_RESIDUAL_M: f64 = 0.01;
/// Coordinates above this (m) are taken for millimetres.
const LARGEST_POINT_M: f64 = 100.0;

/// Refuses calibrated points and residuals that are clearly not in metres.
pub fn check_units(field: &MeasuredField) -> Result<(), ModelError> {
    let largest = |list: &[Vector3<f64>]| list.iter().map(Vector3::amax).fold(0.0, f64::max);
    let (point_m, residual_m) = (largest(field.points_m()), largest(field.errors_m()));
    if point_m > LARGEST_POINT_M {
        return Err(ModelError::PointUnit { largest_m: point_m });
    }
    if residual_m > LARGEST_RESIDUAL_M {
        return Err(ModelError::Unit { largest_m: residual_m });
    }
    Ok(())
}

fn check(parts: &Parts) -> Result<(), ModelError> {
    check_units(&parts.field)?;
    let positive = |values: &[f64], what| {
        let is_good = values.iter().all(|v| v.is_finite() && *v > 0.0);
        is_good.then_some(()).ok_or(ModelError::Scale(what))
    };
    positive(parts.calibration.scale.as_slice(), "a factor of the calibration")?;
    let points = parts.field.points_m().len();
    for component in &parts.kriging.components {
        positive(component.length_m.as_slice(), "a length scale of kriging")?;
        positive(&[component.signal_m], "the signal of kriging")?;
        if !(component.noise_m.is_finite() && component.noise_m >= 0.0) {
            return Err(ModelError::Scale("the noise of kriging"));
        }
        if !(0.0..=1.0).contains(&component.seen) {
            return Err(ModelError::Share);
        }
        if component.weights_per_m.len() != points {
            return Err(ModelError::Weights { weights: component.weights_per_m.len(), points });
        }
        if !(component.trend_m.is_finite() && component.weights_per_m.iter().all(|w| w.is_finite())) {
            return Err(ModelError::NotFinite("a weight or the trend of kriging"));
        }
    }
    let kind = parts.kind.name();
    let needed = parts.kind.has_trend();
    if parts.trend.is_some() != needed {
        return Err(ModelError::Ensemble { kind, what: "networks on the position", needed });
    }
    let needed = parts.kind.has_attention();
    match &parts.ensemble {
        Some(ensemble) if needed && !ensemble.members.is_empty() => check_ensemble(ensemble),
        None if !needed => Ok(()),
        _ => Err(ModelError::Ensemble { kind, what: "networks on the neighbourhood", needed }),
    }
}

fn check_ensemble(ensemble: &Ensemble) -> Result<(), ModelError> {
    ensemble.config.check()?;
    let Normaliser { mean_m, scale_m, spacing_m } = &ensemble.normaliser;
    if !mean_m.iter().all(|m| m.is_finite()) {
        return Err(ModelError::NotFinite("the normaliser's mean"));
    }
    if !scale_m.iter().chain([spacing_m]).all(|s| s.is_finite() && *s > 0.0) {
        return Err(ModelError::Scale("a scale of the normaliser"));
    }
    for (member, parameters) in ensemble.members.iter().enumerate() {
        let again = Parameters::new(&ensemble.config, parameters.values().to_vec());
        again.map_err(|source| ModelError::Parameters { member, source })?;
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests;
