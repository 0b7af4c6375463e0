//! All methods on the same split of the same data, by seed.
//!
//! Place in the flow: measured residuals in, one table out: figures (µm) on points that no method saw, by seed with intervals,
//! and the recommendation. 7:2:1 as in Liang 2025: seven parts teach, two say when to stop, one judges; parts are blocks of
//! space unless asked otherwise. Interpolating methods have the points of all nine parts, as has the network's lattice.
//! The clock is the caller's (s): models know no time.

use crate::attention::Attention;
use crate::belief;
use crate::config::{Config, Split};
use crate::device::Device;
use crate::networks::Networks;
use crate::optimise::{Examples, Network, Training, outputs};
use crate::perceptron::Perceptron;
use crate::recommend::{Candidate, Recommendation, recommend};
use crate::scores::Scores;
use crate::split;
use crate::swarm::Swarm;
use crate::train::{Go, TrainingError, ZERO, fitted_kriging, seed_of};
use crate::views::{Material, Positions, ViewError, normaliser};
use abbe_field::idw::{EXPONENT, Reference};
use abbe_field::{Idw, Interpolator, MeasuredField, Trilinear};
use abbe_residual_net::network::{Normaliser, Parameters};
use abbe_residual_net::{Calibration, Ensemble, Kind, Kriging, PositionEnsemble, check_units, place, place_box_m};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Parts of the split: 7:2:1.
const PARTS: usize = 10;
/// Parts that say when to stop; part 0 judges.
const STOPPING: [usize; 2] = [1, 2];
/// Width of the plain network on the position.
const WIDTH: usize = 64;

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
    pub fn kind(self) -> Option<Kind> {
        match self {
            Rival::Kriging => Some(Kind::Kriging),
            Rival::Network => Some(Kind::Network),
            Rival::KrigingNetwork => Some(Kind::KrigingNetwork),
            Rival::PerceptronKriging => Some(Kind::PerceptronKriging),
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
    /// Whether the split flatters.
    pub flattering: bool,
    /// One row a method.
    pub rows: Vec<RivalRow>,
    /// What the errors on all judging parts recommend, among methods that answered everywhere.
    pub recommendation: Option<Recommendation>,
    /// Whether all seeds were run.
    pub complete: bool,
}

/// Compares. `clock` gives seconds since any instant; `observe` is told after each method of each seed (done, of all).
///
/// # Errors
/// Points that make no field, a configuration that does not hold, a training that fails.
pub fn compare(
    field: &MeasuredField,
    config: &CompareConfig,
    clock: &dyn Fn() -> f64,
    observe: &mut dyn FnMut(usize, usize) -> Go,
) -> Result<Comparison, TrainingError> {
    compare_measured(field, [true; 3], config, clock, observe)
}

/// The same where only these components were measured: what a field holds of the others counts for nothing.
///
/// # Errors
/// As [`compare`].
pub fn compare_measured(
    field: &MeasuredField,
    measured: [bool; 3],
    config: &CompareConfig,
    clock: &dyn Fn() -> f64,
    observe: &mut dyn FnMut(usize, usize) -> Go,
) -> Result<Comparison, TrainingError> {
    config.training.check()?;
    check_units(field)?;
    let mut runs: Vec<Vec<Result<Judged, String>>> = vec![Vec::new(); config.rivals.len()];
    let mut blocks: Vec<usize> = Vec::new();
    let all = config.seeds * config.rivals.len();
    let mut complete = true;
    for number in 0..config.seeds {
        let trial = Trial { measured, ..Trial::new(field, config, number, clock)? };
        for (runs, rival) in runs.iter_mut().zip(&config.rivals) {
            runs.push(trial.judge(*rival)?);
        }
        let block = split::blocks(field.points_m(), &config.training.split);
        blocks.extend(trial.judging.iter().map(|k| number * (block.len() + 1) + block[*k]));
        let done = (number + 1) * config.rivals.len();
        if observe(done, all) == Go::Stop && done < all {
            complete = false;
            break;
        }
    }
    Ok(Comparison {
        config: config.clone(),
        points: field.points_m().len(),
        flattering: config.training.split.is_flattering(),
        rows: config.rivals.iter().zip(&runs).map(|(rival, runs)| row(*rival, runs)).collect(),
        recommendation: recommend(&candidates(config, &runs), &blocks),
        complete,
    })
}

/// Errors of the methods that answered everywhere.
fn candidates(config: &CompareConfig, runs: &[Vec<Result<Judged, String>>]) -> Vec<Candidate> {
    let one = |(rival, runs): (&Rival, &Vec<Result<Judged, String>>)| {
        let errors: Option<Vec<_>> = runs.iter().map(|run| run.as_ref().ok().map(|j| j.errors_m.clone())).collect();
        Some(Candidate { method: rival.name().to_owned(), errors_m: errors?.concat() })
    };
    config.rivals.iter().zip(runs).filter_map(one).collect()
}

fn row(rival: Rival, runs: &[Result<Judged, String>]) -> RivalRow {
    let seeds: Vec<SeedRow> = runs.iter().flatten().filter_map(Judged::row).collect();
    let of = |pick: &dyn Fn(&SeedRow) -> f64| Interval::of(&seeds.iter().map(pick).collect::<Vec<_>>());
    RivalRow {
        rival,
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

/// One split.
struct Trial<'a> {
    field: &'a MeasuredField,
    measured: [bool; 3],
    config: &'a Config,
    seed: u64,
    teaching: Vec<usize>,
    stopping: Vec<usize>,
    judging: Vec<usize>,
    /// Everything but what judges.
    known: MeasuredField,
    normaliser: Normaliser,
    /// Kriging of what is known, and the time its fit took (s).
    kriging: Kriging,
    kriging_s: f64,
    clock: &'a dyn Fn() -> f64,
}

type Predictor = Box<dyn Fn(&Vector3<f64>) -> Result<Vector3<f64>, String>>;

impl<'a> Trial<'a> {
    fn new(
        field: &'a MeasuredField,
        config: &'a CompareConfig,
        number: usize,
        clock: &'a dyn Fn() -> f64,
    ) -> Result<Trial<'a>, TrainingError> {
        let config = &config.training;
        let seed = seed_of(config.seed, number);
        let parts = Split { folds: PARTS, ..config.split };
        let fold = split::folds(field.points_m(), &parts, seed);
        let of = |wanted: &dyn Fn(usize) -> bool| (0..fold.len()).filter(|k| wanted(fold[*k])).collect::<Vec<_>>();
        let (judging, stopping) = (of(&|f| f == 0), of(&|f| STOPPING.contains(&f)));
        let teaching = of(&|f| f != 0 && !STOPPING.contains(&f));
        let known = field.part(&of(&|f| f != 0)).map_err(ViewError::from)?;
        let normaliser = normaliser(known.points_m(), known.errors_m());
        let start = clock();
        let kriging = fitted_kriging(&known)?;
        let kriging_s = clock() - start;
        let measured = [true; 3];
        Ok(Trial {
            field,
            measured,
            config,
            seed,
            teaching,
            stopping,
            judging,
            known,
            normaliser,
            kriging,
            kriging_s,
            clock,
        })
    }

    fn judge(&self, rival: Rival) -> Result<Result<Judged, String>, TrainingError> {
        let start = (self.clock)();
        let predictor = match self.predictor(rival)? {
            Ok(predictor) => predictor,
            Err(reason) => return Ok(Err(reason)),
        };
        let trained = (self.clock)();
        let predicted: Result<Vec<_>, String> =
            self.judging.iter().map(|k| predictor(&self.field.points_m()[*k])).collect();
        let end = (self.clock)();
        let shared_s = if rival.kind().is_some_and(|kind| kind != Kind::Network) { self.kriging_s } else { 0.0 };
        let error = |(k, p): (&usize, Vector3<f64>)| {
            let missed: Vector3<f64> = p - self.field.errors_m()[*k];
            Vector3::from_fn(|d, _| if self.measured[d] { missed[d] } else { 0.0 })
        };
        Ok(predicted.map(|predicted| Judged {
            seed: self.seed,
            components: self.measured.iter().filter(|is_measured| **is_measured).count(),
            errors_m: self.judging.iter().zip(predicted).map(error).collect(),
            training_s: trained - start + shared_s,
            prediction_s: (end - trained) / self.judging.len() as f64,
        }))
    }

    fn predictor(&self, rival: Rival) -> Result<Result<Predictor, String>, TrainingError> {
        let interpolator = |made: Result<Box<dyn Interpolator>, String>| {
            made.map(|field| -> Predictor {
                Box::new(move |p| field.at(p).map(|found| found.error_m).map_err(|reason| reason.to_string()))
            })
        };
        Ok(match rival {
            Rival::Zero => Ok(Box::new(|_| Ok(Vector3::zeros()))),
            Rival::Trilinear => interpolator(Ok(Box::new(Trilinear::new(&self.known)))),
            Rival::Idw => {
                let made = Idw::new(&self.known, Reference::Hexahedron, EXPONENT);
                interpolator(made.map(|f| -> Box<dyn Interpolator> { Box::new(f) }).map_err(|e| e.to_string()))
            }
            Rival::Perceptron => Ok(self.on_position(Perceptron::plain(WIDTH))?),
            Rival::ResidualPerceptron => Ok(self.on_position(Perceptron::residual(&self.config.perceptron))?),
            Rival::Belief => {
                Ok(self.on_position(belief::pretrained(&self.positions().view(&self.teaching).inputs, self.seed))?)
            }
            Rival::Swarm => Ok(self.swarm()),
            Rival::Kriging => Ok(self.model(Kind::Kriging)?),
            Rival::Network => Ok(self.model(Kind::Network)?),
            Rival::KrigingNetwork => Ok(self.model(Kind::KrigingNetwork)?),
            Rival::PerceptronKriging => Ok(self.model(Kind::PerceptronKriging)?),
        })
    }

    fn positions(&self) -> Positions<'_> {
        Positions::new(self.field, &self.known, &self.normaliser)
    }

    fn position_examples(&self) -> Examples {
        self.positions().examples(&self.teaching, &self.stopping)
    }

    fn on_position(&self, network: Perceptron) -> Result<Predictor, TrainingError> {
        let best = self.trained(&network, &self.position_examples(), "perceptron")?;
        let ((low_m, high_m), normaliser) = (place_box_m(self.known.points_m()), self.normaliser);
        Ok(Box::new(move |p| {
            let at = place(p, &low_m, &high_m);
            let output = outputs(&network, &best, &at, &Device::cpu()).map_err(|e| e.to_string())?;
            Ok(normaliser.restore(&Vector3::from_fn(|k, _| f64::from(output[k]))))
        }))
    }

    fn swarm(&self) -> Predictor {
        let swarm = Swarm::train(&self.position_examples(), self.seed);
        let ((low_m, high_m), normaliser) = (place_box_m(self.known.points_m()), self.normaliser);
        Box::new(move |p| Ok(normaliser.restore(&Vector3::from(swarm.output(&place(p, &low_m, &high_m))))))
    }

    fn trained<N: Network>(
        &self,
        network: &N,
        examples: &Examples,
        kind: &'static str,
    ) -> Result<Vec<f32>, TrainingError> {
        let failed = |source| TrainingError::Member { kind, member: 0, source };
        let optimiser = &self.config.optimiser;
        let training = Training::new(network, examples, optimiser, self.seed, &Device::cpu()).map_err(failed)?;
        let mut run = training.start().map_err(failed)?;
        while !run.is_over(optimiser) {
            training.epoch(&mut run).map_err(failed)?;
        }
        Ok(run.best)
    }

    /// A model as it runs live, with a single network.
    fn model(&self, kind: Kind) -> Result<Predictor, TrainingError> {
        let networks = match kind {
            Kind::Kriging => Networks::None,
            Kind::Network | Kind::KrigingNetwork => Networks::Neighbourhood(self.ensemble(kind, &self.kriging)?),
            Kind::PerceptronKriging => Networks::Position(self.trend()?),
        };
        let model = networks.model(kind, &self.known, &self.kriging, Calibration::none())?;
        Ok(Box::new(move |p| Ok(model.predict(p).residual_m)))
    }

    fn trend(&self) -> Result<PositionEnsemble, TrainingError> {
        let config = self.config.perceptron;
        let best = self.trained(&Perceptron::residual(&config), &self.position_examples(), "perceptron-kriging")?;
        Ok(self.positions().ensemble(config, vec![best]))
    }

    fn ensemble(&self, kind: Kind, kriging: &Kriging) -> Result<Ensemble, TrainingError> {
        let config = self.config.network;
        let mut normaliser = self.normaliser;
        let material = |normaliser| Material {
            kind,
            field: self.field,
            kriging,
            config: &self.config.network,
            normaliser,
            split: &self.config.split,
        };
        if kind == Kind::KrigingNetwork {
            let known: Vec<usize> = self.teaching.iter().chain(&self.stopping).copied().collect();
            let left = material(&self.normaliser).left_by_kriging(&known, self.seed)?;
            normaliser = crate::views::normaliser(self.known.points_m(), &left);
        }
        let examples = material(&normaliser).examples(&self.teaching, &self.stopping, self.seed)?;
        let starts_at_zero = kind == Kind::KrigingNetwork;
        let best = self.trained(&Attention { config, starts_at_zero }, &examples, kind.name())?;
        Ok(Ensemble { config, normaliser, members: vec![Parameters::new(&config, best)?] })
    }
}

#[cfg(test)]
mod tests;
