//! A residual model as a plain record, and back: what an artifact keeps.
//!
//! Place in the flow: the writer of artifacts serialises a [`Record`] without knowing what is in it; the reader hands it back, and
//! nothing is taken that is missing, of another shape, no number, or not known. Units stand in the names. A model of position alone
//! has its points in `point_m`; any other names its inputs (`input_0` …), with values, scales and ranges of each. Values come back
//! bit for bit (f32 is widened, which is exact), so a model read predicts the same bits as the one written.

use crate::calibration::Calibration;
use crate::kind::ResidualMethod;
use crate::kriging::{Component, Kriging};
use crate::model::{Ensemble, ModelError, Parts, ResidualModel};
use crate::network::{ConfigError, NetworkConfig, Normaliser, Parameters, ParametersError, PositionConfig};
use crate::trend::PositionEnsemble;
use abbe_field::kriging::Kernel;
use abbe_field::{FieldError, MOST_INPUTS, MeasuredField, Samples};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use thiserror::Error;

/// Axes, for names.
const AXES: [&str; 3] = ["x", "y", "z"];
/// Largest whole number that is taken for a size.
const LARGEST_SIZE: f64 = 1e6;
/// Members at most.
const MOST_MEMBERS: usize = 1000;

/// A model in plain numbers and words, by name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// What predicts: a name of [`ResidualMethod`].
    pub kind: String,
    /// Scalars; the unit stands in the name.
    pub numbers: BTreeMap<String, f64>,
    /// Words.
    pub texts: BTreeMap<String, String>,
    /// Lists and matrices.
    pub arrays: BTreeMap<String, Array>,
}

/// An array of any shape, row by row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Array {
    /// Length along each direction.
    pub shape: Vec<usize>,
    /// As many values as the product of the shape.
    pub values: Vec<f64>,
}

/// A record that is no model; the text names the entry.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RecordError {
    /// A kind that this program does not know.
    #[error("kind {0:?} is not known; known are {known}", known = ResidualMethod::ALL.map(ResidualMethod::name).join(", "))]
    Kind(String),
    /// An entry is not there.
    #[error("{0} is missing")]
    Missing(String),
    /// An entry that nothing reads.
    #[error("{0} is not known in a model of this kind; the record is from another version")]
    Unknown(String),
    /// A word that this program does not know.
    #[error("{name} is {found:?}; known are {known}")]
    Text {
        /// Entry.
        name: &'static str,
        /// What it says.
        found: String,
        /// What it may say.
        known: &'static str,
    },
    /// A number that is no size.
    #[error("{name} is {value}; it must be a whole number")]
    Size {
        /// Entry.
        name: String,
        /// What it is.
        value: f64,
    },
    /// An array of another shape.
    #[error("{name} has the shape {found:?} with {values} values; expected {expected}")]
    Shape {
        /// Entry.
        name: String,
        /// Its shape.
        found: Vec<usize>,
        /// Number of its values.
        values: usize,
        /// What is expected.
        expected: String,
    },
    /// A range that is not that of the points.
    #[error("input_low or input_high is not the range of input_values; the record was changed by hand")]
    Range,
    /// The calibrated points make no field.
    #[error("calibrated points: {0}")]
    Field(#[from] FieldError),
    /// Network sizes that do not hold.
    #[error("network: {0}")]
    Config(#[from] ConfigError),
    /// Parameters that do not fit.
    #[error("member {member}: {source}")]
    Parameters {
        /// Which.
        member: usize,
        /// Why.
        source: ParametersError,
    },
    /// The parts do not fit each other.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl ResidualModel {
    /// Everything the model is made of.
    pub fn to_record(&self) -> Record {
        let parts = self.parts();
        let mut record = Record {
            kind: parts.kind.name().to_owned(),
            numbers: BTreeMap::new(),
            texts: BTreeMap::new(),
            arrays: BTreeMap::new(),
        };
        let is_plain = parts.field.is_position_alone();
        if is_plain {
            record.vectors("point_m", &parts.field.places());
        } else {
            record.write_inputs(parts);
        }
        record.vectors("residual_m", parts.field.errors_m());
        if let Some(u_m) = parts.field.u_m() {
            record.vectors("residual_u_m", u_m);
        }
        record.array("calibration", vec![3], parts.calibration.scale.iter().copied().collect());
        record.texts.insert("kernel".into(), kernel_name(parts.kriging.kernel).into());
        for (axis, component) in AXES.iter().zip(&parts.kriging.components) {
            record.list(&with_unit(&format!("length_{axis}"), is_plain), &component.length);
            record.numbers.insert(format!("signal_{axis}_m"), component.signal_m);
            record.numbers.insert(format!("noise_{axis}_m"), component.noise_m);
            record.numbers.insert(format!("seen_{axis}"), component.seen);
            record.numbers.insert(format!("trend_{axis}_m"), component.trend_m);
            let weights = component.weights_per_m.clone();
            record.array(&format!("weights_{axis}_per_m"), vec![weights.len()], weights);
        }
        if let Some(ensemble) = &parts.ensemble {
            record.write_ensemble(ensemble);
        }
        if let Some(trend) = &parts.trend {
            record.write_trend(trend, is_plain);
        }
        record
    }

    /// The model of a record; every name and shape is checked, and nothing may be left over.
    pub fn from_record(record: Record) -> Result<ResidualModel, RecordError> {
        let kind = ResidualMethod::ALL.into_iter().find(|kind| kind.name() == record.kind);
        let kind = kind.ok_or_else(|| RecordError::Kind(record.kind.clone()))?;
        let mut record = Reader(record);
        let is_plain = !record.0.texts.contains_key(&input_key(0));
        let field = if is_plain { record.positions()? } else { record.inputs()? };
        let size = field.size();
        let scale = if is_plain { vec![1.0; size] } else { record.scale(&field)? };
        let calibration = Calibration { scale: record.vector("calibration")? };
        let kernel = record.kernel()?;
        let components = [0, 1, 2].map(|axis| record.component(axis, size, is_plain));
        let [x, y, z] = components;
        let components = [x?, y?, z?];
        let ensemble = if kind.has_attention() { Some(record.ensemble(size)?) } else { None };
        let trend = if kind.has_trend() { Some(record.trend(size, is_plain)?) } else { None };
        record.is_empty()?;
        let kriging = Kriging { kernel, components };
        Ok(ResidualModel::new(Parts { kind, field, scale, kriging, ensemble, trend, calibration })?)
    }
}

/// Name of an input's name.
fn input_key(input: usize) -> String {
    format!("input_{input}")
}

/// Lengths of positions are in metres; those of named inputs in the unit of each.
fn with_unit(name: &str, is_plain: bool) -> String {
    if is_plain { format!("{name}_m") } else { name.to_owned() }
}

fn kernel_name(kernel: Kernel) -> &'static str {
    match kernel {
        Kernel::Matern52 => "matern-5/2",
        Kernel::SquaredExponential => "squared-exponential",
    }
}

