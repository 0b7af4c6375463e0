//! What a study says: the result of every diagnosis without a chain, ready for report and JSON.
//!
//! Place in the flow: made by [`super::assemble`], printed by the command. Root mean squares in µm; parameters in the
//! SI unit that stands beside them. Where rows have uncertainties of their own, every rms is weighted by them.

use super::terms::Terms;
use crate::explanation::Explanation;

/// What was left out together to judge.
#[derive(Debug, Clone, PartialEq)]
pub struct Blocks {
    /// In words, such as `pose` or `cycle`.
    pub what: String,
    /// How many.
    pub count: usize,
}

/// Error on blocks that the fit did not see.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOutRms {
    /// Root mean square (µm).
    pub rms_um: f64,
    /// 95 % interval by the jackknife over blocks, on the logarithm (µm); `None` with fewer than three blocks.
    pub interval_um: Option<(f64, f64)>,
    /// Directions judged: rows less what only the block left out could determine.
    pub judged: usize,
}

/// How well a model describes the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judgement {
    /// Root mean square of the residuals of the fit itself (µm).
    pub rms_um: f64,
    /// Error on blocks left out.
    pub held_out: HeldOutRms,
    /// χ² per degree of freedom with the declared uncertainties; `None` where none are declared.
    pub chi2_per_dof: Option<f64>,
    /// Standard deviation of one row as the residuals estimate it (µm), with the degrees of freedom used up.
    pub estimated_sigma_um: f64,
    /// Degrees of freedom.
    pub degrees_of_freedom: f64,
}

/// A parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// SI.
    pub value: f64,
    /// SI unit.
    pub unit: &'static str,
    /// Standard uncertainty (k = 1) from the scatter of the residuals and how that may be correlated, SI.
    pub u: f64,
    /// Half of the 95 % interval about the value: u times Student's t for the degrees of freedom there are, SI.
    pub half_95: f64,
    /// Magnitude beyond which it is not believed, SI.
    pub plausible: f64,
}

impl Parameter {
    /// Whether the magnitude is one that such an effect can have.
    pub fn is_plausible(&self) -> bool {
        self.value.abs() <= self.plausible
    }
}

/// An effect found.
#[derive(Debug, Clone, PartialEq)]
pub struct Effect {
    /// Name, unique in the study.
    pub name: String,
    /// Formula or shape.
    pub formula: String,
    /// Attributed or empirical.
    pub kind: Explanation,
    /// Logged quantities it depends on.
    pub covariates: Vec<String>,
    /// Probability by chance given all other effects found, corrected for the number of candidates.
    pub p_value: f64,
    /// Share of its signature that the model without it could absorb.
    pub alias_share: f64,
    /// Estimates.
    pub parameters: Vec<Parameter>,
    /// Held-out rms without it less held-out rms with it, all other effects present (µm).
    pub held_out_gain_um: f64,
    /// Candidates that would explain the same within the evidence of these data.
    pub rivals: Vec<String>,
}

/// One step of the ladder.
#[derive(Debug, Clone, PartialEq)]
pub struct Rung {
    /// Effect added here; `None` for the base model.
    pub added: Option<String>,
    /// After adding it.
    pub judgement: Judgement,
    /// Probability by chance on this rung, corrected for the number of candidates.
    pub p_value: Option<f64>,
    /// Share of its signature that the rungs below could absorb.
    pub alias_share: Option<f64>,
    /// Its parameters as fitted on this rung.
    pub parameters: Vec<Parameter>,
}

/// A candidate against the base model alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Considered {
    /// Name.
    pub name: String,
    /// Attributed or empirical.
    pub kind: Explanation,
    /// Parameters that the base model leaves to be determined; 0 where it contains the candidate.
    pub tested: usize,
    /// F test, uncorrected.
    pub p_value: f64,
    /// After Holm.
    pub p_holm: f64,
    /// Twice the log likelihood gained, less a price for parameters and for the number of candidates.
    pub evidence: f64,
    /// Share of its signature that the base model could absorb.
    pub alias_share: f64,
}

/// A set of effects and how well it predicts.
#[derive(Debug, Clone, PartialEq)]
pub struct Alternative {
    /// Names.
    pub effects: Vec<String>,
    /// With these effects and no others.
    pub judgement: Judgement,
    /// Their parameters, in the order of the effects.
    pub parameters: Vec<Parameter>,
    /// F test of the set against the base model, not corrected for the number of sets tried.
    pub p_value: f64,
    /// Twice the log likelihood gained over the base model, less the price of its parameters.
    pub evidence: f64,
}

/// What the data cannot decide.
#[derive(Debug, Clone, PartialEq)]
pub struct Ambiguity {
    /// Effects that look the same, or one that looks like the model itself.
    pub effects: Vec<String>,
    /// Why.
    pub because: String,
    /// Measurement that would tell.
    pub decided_by: String,
}

/// An effect that these data cannot test.
#[derive(Debug, Clone, PartialEq)]
pub struct Untestable {
    /// Name.
    pub name: String,
    /// What is missing: a sensor, a column, a move.
    pub needs: String,
}

