//! A residual model: calibrated points, kriging, the network's members, and how far its statements hold.
//!
//! Place in the flow: made of plain parts by training or by reading an artifact, checked once; then one function, live and
//! offline alike. A point's inputs in ([`ResidualModel::at`] collects them: the position in m, machine frame, and what the sample
//! says of the others, in the unit of their names), residual = actual − corrected so far (m) with covariance (m²) out. Nothing is
//! allocated in a prediction.
//!
//! | kind | residual |
//! |---|---|
//! | kriging | kriging of the calibrated residuals |
//! | network | mean of the members on the calibrated residuals around the point |
//! | kriging-network | kriging, and the mean of the members on what kriging leaves at the calibrated points around |
//! | perceptron-kriging | mean of networks on the inputs, and kriging of what it leaves at the calibrated points |
//!
//! Variance of a component: calibration² · (variance of kriging at the point + variance of the members' mean about it + σ²) + what
//! is common. Kriging's variance stands under every kind, as it knows how far the point lies from what was measured. Beyond the
//! calibrated points a network says nothing reliable: there the square of its difference to kriging is added. σ² is what
//! neighbours do not share beyond their declared uncertainty: the machine's repeatability and field finer than the points, both
//! of which will be there again. What is declared and not seen as scatter is common to neighbours, so no number of them takes it away.

use crate::calibrated_points::CalibratedPoints;
use crate::calibration::Calibration;
use crate::kind::ResidualMethod;
use crate::kriging::{Kriging, KrigingVariance};
use crate::neighbourhood::{VERTICES, Vertices};
use crate::network::tokens::Normaliser;
use crate::network::{ConfigError, Folded, MOST_NEIGHBOURED, NetworkConfig, Parameters, ParametersError};
use crate::supporting_planes::SupportingPlanes;
use crate::trend::{PositionEnsemble, Trend, TrendError};
use abbe_field::{MOST_INPUTS, Samples, place_of};
use abbe_geometry::effects::{CovariateProblem, CovariateSource, known_covariate};
use abbe_geometry::residual_field::ResidualPrediction;
use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

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
    pub kind: ResidualMethod,
    /// Calibrated points by their inputs, residuals and, where known, their standard uncertainty (m).
    pub field: Samples,
    /// Scale of each input, in its unit: over these, distances of neighbours compare. All 1 where the position is all there is.
    pub scale: Vec<f64>,
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

/// Inputs of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct At {
    values: [f64; MOST_INPUTS],
    size: usize,
}

impl At {
    /// One number for each input of the model.
    pub fn as_slice(&self) -> &[f64] {
        &self.values[..self.size]
    }
}

