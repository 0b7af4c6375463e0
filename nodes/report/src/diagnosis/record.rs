//! The data of a diagnosis: everything that stands in `diagnosis.json`, for every kind of data that can be diagnosed.
//!
//! Place in the flow: `abbe diagnose` fills it, [`super::DiagnosisReport`] shows it. Micrometres where the name says so,
//! parameters and shapes in the SI unit beside them. Missing is `None`, never 0: JSON then says `null`.

use std::collections::BTreeMap;

use super::shaped::{for_readers, places_mm, shaped};
use crate::text::{listed, significant};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Rivals that a sentence names at most; the table has all.
const RIVALS: usize = 5;

/// A diagnosis.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The answer in a few sentences.
    pub verdict: String,
    /// Nothing was found, and the residual has no structure that noise lacks.
    pub consistent_with_noise: bool,
    /// Nothing was found, but neighbouring readings share errors; all figures allow for that.
    #[serde(default)]
    pub only_correlated: bool,
    /// The error functions had too few coefficients and got more.
    pub enriched: bool,
    /// Effects found, in the order in which they went in.
    pub effects: Vec<Effect>,
    /// Candidates that explain the residual but stay out of the model, each with the reason.
    #[serde(default)]
    pub set_aside: Vec<SetAside>,
    /// Why nothing was adopted although something was found.
    #[serde(default)]
    pub not_adopted: Option<String>,
    /// Error of the model as it was.
    pub before: ErrorFigures,
    /// Error with everything found.
    pub after: ErrorFigures,
    /// How `held_out_rms_um` came about.
    pub held_out: HeldOut,
    /// The independent points, where a file of them was given.
    pub verification: Option<Verification>,
    /// Effects that these data cannot judge.
    pub not_identifiable: Vec<NotIdentifiable>,
    /// Effects that need what was not logged or not varied.
    pub untestable: Vec<Untestable>,
    /// Measurements that would decide, most useful first.
    pub next_measurements: Vec<String>,
    /// Is the residual consistent with noise? Before and after.
    pub detection: Both<Detection>,
    /// What the search decided, in order.
    pub steps: Vec<String>,
    /// From the model as it was to all effects, where they were added one by one in a fixed order.
    pub ladder: Vec<Rung>,
    /// Every candidate against the model as it was, where that is listed.
    pub considered: Vec<Considered>,
    /// Other sets of effects, where they were tried.
    pub alternatives: Vec<Alternative>,
    /// Sentences that a reader of the figures must know.
    pub notes: Vec<String>,
    /// Kind of data.
    pub data_kind: String,
    /// What was measured, when, with what, as far as the data say: each line's name and words.
    #[serde(default)]
    pub about: Vec<(String, String)>,
    /// Machine, where the data belong to a model.
    pub machine: Option<String>,
    /// The model that the diagnosis started from.
    pub model: Option<File>,
    /// The data.
    pub data: File,
    /// The model that came out.
    pub model_out: Option<ModelOut>,
    /// Seed of folds and placebos.
    pub seed: u64,
    /// All options.
    pub options: Value,
    /// Name and version of the software.
    pub software: String,
}

/// The same before and after.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Both<T> {
    /// With the model as it was.
    pub before: T,
    /// With everything found.
    pub after: T,
}

/// A file by its name, without folder, and its hash.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct File {
    /// Name.
    pub file: String,
    /// SHA-256: of the model in a model file, of the bytes of any other.
    pub sha256: String,
}

/// The model that came out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelOut {
    /// Name and hash.
    #[serde(flatten)]
    pub file: File,
    /// Whether it is the model that went in, byte for byte.
    pub is_the_one_given: bool,
}

/// One effect found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Name in the registry of effects.
    pub name: String,
    /// Name for readers.
    pub title: String,
    /// `attributed` or `empirical`.
    pub kind: String,
    /// Formula.
    pub formula: String,
    /// What it is about (axis, sensor, period), figures in SI.
    pub shape: BTreeMap<String, Value>,
    /// Logged quantities it depends on.
    pub covariates: Vec<String>,
    /// Probability by chance, corrected for the number of tests.
    pub p_value: Option<f64>,
    /// Twice the log likelihood gained, after the price of parameters and trials.
    pub evidence: Option<f64>,
    /// Share of its signature that the model without it could absorb.
    pub alias_share: Option<f64>,
    /// Estimates.
    pub parameters: Vec<Parameter>,
    /// Error on blocks left out without it, less that with it.
    pub held_out_gain_um: Option<f64>,
    /// What the same flexibility gains without the tie to the data.
    pub placebo: Placebo,
    /// Other effects that explain nearly the same.
    pub cannot_be_told_from: Vec<Rival>,
    /// Explanations nearly as likely in its place, which corrected coordinates are the mean with.
    #[serde(default)]
    pub averaged_with: Vec<Averaged>,
    /// Whether coordinates are corrected by it. What is only a course in time is in their uncertainty instead.
    #[serde(default = "yes")]
    pub corrects: bool,
    /// Rms of what it does to the readings.
    pub size_um: Option<f64>,
    /// How it predicts what it was not fitted to.
    #[serde(default)]
    pub predicts: Predicts,
}

