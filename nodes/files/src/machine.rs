//! Machine files: TOML to a machine in SI and back.
//!
//! Place in the flow: `launch-config/machines/*.toml` → here → identification, simulator, correction. The file
//! holds mm, µm and expanded uncertainties (k = 2 in the key); everything behind this reader is SI with k = 1.

use crate::error::{FileError, Place};
use crate::identity::Identity;
use crate::machine_document::{
    AxisText, ByAxis, ChainText, ErrorFunctionsText, InstrumentDocument, MachineDocument, MachineRecord, SquarenessText,
};
use crate::names::nearest;
use crate::toml_place::{line_of, syntax};
use crate::units::{micrometres_from_m, millimetres_from_m};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, MachineError, Side, Squareness, USUAL_RAM_TURN_RAD};
use abbe_geometry::{Axis, ErrorId};
use abbe_measurement::instrument::RangeUncertainty;
use std::path::Path;

pub use crate::machine_document::OrderChoice;

/// The one sign convention: files must state it word for word, so that nobody reads a model the other way round.
pub const SIGN_CONVENTION: &str = "error = actual - indicated, of the tool relative to the workpiece; \
                                   actual = indicated + offset + error; angles right-handed; names as in ISO 230-1";
/// Coverage factor of the declared range uncertainty.
const COVERAGE: f64 = 2.0;
pub(crate) const SEE_EXAMPLES: &str = "launch-config/machines holds complete examples";

/// What a machine file says.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineFile {
    /// The machine, checked.
    pub machine: Machine,
    /// Uncertainty of the tracer's range, k = 1.
    pub instrument: RangeUncertainty,
    /// True where a length reading is the distance itself; false where each station has an unknown dead path.
    pub absolute_range: bool,
    /// Who decides the orders.
    pub order: OrderChoice,
    /// Who measures with which machine and instrument, for the head of reports.
    pub identity: Option<Identity>,
}

/// Reads and checks a machine file.
pub fn read_machine(path: &Path) -> Result<MachineFile, FileError> {
    let file = path.display().to_string();
    let bytes = std::fs::read(path).map_err(FileError::io(&file, "read the machine file"))?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let line = 1 + error.as_bytes()[..error.utf8_error().valid_up_to()].iter().filter(|b| **b == b'\n').count();
        FileError::content(Place::file(&file).line(line as u64), "the text is not UTF-8", "save the file as UTF-8")
    })?;
    parse_machine(&text, &file)
}

/// Checks the text of a machine file; `file` is its name in messages.
pub fn parse_machine(text: &str, file: &str) -> Result<MachineFile, FileError> {
    let text = text.trim_start_matches('\u{feff}');
    let document: MachineDocument = toml::from_str(text).map_err(|error| syntax(text, file, &error, SEE_EXAMPLES))?;
    Reader { text, file }.machine_file(document)
}

/// Text of a machine file; reading it gives the same machine.
pub fn machine_text(machine: &MachineFile) -> Result<String, FileError> {
    toml::to_string(&to_document(machine)).map_err(|error| {
        let remedy = "give it names that TOML can hold";
        FileError::content(Place::file(&machine.machine.name), format!("cannot be written: {error}"), remedy)
    })
}

/// Gives the document its meaning, and each problem its line.
struct Reader<'a> {
    text: &'a str,
    file: &'a str,
}

