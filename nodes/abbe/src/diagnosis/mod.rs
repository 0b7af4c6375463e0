//! From a diagnosis to what a user gets: its record, its pictures, its score, its files.
//!
//! Place in the flow: `abbe diagnose` calls [`tracer`] for campaigns with a model and [`study`] for data without one;
//! both give a [`Product`], which [`output`] writes and prints. Scoring on verification points comes last.

pub(crate) mod output;
mod pictures;
mod record;
mod run_pictures;
mod scoring;
pub(crate) mod study;
mod study_added;
mod study_model;
mod study_record;
pub(crate) mod tracer;
mod vector_pictures;

pub(crate) use record::{shape, title};

use crate::pipeline::BagJoin;
use crate::verdict::Accept;
use abbe_report::diagnosis::DiagnosisReport;
use std::path::{Path, PathBuf};

/// What the user asked for, whatever the data are.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Request<'a> {
    /// Machine that data without a model were measured on.
    pub(crate) machine: Option<&'a Path>,
    /// Independent points, for scoring only.
    pub(crate) verify: Option<&'a Path>,
    /// Seed of folds and placebos.
    pub(crate) seed: u64,
    /// Parts in which data are left out; `None` for the usual number.
    pub(crate) folds: Option<usize>,
    /// Whether the instrument of a study is known not to have drifted.
    pub(crate) instrument_checked: bool,
    /// Whether a model is given although the data contradict themselves.
    pub(crate) accept: Accept,
    /// How a bag is read as a campaign.
    pub(crate) join: &'a BagJoin,
}

/// What a diagnosis gives.
pub(crate) struct Product {
    /// Report and JSON.
    pub(crate) report: DiagnosisReport,
    /// Bytes of the model file; `None` where the data belong to no model.
    pub(crate) model: Option<Vec<u8>>,
    /// Why a machine or a model was named and there is no model; empty where there is one, or none was asked for.
    pub(crate) without_model: Vec<String>,
    /// Whether the study was stopped, and this is what it had found by then.
    pub(crate) is_partial: bool,
}

/// Names in the output folder.
pub(crate) const REPORT: &str = "report.html";
pub(crate) const DIAGNOSIS: &str = "diagnosis.json";
pub(crate) const MODEL: &str = "model.json";

/// Name of a file without its folder.
fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// Where the files go.
pub(crate) fn targets(folder: &Path) -> [PathBuf; 3] {
    [REPORT, DIAGNOSIS, MODEL].map(|name| folder.join(name))
}