/// A checked model, ready to predict.
#[derive(Debug, Clone)]
pub struct ResidualModel {
    parts: Parts,
    calibrated: CalibratedPoints,
    /// Where the position is an input.
    planes: Option<SupportingPlanes>,
    /// Least and largest value of each input that is no position.
    ranges: Vec<(f64, f64)>,
    variance: KrigingVariance,
    members: Vec<Folded>,
    trend: Option<Trend>,
    unknown_m2: Matrix3<f64>,
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
        let calibrated = CalibratedPoints::new(parts.kind, &parts.field, &parts.scale, &parts.kriging, normaliser);
        let planes = parts.field.has_position().then(|| SupportingPlanes::new(&parts.field.places()));
        let (low, high) = parts.field.range();
        let ranges = low.into_iter().zip(high).skip(if planes.is_some() { 3 } else { 0 }).collect();
        let trend = parts.trend.clone().map(Trend::new).transpose()?;
        let unknown_m2 = unknown_m2(&parts);
        Ok(ResidualModel { calibrated, planes, ranges, variance, members, trend, unknown_m2, parts })
    }

    /// What it is made of.
    pub fn parts(&self) -> &Parts {
        &self.parts
    }

    /// What predicts.
    pub fn kind(&self) -> ResidualMethod {
        self.parts.kind
    }

    /// Names of the inputs that are no position: covariates, the unit as suffix.
    pub fn covariates(&self) -> &[String] {
        &self.parts.field.names()[if self.planes.is_some() { 3 } else { 0 }..]
    }

    /// Whether the position is among the inputs.
    pub fn has_position(&self) -> bool {
        self.planes.is_some()
    }

    /// The inputs of a geometrically corrected point (m, machine frame) and its sample.
    ///
    /// # Errors
    /// An input that the sample lacks, or whose value is too old.
    pub fn at(&self, point_m: &Vector3<f64>, covariates: &dyn CovariateSource) -> Result<At, CovariateProblem> {
        let mut at = At { values: [0.0; MOST_INPUTS], size: self.parts.field.size() };
        let first = self.parts.field.size() - self.covariates().len();
        at.values[..first].copy_from_slice(&point_m.as_slice()[..first]);
        for (value, name) in at.values[first..].iter_mut().zip(self.covariates()) {
            *value = known_covariate(covariates, name)?;
        }
        Ok(at)
    }

    /// Covariance (m²) of what is left where no residual is added, as the inputs of a sample are not known: the mean square of the
    /// calibrated residuals, and what they have in common.
    pub fn unknown_m2(&self) -> Matrix3<f64> {
        self.unknown_m2
    }

    /// Residual at a point by its inputs. For a point that is no number, or so far away that it has none, the residual is zero, its
    /// covariance infinite and the point not inside.
    pub fn predict(&self, at: &[f64]) -> ResidualPrediction {
        let Some(apart) = self.predict_apart(at) else {
            let covariance_m2 = Matrix3::from_diagonal(&Vector3::repeat(f64::INFINITY));
            return ResidualPrediction { residual_m: Vector3::zeros(), covariance_m2, inside: false };
        };
        let covariance_m2 = Matrix3::from_diagonal(&(apart.own_m2 + apart.common_m2));
        ResidualPrediction { residual_m: apart.residual_m, covariance_m2, inside: apart.inside }
    }

    /// The same with its variance in two parts; `None` where there is no number, or the inputs are not those of the model.
    pub fn predict_apart(&self, at: &[f64]) -> Option<Apart> {
        let is_finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
        let is_whole = at.len() == self.parts.field.size() && is_finite(at);
        let vertices = self.calibrated.vertices(at).filter(|_| is_whole)?;
        let inside = self.is_inside(at, &vertices);
        let (residual_m, variance_m2) = self.mean_and_variance(at, &vertices, inside);
        let Parts { kriging, field, calibration: Calibration { scale }, .. } = &self.parts;
        let own_m2 = (variance_m2 + kriging.unshared_m2()).component_mul(&scale.component_mul(scale));
        let common_m2 = kriging.common_m2(field, vertices.nearest);
        let has_number = is_finite(residual_m.as_slice()) && is_finite(own_m2.as_slice());
        has_number.then_some(Apart { residual_m, own_m2, common_m2, inside })
    }

    /// Whether the position lies among the calibrated ones, and each other input within its range.
    fn is_inside(&self, at: &[f64], vertices: &Vertices) -> bool {
        let further = &at[at.len() - self.ranges.len()..];
        let is_within = |(value, (low, high)): (&f64, &(f64, f64))| (*low..=*high).contains(value);
        let is_among = |planes: &SupportingPlanes| vertices.occupied == [true; VERTICES] || planes.holds(&place_of(at));
        self.planes.as_ref().is_none_or(is_among) && further.iter().zip(&self.ranges).all(is_within)
    }

    fn mean_and_variance(&self, at: &[f64], vertices: &Vertices, inside: bool) -> (Vector3<f64>, Vector3<f64>) {
        let variance_m2 = self.variance.at(at, vertices.nearest);
        if let Some(trend) = &self.trend {
            let trend_m = trend.at(at);
            let beyond_m =
                if inside { Vector3::zeros() } else { trend_m - trend.at(self.parts.field.point(vertices.nearest)) };
            return (trend_m + self.calibrated.kriging_m(at), variance_m2 + beyond_m.component_mul(&beyond_m));
        }
        let Some(ensemble) = &self.parts.ensemble else {
            return (self.calibrated.kriging_m(at), variance_m2);
        };
        let (network_m, scatter_m2) = self.evaluate(ensemble, at, vertices);
        let on_kriging = self.parts.kind == ResidualMethod::KrigingNetwork;
        // Kriging is the dear part: left out where nothing needs it.
        let kriging_m = if on_kriging || !inside { self.calibrated.kriging_m(at) } else { Vector3::zeros() };
        let residual_m = if on_kriging { kriging_m + network_m } else { network_m };
        let beyond_m = if inside { Vector3::zeros() } else { residual_m - kriging_m };
        (residual_m, variance_m2 + scatter_m2 + beyond_m.component_mul(&beyond_m))
    }

    /// Mean of the members (m) and the variance of a single one about it (m²).
    fn evaluate(&self, ensemble: &Ensemble, at: &[f64], vertices: &Vertices) -> (Vector3<f64>, Vector3<f64>) {
        let tokens = self.calibrated.tokens(&ensemble.config, &ensemble.normaliser, at, vertices);
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

/// Mean square of the calibrated residuals, with the largest variance that neighbours have in common (m²).
fn unknown_m2(Parts { field, kriging, .. }: &Parts) -> Matrix3<f64> {
    let squares = field.errors_m().iter().map(|error| error * error.transpose()).sum::<Matrix3<f64>>();
    let common = (0..field.count()).fold(Vector3::zeros(), |most, k| kriging.common_m2(field, k).sup(&most));
    squares / field.count() as f64 + Matrix3::from_diagonal(&common)
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
    /// Method and parts disagree.
    #[error("a model of kind {kind} {} {what}; train it again", if *.needed { "needs" } else { "has no use for" })]
    Ensemble {
        /// Method.
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
    /// Scales that do not fit the inputs.
    #[error("{found} scales for {expected} inputs; the parts are from different models")]
    InputScales {
        /// Scales, or box corners.
        found: usize,
        /// Inputs.
        expected: usize,
    },
    /// More inputs than a network on the neighbourhood takes.
    #[error(
        "a network on the neighbourhood takes {MOST_NEIGHBOURED} inputs at most, and these are {0}; take the method kriging or \
         perceptron-kriging, or fewer inputs"
    )]
    Neighboured(usize),
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
pub fn check_units(field: &Samples) -> Result<(), ModelError> {
    let largest = |list: &[Vector3<f64>]| list.iter().map(Vector3::amax).fold(0.0, f64::max);
    let point_m = if field.has_position() { largest(&field.places()) } else { 0.0 };
    let residual_m = largest(field.errors_m());
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
    let (points, size) = (parts.field.count(), parts.field.size());
    positive(&parts.scale, "a scale of an input")?;
    let lengths = parts.kriging.components.iter().map(|component| component.length.len());
    let boxes = parts.trend.iter().map(|trend| trend.low.len());
    if let Some(found) = lengths.chain(boxes).chain([parts.scale.len()]).find(|found| *found != size) {
        return Err(ModelError::InputScales { found, expected: size });
    }
    for component in &parts.kriging.components {
        positive(&component.length, "a length scale of kriging")?;
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
        Some(ensemble) if needed && !ensemble.members.is_empty() => check_ensemble(ensemble, size),
        None if !needed => Ok(()),
        _ => Err(ModelError::Ensemble { kind, what: "networks on the neighbourhood", needed }),
    }
}

fn check_ensemble(ensemble: &Ensemble, inputs: usize) -> Result<(), ModelError> {
    if inputs > MOST_NEIGHBOURED {
        return Err(ModelError::Neighboured(inputs));
    }
    ensemble.config.check()?;
    let Normaliser { mean_m, scale_m, spacing_m } = &ensemble.normaliser;
    if !mean_m.iter().all(|m| m.is_finite()) {
        return Err(ModelError::NotFinite("the normaliser's mean"));
    }
    if !scale_m.iter().chain([spacing_m]).all(|s| s.is_finite() && *s > 0.0) {
        return Err(ModelError::Scale("a scale of the normaliser"));
    }
    for (member, parameters) in ensemble.members.iter().enumerate() {
        let again = Parameters::new(&ensemble.config, inputs, parameters.values().to_vec());
        again.map_err(|source| ModelError::Parameters { member, source })?;
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests;