/// How the model with an effect predicts readings left out, beside the model without it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Predicts {
    /// By kind of block.
    pub left_out: Vec<LeftOut>,
    /// What could not be left out, in words.
    pub not_judged: Vec<String>,
}

/// Blocks of one kind left out of both fits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LeftOut {
    /// `line`, `station`, `time`, `offset` or the name of a covariate.
    pub by: String,
    /// Blocks.
    pub blocks: usize,
    /// Rms without the effect over the declared noise.
    pub without: Option<f64>,
    /// Rms with it, over the same readings.
    pub with: Option<f64>,
    /// Gain in standard deviations.
    pub deviations: Option<f64>,
}

/// A candidate that stays out of the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SetAside {
    /// Name in the registry of effects.
    pub name: String,
    /// Name for readers.
    pub title: String,
    /// Shape, figures in SI.
    pub shape: BTreeMap<String, Value>,
    /// Why it stays out.
    pub because: String,
}

/// A parameter, SI.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: Option<f64>,
    /// SI unit.
    pub unit: String,
    /// Standard uncertainty (k = 1).
    pub u: Option<f64>,
    /// Magnitude beyond which it is not believed.
    pub plausible: Option<f64>,
    /// Whether the value is within it.
    pub is_plausible: bool,
}

/// Gain of an effect beside that of placebos: its own columns, cut loose from the readings they belong to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Placebo {
    /// Gain of the effect.
    pub gain: Option<f64>,
    /// Unit of the gains, in words.
    pub unit: String,
    /// Placebos drawn.
    pub draws: usize,
    /// Median gain of the placebos.
    pub median: Option<f64>,
    /// Gain that one placebo in twenty exceeds.
    pub quantile_95: Option<f64>,
    /// Share of placebos, the effect itself counted as one, that gain as much or more.
    pub share_as_good: Option<f64>,
}

/// Another effect that explains nearly the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rival {
    /// Name.
    pub name: String,
    /// Name for readers; the name where it has none.
    #[serde(default)]
    pub title: String,
    /// Its shape, figures in SI.
    pub shape: BTreeMap<String, Value>,
    /// How much less evidence it has.
    pub evidence_behind: Option<f64>,
}

/// An explanation that takes part in corrected coordinates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Averaged {
    /// Name.
    pub name: String,
    /// Name for readers; the name where it has none.
    #[serde(default)]
    pub title: String,
    /// Its shape, figures in SI.
    pub shape: BTreeMap<String, Value>,
    /// Its share of the mean.
    pub share: Option<f64>,
}

/// Error of one model.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorFigures {
    /// Rms on blocks that no step saw.
    pub held_out_rms_um: Option<f64>,
    /// Its 95 % interval.
    pub held_out_interval_um: Option<(f64, f64)>,
    /// Rms at the independent points, three-dimensional, after rigid alignment.
    pub verify_rms_um: Option<f64>,
    /// Its 95 % interval.
    pub verify_interval_um: Option<(f64, f64)>,
    /// Largest error at the independent points.
    pub verify_max_um: Option<f64>,
    /// χ² per degree of freedom with the declared uncertainties.
    pub chi2_per_dof: Option<f64>,
    /// Rms of the residuals of the fit itself.
    pub residual_rms_um: Option<f64>,
}

/// How the error on data left out came about.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// What was left out together.
    pub blocks: String,
    /// Why there is no figure; `None` where there is one.
    pub missing_because: Option<String>,
    /// Lines that could not be left out and parts that could not be fitted, in words.
    #[serde(default)]
    pub not_judged: Vec<String>,
    /// 95 % interval of mean square before less mean square after (µm²): above zero where the gain is sure.
    pub gain_interval_um2: Option<(f64, f64)>,
    /// What each part of the data found by itself.
    pub found_by_part: Vec<Vec<String>>,
    /// Error of blocks left out of the final fit only, over the declared noise.
    pub blocked: Vec<Blocked>,
}