impl Reader<'_> {
    fn wrong(&self, path: &[&str], problem: impl Into<String>, remedy: impl Into<String>) -> FileError {
        let mut place = Place::file(self.file).key(&path.join("."));
        place.line = line_of(self.text, path);
        FileError::content(place, problem, remedy)
    }

    fn machine_file(&self, document: MachineDocument) -> Result<MachineFile, FileError> {
        let order = document.machine_order();
        let (instrument, absolute_range) = (self.instrument(&document.instrument)?, document.instrument.absolute);
        let identity = document.identity.clone();
        identity.iter().try_for_each(|identity| identity.check(self.text, self.file))?;
        Ok(MachineFile { machine: self.machine(document.into_record())?, instrument, absolute_range, order, identity })
    }

    fn machine(&self, record: MachineRecord) -> Result<Machine, FileError> {
        self.check_texts(&record)?;
        let machine = Machine {
            joints: self.joints(&record.chain)?,
            stroke_m: self.stroke_m(&record.stroke_m)?,
            squareness: self.squareness(&record.squareness)?,
            rotation: record.rotation.into(),
            kinds: self.kinds(&record.error_functions)?,
            repeatability_m: record.repeatability_m,
            u_ram_turn_rad: record.u_ram_turn_rad.unwrap_or([USUAL_RAM_TURN_RAD; 3]),
            default_offset_m: record.default_offset_m,
            name: record.name,
            frame_id: record.frame_id,
        };
        if machine.default_offset_m.is_some_and(|offset| offset.iter().any(|v| !v.is_finite())) {
            return Err(self.wrong(&["default_offset_mm"], "holds a number that is not finite", "give three numbers"));
        }
        machine.validate().map_err(|error| self.invalid(&error))?;
        Ok(machine)
    }

    fn check_texts(&self, record: &MachineRecord) -> Result<(), FileError> {
        for (key, value) in [("name", &record.name), ("frame_id", &record.frame_id)] {
            if value.is_empty() || value.chars().any(|c| c.is_whitespace() || c.is_control()) {
                let problem = format!("{value:?} is empty or holds blanks");
                return Err(self.wrong(&[key], problem, "write a name without blanks"));
            }
        }
        if record.sign_convention != SIGN_CONVENTION {
            let problem = format!("{:?} is not the convention used here", record.sign_convention);
            let remedy = format!("turn the signs where they differ and write {SIGN_CONVENTION:?}");
            return Err(self.wrong(&["sign_convention"], problem, remedy));
        }
        Ok(())
    }

    fn joints(&self, chain: &ChainText) -> Result<[Joint; 3], FileError> {
        let joint = |side| move |axis: &AxisText| Joint { axis: (*axis).into(), side };
        // The file counts each side from the bed; the chain runs from the workpiece through the bed to the tool.
        let workpiece = chain.workpiece_side.iter().rev().map(joint(Side::Workpiece));
        let joints: Vec<Joint> = workpiece.chain(chain.tool_side.iter().map(joint(Side::Tool))).collect();
        let listed: String = joints.iter().map(|joint| joint.axis.letter()).collect();
        joints.try_into().map_err(|_| self.invalid(&MachineError::Chain(listed)))
    }

    fn stroke_m(&self, stroke_m: &ByAxis<[f64; 2]>) -> Result<[(f64, f64); 3], FileError> {
        let stroke_m = stroke_m.into_array();
        for (axis, [lower_m, upper_m]) in Axis::ALL.into_iter().zip(stroke_m) {
            if !(lower_m.is_finite() && upper_m.is_finite() && lower_m < upper_m) {
                let [lower, upper] = [lower_m, upper_m].map(millimetres_from_m);
                let problem = format!("the stroke from {lower} mm to {upper} mm is empty or not finite");
                return Err(self.wrong(&["stroke_mm", &axis.letter().to_string()], problem, "write [lower, upper]"));
            }
        }
        Ok(stroke_m.map(|[lower_m, upper_m]| (lower_m, upper_m)))
    }

    fn squareness(&self, entries: &[SquarenessText]) -> Result<[Squareness; 3], FileError> {
        let known: Vec<Squareness> = entries.iter().map(Squareness::from).collect();
        for (k, entry) in entries.iter().enumerate() {
            if entry.name.is_empty() || entries[..k].iter().any(|other| other.name == entry.name) {
                let problem = format!("{:?} is empty or stands twice", entry.name);
                return Err(self.wrong(&["squareness", &k.to_string(), "name"], problem, "name each one, as in C0Y"));
            }
        }
        let found = known.len();
        known.try_into().map_err(|_| {
            let remedy = "give three [[squareness]] tables, one about each of X, Y and Z";
            self.wrong(&["squareness"], format!("{found} squareness errors are declared"), remedy)
        })
    }

    fn kinds(&self, functions: &ErrorFunctionsText) -> Result<[Option<FunctionKind>; ErrorId::COUNT], FileError> {
        let mut kinds = [functions.default.into(); ErrorId::COUNT];
        for (name, kind) in &functions.by_error {
            let Some(id) = ErrorId::from_name(name) else {
                let names: Vec<String> = ErrorId::all().map(ErrorId::name).collect();
                let known = names.iter().map(String::as_str).chain(["order", "default"]);
                let hint = nearest(name, known).map_or(String::new(), |near| format!("did you mean {near}? "));
                let remedy = format!("{hint}write an ISO 230-1 name such as EXX or EBZ");
                return Err(self.wrong(&["error_functions", name], "no error has this name", remedy));
            };
            kinds[id.index()] = (*kind).into();
        }
        Ok(kinds)
    }

    fn instrument(&self, document: &InstrumentDocument) -> Result<RangeUncertainty, FileError> {
        let figures = [
            ("u_k2_constant_um", document.u_k2_constant_um),
            ("u_k2_proportional_um_per_m", document.u_k2_proportional_um_per_m),
            ("u_k2_common_um_per_m", document.u_k2_common_um_per_m.unwrap_or(0.0)),
        ];
        for (key, value) in figures {
            if !(value.is_finite() && value >= 0.0) {
                let problem = format!("{value} is not a finite number of 0 or more");
                return Err(self.wrong(&["instrument", key], problem, "write the figure of the data sheet, k = 2"));
            }
        }
        let [constant_m, per_metre, common_per_metre] = figures.map(|(_, um)| um / 1e6 / COVERAGE);
        // What is common does not scatter: readings still need a weight.
        if constant_m + per_metre == 0.0 {
            let remedy = "write the figures of the data sheet, k = 2";
            return Err(self.wrong(&["instrument"], "no instrument is without uncertainty", remedy));
        }
        Ok(RangeUncertainty { constant_m, per_metre, common_per_metre })
    }

    fn invalid(&self, error: &MachineError) -> FileError {
        match error {
            MachineError::Chain(_) => self.wrong(&["chain"], error.to_string(), SEE_EXAMPLES),
            MachineError::Squareness { .. } => self.wrong(&["squareness"], error.to_string(), SEE_EXAMPLES),
            MachineError::Basis { name, source } => {
                let path = ["error_functions", name.as_str()];
                let present = line_of(self.text, &path) != line_of(self.text, &path[..1]);
                let path = if present { path } else { ["error_functions", "default"] };
                self.wrong(&path, format!("error {name}: {source}"), "correct the number of pieces")
            }
            MachineError::Figure { .. } => {
                self.wrong(&["repeatability_um"], error.to_string(), "write three numbers, k = 1")
            }
            MachineError::RamTurn { .. } => {
                let remedy = "write three numbers, k = 1, or leave the key out for the usual 200 µrad";
                self.wrong(&["u_k1_ram_turn_urad"], error.to_string(), remedy)
            }
        }
    }
}