impl Record {
    fn array(&mut self, name: &str, shape: Vec<usize>, values: Vec<f64>) {
        self.arrays.insert(name.to_owned(), Array { shape, values });
    }

    fn vectors(&mut self, name: &str, list: &[Vector3<f64>]) {
        let values = list.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
        self.array(name, vec![list.len(), 3], values);
    }

    fn list(&mut self, name: &str, values: &[f64]) {
        self.array(name, vec![values.len()], values.to_vec());
    }

    fn write_inputs(&mut self, parts: &Parts) {
        for (input, name) in parts.field.names().iter().enumerate() {
            self.texts.insert(input_key(input), name.clone());
        }
        let (low, high) = parts.field.range();
        let values = parts.field.points().flatten().copied().collect();
        self.array("input_values", vec![parts.field.count(), parts.field.size()], values);
        self.list("input_low", &low);
        self.list("input_high", &high);
        self.list("input_scale", &parts.scale);
    }

    fn write_ensemble(&mut self, ensemble: &Ensemble) {
        let NetworkConfig { width, heads, sigma, attention, weighting, position } = ensemble.config;
        let flag = |is_on: bool| if is_on { "on" } else { "off" }.to_owned();
        self.numbers.insert("width".into(), width as f64);
        self.numbers.insert("heads".into(), heads as f64);
        self.numbers.insert("sigma_spacings".into(), sigma);
        self.texts.insert("attention".into(), flag(attention));
        self.texts.insert("weighting".into(), flag(weighting));
        self.texts.insert("position".into(), flag(position));
        self.array("mean_m", vec![3], ensemble.normaliser.mean_m.iter().copied().collect());
        self.array("scale_m", vec![3], ensemble.normaliser.scale_m.iter().copied().collect());
        self.numbers.insert("spacing_m".into(), ensemble.normaliser.spacing_m);
        self.write_members(ensemble.members.iter().map(Parameters::values));
    }