/// Whether replicates say that something is left.
#[derive(Debug, Clone, PartialEq)]
pub struct LackOfFit {
    /// Replicates of what.
    pub of: String,
    /// Probability by chance before any effect is added.
    pub p_before: f64,
    /// The same after; `None` where the effects leave nothing to test.
    pub p_after: Option<f64>,
}

/// The noise of one axis or component, as the fit with all effects leaves it.
#[derive(Debug, Clone, PartialEq)]
pub struct SeriesNoise {
    /// Which, in words.
    pub of: String,
    /// Standard deviation of one row (µm; declared uncertainties weigh it).
    pub sigma_um: f64,
    /// Correlation of a row with the one measured before it; `None` where the rows are too few to tell.
    pub neighbours: Option<Correlation>,
    /// Rows.
    pub rows: usize,
}

/// A correlation in order of measurement, by restricted likelihood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlation {
    /// Of neighbouring rows: share times the slow part's own correlation.
    pub value: f64,
    /// 95 % interval.
    pub interval: (f64, f64),
    /// Share of the variance that is slow.
    pub slow_share: f64,
    /// Steps over which the slow part falls to 1/e.
    pub steps: Option<f64>,
}

/// A row that no explanation reaches, left out of everything.
#[derive(Debug, Clone, PartialEq)]
pub struct RejectedRow {
    /// Which, in words.
    pub name: String,
    /// Residual against the fit without it (µm).
    pub residual_um: f64,
    /// The same in standard deviations.
    pub deviations: f64,
}

/// What is left of one row, or of a component of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOver {
    /// Row as it was given, from 0.
    pub row: usize,
    /// Component x, y, z as 0, 1, 2; 0 for runs.
    pub component: usize,
    /// By the base model (m).
    pub before_m: f64,
    /// With everything found (m).
    pub after_m: f64,
}

/// One thing that was looked at before anything was said to be noise.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// What, in words.
    pub what: String,
    /// What was seen.
    pub says: String,
    /// Whether that is what noise does; `None` where the data cannot tell.
    pub is_noise: Option<bool>,
}

/// The search judged on blocks that no step of it saw.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Unseen {
    /// Error of the base model.
    pub before: Option<HeldOutRms>,
    /// Error with what each search found.
    pub after: Option<HeldOutRms>,
    /// Whether the error comes down by more than the parts differ in (one-sided, 95 %); `None` without figures.
    pub is_sure: Option<bool>,
    /// Parts that were left out in turn.
    pub folds: usize,
    /// What each search found.
    pub found: Vec<Vec<String>>,
    /// Parts that could not be judged, with the reason.
    pub not_judged: Vec<String>,
    /// Why there is no figure.
    pub missing_because: Option<String>,
    /// Whether what was found was chosen on all blocks and only fitted without each, as there are too few for searches.
    pub chosen_on_all: bool,
}

/// The diagnosis.
#[derive(Debug, Clone, PartialEq)]
pub struct StudyDiagnosis {
    /// Kind of data.
    pub of: &'static str,
    /// Scalar observations.
    pub rows: usize,
    /// What was left out together.
    pub blocks: Blocks,
    /// No effect passes, replicates show no lack of fit, nothing wanders slowly, few rows stand apart, and the scatter is
    /// what was declared, if it was; [`StudyDiagnosis::looked`] says what each look saw.
    pub consistent_with_noise: bool,
    /// What was found, strongest first.
    pub effects: Vec<Effect>,
    /// The base model.
    pub before: Judgement,
    /// With all effects.
    pub after: Judgement,
    /// The error before and after on blocks that no step of the search saw.
    pub unseen: Unseen,
    /// Noise of each axis or component.
    pub noise: Vec<SeriesNoise>,
    /// Rows left out as gross errors.
    pub rejected: Vec<RejectedRow>,
    /// What is left of each row that counts; none where rows of the study are made of several.
    pub left: Vec<LeftOver>,
    /// What was looked at before anything was called noise.
    pub looked: Vec<Look>,
    /// From the base model to all effects; the choice of effects saw the blocks that are left out here.
    pub ladder: Vec<Rung>,
    /// Every candidate against the base model.
    pub considered: Vec<Considered>,
    /// Other sets of effects, best prediction first; only where all were tried.
    pub alternatives: Vec<Alternative>,
    /// Test by replicates, where there are any.
    pub lack_of_fit: Option<LackOfFit>,
    /// What cannot be told apart.
    pub not_identifiable: Vec<Ambiguity>,
    /// What could not be tested.
    pub untestable: Vec<Untestable>,
    /// What would be the same at all rows, in words: neither seen nor in any uncertainty.
    pub hidden: Vec<String>,
    /// What to measure next.
    pub next_measurements: Vec<String>,
    /// What parts of the data say otherwise, in words.
    pub contradictions: Vec<String>,
    /// What was found, as effects of a machine model.
    pub terms: Terms,
    /// Whether it was asked to stop: these are the effects found until then, not judged on blocks left out.
    pub is_stopped: bool,
    /// Sentences a reader of the figures must know.
    pub notes: Vec<String>,
}
