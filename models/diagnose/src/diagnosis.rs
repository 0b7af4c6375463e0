//! What a diagnosis says: found, not found, not tellable, and the error before and after.
//!
//! Place in the flow: the result of [`crate::diagnose()`]; the command line writes it as JSON and as a report. SI.

use crate::clock::ClockShift;
use crate::competing::Competing;
use crate::explanation::Explanation;
use crate::gate::Verdict;
use crate::late::Late;
use crate::machine_step::MachineStep;
use crate::noise::Detection;
use crate::step::SetAside;
use crate::wander::{Slow, Wander};
use abbe_geometry::effects::Shape;
use abbe_geometry::model::MachineModel;
use abbe_identify::Identified;

/// Half width of a 95 % interval in standard deviations.
pub(crate) const BAND_95: f64 = 1.96;

/// Outcome of a diagnosis.
#[derive(Debug)]
pub struct Diagnosis {
    /// The model's fit of the campaign as it was.
    pub before: Identified,
    /// With what was found; equal to `before` in structure where nothing was.
    pub after: Identified,
    /// The model to correct with: `after` averaged with what competes, without what is only a course in time.
    pub model: MachineModel,
    /// Residual of `before`.
    pub detection_before: Detection,
    /// Residual of `after`.
    pub detection_after: Detection,
    /// Nothing was found, and the residual has no structure that noise lacks.
    pub consistent_with_noise: bool,
    /// The same, but for errors that neighbouring readings share: noise of the air or the instrument, or something slow.
    pub only_correlated: bool,
    /// Effects found, in the order in which they went in.
    pub found: Vec<Found>,
    /// What the search decided, in words.
    pub steps: Vec<String>,
    /// Lines that the fit rejected as a whole: measure them again.
    pub rejected_lines: Vec<String>,
    /// Error functions had too few coefficients and got more.
    pub enriched: bool,
    /// A step of the machine in the middle of the campaign, which no model describes on both sides.
    pub machine_step: Option<MachineStep>,
    /// Slow changes of the machine or its stations, each too small to be named.
    pub wander: Option<Wander>,
    /// Where nothing was found: what the fit that it began with shows of such changes if all noise is of single readings. It stands in the
    /// uncertainty, and may be noise that hangs together.
    pub may_wander: Option<Wander>,
    /// Slow changes that no log follows, in the place of what was found.
    pub slow: Slow,
    /// What the last lines are off by, after which nothing was measured.
    pub late: Option<Late>,
    /// A log that goes by another clock than the readings: what follows it was set aside.
    pub clock: Option<ClockShift>,
    /// Candidates that explain the residual but stay out, each with the reason.
    pub set_aside: Vec<SetAside>,
    /// Whether the uncertainty of `model` holds some of them, or all that was not adopted.
    pub holds_aside: bool,
    /// Why nothing at all was adopted although the search found something; `after` is then `before`.
    pub not_adopted: Option<String>,
    /// All that was found together, judged on what it was not fitted to; `None` where nothing was found.
    pub gate: Option<Verdict>,
    /// Error on lines that no step saw.
    pub unseen: Option<Unseen>,
    /// Why there is no such error; `None` where there is one.
    pub unseen_missing: Option<String>,
    /// Blocked error of the final structure.
    pub blocked: Vec<Blocked>,
    /// Effects that this plan cannot judge, or not tell from others.
    pub not_identifiable: Vec<NotIdentifiable>,
    /// Effects that need what was not logged or not varied.
    pub untestable: Vec<Untestable>,
    /// Measurements that would decide, most useful first.
    pub next_measurements: Vec<String>,
}