/// Error on blocks of one kind, as a ratio to the declared noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Blocked {
    /// Kind of block.
    pub by: String,
    /// With the model as it was.
    pub before: Option<f64>,
    /// With everything found.
    pub after: Option<f64>,
}

/// What independent points say.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verification {
    /// The file.
    #[serde(flatten)]
    pub file: File,
    /// Points.
    pub points: usize,
    /// Points outside the volume that the model after was identified in.
    pub extrapolated: usize,
    /// Points that lack a covariate the model after needs; they count, without the effect.
    pub covariate_missing: usize,
    /// 95 % interval of mean square before less mean square after (µm²).
    pub gain_interval_um2: Option<(f64, f64)>,
}

/// An effect that the data cannot judge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NotIdentifiable {
    /// Name.
    pub name: String,
    /// Name for readers; the name where it has none.
    #[serde(default)]
    pub title: String,
    /// Shape, figures in SI.
    pub shape: BTreeMap<String, Value>,
    /// Share of its signature that the model absorbs.
    pub alias_share: Option<f64>,
    /// What it looks like.
    pub aliased_with: Vec<String>,
    /// Why, where there is more to say than the share.
    pub because: Option<String>,
    /// What would tell.
    pub decided_by: String,
}

/// An effect that cannot be tested.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Untestable {
    /// Name.
    pub name: String,
    /// Name for readers; the name where it has none.
    #[serde(default)]
    pub title: String,
    /// Sensor, column or move that is missing.
    pub needs: String,
}

/// What the residual says about itself.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Detection {
    /// In words.
    pub words: String,
    /// Whether some structure is shown that noise does not have.
    pub has_structure: Option<bool>,
    /// χ² per degree of freedom with the declared uncertainties.
    pub chi2_per_dof: Option<f64>,
    /// Probability of such a χ² if the declared uncertainties are right.
    pub p_declared: Option<f64>,
    /// Estimated over declared standard deviation.
    pub estimated_over_declared: Option<f64>,
    /// Estimated standard deviation of one observation.
    pub estimated_sigma_um: Option<f64>,
    /// Rms of the residuals used.
    pub rms_um: Option<f64>,
    /// Observations used.
    pub used: usize,
    /// Observations rejected.
    pub rejected: usize,
    /// Correlation of neighbours on a line; 0 for noise.
    pub along_lines: Option<Structure>,
    /// Scatter of the lines' means over what noise gives; 1 for noise.
    pub between_lines: Option<Structure>,
    /// Misfit over the scatter of replicates; 1 for noise. `None` without enough replicates.
    pub lack_of_fit: Option<Structure>,
    /// By station, offset and direction of approach.
    pub groups: Vec<Group>,
}

/// A figure and how probable it is by chance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Structure {
    /// The figure; `None` where only the probability is known.
    pub value: Option<f64>,
    /// Probability of such a value by chance.
    pub p_value: Option<f64>,
}

/// Residuals of some observations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Group {
    /// Which.
    pub name: String,
    /// Observations.
    pub count: usize,
    /// Mean residual.
    pub mean_um: Option<f64>,
    /// Mean square over the declared variance.
    pub mean_square: Option<f64>,
}

/// One step of the ladder from the base model to all effects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rung {
    /// Effect added here; `None` for the base model.
    pub added: Option<String>,
    /// Error on blocks left out.
    pub held_out_rms_um: Option<f64>,
    /// Its 95 % interval.
    pub held_out_interval_um: Option<(f64, f64)>,
    /// Rms of the residuals of the fit.
    pub residual_rms_um: Option<f64>,
    /// Probability by chance on this rung, corrected.
    pub p_value: Option<f64>,
    /// Share that the rungs below could absorb.
    pub alias_share: Option<f64>,
    /// Parameters as fitted on this rung.
    pub parameters: Vec<Parameter>,
}

/// A candidate against the base model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Considered {
    /// Name.
    pub name: String,
    /// `attributed` or `empirical`.
    pub kind: String,
    /// Parameters that the base model leaves to be determined.
    pub tested: usize,
    /// Uncorrected.
    pub p_value: Option<f64>,
    /// After Holm.
    pub p_holm: Option<f64>,
    /// Twice the log likelihood gained, less the price.
    pub evidence: Option<f64>,
    /// Share that the base model could absorb.
    pub alias_share: Option<f64>,
}

/// A set of effects and how well it predicts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alternative {
    /// Names.
    pub effects: Vec<String>,
    /// Error on blocks left out.
    pub held_out_rms_um: Option<f64>,
    /// Its 95 % interval.
    pub held_out_interval_um: Option<(f64, f64)>,
    /// F test against the base model, not corrected.
    pub p_value: Option<f64>,
    /// Twice the log likelihood gained, less the price.
    pub evidence: Option<f64>,
}

