//! The report of a corrected campaign: its data as plain structs, in the units that readers use.
//!
//! The caller converts from SI once; every field names its unit. Positions are in the machine frame.
//! Error = actual − indicated; errors carry ISO 230-1 names.

mod build;
mod closing;
mod curves;
mod fit;
mod residuals;
mod verification;

pub use closing::{Closing, InUse};

use crate::identity::Identity;
use crate::report::NextStep;
use crate::sections::Callout;
use serde::{Deserialize, Serialize};

/// What was run, on what, with what.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RunHeader {
    /// Title of the report.
    pub title: String,
    /// What was run, in a sentence.
    pub what: String,
    /// Who, when and which.
    #[serde(default)]
    pub identity: Identity,
    /// What to do next.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<NextStep>,
    /// What was measured, when, with what: as far as the data say.
    #[serde(default)]
    pub about: Vec<FileEntry>,
    /// Files read and written.
    pub files: Vec<FileEntry>,
    /// Hash of the campaign's data.
    pub data_hash: Option<String>,
    /// Hash of the identified model.
    pub model_hash: Option<String>,
    /// Name and version of the software.
    pub software_version: String,
}

/// A file of the run.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileEntry {
    /// What it is, e.g. `campaign`.
    pub role: String,
    /// Its name.
    pub name: String,
}

/// A verification point that took no part in the fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VerificationPoint {
    /// Indicated position.
    pub position_mm: [f64; 3],
    /// Error of the indicated position (actual − indicated), after the alignment that `verification_note` tells.
    pub before_um: [f64; 3],
    /// Error left after correction; missing where no correction was possible.
    pub after_um: Option<[f64; 3]>,
    /// Error left with the model that a diagnosis made of it; missing where there is none.
    #[serde(default)]
    pub after_loop_um: Option<[f64; 3]>,
}

/// How the fit went.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FitSummary {
    /// Estimated standard deviation of the residuals.
    pub residual_sigma_um: Option<f64>,
    /// Standard deviation that the declared uncertainties predict.
    pub declared_sigma_um: Option<f64>,
    /// χ² over degrees of freedom, with the declared uncertainties.
    pub chi2_per_dof: Option<f64>,
    /// Degrees of freedom.
    pub degrees_of_freedom: Option<f64>,
    /// Readings used.
    pub readings_used: usize,
    /// Readings rejected.
    pub readings_rejected: usize,
    /// Whether the iteration converged.
    pub converged: bool,
}

/// Duration of a step of the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepDuration {
    /// Name of the step.
    pub name: String,
    /// Its duration.
    pub duration_s: Option<f64>,
}

/// A residual of the fit (measured − modelled range).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// Name of the station, as in the list of stations.
    pub station: String,
    /// Name of the line that it was read on.
    #[serde(default)]
    pub line: String,
    /// Time since the campaign began.
    pub time_s: f64,
    /// Indicated position.
    pub position_mm: [f64; 3],
    /// The residual.
    pub residual_um: f64,
    /// Declared standard uncertainty of the reading.
    pub declared_sigma_um: Option<f64>,
}

/// Whether an error is a displacement or a rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ErrorKind {
    /// Positioning or straightness, µm.
    Linear,
    /// Roll, pitch or yaw, µrad.
    Angular,
}

impl ErrorKind {
    /// The unit of the error.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Linear => "µm",
            Self::Angular => "µrad",
        }
    }
}

/// One of the 18 position-dependent errors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ErrorCurve {
    /// ISO 230-1 name, e.g. `EXX`.
    pub name: String,
    /// Axis of motion: `x`, `y` or `z`.
    pub axis: String,
    /// Displacement (values in µm) or rotation (values in µrad).
    pub kind: ErrorKind,
    /// Positions along the axis.
    pub position_mm: Vec<f64>,
    /// The error at the positions, µm or µrad; missing outside the identified range.
    pub value: Vec<Option<f64>>,
    /// Half width of the 95 % band at the positions, µm or µrad.
    pub half_width_95: Option<Vec<Option<f64>>>,
    /// The true error at the positions where a simulator knows it, µm or µrad.
    pub truth: Option<Vec<Option<f64>>>,
}

/// One of the squareness errors, or an angle of the turn of the ram.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SquarenessError {
    /// ISO 230-1 name, e.g. `C0Y`, or what it is.
    pub name: String,
    /// Its value.
    pub value_urad: Option<f64>,
    /// Expanded uncertainty, 95 %.
    pub expanded_95_urad: Option<f64>,
    /// The true value where a simulator knows it.
    pub truth_urad: Option<f64>,
}

/// The 21 errors: 18 curves and the squareness errors; the turn of the ram beside them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorCurveSet {
    /// The curves; shown three a row in the order given.
    pub curves: Vec<ErrorCurve>,
    /// The squareness errors, and the turn of the ram.
    pub squareness: Vec<SquarenessError>,
}

