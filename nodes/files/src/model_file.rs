//! Model files: JSON in an envelope with the hash of its content.
//!
//! Place in the flow: identification → [`ModelFile::save`] → nodes, `abbe correct`, monitor through
//! [`ModelFile::load`]. `{"format":"abbe-model","version":1,"sha256":"…","model":{…}}`, where the hash is of the
//! bytes of the value of `model`. A file that is cut off, changed in one bit, of an unknown version or of another
//! machine is refused.

use crate::atomic::write_atomically;
use crate::error::{FileError, Place};
use crate::machine::OrderChoice;
use crate::model_record::ModelRecord;
use abbe_geometry::model::MachineModel;
use abbe_measurement::instrument::RangeUncertainty;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use serde_json::value::RawValue;
use sha2::{Digest, Sha256};
use std::path::Path;

const FORMAT: &str = "abbe-model";
const VERSION: u64 = 1;

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
    /// Name and version of the software that made the model.
    pub software: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Envelope<'a> {
    format: &'a str,
    version: u64,
    sha256: &'a str,
    #[serde(borrow)]
    model: &'a RawValue,
}

/// What is read first, so that a later version is recognised as such.
#[derive(Deserialize)]
struct Head {
    format: String,
    version: u64,
}

impl ModelFile {
    /// Bytes of the file and SHA-256 of the model in it. The same model gives the same bytes.
    pub fn to_bytes(&self, name: &str) -> Result<(Vec<u8>, [u8; 32]), FileError> {
        self.check_finite(name)?;
        let unwritable = |error: serde_json::Error| {
            FileError::content(Place::file(name), format!("the model cannot be written: {error}"), "report this")
        };
        let model = serde_json::to_string_pretty(&ModelRecord::new(self)).map_err(unwritable)?;
        let digest: [u8; 32] = Sha256::digest(model.as_bytes()).into();
        let model = RawValue::from_string(model).map_err(unwritable)?;
        let envelope = Envelope { format: FORMAT, version: VERSION, sha256: &hex(&digest), model: &model };
        // No line end after the last brace: every byte counts, so that a file cut by one byte is recognised.
        Ok((serde_json::to_vec(&envelope).map_err(unwritable)?, digest))
    }

    /// SHA-256 of the model, as on the wire and in reports.
    pub fn sha256(&self) -> Result<[u8; 32], FileError> {
        self.to_bytes("model").map(|(_, digest)| digest)
    }

    /// Writes the whole file or nothing, and returns the SHA-256 of the model.
    pub fn save(&self, path: &Path) -> Result<[u8; 32], FileError> {
        let (bytes, digest) = self.to_bytes(&path.display().to_string())?;
        write_atomically(path, &bytes)?;
        Ok(digest)
    }

    /// Reads a model file; also returns the SHA-256 of the model.
    pub fn load(path: &Path) -> Result<(ModelFile, [u8; 32]), FileError> {
        let file = path.display().to_string();
        let bytes = std::fs::read(path).map_err(FileError::io(&file, "read the model"))?;
        ModelFile::from_bytes(&bytes, &file)
    }

    /// Reads a model file of the machine with that name, and no other.
    pub fn load_for(path: &Path, machine: &str) -> Result<(ModelFile, [u8; 32]), FileError> {
        let (file, digest) = ModelFile::load(path)?;
        let found = &file.model.parts().machine.name;
        if found != machine {
            let place = Place::file(&path.display().to_string()).key("machine.name");
            let problem = format!("the model is of machine {found:?}, not of {machine:?}");
            return Err(FileError::content(place, problem, "give the model of this machine, or identify one"));
        }
        Ok((file, digest))
    }

    /// Reads the bytes of a model file; `name` is the file in messages.
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<(ModelFile, [u8; 32]), FileError> {
        let head: Head = serde_json::from_slice(bytes).map_err(|error| unreadable(name, bytes, &error))?;
        let refuse = |key: &str, problem: String, remedy: &str| {
            Err(FileError::content(Place::file(name).key(key), problem, remedy))
        };
        if head.format != FORMAT {
            let problem = format!("{:?} is not a model, which says {FORMAT:?} here", head.format);
            return refuse("format", problem, "give a file that abbe identify has written");
        }
        if head.version != VERSION {
            let problem = format!("version {} is not known; this software reads version {VERSION}", head.version);
            return refuse("version", problem, "use the software that wrote the model, or identify it again");
        }
        let envelope: Envelope<'_> = serde_json::from_slice(bytes).map_err(|error| unreadable(name, bytes, &error))?;
        let digest: [u8; 32] = Sha256::digest(envelope.model.get().as_bytes()).into();
        if envelope.sha256 != hex(&digest) {
            let problem = "the content does not match its hash: it was changed after it was written".to_owned();
            return refuse("sha256", problem, "copy the file again, or identify the model again");
        }
        let record: ModelRecord =
            serde_json::from_str(envelope.model.get()).map_err(|error| unreadable(name, bytes, &error))?;
        Ok((record.into_model_file(name)?, digest))
    }

    /// JSON has no word for a number that is not finite.
    fn check_finite(&self, name: &str) -> Result<(), FileError> {
        let parts = self.model.parts();
        let (identified, quality) = (&parts.identified, &parts.quality);
        let bounds =
            identified.reading_m.iter().chain(&identified.offset_m).flat_map(|(lower, upper)| [*lower, *upper]);
        let stations = parts.stations.iter().flat_map(|s| s.position_m.iter().copied().chain([s.dead_path_m]));
        let shapes = parts.effects.iter().flat_map(|fitted| fitted.shape.figures());
        let figures: [(&str, Vec<f64>); 5] = [
            ("identified_volume", bounds.collect()),
            ("stations", stations.collect()),
            ("effects", shapes.collect()),
            ("quality", vec![quality.chi2_per_dof, quality.residual_rms_m]),
            ("instrument", vec![self.instrument.constant_m, self.instrument.per_metre]),
        ];
        for (key, values) in figures {
            if values.iter().any(|value| !value.is_finite()) {
                let problem = "a number is not finite, so the model cannot be stored";
                return Err(FileError::content(Place::file(name).key(key), problem, "identify it again"));
            }
        }
        Ok(())
    }
}

/// Lower-case hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn unreadable(name: &str, bytes: &[u8], error: &serde_json::Error) -> FileError {
    let place = Place::file(name).line(error.line() as u64);
    // A file cut within a number is no end of file to the parser, but no whole file ends without its brace.
    let cut_off = error.is_eof() || (bytes.starts_with(b"{") && !bytes.ends_with(b"}"));
    let (problem, remedy) = if cut_off {
        ("the model file is cut off".to_owned(), "copy it again, or identify the model again")
    } else {
        (format!("this is no model file: {error}"), "give a file that abbe identify has written")
    };
    FileError::content(place, problem, remedy)
}