    fn write_trend(&mut self, trend: &PositionEnsemble, is_plain: bool) {
        self.numbers.insert("width".into(), trend.config.width as f64);
        self.numbers.insert("blocks".into(), trend.config.blocks as f64);
        self.list(&with_unit("low", is_plain), &trend.low);
        self.list(&with_unit("high", is_plain), &trend.high);
        self.array("mean_m", vec![3], trend.mean_m.iter().copied().collect());
        self.array("scale_m", vec![3], trend.scale_m.iter().copied().collect());
        self.write_members(trend.members.iter().map(Vec::as_slice));
    }

    fn write_members<'a>(&mut self, members: impl ExactSizeIterator<Item = &'a [f32]>) {
        self.numbers.insert("members".into(), members.len() as f64);
        for (index, member) in members.enumerate() {
            let values: Vec<f64> = member.iter().map(|v| f64::from(*v)).collect();
            self.array(&format!("member_{index}"), vec![values.len()], values);
        }
    }
}

/// Calibrated residuals (m), and their uncertainties where they are known (m).
type Residuals = (Vec<Vector3<f64>>, Option<Vec<Vector3<f64>>>);

/// A record from which entries are taken one by one.
struct Reader(Record);

impl Reader {
    fn number(&mut self, name: &str) -> Result<f64, RecordError> {
        self.0.numbers.remove(name).ok_or_else(|| RecordError::Missing(name.to_owned()))
    }

    fn size(&mut self, name: &str) -> Result<usize, RecordError> {
        let value = self.number(name)?;
        let is_whole = value.fract() == 0.0 && (0.0..=LARGEST_SIZE).contains(&value);
        is_whole.then_some(value as usize).ok_or(RecordError::Size { name: name.to_owned(), value })
    }

    fn text(&mut self, name: &'static str) -> Result<String, RecordError> {
        self.0.texts.remove(name).ok_or_else(|| RecordError::Missing(name.to_owned()))
    }

    fn flag(&mut self, name: &'static str) -> Result<bool, RecordError> {
        match self.text(name)?.as_str() {
            "on" => Ok(true),
            "off" => Ok(false),
            found => Err(RecordError::Text { name, found: found.to_owned(), known: "on, off" }),
        }
    }

    fn kernel(&mut self) -> Result<Kernel, RecordError> {
        let found = self.text("kernel")?;
        let all = [Kernel::Matern52, Kernel::SquaredExponential];
        let known = "matern-5/2, squared-exponential";
        let kernel = all.into_iter().find(|kernel| kernel_name(*kernel) == found);
        kernel.ok_or(RecordError::Text { name: "kernel", found, known })
    }

    /// An array whose shape is accepted, for which `expected` is the word.
    fn array(&mut self, name: &str, fits: impl Fn(&[usize]) -> bool, expected: &str) -> Result<Vec<f64>, RecordError> {
        let array = self.0.arrays.remove(name).ok_or_else(|| RecordError::Missing(name.to_owned()))?;
        let size = array.shape.iter().try_fold(1_usize, |size, length| size.checked_mul(*length));
        if fits(&array.shape) && size == Some(array.values.len()) {
            return Ok(array.values);
        }
        let (name, expected) = (name.to_owned(), expected.to_owned());
        Err(RecordError::Shape { name, values: array.values.len(), found: array.shape, expected })
    }

    fn list(&mut self, name: &str) -> Result<Vec<f64>, RecordError> {
        self.array(name, |shape| shape.len() == 1, "[n]")
    }

    fn vector(&mut self, name: &str) -> Result<Vector3<f64>, RecordError> {
        Ok(Vector3::from_column_slice(&self.array(name, |shape| shape == [3], "[3]")?))
    }

    fn vectors(&mut self, name: &str) -> Result<Vec<Vector3<f64>>, RecordError> {
        let values = self.array(name, |shape| matches!(shape, [_, 3]), "[n, 3]")?;
        Ok(values.chunks_exact(3).map(Vector3::from_column_slice).collect())
    }

    /// As many numbers as there are inputs.
    fn of_inputs(&mut self, name: &str, size: usize) -> Result<Vec<f64>, RecordError> {
        self.array(name, |shape| shape == [size], &format!("[{size}]"))
    }

