//! All methods on the same split of the same data, by seed.
//!
//! Place in the flow: measured residuals in, one table out: figures (µm) on points that no method saw, by seed with intervals,
//! and the recommendation. Where there are inputs beside the position, all methods have the position alone, and those that become
//! models have all inputs as well, on the same split: whether these help is judged by nothing else. 7:2:1 as in Liang 2025: seven parts teach, two say when to stop, one judges; parts are blocks of
//! space unless asked otherwise. Interpolating methods have the points of all nine parts, as has the network's lattice.
//! The clock is the caller's (s): models know no time.

use crate::config::{Config, Split};
use crate::error::TrainingError;
use crate::recommend::{Candidate, Recommendation, ZERO, named, recommend};
use crate::scores::Scores;
use crate::split;
use crate::train::{Go, seed_of};
use crate::views::ViewError;
use abbe_field::{FieldError, Samples};
use abbe_residual_net::network::MOST_NEIGHBOURED;
use abbe_residual_net::{ResidualMethod, check_units};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};
use trial::Trial;

mod trial;

/// Parts of the split: 7:2:1.
const PARTS: usize = 10;
/// A method of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rival {
    /// No residual at all.
    Zero,
    /// Trilinear in the hexahedron of measured points; not defined for scattered ones.
    Trilinear,
    /// Inverse squared distances over the hexahedron.
    Idw,
    /// Kriging with fitted length scales.
    Kriging,
    /// Network on the position, two hidden layers.
    Perceptron,
    /// Network on the position with residual blocks.
    ResidualPerceptron,
    /// Network on the position found by a genetic particle swarm.
    Swarm,
    /// Network on the position pretrained by Boltzmann machines.
    Belief,
    /// The neighbourhood attention network.
    Network,
    /// The same on what kriging leaves.
    KrigingNetwork,
    /// Residual blocks on the position, and kriging of what they leave.
    PerceptronKriging,
}

impl Rival {
    /// All of them, the simplest first.
    pub const ALL: [Rival; 11] = [
        Rival::Zero,
        Rival::Trilinear,
        Rival::Idw,
        Rival::Kriging,
        Rival::Perceptron,
        Rival::ResidualPerceptron,
        Rival::Swarm,
        Rival::Belief,
        Rival::Network,
        Rival::KrigingNetwork,
        Rival::PerceptronKriging,
    ];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Rival::Zero => ZERO,
            Rival::Trilinear => "trilinear",
            Rival::Idw => "idw",
            Rival::Kriging => "kriging",
            Rival::Perceptron => "perceptron",
            Rival::ResidualPerceptron => "residual-perceptron",
            Rival::Swarm => "genetic-swarm",
            Rival::Belief => "deep-belief",
            Rival::Network => "network",
            Rival::KrigingNetwork => "kriging-network",
            Rival::PerceptronKriging => "perceptron-kriging",
        }
    }

    /// MSE (µm²) and MAE (µm) that Liang 2025 table 1 publishes for such a method, on data that are not published.
    pub fn published(self) -> Option<(f64, f64)> {
        match self {
            Rival::Network => Some((0.3249, 0.4104)),
            Rival::Swarm => Some((5.3211, 2.1594)),
            Rival::ResidualPerceptron => Some((3.3465, 1.9465)),
            Rival::Belief => Some((2.8926, 1.7836)),
            _ => None,
        }
    }

    /// The kind of model that `train` makes of it, if it is one.
    pub fn kind(self) -> Option<ResidualMethod> {
        match self {
            Rival::Kriging => Some(ResidualMethod::Kriging),
            Rival::Network => Some(ResidualMethod::Network),
            Rival::KrigingNetwork => Some(ResidualMethod::KrigingNetwork),
            Rival::PerceptronKriging => Some(ResidualMethod::PerceptronKriging),
            _ => None,
        }
    }
}

/// What is compared, and how often.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CompareConfig {
    /// Seed, network, optimiser and kind of split; of the split, the number of folds is always ten here.
    pub training: Config,
    /// Splits and trainings, each with a seed of its own.
    pub seeds: usize,
    /// Methods.
    pub rivals: Vec<Rival>,
}

impl Default for CompareConfig {
    fn default() -> CompareConfig {
        CompareConfig { training: Config::default(), seeds: 5, rivals: Rival::ALL.to_vec() }
    }
}