/// Meaning of the machine inside a model file; `file` is the model's name in messages.
pub(crate) fn machine_of_record(record: MachineRecord, file: &str) -> Result<Machine, FileError> {
    Reader { text: "", file }.machine(record)
}

/// A machine as a model file holds it.
pub(crate) fn record_of_machine(machine: &Machine, order: OrderChoice) -> MachineRecord {
    MachineRecord {
        name: machine.name.clone(),
        frame_id: machine.frame_id.clone(),
        sign_convention: SIGN_CONVENTION.to_owned(),
        rotation: machine.rotation.into(),
        repeatability_m: machine.repeatability_m,
        u_ram_turn_rad: Some(machine.u_ram_turn_rad),
        default_offset_m: machine.default_offset_m,
        chain: ChainText::from(machine),
        stroke_m: ByAxis::from_array(machine.stroke_m.map(|(lower_m, upper_m)| [lower_m, upper_m])),
        error_functions: ErrorFunctionsText::new(machine, order),
        squareness: machine.squareness.iter().map(SquarenessText::from).collect(),
    }
}

fn to_document(file: &MachineFile) -> MachineDocument {
    let instrument = InstrumentDocument {
        u_k2_constant_um: micrometres_from_m(file.instrument.constant_m * COVERAGE),
        u_k2_proportional_um_per_m: micrometres_from_m(file.instrument.per_metre * COVERAGE),
        u_k2_common_um_per_m: Some(micrometres_from_m(file.instrument.common_per_metre * COVERAGE))
            .filter(|u| *u > 0.0),
        absolute: file.absolute_range,
    };
    MachineDocument {
        identity: file.identity.clone(),
        ..MachineDocument::new(record_of_machine(&file.machine, file.order), instrument)
    }
}
