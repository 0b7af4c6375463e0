//! Residual model files: a trained residual field with everything needed to use it and to trust it.
//!
//! Place in the flow: `abbe train` → [`ResidualFile::save`] → residual node, `abbe correct`, `predict` and replay through
//! [`ResidualFile::load`], in the envelope of [`crate::envelope`]: `{"format":"abbe-residual","version":2,"sha256":"…",
//! "residual":{…}}`. Points and lengths in m, machine frame; residual = actual − corrected by the geometric model that the
//! file names. A file that is cut off, changed in one bit, of another version, layout or machine is refused.

use crate::atomic::write_atomically;
use crate::envelope::{self, FileKind, hex, sha256_of_hex};
use crate::error::{FileError, Place};
use crate::machine::SIGN_CONVENTION;
use crate::model_contents::DataSource;
use crate::model_record::OneLine;
use abbe_geometry::effects::{CovariateProblem, CovariateSource};
use abbe_geometry::residual_field::{ResidualField, ResidualPrediction};
use abbe_geometry::{Matrix3, Vector3};
use abbe_residual_net::ResidualModel;
use abbe_residual_net::record::{Array, Record};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

const KIND: FileKind = FileKind {
    format: "abbe-residual",
    version: 2,
    name: "residual model",
    maker: "abbe train",
    again: "train the residual model again",
};
const UNITS: &str = "SI: m, machine frame; uncertainties are standard uncertainties (k = 1); units stand in the names";

/// The geometric model that leaves what a residual model was trained on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResidualOwner {
    /// Name of the machine.
    pub machine: String,
    /// SHA-256 of its geometric model.
    pub model_sha256: [u8; 32],
}