/// Mean over the seeds, and the 95 % interval of that mean (Student's t; none of a single seed).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interval {
    /// Mean.
    pub mean: f64,
    /// Lower end.
    pub low: Option<f64>,
    /// Upper end.
    pub high: Option<f64>,
}

impl Interval {
    /// Of some values; `None` without any.
    pub fn of(values: &[f64]) -> Option<Interval> {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let quantile = StudentsT::new(0.0, 1.0, count - 1.0).ok().map(|t| t.inverse_cdf(0.975));
        let half = quantile.map(|q| q * (variance / count).sqrt());
        (!values.is_empty()).then_some(Interval { mean, low: half.map(|h| mean - h), high: half.map(|h| mean + h) })
    }
}

/// One method on one split.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeedRow {
    /// Seed.
    pub seed: u64,
    /// Its figures.
    pub scores: Scores,
    /// Time to train or fit (s).
    pub training_s: f64,
    /// Time of one prediction, mean over the judging points (s).
    pub prediction_s: f64,
}

/// One method on all splits. A method that has no answer at some point has no row for that seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RivalRow {
    /// Method.
    pub rival: Rival,
    /// Whether it had the position alone, where others had further inputs.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub position_alone: bool,
    /// By seed.
    pub seeds: Vec<SeedRow>,
    /// Mean squared component (µm²).
    pub mse_um2: Option<Interval>,
    /// Mean absolute component (µm).
    pub mae_um: Option<Interval>,
    /// Error that 95 % stay below (µm).
    pub error_95_um: Option<Interval>,
    /// Worst error (µm).
    pub worst_um: Option<Interval>,
    /// Time to train (s).
    pub training_s: Option<Interval>,
    /// Time of a prediction (s).
    pub prediction_s: Option<Interval>,
    /// Why there are no figures for some seed.
    pub missing: Option<String>,
}

/// The table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// Configuration.
    pub config: CompareConfig,
    /// Points.
    pub points: usize,
    /// Names of the inputs, where these are not the position alone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<String>,
    /// Whether the split flatters.
    pub flattering: bool,
    /// One row a method.
    pub rows: Vec<RivalRow>,
    /// What the errors on all judging parts recommend, among methods that answered everywhere.
    pub recommendation: Option<Recommendation>,
    /// Whether all seeds were run.
    pub complete: bool,
}

impl RivalRow {
    /// Name in tables.
    pub fn name(&self) -> String {
        named(self.rival.name(), self.position_alone)
    }
}

/// What is compared: the same points by their position, by other inputs, or by both.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// By the position alone; none where it is not known.
    pub alone: Option<&'a Samples>,
    /// By all inputs, where these are not the position alone.
    pub inputs: Option<&'a Samples>,
    /// Components that were measured: what a field holds of the others counts for nothing.
    pub measured: [bool; 3],
}

impl<'a> Subject<'a> {
    /// Points that are known by their position.
    pub fn position(alone: &'a Samples) -> Subject<'a> {
        Subject { alone: Some(alone), inputs: None, measured: [true; 3] }
    }

    /// What the split is made of.
    fn whole(&self) -> Option<&'a Samples> {
        self.inputs.or(self.alone)
    }

    /// Methods by what they have, the plainest first.
    fn contestants(&self, config: &CompareConfig) -> Vec<Contestant<'a>> {
        let mut all = Vec::new();
        let position_alone = self.inputs.is_some();
        if let Some(samples) = self.alone {
            let one = |rival: &Rival| Contestant {
                rival: *rival,
                samples,
                position_alone: position_alone && *rival != Rival::Zero,
            };
            all.extend(config.rivals.iter().map(one));
        }
        if let Some(samples) = self.inputs {
            let takes = |kind: ResidualMethod| !kind.has_attention() || samples.size() <= MOST_NEIGHBOURED;
            let zero = self.alone.is_none();
            let fits = |rival: &&Rival| rival.kind().is_some_and(takes) || zero && **rival == Rival::Zero;
            let one = |rival: &Rival| Contestant { rival: *rival, samples, position_alone: false };
            all.extend(config.rivals.iter().filter(fits).map(one));
        }
        all
    }
}

/// A method with what it has of the points.
#[derive(Debug, Clone, Copy)]
struct Contestant<'a> {
    rival: Rival,
    samples: &'a Samples,
    position_alone: bool,
}

