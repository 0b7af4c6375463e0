//! The content of a model file as JSON holds it: SI throughout, every number beside its unit.
//!
//! Place in the flow: [`crate::model_file`] wraps it in the hashed envelope; here a checked model becomes a
//! structure for JSON and back. Coefficients stand under their error's name, so that a file can be read by eye.

use crate::error::{FileError, Place};
use crate::machine::{SIGN_CONVENTION, machine_of_record, record_of_machine};
use crate::machine_document::MachineRecord;
use crate::model_contents::{DataSource, Doubt, ModelFile, ResidualReference};
use crate::ram_turn_record::{RamTurnRecord, with_three_more};
use abbe_geometry::by_place::VarianceByPlace;
use abbe_geometry::effects::{ParameterSpec, Shape, ShapeValue};
use abbe_geometry::layout::Layout;
use abbe_geometry::machine::Machine;
use abbe_geometry::model::{Difference, FitQuality, FittedEffect, IdentifiedVolume, MachineModel, ModelParts, Station};
use abbe_geometry::unseen_expansion::{UnseenExpansion, UnseenExpansions};
use abbe_geometry::{ErrorId, Vector3};
use abbe_measurement::instrument::RangeUncertainty;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::Value;
use serde_json::value::RawValue;
use std::collections::BTreeMap;

const UNITS: &str = "SI: m, rad, s; uncertainties are standard uncertainties (k = 1)";
const REFERENCE_POINT: &str = "ram reference point; the offset leads from it to tip or reflector in the ram frame; \
                               every error is 0 at the lower end of its stroke, straightness also at the upper end";
const COVARIANCE_ORDER: &str = "packed lower triangle row by row: error coefficients EXX EYX EZX EAX EBX ECX EXY ... \
                                ECZ, squareness, turn of the ram, effect parameters, then x y z and dead path of each \
                                station";
/// Of software that knew no turn of the ram.
const EARLIER_COVARIANCE_ORDER: &str = "packed lower triangle row by row: error coefficients EXX EYX EZX EAX EBX ECX EXY \
                                        ... ECZ, squareness, effect parameters, then x y z and dead path of each station";