fn yes() -> bool {
    true
}

impl Effect {
    /// Title with what it is about and what it follows: `backlash of Y`, `expansion of X by temp_scale_x_c`.
    pub fn label(&self) -> String {
        let text = |key: &str| self.shape.get(key).and_then(Value::as_str);
        let about = self.about();
        let about = match text("toward") {
            Some(toward) => format!("{about} toward {}", toward.to_uppercase()),
            None => about,
        };
        match (text("sensor"), text("warm"), text("cold")) {
            (Some(sensor), ..) => format!("{about} by {sensor}"),
            (None, Some(warm), Some(cold)) => format!("{about} by {warm} less {cold}"),
            _ => about,
        }
    }

    /// What these data do not tell it from, the nearest by name; nothing where there is none.
    pub fn rivals(&self) -> Option<String> {
        let names: Vec<String> = self.cannot_be_told_from.iter().map(Rival::label).collect();
        (!names.is_empty()).then(|| listed(&names, RIVALS, ", "))
    }

    /// Period of a wave, in the unit of what it follows; of time in minutes.
    fn period(&self) -> Option<String> {
        let number = |key: &str| self.shape.get(key).and_then(Value::as_f64);
        let period = (number("p_high")? - number("p_low")?) / number("cycles")?;
        match self.covariates.first()?.as_str() {
            "time_s" => Some(format!("{:.1} min", period / 60.0)),
            _ => Some(significant(period, 3)),
        }
    }

    /// Amplitude of a wave that has a sine and a cosine, as a parameter; its u takes these as independent.
    pub fn amplitude(&self) -> Option<Parameter> {
        let [sine, cosine] = self.parameters.as_slice() else { return None };
        if (sine.name.as_str(), cosine.name.as_str()) != ("sine", "cosine") {
            return None;
        }
        let ((a, ua), (b, ub)) = ((sine.value?, sine.u?), (cosine.value?, cosine.u?));
        let value = a.hypot(b);
        let u = (a * ua).hypot(b * ub) / value;
        let name = "amplitude".to_owned();
        u.is_finite().then(|| Parameter { name, value: Some(value), u: Some(u), plausible: None, ..sine.clone() })
    }

    /// Period of a wave of an axis, and where on its axis it is, of what is in one place.
    fn along(&self) -> String {
        let period_mm = self.shape.get("period_m").and_then(Value::as_f64).map(|m| 1e3 * m);
        let period = period_mm.map(|mm| format!(", period {} mm", significant(mm, 3)));
        let place = self.place().map(|place| format!(" {place}"));
        [period, place].into_iter().flatten().collect()
    }

    /// Where on its axis it is, of what is in one place.
    fn place(&self) -> Option<String> {
        places_mm(&self.shape).map(|[(_, from), (_, to)]| format!("between {from} and {to} mm"))
    }

    fn about(&self) -> String {
        let text = |key: &str| self.shape.get(key).and_then(Value::as_str);
        match (text("axis"), text("carriage"), text("line")) {
            (Some(axis), ..) => format!("{} of {}{}", self.title, axis.to_uppercase(), self.along()),
            (None, Some(carriage), _) => {
                let carrying = text("carrying").unwrap_or("?");
                format!("{}, {} on {}", self.title, carriage.to_uppercase(), carrying.to_uppercase())
            }
            (None, None, Some(line)) => format!("{} {line}", self.title),
            _ if self.name == "empirical" && !self.covariates.is_empty() => {
                let every = self.period().map_or_else(String::new, |period| format!(", period {period}"));
                format!("{} in {}{every}", self.title, self.covariates.join(" and "))
            }
            _ => self.title.clone(),
        }
    }
}

impl SetAside {
    /// Title and shape.
    pub fn label(&self) -> String {
        shaped(&self.title, &self.shape)
    }
}

impl Averaged {
    /// Name for readers, shape and share: `backlash (axis y, over x, terms 2) 12 %`.
    pub fn label(&self) -> String {
        let name = self.named();
        self.share.map_or(name.clone(), |share| format!("{name} {:.0} %", 100.0 * share))
    }

    pub(super) fn named(&self) -> String {
        shaped(for_readers(&self.name, &self.title), &self.shape)
    }
}

impl Rival {
    /// Name for readers and shape: `backlash (axis y, over x, terms 2)`.
    pub fn label(&self) -> String {
        shaped(for_readers(&self.name, &self.title), &self.shape)
    }
}
