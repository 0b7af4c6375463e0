//! Model files: JSON in an envelope with the hash of its content.
//!
//! Place in the flow: identification → [`ModelFile::save`] → nodes, `abbe correct`, monitor through
//! [`ModelFile::load`], in the envelope of [`crate::envelope`]: `{"format":"abbe-model","version":1,"sha256":"…",
//! "model":{…}}`. A file that is cut off, changed in one bit, of an unknown version or of another machine is refused.

use crate::atomic::write_atomically;
use crate::envelope::{self, FileKind};
use crate::error::{FileError, Place};
use crate::model_contents::{Doubt, ModelFile};
use crate::model_record::ModelRecord;
use crate::units::millimetres_from_m;
use abbe_geometry::Axis;
use abbe_geometry::machine::{Machine, Side};
use std::path::Path;

const KIND: FileKind = FileKind {
    format: "abbe-model",
    version: 1,
    name: "model",
    maker: "abbe identify",
    again: "identify the model again",
};

/// Ends of strokes that are closer than this are the same (m): files hold them in mm.
const SAME_END_M: f64 = 1e-9;

impl ModelFile {
    /// Bytes of the file and SHA-256 of the model in it. The same model gives the same bytes.
    pub fn to_bytes(&self, name: &str) -> Result<(Vec<u8>, [u8; 32]), FileError> {
        self.check_finite(name)?;
        envelope::seal(&KIND, &ModelRecord::new(self), name)
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

    /// Reads a model file; also returns the SHA-256 of the model. What speaks against it goes to the log.
    pub fn load(path: &Path) -> Result<(ModelFile, [u8; 32]), FileError> {
        let file = path.display().to_string();
        let bytes = std::fs::read(path).map_err(FileError::io(&file, "read the model"))?;
        let (model, digest) = ModelFile::from_bytes(&bytes, &file)?;
        model.said_against().for_each(|doubt| tracing::warn!("{file}: {doubt}"));
        Ok((model, digest))
    }

    /// What whoever corrects with this model should know, in words.
    pub fn said_against(&self) -> impl Iterator<Item = String> {
        self.doubts.iter().map(|Doubt { grade, text }| match grade.as_str() {
            "refusal" => format!("this model was refused and made all the same, because that was accepted: {text}"),
            _ => format!("identification warned of this model: {text}"),
        })
    }

    /// Reads a model file of this machine, and no other: of its name, its frame, its chain and its strokes, from whose ends errors
    /// are counted. What else stands in a machine file is about how a model is identified, and the model has its own.
    pub fn load_for(path: &Path, machine: &Machine) -> Result<(ModelFile, [u8; 32]), FileError> {
        let (file, digest) = ModelFile::load(path)?;
        let found = &file.model.parts().machine;
        let refused = |key: &str, problem: String, remedy: &str| {
            Err(FileError::content(Place::file(&path.display().to_string()).key(key), problem, remedy))
        };
        if found.name != machine.name {
            let problem = format!("the model is of machine {:?}, not of {:?}", found.name, machine.name);
            return refused("machine.name", problem, "give the model of this machine, or identify one");
        }
        let remedy = "correct the machine file, or identify the model again with it";
        if found.frame_id != machine.frame_id {
            let (model, file) = (&found.frame_id, &machine.frame_id);
            let problem = format!("the model is of frame_id {model:?}, and the machine file says {file:?}");
            return refused("machine.frame_id", problem, remedy);
        }
        if found.joints != machine.joints {
            let (model, file) = (chain(found), chain(machine));
            let problem = format!("the model is of the chain {model}, and the machine file says {file}");
            return refused("machine.chain", problem, remedy);
        }
        if let Some(axis) = Axis::ALL.into_iter().find(|axis| differ(found, machine, *axis)) {
            let mm = |of: &Machine| {
                let (lower_m, upper_m) = of.stroke_m[axis.index()];
                format!("{} to {} mm", millimetres_from_m(lower_m), millimetres_from_m(upper_m))
            };
            let (letter, model, file) = (axis.letter(), mm(found), mm(machine));
            let problem =
                format!("the model is of a stroke of {letter} from {model}, and the machine file says {file}");
            return refused("machine.stroke_m", problem, remedy);
        }
        Ok((file, digest))
    }

    /// Reads the bytes of a model file; `name` is the file in messages.
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<(ModelFile, [u8; 32]), FileError> {
        let (record, digest): (ModelRecord, [u8; 32]) = envelope::open(&KIND, bytes, name)?;
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
            (
                "instrument",
                vec![self.instrument.constant_m, self.instrument.per_metre, self.instrument.common_per_metre],
            ),
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

/// Whether the ends of a stroke are not the same (m), but for the rounding of files in mm.
fn differ(model: &Machine, file: &Machine, axis: Axis) -> bool {
    let (own, other) = (model.stroke_m[axis.index()], file.stroke_m[axis.index()]);
    (own.0 - other.0).abs().max((own.1 - other.1).abs()) > SAME_END_M
}

/// The chain in words, from the workpiece to the tool: `Y, bed, X, Z`.
fn chain(machine: &Machine) -> String {
    let letters = |side| {
        machine.joints.iter().filter(move |joint| joint.side == side).map(|joint| joint.axis.letter().to_string())
    };
    letters(Side::Workpiece).chain(["bed".to_owned()]).chain(letters(Side::Tool)).collect::<Vec<_>>().join(", ")
}
