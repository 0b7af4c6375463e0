//! One trial: a campaign with a known flaw, diagnosed without knowing it, and scored.
//!
//! Place in the flow: a [`Trial`] is made from scenario, seed and factor; [`run`] hands campaign and description to a
//! [`Diagnoser`] and scores the model that comes back on points that no fit saw. Lengths in m.

use std::collections::BTreeMap;
use std::sync::Mutex;

use abbe_geometry::machine::Machine;
use abbe_geometry::model::MachineModel;
use abbe_identify::{IdentifyOptions, OrderChoice, identify};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_virtual_machine::verification::VerificationPoint;
use abbe_virtual_machine::{SimulationConfig, simulate_campaign, verification_points};

use crate::attribution::{Accepted, Finding, attribute};
use crate::description::describe;
use crate::error::TrialError;
use crate::record::{Outcome, Record};
use crate::scenario::{Scenario, SizedBy, choices, declared_instrument, with_effects};
use crate::score::{history, verified};
use crate::sizing;

/// Verification points of a trial.
const POINTS: usize = 300;
/// Seed of the points, apart from the trial's own.
const POINTS_SEED: u64 = 7000;

/// What a diagnosis says.
#[derive(Debug)]
pub struct Verdict {
    /// The model that came out.
    pub model: MachineModel,
    /// Whether it calls the residual consistent with the declared noise.
    pub consistent_with_noise: bool,
    /// What it added.
    pub findings: Vec<Finding>,
    /// What it says cannot be told apart, in its words.
    pub not_identifiable: Vec<String>,
    /// What it decided on the way, in its words.
    pub steps: Vec<String>,
    /// χ² per degree of freedom before and after.
    pub chi2_per_dof: [f64; 2],
}

/// Something that diagnoses campaigns; the bench does not care how.
pub trait Diagnoser: Sync {
    /// Diagnoses a campaign of a machine that is described so.
    ///
    /// # Errors
    /// The diagnosis failed; its words go into the record.
    fn diagnose(
        &self,
        machine: &Machine,
        instrument: RangeUncertainty,
        campaign: &Campaign,
        order: OrderChoice,
    ) -> Result<Verdict, TrialError>;
}

/// What was found out once and serves further trials of the same seed: errors without effect, excess per size.
#[derive(Debug, Default)]
pub struct Memory(Mutex<BTreeMap<String, Result<f64, TrialError>>>);

impl Memory {
    /// The value under a key, worked out if nobody has yet. Two threads may both work it out, to the same result.
    fn get(&self, key: String, work: impl FnOnce() -> Result<f64, TrialError>) -> Result<f64, TrialError> {
        // A thread that died while holding the lock left whole entries behind.
        let lock = || self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(known) = lock().get(&key) {
            return known.clone();
        }
        let found = work();
        lock().insert(key, found.clone());
        found
    }
}

/// One trial that is to be run.
#[derive(Debug, Clone, Copy)]
pub struct Trial<'a> {
    /// Its scenario.
    pub scenario: &'a Scenario,
    /// Its seed.
    pub seed: u64,
    /// How large the effect is to be, see [`SizedBy`]; `None` without effect.
    pub level: Option<f64>,
}

/// Everything about a trial before its effect has a size.
struct Prepared<'a> {
    scenario: &'a Scenario,
    config: SimulationConfig,
    machine: Machine,
    /// Distinguishes trials whose errors without effect differ.
    key: String,
}

/// A campaign with its effects and the error that it leaves without a word for them.
struct Staged {
    texts: Vec<String>,
    config: SimulationConfig,
    clean_m: f64,
    before_m: f64,
}

/// Runs one trial. What goes wrong with it is part of the record, not an error of the bench.
pub fn run(trial: &Trial, memory: &Memory, diagnoser: &dyn Diagnoser, table: &[Accepted]) -> Record {
    let outcome = Prepared::new(trial)
        .and_then(|prepared| prepared.stage(trial.level, memory).map(|staged| (prepared, staged)))
        .and_then(|(prepared, staged)| prepared.diagnose(&staged, diagnoser, table));
    Record {
        scenario: trial.scenario.name.clone(),
        family: trial.scenario.family.name().to_owned(),
        seed: trial.seed,
        level: trial.level,
        outcome: outcome.map_err(|problem| problem.to_string()),
    }
}