/// A trained residual field with everything that is to be known of how it came about.
#[derive(Debug)]
pub struct ResidualFile {
    /// The field, checked and ready to predict.
    pub model: ResidualModel,
    /// The geometric model it belongs to; `None` for residuals of unknown origin, which correct nothing by themselves.
    pub owner: Option<ResidualOwner>,
    /// What it was trained on.
    pub data: Vec<DataSource>,
    /// Seed of initial weights, batches and splits.
    pub seed: u64,
    /// Whether training went on to its end; a file of a stopped training holds the best so far.
    pub complete: bool,
    /// Configuration of the training.
    pub config: Value,
    /// Figures on data left out, by method, and why this one was chosen.
    pub validation: Value,
    /// Name and version of the software that made it.
    pub software: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    software: String,
    units: String,
    sign_convention: String,
    belongs_to: Option<OwnerRecord>,
    data: Vec<DataSource>,
    seed: u64,
    complete: bool,
    config: Value,
    validation: Value,
    predictor: PredictorRecord,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct OwnerRecord {
    machine: String,
    model_sha256: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PredictorRecord {
    kind: String,
    numbers: BTreeMap<String, f64>,
    texts: BTreeMap<String, String>,
    arrays: BTreeMap<String, ArrayRecord>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ArrayRecord {
    shape: Vec<usize>,
    values: OneLine,
}

impl ResidualFile {
    /// Bytes of the file and SHA-256 of its content. The same field gives the same bytes.
    ///
    /// # Errors
    /// A number that is not finite.
    pub fn to_bytes(&self, file: &str) -> Result<(Vec<u8>, [u8; 32]), FileError> {
        let record = self.model.to_record();
        let figures = record.arrays.iter().map(|(name, array)| (name, array.values.as_slice()));
        let numbers = record.numbers.iter().map(|(name, value)| (name, std::slice::from_ref(value)));
        if let Some((name, _)) = figures.chain(numbers).find(|(_, values)| values.iter().any(|v| !v.is_finite())) {
            let problem = "a number is not finite, so the residual model cannot be stored";
            return Err(FileError::content(Place::file(file).key(name), problem, "train it again"));
        }
        let owner = |owner: &ResidualOwner| OwnerRecord {
            machine: owner.machine.clone(),
            model_sha256: hex(&owner.model_sha256),
        };
        let array =
            |(name, array): (String, Array)| (name, ArrayRecord { shape: array.shape, values: OneLine(array.values) });
        let content = Content {
            software: self.software.clone(),
            units: UNITS.to_owned(),
            sign_convention: SIGN_CONVENTION.to_owned(),
            belongs_to: self.owner.as_ref().map(owner),
            data: self.data.clone(),
            seed: self.seed,
            complete: self.complete,
            config: self.config.clone(),
            validation: self.validation.clone(),
            predictor: PredictorRecord {
                kind: record.kind,
                numbers: record.numbers,
                texts: record.texts,
                arrays: record.arrays.into_iter().map(array).collect(),
            },
        };
        envelope::seal(&KIND, &content, file)
    }

    /// Writes the whole file or nothing, and returns the SHA-256 of its content.
    ///
    /// # Errors
    /// What the system says, or a number that is not finite.
    pub fn save(&self, path: &Path) -> Result<[u8; 32], FileError> {
        let (bytes, digest) = self.to_bytes(&path.display().to_string())?;
        write_atomically(path, &bytes)?;
        Ok(digest)
    }

    /// Reads a residual model; also returns the SHA-256 of its content. What its training said against it goes to the log.
    ///
    /// # Errors
    /// What is wrong with the file, and what to do.
    pub fn load(path: &Path) -> Result<(ResidualFile, [u8; 32]), FileError> {
        let file = path.display().to_string();
        let bytes = std::fs::read(path).map_err(FileError::io(&file, "read the residual model"))?;
        let (model, digest) = ResidualFile::from_bytes(&bytes, &file)?;
        model.doubts().for_each(|doubt| tracing::warn!("{file}: {doubt}"));
        Ok((model, digest))
    }

    /// What whoever corrects with this model should know: what its own training said against it.
    pub fn doubts(&self) -> impl Iterator<Item = &'static str> {
        let advised = self.validation.pointer("/recommendation/method").and_then(Value::as_str);
        let against = "held-out data spoke for no residual model at all when it was trained; do not correct with it";
        let no_help =
            "held-out data did not show that its inputs beside the position help; train on the position alone";
        let is_plainer = advised.is_some_and(|method| method.ends_with(" (position alone)"));
        let stopped = "its training was stopped before its end; abbe train --resume goes on";
        let doubts = [(advised == Some("zero"), against), (is_plainer, no_help), (!self.complete, stopped)];
        doubts.into_iter().filter_map(|(is_so, doubt)| is_so.then_some(doubt))
    }

    /// Reads a residual model that belongs to a geometric model of the machine with that name; also says which.
    ///
    /// # Errors
    /// As [`ResidualFile::load`]; another machine, or residuals of unknown origin.
    pub fn load_for(path: &Path, machine: &str) -> Result<(ResidualFile, ResidualOwner, [u8; 32]), FileError> {
        let (file, digest) = ResidualFile::load(path)?;
        let place = Place::file(&path.display().to_string()).key("belongs_to");
        let Some(owner) = file.owner.clone() else {
            let problem = "the residual model does not say which geometric model it belongs to";
            return Err(FileError::content(
                place,
                problem,
                "train it again with --model, so that it is applied to no other",
            ));
        };
        if owner.machine != machine {
            let problem = format!("the residual model is of machine {:?}, not of {machine:?}", owner.machine);
            return Err(FileError::content(place, problem, "give the residual model of this machine, or train one"));
        }
        Ok((file, owner, digest))
    }

    /// Reads a residual model that belongs to exactly this geometric model.
    ///
    /// # Errors
    /// As [`ResidualFile::load_for`]; another geometric model.
    pub fn load_for_model(
        path: &Path,
        machine: &str,
        model_sha256: &[u8; 32],
    ) -> Result<(ResidualFile, [u8; 32]), FileError> {
        let (file, owner, digest) = ResidualFile::load_for(path, machine)?;
        if owner.model_sha256 != *model_sha256 {
            let place = Place::file(&path.display().to_string()).key("belongs_to.model_sha256");
            let problem = format!(
                "the residual model was trained on what model {} leaves, not model {}",
                hex(&owner.model_sha256),
                hex(model_sha256)
            );
            let remedy = "give the model that it belongs to, or train on the residuals of this model";
            return Err(FileError::content(place, problem, remedy));
        }
        Ok((file, digest))
    }

    /// Reads the bytes of a residual model; `name` is the file in messages.
    ///
    /// # Errors
    /// What is wrong with the file, and what to do.
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<(ResidualFile, [u8; 32]), FileError> {
        let (content, digest): (Content, [u8; 32]) = envelope::open(&KIND, bytes, name)?;
        let place = |key: &str| Place::file(name).key(key);
        let again = "use the software that wrote it, or train the residual model again";
        for (key, found, known) in
            [("units", &content.units, UNITS), ("sign_convention", &content.sign_convention, SIGN_CONVENTION)]
        {
            if found != known {
                let problem = format!("{found:?} is not what this software computes with, which is {known:?}");
                return Err(FileError::content(place(key), problem, again));
            }
        }
        let owner = content.belongs_to.map(|owner| owner_of(owner, name)).transpose()?;
        let array = |(key, array): (String, ArrayRecord)| (key, Array { shape: array.shape, values: array.values.0 });
        let PredictorRecord { kind, numbers, texts, arrays } = content.predictor;
        let record = Record { kind, numbers, texts, arrays: arrays.into_iter().map(array).collect() };
        let model = ResidualModel::from_record(record)
            .map_err(|error| FileError::content(place("predictor"), error.to_string(), again))?;
        let file = ResidualFile {
            model,
            owner,
            data: content.data,
            seed: content.seed,
            complete: content.complete,
            config: content.config,
            validation: content.validation,
            software: content.software,
        };
        Ok((file, digest))
    }
}

fn owner_of(record: OwnerRecord, name: &str) -> Result<ResidualOwner, FileError> {
    let model_sha256 = sha256_of_hex(&record.model_sha256).ok_or_else(|| {
        let place = Place::file(name).key("belongs_to.model_sha256");
        FileError::content(place, "the hash is not 64 hexadecimal digits", "train the residual model again")
    })?;
    Ok(ResidualOwner { machine: record.machine, model_sha256 })
}

/// A residual field with the hash of the file that it came from: what nodes and commands correct with.
#[derive(Debug)]
pub struct LoadedResidual {
    model: ResidualModel,
    sha256: [u8; 32],
}

impl LoadedResidual {
    /// A field and the hash of its file.
    pub fn new(model: ResidualModel, sha256: [u8; 32]) -> LoadedResidual {
        LoadedResidual { model, sha256 }
    }
}

impl ResidualField for LoadedResidual {
    fn covariates(&self) -> &[String] {
        self.model.covariates()
    }

    fn predict(
        &self,
        point_in_machine_m: &Vector3<f64>,
        covariates: &dyn CovariateSource,
    ) -> Result<ResidualPrediction, CovariateProblem> {
        Ok(self.model.predict(self.model.at(point_in_machine_m, covariates)?.as_slice()))
    }

    fn unknown_m2(&self) -> Matrix3<f64> {
        self.model.unknown_m2()
    }

    fn sha256(&self) -> [u8; 32] {
        self.sha256
    }
}