/// Compares. `clock` gives seconds since any instant; `observe` is told after each method of each seed (done, of all).
///
/// # Errors
/// Points that make no field, a configuration that does not hold, a training that fails.
pub fn compare(
    subject: &Subject,
    config: &CompareConfig,
    clock: &dyn Fn() -> f64,
    observe: &mut dyn FnMut(usize, usize) -> Go,
) -> Result<Comparison, TrainingError> {
    config.training.check()?;
    let whole = subject.whole().ok_or(ViewError::from(FieldError::TooFew(0)))?;
    check_units(whole)?;
    let contestants = subject.contestants(config);
    let mut runs: Vec<Vec<Result<Judged, String>>> = vec![Vec::new(); contestants.len()];
    let mut blocks: Vec<usize> = Vec::new();
    let all = config.seeds * contestants.len();
    let mut complete = true;
    let block = split::blocks(&whole.places(), &config.training.split);
    for number in 0..config.seeds {
        let seed = seed_of(config.training.seed, number);
        let fold = split::folds(&whole.places(), &Split { folds: PARTS, ..config.training.split }, seed);
        let trial = |samples| Trial::new(samples, &fold, subject.measured, &config.training, seed, clock);
        let alone = subject.alone.map(trial).transpose()?;
        let inputs = subject.inputs.map(trial).transpose()?;
        for (runs, contestant) in runs.iter_mut().zip(&contestants) {
            let has_inputs = subject.inputs.is_some_and(|samples| std::ptr::eq(samples, contestant.samples));
            let trial = if has_inputs { &inputs } else { &alone };
            let judged = trial.as_ref().map(|trial| trial.judge(contestant.rival)).transpose()?;
            runs.extend(judged);
        }
        blocks.extend((0..fold.len()).filter(|k| fold[*k] == 0).map(|k| number * (block.len() + 1) + block[k]));
        let done = (number + 1) * contestants.len();
        if observe(done, all) == Go::Stop && done < all {
            complete = false;
            break;
        }
    }
    Ok(Comparison {
        config: config.clone(),
        points: whole.count(),
        inputs: subject.inputs.map_or(Vec::new(), |samples| samples.names().to_vec()),
        flattering: config.training.split.is_flattering(),
        rows: contestants.iter().zip(&runs).map(|(contestant, runs)| row(contestant, runs)).collect(),
        recommendation: recommend(&candidates(&contestants, &runs), &blocks),
        complete,
    })
}

/// Errors of the methods that answered everywhere.
fn candidates(contestants: &[Contestant], runs: &[Vec<Result<Judged, String>>]) -> Vec<Candidate> {
    let one = |(contestant, runs): (&Contestant, &Vec<Result<Judged, String>>)| {
        let errors: Option<Vec<_>> = runs.iter().map(|run| run.as_ref().ok().map(|j| j.errors_m.clone())).collect();
        let Contestant { rival, position_alone, .. } = *contestant;
        let is_plainer = position_alone || rival == Rival::Zero;
        Some(Candidate { method: named(rival.name(), position_alone), is_plainer, errors_m: errors?.concat() })
    };
    contestants.iter().zip(runs).filter_map(one).collect()
}

fn row(contestant: &Contestant, runs: &[Result<Judged, String>]) -> RivalRow {
    let seeds: Vec<SeedRow> = runs.iter().flatten().filter_map(Judged::row).collect();
    let of = |pick: &dyn Fn(&SeedRow) -> f64| Interval::of(&seeds.iter().map(pick).collect::<Vec<_>>());
    RivalRow {
        rival: contestant.rival,
        position_alone: contestant.position_alone,
        mse_um2: of(&|s| s.scores.mse_um2),
        mae_um: of(&|s| s.scores.mae_um),
        error_95_um: of(&|s| s.scores.error_95_um),
        worst_um: of(&|s| s.scores.worst_um),
        training_s: of(&|s| s.training_s),
        prediction_s: of(&|s| s.prediction_s),
        missing: runs.iter().find_map(|run| run.as_ref().err().cloned()),
        seeds,
    }
}

/// Errors of one method on one split.
#[derive(Debug, Clone)]
struct Judged {
    seed: u64,
    /// Components that were measured.
    components: usize,
    errors_m: Vec<Vector3<f64>>,
    training_s: f64,
    prediction_s: f64,
}

impl Judged {
    fn row(&self) -> Option<SeedRow> {
        let Judged { seed, training_s, prediction_s, .. } = *self;
        let scores = Scores::of_components(&self.errors_m, self.components)?;
        Some(SeedRow { seed, scores, training_s, prediction_s })
    }
}

#[cfg(test)]
mod tests;