impl Prepared<'_> {
    fn new<'a>(trial: &Trial<'a>) -> Result<Prepared<'a>, TrialError> {
        let scenario = trial.scenario;
        let config = scenario.clean_config(trial.seed)?;
        let repeatability_m = declared_instrument().repeatability_m;
        let machine = describe(&config.machine, scenario.kind, scenario.held_zero, repeatability_m)?;
        let key = format!(
            "{} {:?} {:?} {:?} {:?} {:?} {} {:?} {:?}",
            trial.seed,
            scenario.machine,
            scenario.plan,
            scenario.roughness,
            scenario.kind,
            scenario.order,
            scenario.noise,
            scenario.outliers,
            scenario.correlated
        );
        Ok(Prepared { scenario, config, machine, key })
    }

    /// Gives the effects their sizes.
    fn stage(&self, level: Option<f64>, memory: &Memory) -> Result<Staged, TrialError> {
        let clean_m = memory.get(self.key.clone(), || self.left_m(&self.config))?;
        let Some(level) = level else {
            return Ok(Staged { texts: Vec::new(), config: self.config.clone(), clean_m, before_m: clean_m });
        };
        let templates = self.scenario.injected.iter();
        let sized: Result<Vec<(f64, Option<f64>)>, TrialError> =
            templates.map(|template| self.size(template, level, clean_m, memory)).collect();
        let sized = sized?;
        let sizes: Vec<f64> = sized.iter().map(|(size, _)| *size).collect();
        let texts = self.scenario.texts(&self.config, &sizes)?;
        let config = with_effects(&self.config, &texts)?;
        // The search for the size of a single effect ended with this very campaign.
        let before_m = match sized.as_slice() {
            [(_, Some(rms_m))] => *rms_m,
            _ => self.left_m(&config)?,
        };
        Ok(Staged { texts, config, clean_m, before_m })
    }

    /// Size of an effect, and the verification error (m) with it alone, where that is known.
    fn size(
        &self,
        template: &str,
        level: f64,
        clean_m: f64,
        memory: &Memory,
    ) -> Result<(f64, Option<f64>), TrialError> {
        if self.scenario.sized_by == SizedBy::Size {
            return Ok((level, None));
        }
        let mut evaluate = |size| self.left_with_m(template, size);
        let key = format!("{} {template}", self.key);
        let per_size = memory.get(key, || sizing::gauge(clean_m, &mut evaluate))?;
        match self.scenario.injected.len() {
            1 => {
                let found = sizing::find(level, clean_m, per_size, &mut evaluate)?;
                Ok((found.size, Some(found.rms_m)))
            }
            // Each of several effects would reach the factor alone, by proportion.
            _ => Ok(((level * level - 1.0).sqrt() / per_size, None)),
        }
    }

    fn left_with_m(&self, template: &str, size: f64) -> Result<f64, TrialError> {
        let text = choices(&self.config).fill(template, size)?;
        self.left_m(&with_effects(&self.config, &[text])?)
    }

    /// Verification error (m) of the best rigid fit.
    fn left_m(&self, config: &SimulationConfig) -> Result<f64, TrialError> {
        let simulated = simulate_campaign(config)?;
        let options = IdentifyOptions { order: self.scenario.order, ..IdentifyOptions::default() };
        let range = declared_instrument().range;
        let found = identify(&self.machine, range, &simulated.campaign, &options, &mut |_| true)?;
        Ok(verified(&found.model, &points(config, 0)?)?.rms_m)
    }

    fn diagnose(&self, staged: &Staged, diagnoser: &dyn Diagnoser, table: &[Accepted]) -> Result<Outcome, TrialError> {
        let campaign = simulate_campaign(&staged.config)?.campaign;
        let range = declared_instrument().range;
        let verdict = diagnoser.diagnose(&self.machine, range, &campaign, self.scenario.order)?;
        let after = verified(&verdict.model, &points(&staged.config, history(&verdict.model))?)?;
        Ok(Outcome {
            injected: staged.texts.clone(),
            clean_m: staged.clean_m,
            before_m: staged.before_m,
            after_m: after.rms_m,
            covered: after.covered,
            consistent_with_noise: verdict.consistent_with_noise,
            attribution: attribute(&verdict.findings, &with_line_names(&staged.texts, &campaign), table),
            found: verdict.findings.iter().map(|finding| finding.detail.clone()).collect(),
            not_identifiable: verdict.not_identifiable,
            steps: verdict.steps,
            chi2_per_dof: verdict.chi2_per_dof,
        })
    }
}

/// Texts with the lines that they count replaced by those lines' names, as a diagnosis knows them.
fn with_line_names(texts: &[String], campaign: &Campaign) -> Vec<String> {
    let part = |part: &str| {
        let index = part.strip_prefix("line=").and_then(|number| number.parse::<usize>().ok());
        match index.and_then(|index| campaign.lines.get(index)) {
            Some(name) => format!("line={name}"),
            None => part.to_owned(),
        }
    };
    texts.iter().map(|text| text.split_whitespace().map(part).collect::<Vec<_>>().join(" ")).collect()
}

fn points(config: &SimulationConfig, before: usize) -> Result<Vec<VerificationPoint>, TrialError> {
    Ok(verification_points(config, before + POINTS, config.seed + POINTS_SEED)?)
}