    /// Calibrated residuals, and their uncertainties where they are known.
    fn residuals(&mut self) -> Result<Residuals, RecordError> {
        let errors_m = self.vectors("residual_m")?;
        let has_u = self.0.arrays.contains_key("residual_u_m");
        Ok((errors_m, has_u.then(|| self.vectors("residual_u_m")).transpose()?))
    }

    /// Calibrated points of the position alone.
    fn positions(&mut self) -> Result<Samples, RecordError> {
        let points_m = self.vectors("point_m")?;
        let (errors_m, u_m) = self.residuals()?;
        Ok(Samples::from(&MeasuredField::new(points_m, errors_m, u_m)?))
    }

    /// Calibrated points of named inputs.
    fn inputs(&mut self) -> Result<Samples, RecordError> {
        let names: Vec<String> = (0..MOST_INPUTS).map_while(|k| self.0.texts.remove(&input_key(k))).collect();
        let size = names.len();
        let at = self.array("input_values", |shape| matches!(shape, [_, d] if *d == size), &format!("[n, {size}]"))?;
        let (errors_m, u_m) = self.residuals()?;
        Ok(Samples::new(names, at, errors_m, u_m)?)
    }

    /// Scales of named inputs, whose ranges are those of the points.
    fn scale(&mut self, field: &Samples) -> Result<Vec<f64>, RecordError> {
        let size = field.size();
        let range = (self.of_inputs("input_low", size)?, self.of_inputs("input_high", size)?);
        (range == field.range()).then_some(()).ok_or(RecordError::Range)?;
        self.of_inputs("input_scale", size)
    }

    fn component(&mut self, axis: usize, size: usize, is_plain: bool) -> Result<Component, RecordError> {
        let axis = AXES[axis];
        Ok(Component {
            length: self.of_inputs(&with_unit(&format!("length_{axis}"), is_plain), size)?,
            signal_m: self.number(&format!("signal_{axis}_m"))?,
            noise_m: self.number(&format!("noise_{axis}_m"))?,
            seen: self.number(&format!("seen_{axis}"))?,
            trend_m: self.number(&format!("trend_{axis}_m"))?,
            weights_per_m: self.list(&format!("weights_{axis}_per_m"))?,
        })
    }

    fn ensemble(&mut self, inputs: usize) -> Result<Ensemble, RecordError> {
        let config = NetworkConfig {
            width: self.size("width")?,
            heads: self.size("heads")?,
            sigma: self.number("sigma_spacings")?,
            attention: self.flag("attention")?,
            weighting: self.flag("weighting")?,
            position: self.flag("position")?,
        };
        config.check()?;
        let normaliser = Normaliser {
            mean_m: self.vector("mean_m")?,
            scale_m: self.vector("scale_m")?,
            spacing_m: self.number("spacing_m")?,
        };
        let checked = |(member, values)| {
            Parameters::new(&config, inputs, values).map_err(|source| RecordError::Parameters { member, source })
        };
        let members = self.members()?.into_iter().enumerate().map(checked).collect::<Result<_, _>>()?;
        Ok(Ensemble { config, normaliser, members })
    }

    fn trend(&mut self, size: usize, is_plain: bool) -> Result<PositionEnsemble, RecordError> {
        Ok(PositionEnsemble {
            config: PositionConfig { width: self.size("width")?, blocks: self.size("blocks")? },
            low: self.of_inputs(&with_unit("low", is_plain), size)?,
            high: self.of_inputs(&with_unit("high", is_plain), size)?,
            mean_m: self.vector("mean_m")?,
            scale_m: self.vector("scale_m")?,
            members: self.members()?,
        })
    }

    /// Parameters of all members. What was widened comes back exactly; anything else is no number of that precision, and
    /// refused as such by the networks.
    fn members(&mut self) -> Result<Vec<Vec<f32>>, RecordError> {
        let count = self.size("members")?;
        let one = |member| Ok(self.list(&format!("member_{member}"))?.into_iter().map(narrow).collect());
        (0..count.min(MOST_MEMBERS)).map(one).collect()
    }

    fn is_empty(&self) -> Result<(), RecordError> {
        let Record { numbers, texts, arrays, .. } = &self.0;
        let left = numbers.keys().chain(texts.keys()).chain(arrays.keys()).next();
        left.map_or(Ok(()), |name| Err(RecordError::Unknown(name.clone())))
    }
}

/// The single-precision number that was widened; not a number if there is none.
fn narrow(value: f64) -> f32 {
    let narrow = value as f32;
    if f64::from(narrow) == value { narrow } else { f32::NAN }
}

#[cfg(test)]
mod tests;
