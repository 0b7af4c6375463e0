//! What a model file holds beside its envelope.
//!
//! Place in the flow: identification and diagnosis fill it, [`crate::model_file`] saves and loads it, [`crate::model_record`] is its
//! form in JSON. SI.

use crate::machine::OrderChoice;
use abbe_geometry::model::MachineModel;
use abbe_measurement::instrument::RangeUncertainty;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A file that the model was identified from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataSource {
    /// Name of the file without its folder.
    pub file: String,
    /// SHA-256 of its bytes, 64 hexadecimal digits.
    pub sha256: String,
}

/// The residual network that belongs to a model.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResidualReference {
    /// Name of its file, beside the model's.
    pub file: String,
    /// SHA-256 of its bytes, 64 hexadecimal digits.
    pub sha256: String,
}

/// What speaks against a model, as its own identification found it: everyone who uses the model should know.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Doubt {
    /// `warning`, or `refusal` where the model was made all the same because its user accepted that.
    pub grade: String,
    /// What it is, and what may be behind it.
    pub text: String,
}

/// A model with everything that is to be known of how it came about.
#[derive(Debug)]
pub struct ModelFile {
    /// The model, checked and ready to correct.
    pub model: MachineModel,
    /// Who decided the orders of the error functions.
    pub order: OrderChoice,
    /// Uncertainty of the tracer's range, k = 1.
    pub instrument: RangeUncertainty,
    /// True where length readings are distances.
    pub absolute_range: bool,
    /// Residual network to be applied after the model.
    pub residual_network: Option<ResidualReference>,
    /// What the model was identified from.
    pub data: Vec<DataSource>,
    /// Seed of whatever was random in identification.
    pub seed: Option<u64>,
    /// Options of identification.
    pub options: Value,
    /// What identification wants to keep: order selection, correlations, rejected readings.
    pub evidence: Value,
    /// What speaks against it.
    pub doubts: Vec<Doubt>,
    /// Name and version of the software that made the model.
    pub software: String,
}