/// One effect found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Name in the registry.
    pub name: &'static str,
    /// Name for readers.
    pub title: &'static str,
    /// Formula.
    pub formula: &'static str,
    /// Explained or described. An effect with a name only describes where a free dependence explains clearly more.
    pub kind: Explanation,
    /// Shape.
    pub shape: Shape,
    /// Covariates and quantities it depends on.
    pub covariates: Vec<String>,
    /// Probability by chance when it was found, corrected for the number of tests.
    pub p_value: f64,
    /// Evidence when it was found: twice the log likelihood after the price of parameters and trials.
    pub evidence: f64,
    /// Share of its signature that errors, stations and dead paths could absorb.
    pub alias_share: f64,
    /// Parameters.
    pub parameters: Vec<FoundParameter>,
    /// Rms of what it does to the ranges (m).
    pub size_m: f64,
    /// Other effects that explain nearly the same here.
    pub rivals: Vec<Rival>,
    /// Explanations nearly as likely in its place. Coordinates by the model of [`Diagnosis::model`] are the mean of all, weighted by how
    /// likely each is, with their disagreement in the covariance.
    pub competing: Vec<Competing>,
    /// Whether coordinates are corrected by it. What is only a course in time is in their uncertainty instead.
    pub corrects: bool,
    /// Gain in blocked rms over the model without it (m), lines left out; `None` where there is no fit without it.
    pub held_out_gain_m: Option<f64>,
    /// Its gain beside placebos; `None` where there is no fit without it.
    pub placebo: Option<Placebo>,
    /// How it predicts lines, times, stations, offsets and covariates that it was not fitted to.
    pub gate: Verdict,
}

/// A parameter with its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundParameter {
    /// Name.
    pub name: String,
    /// SI unit.
    pub unit: &'static str,
    /// Value.
    pub value: f64,
    /// Standard uncertainty (k = 1).
    pub u: f64,
    /// Magnitude beyond which it is not believed.
    pub plausible: f64,
}

impl FoundParameter {
    /// Whether the value is one that such a parameter can have.
    pub fn is_plausible(&self) -> bool {
        self.value.abs() <= self.plausible
    }
}

/// Another effect that explains nearly the same.
#[derive(Debug, Clone, PartialEq)]
pub struct Rival {
    /// Name.
    pub name: &'static str,
    /// Its shape.
    pub shape: Shape,
    /// How much less evidence it has.
    pub evidence_behind: f64,
}

/// An effect that this plan cannot judge.
#[derive(Debug, Clone, PartialEq)]
pub struct NotIdentifiable {
    /// Name.
    pub name: &'static str,
    /// Shape.
    pub shape: Shape,
    /// Share of its signature that the model's own parameters absorb.
    pub alias_share: f64,
    /// The parameters that absorb most of it.
    pub aliased_with: Vec<String>,
    /// What would tell.
    pub decided_by: &'static str,
}

/// An effect that cannot be tested, or a quantity by which none can.
#[derive(Debug, Clone, PartialEq)]
pub struct Untestable {
    /// Name.
    pub name: String,
    /// Title.
    pub title: String,
    /// What it needs.
    pub needs: String,
}

/// A mean square with the interval that blocks give.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOutError {
    /// Rms (m).
    pub rms_m: f64,
    /// 95 % interval of the rms (m).
    pub interval_m: (f64, f64),
}

/// Error on lines left out of the whole search.
#[derive(Debug, Clone, PartialEq)]
pub struct Unseen {
    /// Without what the search found.
    pub before: HeldOutError,
    /// With it.
    pub after: HeldOutError,
    /// 95 % interval of before² − after² (m²), by lines: above zero where the gain is sure.
    pub gain_m2: (f64, f64),
    /// What the lines left out show beyond the declared noise with what was found: standard deviation along X, Y and Z (m); 0 where
    /// chance explains it. A fit that has taken noise for an effect shows it here, and not on the readings that it saw.
    pub unexplained_m: [f64; 3],
    /// What each fold found, by name.
    pub found: Vec<Vec<String>>,
    /// What could not be left out or fitted, in words.
    pub not_judged: Vec<String>,
}

impl Unseen {
    /// Whether lines that no step saw are predicted worse with what was found, by more than one standard deviation between
    /// lines.
    pub(crate) fn loses(&self) -> bool {
        let (low, high) = self.gain_m2;
        let (gain, deviation) = (0.5 * (low + high), (high - low) / (2.0 * BAND_95));
        gain < -deviation
    }
}

/// Blocked error of the final structure, by kind of block.
#[derive(Debug, Clone, PartialEq)]
pub struct Blocked {
    /// `line`, `station`, `time` or `offset`.
    pub by: String,
    /// Whitened rms without the effects.
    pub before: f64,
    /// Whitened rms with them.
    pub after: f64,
}

/// Placebos of one effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Placebo {
    /// Reduction of the blocked mean square by the effect itself (whitened, share of the noise).
    pub gain: f64,
    /// The same for its columns moved to other readings.
    pub placebo_gains: Vec<f64>,
}