const WANDERING_FORMS: &str = "packed lower triangle row by row: 1 x y z xx xy xz yy yz zz, each coordinate the reading from the \
                               middle over half the span";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ModelRecord {
    software: String,
    units: String,
    reference_point: String,
    sign_convention: String,
    machine: MachineRecord,
    instrument: InstrumentRecord,
    error_functions: BTreeMap<String, CoefficientsRecord>,
    squareness: BTreeMap<String, ValueRecord>,
    /// None in files of earlier software.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ram_turn: Option<RamTurnRecord>,
    effects: Vec<EffectRecord>,
    residual_network: Option<ResidualReference>,
    stations: Vec<StationRecord>,
    identified_volume: VolumeRecord,
    quality: QualityRecord,
    data: Vec<DataSource>,
    seed: Option<u64>,
    options: Value,
    evidence: Value,
    covariance: CovarianceRecord,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct InstrumentRecord {
    u_k1_constant_m: f64,
    u_k1_per_metre: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    u_k1_common_per_metre: Option<f64>,
    absolute: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CoefficientsRecord {
    unit: String,
    coefficients: OneLine,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ValueRecord {
    unit: String,
    value: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct EffectRecord {
    name: String,
    /// Figures in SI, names.
    shape: BTreeMap<String, ShapeRecord>,
    parameters: Vec<ParameterRecord>,
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum ShapeRecord {
    Number(f64),
    Text(String),
    Numbers(Vec<f64>),
    Texts(Vec<String>),
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ParameterRecord {
    name: String,
    unit: String,
    value: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StationRecord {
    name: String,
    position_m: [f64; 3],
    dead_path_m: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct VolumeRecord {
    reading_m: [(f64, f64); 3],
    offset_m: [(f64, f64); 3],
    /// In the unit of the name.
    #[serde(default)]
    covariates: BTreeMap<String, (f64, f64)>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    differences: Vec<DifferenceRecord>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DifferenceRecord {
    name: String,
    less: String,
    range_k: (f64, f64),
}

impl DifferenceRecord {
    fn of(difference: &Difference) -> DifferenceRecord {
        let Difference { name, less, range } = difference.clone();
        DifferenceRecord { name, less, range_k: range }
    }

    fn difference(self) -> Difference {
        Difference { name: self.name, less: self.less, range: self.range_k }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct QualityRecord {
    readings: usize,
    rejected: usize,
    chi2_per_dof: f64,
    residual_rms_m: f64,
    /// None in files of earlier software.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    unexplained_m: Option<UnexplainedRecord>,
    /// What a machine that wanders does, by place; most models have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    wanders: Option<WandersRecord>,
    /// Where no temperature was logged, and in files of earlier software, there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    unseen_expansions: Option<UnseenExpansionsRecord>,
    /// What speaks against the model; files of earlier software have none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    doubts: Vec<Doubt>,
}

/// What is unexplained along X, Y and Z (m); earlier software wrote one figure for any direction.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(untagged)]
enum UnexplainedRecord {
    ByAxis([f64; 3]),
    Any(f64),
}

/// Variance along X, Y and Z by place.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct WandersRecord {
    /// Of what, for readers of the file.
    forms: String,
    middle_m: [f64; 3],
    half_span_m: [f64; 3],
    x_packed_m2: OneLine,
    y_packed_m2: OneLine,
    z_packed_m2: OneLine,
}

impl WandersRecord {
    fn of(wanders: &VarianceByPlace) -> WandersRecord {
        let [x, y, z] = wanders.packed_m2.clone().map(OneLine);
        WandersRecord {
            forms: WANDERING_FORMS.to_owned(),
            middle_m: wanders.middle_m,
            half_span_m: wanders.half_span_m,
            x_packed_m2: x,
            y_packed_m2: y,
            z_packed_m2: z,
        }
    }

    fn variance(self) -> VarianceByPlace {
        VarianceByPlace {
            middle_m: self.middle_m,
            half_span_m: self.half_span_m,
            packed_m2: [self.x_packed_m2.0, self.y_packed_m2.0, self.z_packed_m2.0],
        }
    }
}

/// Expansions that the data cannot rule out.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct UnseenExpansionsRecord {
    by_sensor: Vec<UnseenExpansionRecord>,
    /// In the order of the covariance.
    absorbed: Vec<OneLine>,
}

impl UnseenExpansionsRecord {
    fn of(unseen: &UnseenExpansions) -> Option<UnseenExpansionsRecord> {
        (*unseen != UnseenExpansions::default()).then(|| UnseenExpansionsRecord {
            by_sensor: unseen.by_sensor.iter().map(UnseenExpansionRecord::of).collect(),
            absorbed: unseen.absorbed.iter().cloned().map(OneLine).collect(),
        })
    }

    fn unseen(self) -> UnseenExpansions {
        UnseenExpansions {
            by_sensor: self.by_sensor.into_iter().map(UnseenExpansionRecord::unseen).collect(),
            absorbed: self.absorbed.into_iter().map(|absorbed| absorbed.0).collect(),
        }
    }
}

/// What the data leave open of the expansion of X, Y and Z with a temperature, and of the squareness errors in the order of the machine.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct UnseenExpansionRecord {
    sensor: String,
    per_kelvin: [f64; 3],
    at_c: [f64; 3],
    /// In files of earlier software there is none.
    #[serde(default)]
    squareness_per_kelvin: [f64; 3],
    #[serde(default)]
    squareness_at_c: [f64; 3],
}

impl UnseenExpansionRecord {
    fn of(unseen: &UnseenExpansion) -> UnseenExpansionRecord {
        let UnseenExpansion { sensor, per_kelvin, at_c, squareness_per_kelvin, squareness_at_c } = unseen.clone();
        UnseenExpansionRecord { sensor, per_kelvin, at_c, squareness_per_kelvin, squareness_at_c }
    }

    fn unseen(self) -> UnseenExpansion {
        UnseenExpansion {
            sensor: self.sensor,
            per_kelvin: self.per_kelvin,
            at_c: self.at_c,
            squareness_per_kelvin: self.squareness_per_kelvin,
            squareness_at_c: self.squareness_at_c,
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CovarianceRecord {
    order: String,
    packed: OneLine,
    /// What straight lines between nodes add, in the same order; where they add nothing, and in files of earlier software,
    /// there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    of_chords_packed: Option<OneLine>,
}

/// A list that stays on one line where everything around it is indented.
#[derive(Deserialize)]
#[serde(transparent)]
pub(crate) struct OneLine(pub(crate) Vec<f64>);

impl Serialize for OneLine {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let text = serde_json::to_string(&self.0).map_err(serde::ser::Error::custom)?;
        RawValue::from_string(text).map_err(serde::ser::Error::custom)?.serialize(serializer)
    }
}

impl ModelRecord {
    pub(crate) fn new(file: &ModelFile) -> ModelRecord {
        let parts = file.model.parts();
        let layout = file.model.layout();
        let functions = ErrorId::all().filter(|id| layout.basis(*id).is_some()).map(|id| {
            let coefficients = OneLine(parts.coefficients[layout.range(id)].to_vec());
            (id.name(), CoefficientsRecord { unit: unit(id).to_owned(), coefficients })
        });
        let squareness = parts.machine.squareness.iter().zip(&parts.coefficients[layout.squareness()]);
        ModelRecord {
            software: file.software.clone(),
            units: UNITS.to_owned(),
            reference_point: REFERENCE_POINT.to_owned(),
            sign_convention: SIGN_CONVENTION.to_owned(),
            machine: record_of_machine(&parts.machine, file.order),
            instrument: InstrumentRecord {
                u_k1_constant_m: file.instrument.constant_m,
                u_k1_per_metre: file.instrument.per_metre,
                u_k1_common_per_metre: Some(file.instrument.common_per_metre).filter(|u| *u > 0.0),
                absolute: file.absolute_range,
            },
            error_functions: functions.collect(),
            squareness: squareness
                .map(|(entry, value)| (entry.name.clone(), ValueRecord { unit: "rad".to_owned(), value: *value }))
                .collect(),
            ram_turn: Some(RamTurnRecord {
                angles_rad: file.model.ram_turn().map(|(angle_rad, _)| angle_rad),
                about_offset_m: parts.offset_centre_m,
            }),
            effects: parts.effects.iter().map(effect_record).collect(),
            residual_network: file.residual_network.clone(),
            stations: parts.stations.iter().map(station_record).collect(),
            identified_volume: VolumeRecord {
                reading_m: parts.identified.reading_m,
                offset_m: parts.identified.offset_m,
                covariates: parts.identified.covariates.clone(),
                differences: parts.identified.differences.iter().map(DifferenceRecord::of).collect(),
            },
            quality: QualityRecord {
                readings: parts.quality.readings,
                rejected: parts.quality.rejected,
                chi2_per_dof: parts.quality.chi2_per_dof,
                residual_rms_m: parts.quality.residual_rms_m,
                unexplained_m: Some(UnexplainedRecord::ByAxis(parts.quality.unexplained_m)),
                wanders: parts.quality.wanders.as_ref().map(WandersRecord::of),
                unseen_expansions: UnseenExpansionsRecord::of(&parts.quality.unseen_expansions),
                doubts: file.doubts.clone(),
            },
            data: file.data.clone(),
            seed: file.seed,
            options: file.options.clone(),
            evidence: file.evidence.clone(),
            covariance: CovarianceRecord {
                order: COVARIANCE_ORDER.to_owned(),
                packed: OneLine(parts.covariance.clone()),
                of_chords_packed: Some(OneLine(parts.chord_covariance.clone())).filter(|chords| !chords.0.is_empty()),
            },
        }
    }

    /// The model, checked; `name` is the file in messages.
    pub(crate) fn into_model_file(mut self, name: &str) -> Result<ModelFile, FileError> {
        self.check_texts(name)?;
        self.check_names(name)?;
        let RamTurnRecord { angles_rad, about_offset_m } =
            self.ram_turn.unwrap_or_else(|| RamTurnRecord::unknown(&self.identified_volume.offset_m));
        let order = self.machine.error_functions.order;
        let machine = machine_of_record(self.machine, name)?;
        let layout =
            Layout::new(&machine, about_offset_m).map_err(|error| damaged(name, "machine", error.to_string()))?;
        let mut coefficients = error_coefficients(&layout, &mut self.error_functions, name)?;
        coefficients.extend(squareness_values(&machine, &mut self.squareness, name)?);
        coefficients.extend(angles_rad);
        let effects = self.effects.into_iter().map(|record| {
            let key = format!("effects.{}", record.name);
            fitted_effect(record, &machine).map_err(|problem| damaged(name, &key, problem))
        });
        let effects = effects.collect::<Result<_, _>>()?;
        let mut covariance = self.covariance.packed.0;
        let mut chord_covariance = self.covariance.of_chords_packed.map(|chords| chords.0).unwrap_or_default();
        if self.ram_turn.is_none() {
            let first = layout.ram_turn().start;
            covariance = with_three_more(&covariance, first, machine.u_ram_turn_rad.map(|u| u * u));
            chord_covariance = with_three_more(&chord_covariance, first, [0.0; 3]);
        }
        let parts = ModelParts {
            machine,
            coefficients,
            offset_centre_m: about_offset_m,
            effects,
            stations: self.stations.into_iter().map(station).collect(),
            covariance,
            chord_covariance,
            identified: IdentifiedVolume {
                reading_m: self.identified_volume.reading_m,
                offset_m: self.identified_volume.offset_m,
                covariates: self.identified_volume.covariates,
                differences: self.identified_volume.differences.into_iter().map(DifferenceRecord::difference).collect(),
            },
            quality: FitQuality {
                readings: self.quality.readings,
                rejected: self.quality.rejected,
                chi2_per_dof: self.quality.chi2_per_dof,
                residual_rms_m: self.quality.residual_rms_m,
                unexplained_m: unexplained_m(&self.quality),
                wanders: self.quality.wanders.map(WandersRecord::variance),
                unseen_expansions: self
                    .quality
                    .unseen_expansions
                    .map(UnseenExpansionsRecord::unseen)
                    .unwrap_or_default(),
            },
        };
        Ok(ModelFile {
            model: MachineModel::new(parts).map_err(|error| damaged(name, "model", error.to_string()))?,
            order,
            instrument: RangeUncertainty {
                constant_m: self.instrument.u_k1_constant_m,
                per_metre: self.instrument.u_k1_per_metre,
                common_per_metre: self.instrument.u_k1_common_per_metre.unwrap_or(0.0),
            },
            absolute_range: self.instrument.absolute,
            residual_network: self.residual_network,
            data: self.data,
            seed: self.seed,
            options: self.options,
            evidence: self.evidence,
            doubts: self.quality.doubts,
            software: self.software,
        })
    }

    fn check_texts(&self, name: &str) -> Result<(), FileError> {
        let order = if self.ram_turn.is_some() { COVARIANCE_ORDER } else { EARLIER_COVARIANCE_ORDER };
        let texts = [
            ("sign_convention", &self.sign_convention, SIGN_CONVENTION),
            ("units", &self.units, UNITS),
            ("reference_point", &self.reference_point, REFERENCE_POINT),
            ("covariance.order", &self.covariance.order, order),
        ];
        let forms =
            self.quality.wanders.iter().map(|wanders| ("quality.wanders.forms", &wanders.forms, WANDERING_FORMS));
        match texts.into_iter().chain(forms).find(|(_, found, expected)| found != expected) {
            None => Ok(()),
            Some((key, found, expected)) => {
                Err(damaged(name, key, format!("{found:?} is not what this software means: {expected:?}")))
            }
        }
    }

    /// Names of quantities stand in heads of tables and in messages, where a line break would begin something else.
    fn check_names(&self, name: &str) -> Result<(), FileError> {
        let texts = |shape: &ShapeRecord| match shape {
            ShapeRecord::Text(text) => vec![text.clone()],
            ShapeRecord::Texts(texts) => texts.clone(),
            ShapeRecord::Number(_) | ShapeRecord::Numbers(_) => Vec::new(),
        };
        let of_effects = self.effects.iter().flat_map(|effect| effect.shape.values().flat_map(texts));
        let mut names = self.identified_volume.covariates.keys().cloned().chain(of_effects);
        match names.find(|own| own.chars().any(char::is_control)) {
            None => Ok(()),
            Some(own) => Err(damaged(name, "effects", format!("{own:?} holds a control character"))),
        }
    }
}

/// Along each axis (m). What a file of earlier software does not tell is known but for the freedom that its fit used up.
fn unexplained_m(quality: &QualityRecord) -> [f64; 3] {
    let readings = quality.readings as f64;
    match quality.unexplained_m {
        Some(UnexplainedRecord::ByAxis(by_axis_m)) => by_axis_m,
        Some(UnexplainedRecord::Any(any_m)) => [any_m; 3],
        None => {
            [FitQuality::unexplained_of(quality.chi2_per_dof, readings * quality.residual_rms_m.powi(2), readings); 3]
        }
    }
}

fn damaged(file: &str, key: &str, problem: String) -> FileError {
    FileError::content(Place::file(file).key(key), problem, "the model is damaged; identify it again")
}

/// Coefficients of all error functions in layout order; takes what it uses and refuses what is left.
fn error_coefficients(
    layout: &Layout,
    records: &mut BTreeMap<String, CoefficientsRecord>,
    file: &str,
) -> Result<Vec<f64>, FileError> {
    let mut coefficients = Vec::with_capacity(layout.len());
    for id in ErrorId::all() {
        let Some(basis) = layout.basis(id) else { continue };
        let key = format!("error_functions.{}", id.name());
        let record = records.remove(&id.name()).ok_or_else(|| damaged(file, &key, "the error is missing".into()))?;
        let found = record.coefficients.0;
        if record.unit != unit(id) || found.len() != basis.len() {
            let (length, unit_found, needed, unit_needed) = (found.len(), record.unit, basis.len(), unit(id));
            let problem = format!(
                "it holds {length} coefficients in {unit_found}, but {needed} in {unit_needed} are needed for this machine"
            );
            return Err(damaged(file, &key, problem));
        }
        coefficients.extend(found);
    }
    match records.keys().next() {
        None => Ok(coefficients),
        Some(name) => {
            let problem = "this machine has no such error function".to_owned();
            Err(damaged(file, &format!("error_functions.{name}"), problem))
        }
    }
}

/// Squareness angles (rad) in the machine's order.
fn squareness_values(
    machine: &Machine,
    records: &mut BTreeMap<String, ValueRecord>,
    file: &str,
) -> Result<Vec<f64>, FileError> {
    let mut values = Vec::with_capacity(machine.squareness.len());
    for entry in &machine.squareness {
        let record = records.remove(&entry.name).filter(|record| record.unit == "rad");
        let missing = || damaged(file, "squareness", format!("{} in rad is missing", entry.name));
        values.push(record.ok_or_else(missing)?.value);
    }
    match records.keys().next() {
        None => Ok(values),
        Some(name) => {
            let problem = "this machine has no such squareness".to_owned();
            Err(damaged(file, &format!("squareness.{name}"), problem))
        }
    }
}

fn unit(id: ErrorId) -> &'static str {
    if id.is_angular() { "rad" } else { "m" }
}

fn effect_record(fitted: &FittedEffect) -> EffectRecord {
    let values = fitted.effect.parameters().into_iter().zip(&fitted.parameters);
    EffectRecord {
        name: fitted.effect.name().to_owned(),
        shape: fitted.shape.0.iter().map(|(key, value)| (key.clone(), shape_record(value))).collect(),
        parameters: values
            .map(|(spec, value)| ParameterRecord { name: spec.name, unit: spec.unit.to_owned(), value: *value })
            .collect(),
    }
}

fn shape_record(value: &ShapeValue) -> ShapeRecord {
    match value.clone() {
        ShapeValue::Number(value) => ShapeRecord::Number(value),
        ShapeValue::Text(value) => ShapeRecord::Text(value),
        ShapeValue::Numbers(values) => ShapeRecord::Numbers(values),
        ShapeValue::Texts(values) => ShapeRecord::Texts(values),
    }
}

fn shape_value(record: ShapeRecord) -> ShapeValue {
    match record {
        ShapeRecord::Number(value) => ShapeValue::Number(value),
        ShapeRecord::Text(value) => ShapeValue::Text(value),
        ShapeRecord::Numbers(values) => ShapeValue::Numbers(values),
        ShapeRecord::Texts(values) => ShapeValue::Texts(values),
    }
}

fn fitted_effect(record: EffectRecord, machine: &Machine) -> Result<FittedEffect, String> {
    let values = record.parameters.iter().map(|parameter| parameter.value).collect();
    let shape = Shape(record.shape.into_iter().map(|(key, value)| (key, shape_value(value))).collect());
    let fitted =
        MachineModel::fitted_effect(&record.name, shape, machine, values).map_err(|error| error.to_string())?;
    let specs = fitted.effect.parameters();
    let same = |(spec, found): (&ParameterSpec, &ParameterRecord)| spec.name == found.name && spec.unit == found.unit;
    if specs.len() != record.parameters.len() || !specs.iter().zip(&record.parameters).all(same) {
        let expected: Vec<String> = specs.iter().map(|spec| format!("{} in {}", spec.name, spec.unit)).collect();
        return Err(format!("the parameters are not those of the effect: {}", expected.join(", ")));
    }
    Ok(fitted)
}

fn station_record(station: &Station) -> StationRecord {
    StationRecord {
        name: station.name.clone(),
        position_m: station.position_m.into(),
        dead_path_m: station.dead_path_m,
    }
}

fn station(record: StationRecord) -> Station {
    Station { name: record.name, position_m: Vector3::from(record.position_m), dead_path_m: record.dead_path_m }
}