/// A tracer station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StationEntry {
    /// Name.
    pub name: String,
    /// Identified position.
    pub position_mm: [f64; 3],
    /// Standard uncertainty of the position by axis.
    pub uncertainty_um: Option<[f64; 3]>,
    /// Identified dead path.
    pub dead_path_mm: Option<f64>,
    /// Readings used.
    pub readings: usize,
    /// Root mean square of its residuals.
    pub residual_rms_um: Option<f64>,
}

/// Limits of the measured volume.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeasuringVolume {
    /// Lower corner.
    pub min_mm: [f64; 3],
    /// Upper corner.
    pub max_mm: [f64; 3],
}

/// A line of points measured from a station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeasuredLine {
    /// Its name.
    #[serde(default)]
    pub name: String,
    /// Name of the station.
    pub station: String,
    /// First point.
    pub from_mm: [f64; 3],
    /// Last point.
    pub to_mm: [f64; 3],
}

/// What the evidence chose for one error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OrderChoice {
    /// ISO 230-1 name.
    pub error: String,
    /// The chosen form in words, e.g. `cubic spline, 8 knots`.
    pub form: String,
    /// Effective degrees of freedom.
    pub effective_dof: Option<f64>,
    /// Gain of log evidence over the next simpler form.
    pub evidence_gain: Option<f64>,
}

/// A pair of parameters with high correlation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Correlation {
    /// One parameter.
    pub first: String,
    /// The other.
    pub second: String,
    /// Correlation coefficient.
    pub coefficient: f64,
}

/// What the plan can tell.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Identifiability {
    /// Unknowns of low order, by which the plan is judged.
    pub unknowns: usize,
    /// Numerical rank of the weighted Jacobian after the gauge constraints.
    pub rank: Option<usize>,
    /// Condition of the scaled normal matrix's square root.
    pub condition: Option<f64>,
    /// Ratio of achieved to Cramér-Rao uncertainty, where known.
    pub cramer_rao_ratio: Option<f64>,
    /// Correlations above 0.9 in magnitude.
    pub correlations: Vec<Correlation>,
}

/// A rejected reading.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RejectedReading {
    /// Data row in the campaign, counted from 1.
    pub row: usize,
    /// Name of the station.
    pub station: String,
    /// Name of the line that it was read on.
    #[serde(default)]
    pub line: String,
    /// Time since the campaign began.
    pub time_s: Option<f64>,
    /// Indicated position.
    pub position_mm: [f64; 3],
    /// Its residual.
    pub residual_um: Option<f64>,
    /// Residual over declared standard uncertainty.
    pub normalised: Option<f64>,
    /// Why.
    pub reason: String,
}

/// Figures of the live run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LiveFigures {
    /// Scale samples sent.
    pub samples_sent: Option<u64>,
    /// Corrected samples received.
    pub samples_received: Option<u64>,
    /// Samples lost.
    pub samples_lost: Option<u64>,
    /// Median latency, scale sample to corrected sample.
    pub latency_p50_us: Option<f64>,
    /// 99 % quantile of the latency.
    pub latency_p99_us: Option<f64>,
    /// 99.9 % quantile of the latency.
    pub latency_p999_us: Option<f64>,
    /// How it was carried, in words.
    pub transport: Option<String>,
}

/// Everything the report of a corrected campaign shows.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DemoReport {
    /// What was run.
    pub header: RunHeader,
    /// Verification points; empty if there is no verification.
    pub verification: Vec<VerificationPoint>,
    /// How the verification was made and aligned.
    pub verification_note: Option<String>,
    /// How the fit went.
    pub fit: FitSummary,
    /// Duration of the steps.
    pub steps: Vec<StepDuration>,
    /// Residuals of the readings used.
    pub residuals: Vec<Residual>,
    /// The 21 errors.
    pub errors: ErrorCurveSet,
    /// The stations.
    pub stations: Vec<StationEntry>,
    /// The measured volume; without it, no sketch.
    pub volume: Option<MeasuringVolume>,
    /// The measured lines of the sketch.
    pub lines: Vec<MeasuredLine>,
    /// The choice of model order.
    pub order: Vec<OrderChoice>,
    /// What the plan can tell.
    pub identifiability: Identifiability,
    /// The rejected readings.
    pub rejected: Vec<RejectedReading>,
    /// Figures of the live run; missing if there was none.
    pub live: Option<LiveFigures>,
    /// How the loop went; missing where it was left out.
    #[serde(default)]
    pub closing: Option<Closing>,
    /// Whether this is a fit by itself, to which neither verification nor a live run belongs.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_fit_alone: bool,
    /// What limits the result, gravest first, each as it is to be taken.
    pub remarks: Vec<Callout>,
}
