//! One training: measured residuals in, a model with calibrated uncertainty and the evidence for it out.
//!
//! Place in the flow: called by the command that trains; what comes out is what runs live. Points by their inputs (the position in m
//! in the machine frame, anything else in the unit of its name), residual = actual − corrected so far (m).
//!
//! 1. Kriging: length scales, signal and noise by restricted likelihood, for two kernels; the likelier is kept.
//! 2. The points are dealt into folds, by default of blocks of space. Of each kind of network, member k learns from all folds
//!    but k and k + 1; fold k + 1 says when to stop, and fold k is not seen.
//! 3. Each method predicts each fold from the points of the others (a network: member k predicts fold k). These errors
//!    decide which method is recommended, and scale its deviations so that 95 % intervals hold 95 %.
//! 4. The model: all points as the lattice, all members as an ensemble; over a trend kriging is fitted anew to what all of them
//!    leave.
//!
//! A fold's kriging is fitted anew without it; only the kernel, how much of the declared uncertainties is seen as scatter, and the
//! units of the network (mean and deviation of the residuals, scales of the inputs) come from all points. Where there are further
//! inputs, kriging on the position alone is held out as well, on the same folds: it is what they must be worth more than.

use crate::config::{Config, Method, Split};
use crate::device::Device;
use crate::error::{LEAST_POINTS, TrainingError};
use crate::held_out::{self, HeldOutPoint, Predicted};
use crate::kriging::{fitted_kriging, fitted_without};
use crate::networks::{Networks, input_scale};
use crate::optimise::Run;
use crate::recommend::{Recommendation, ZERO, recommend};
use crate::scores::Scores;
use crate::split;
use abbe_field::Samples;
use abbe_residual_net::network::MOST_NEIGHBOURED;
use abbe_residual_net::{Calibration, Kriging, ModelError, ResidualMethod, ResidualModel, check_units};
use remedy::Dealt;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use task::Task;

mod remedy;
mod task;

/// Points that kriging, or a member of networks, learns from at least; of a member's, a quarter leaves the lattice at a time.
const LEAST_LEARNT: usize = 8;
const LEAST_LEARNT_BY_MEMBERS: usize = 16;

/// Whether to go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Go {
    /// On.
    On,
    /// Stop here and keep the best so far.
    Stop,
}

/// How far a training is; told after each epoch.
#[derive(Debug)]
pub struct Progress<'a> {
    /// Method in training.
    pub kind: ResidualMethod,
    /// Member, from 0, counted over all kinds.
    pub member: usize,
    /// Members of all kinds.
    pub members: usize,
    /// Epoch of the member, from 0.
    pub epoch: usize,
    /// Epochs at most.
    pub epochs: usize,
    /// Mean squared error of the epoch, in units of the network squared.
    pub training_loss: f64,
    /// The same on the validation fold.
    pub validation_loss: f64,
    /// Best validation loss of the member so far.
    pub best_validation_loss: f64,
    /// What a later call needs to go on from here.
    pub state: &'a State,
}

/// A stopped training: plain numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Configuration it was started with.
    pub config: Config,
    /// Fingerprint of the data.
    pub data: u64,
    /// Name of what it was trained on.
    pub device: String,
    /// Members begun, in order; all but the last are done.
    pub runs: Vec<Run>,
}

/// Loss curves of one member.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Curve {
    /// Method that has networks.
    pub kind: String,
    /// Member of the kind, which is also the fold that it does not see.
    pub member: usize,
    /// Training loss of each epoch, in units of the network squared.
    pub training_loss: Vec<f64>,
    /// Validation loss before the first epoch and after each.
    pub validation_loss: Vec<f64>,
    /// Epochs after which the parameters were found that were kept.
    pub best_epoch: usize,
}

/// Figures of a method on held-out folds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldOutScores {
    /// Method.
    pub method: String,
    /// Points that were held out and predicted.
    pub points: usize,
    /// Its figures.
    pub scores: Scores,
    /// Share of components within their 95 % interval, each fold with the factors found on the others; none for "zero".
    pub coverage_95: Option<f64>,
}

/// How a model came about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingRecord {
    /// Configuration, with seed and split.
    pub config: Config,
    /// What the networks were trained on.
    pub device: String,
    /// Points learnt from.
    pub points: usize,
    /// Names of the inputs, where these are not the position alone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<String>,
    /// Whether the split flatters: single points instead of blocks.
    pub flattering: bool,
    /// Kernel of kriging.
    pub kernel: String,
    /// Share of the declared uncertainties that the residuals scatter by, x y z; none where nothing is declared. What is not seen is
    /// taken as common to neighbours, and stays in the uncertainty of every prediction.
    pub declared_seen: Option<[f64; 3]>,
    /// Standard deviation of what neighbours do not share beyond that (µm), x y z; in the uncertainty of every prediction as well.
    pub unshared_um: [f64; 3],
    /// Loss curves.
    pub curves: Vec<Curve>,
    /// Figures on held-out folds.
    pub held_out: Vec<HeldOutScores>,
    /// What they recommend.
    pub recommendation: Recommendation,
    /// Method of the model that was made.
    pub kind: String,
    /// Whether all members were trained to their end.
    pub complete: bool,
}

/// What a training gives.
#[derive(Debug, Clone)]
pub struct Trained {
    /// The model.
    pub model: ResidualModel,
    /// The evidence.
    pub record: TrainingRecord,
    /// To go on from, if it was stopped.
    pub state: State,
    /// Each held-out point as the method of the model predicted it; points of folds that a stopped training did not reach
    /// are left out.
    pub held_out: Vec<HeldOutPoint>,
}

/// Trains on all inputs of the samples. `resume` is the state of a stopped training of the same data and configuration on the same device; on the
/// processor the result is the same, bit for bit, as without the stop. `observe` is told after each epoch and says whether to
/// go on.
pub fn train(
    field: &Samples,
    config: &Config,
    device: &Device,
    resume: Option<State>,
    observe: &mut dyn FnMut(&Progress) -> Go,
) -> Result<Trained, TrainingError> {
    train_beside(field, None, config, device, resume, observe)
}

/// The same, judged against kriging on the position alone: `alone` are the same points by nothing but their position.
///
/// # Errors
/// As [`train`].
pub fn train_beside(
    field: &Samples,
    alone: Option<&Samples>,
    config: &Config,
    device: &Device,
    resume: Option<State>,
    observe: &mut dyn FnMut(&Progress) -> Go,
) -> Result<Trained, TrainingError> {
    config.check()?;
    check_units(field)?;
    check_inputs(field, config)?;
    let data = fingerprint(field);
    let mut state =
        resume.unwrap_or(State { config: config.clone(), data, device: device.name().to_owned(), runs: Vec::new() });
    if state.config != *config {
        return Err(TrainingError::State("configuration"));
    }
    if state.data != data {
        return Err(TrainingError::State("set of residuals"));
    }
    if state.device != device.name() {
        return Err(TrainingError::State("device"));
    }
    let fold = split::folds(&field.places(), &config.split, config.seed);
    check_folds(field, config, &fold)?;
    let kriging = fitted_kriging(field)?;
    let without: Vec<Kriging> =
        (0..config.split.folds).map(|held| fitted_without(field, &fold, held, &kriging)).collect::<Result<_, _>>()?;
    let scale = input_scale(field, &kriging);
    let (kinds, networks) = (kinds_of(field, config), networks_of(field, config));
    let mut trained: Vec<(ResidualMethod, Networks)> =
        kinds.iter().filter(|kind| !kind.has_network()).map(|kind| (*kind, Networks::None)).collect();
    let mut complete = true;
    for (number, kind) in networks.iter().enumerate() {
        let (scale, kriging, without, fold, kinds) = (&scale, &kriging, &without, &fold, networks.len());
        let task = Task { field, scale, config, device, kriging, without, fold, kind: *kind, number, kinds };
        let (networks, done) = task.networks(&mut state, observe)?;
        trained.push((*kind, networks));
        complete = done;
        if !done {
            break;
        }
    }
    let alone = alone.map(|alone| position_alone(alone, &fold, config)).transpose()?;
    finish(field, config, (&scale, &kriging, &without), &fold, (trained, alone), state, complete)
}

/// Refuses more inputs than a network that was asked for takes.
fn check_inputs(field: &Samples, config: &Config) -> Result<(), TrainingError> {
    let has_attention = config.method.kinds().iter().any(|kind| kind.has_attention());
    let too_many = has_attention && config.method != Method::Recommended && field.size() > MOST_NEIGHBOURED;
    if too_many { Err(ModelError::Neighboured(field.size()).into()) } else { Ok(()) }
}

/// The kinds that compete on these inputs: of `recommended`, those that take so many.
fn kinds_of(field: &Samples, config: &Config) -> Vec<ResidualMethod> {
    let takes = |kind: &ResidualMethod| !kind.has_attention() || field.size() <= MOST_NEIGHBOURED;
    config.method.kinds().iter().copied().filter(takes).collect()
}

fn networks_of(field: &Samples, config: &Config) -> Vec<ResidualMethod> {
    kinds_of(field, config).into_iter().filter(|kind| kind.has_network()).collect()
}

/// Kriging on the position alone, held out on folds of points that have further inputs.
fn position_alone(alone: &Samples, fold: &[usize], config: &Config) -> Result<Predicted, TrainingError> {
    let kriging = fitted_kriging(alone)?;
    let without: Vec<Kriging> =
        (0..config.split.folds).map(|held| fitted_without(alone, fold, held, &kriging)).collect::<Result<_, _>>()?;
    let scale = input_scale(alone, &kriging);
    let predicted = held_out::predict(alone, &scale, &without, fold, ResidualMethod::Kriging, &Networks::None)?;
    Ok(Predicted { position_alone: true, ..predicted })
}

/// Refuses points that cannot be held out: too few, or in so few blocks that a fold is empty or leaves next to nothing.
fn check_folds(field: &Samples, config: &Config, fold: &[usize]) -> Result<(), TrainingError> {
    if fold.len() < LEAST_POINTS {
        return Err(TrainingError::Few(fold.len()));
    }
    // A network does not see two folds: the one it predicts, and the one that stops it.
    let has_networks = !networks_of(field, config).is_empty();
    let (least, unseen) = if has_networks { (LEAST_LEARNT_BY_MEMBERS, 2) } else { (LEAST_LEARNT, 1) };
    let dealt = Dealt::of(fold, config.split.folds, unseen);
    if dealt.suffices(least) {
        return Ok(());
    }
    let occupied = split::blocks(&field.places(), &config.split).into_iter().collect::<BTreeSet<_>>().len();
    Err(TrainingError::Folds {
        points: fold.len(),
        occupied,
        folds: config.split.folds,
        learnt: dealt.learnt,
        least,
        remedy: remedy::split(&config.split, |split| {
            Dealt::of(&split::folds(&field.places(), split, config.seed), split.folds, unseen).suffices(least)
        }),
        enough: remedy::enough(config.split.folds, unseen, least).max(LEAST_POINTS),
    })
}

/// Judges, chooses, calibrates, assembles.
fn finish(
    field: &Samples,
    config: &Config,
    (scale, kriging, without): (&[f64], &Kriging, &[Kriging]),
    fold: &[usize],
    (trained, alone): (Vec<(ResidualMethod, Networks)>, Option<Predicted>),
    state: State,
    complete: bool,
) -> Result<Trained, TrainingError> {
    let one =
        |(kind, networks): &(ResidualMethod, Networks)| held_out::predict(field, scale, without, fold, *kind, networks);
    let mut predicted = trained.iter().map(one).collect::<Result<Vec<_>, _>>()?;
    predicted.splice(0..0, alone);
    let block = split::blocks(&field.places(), &config.split);
    let (recommendation, kind) = choose(field, &predicted, &block, config);
    let chosen = predicted
        .iter()
        .find(|p| p.kind == kind && !p.position_alone)
        .ok_or(TrainingError::NoCalibration(kind.name()))?;
    let calibration = Calibration::from_held_out(&chosen.pairs()).ok_or(TrainingError::NoCalibration(kind.name()))?;
    let held_out = chosen.points(field, &calibration);
    let found = trained.into_iter().find(|(k, _)| *k == kind).map_or(Networks::None, |(_, networks)| networks);
    let model = found.model(kind, field, scale, kriging, calibration)?;
    let unshared_m = model.parts().kriging.unshared_m2().map(f64::sqrt).component_mul(&calibration.scale);
    let record = TrainingRecord {
        config: config.clone(),
        device: state.device.clone(),
        points: fold.len(),
        inputs: if field.is_position_alone() { Vec::new() } else { field.names().to_vec() },
        flattering: config.split.is_flattering(),
        kernel: format!("{:?}", kriging.kernel),
        declared_seen: field.u_m().map(|_| kriging.seen().into()),
        unshared_um: unshared_m.map(|u| u * 1e6).into(),
        curves: curves(&state, &config.split, &networks_of(field, config)),
        held_out: held_out_scores(field, &predicted),
        recommendation,
        kind: kind.name().to_owned(),
        complete,
    };
    Ok(Trained { model, record, state, held_out })
}

/// What held-out points recommend among everything that predicted them, and the kind to make. Where "zero" is recommended
/// and a model was asked for all the same, the kind is the best of those trained.
fn choose(
    field: &Samples,
    predicted: &[Predicted],
    block: &[usize],
    config: &Config,
) -> (Recommendation, ResidualMethod) {
    // A stopped training has not predicted all folds with all methods: they compete on the points they share.
    let shared: Vec<usize> = (0..block.len()).filter(|k| predicted.iter().all(|p| p.errors_m[*k].is_some())).collect();
    let candidates = held_out::candidates(field, predicted, &shared);
    let blocks: Vec<usize> = shared.iter().map(|k| block[*k]).collect();
    let nothing = || Recommendation { method: ZERO.into(), why: "no point was held out".into() };
    let recommendation = recommend(&candidates, &blocks).unwrap_or_else(nothing);
    let plainer = candidates.iter().take_while(|candidate| candidate.is_plainer).count();
    let among_kinds = recommend(&candidates[plainer..], &blocks);
    let named = |name: &str| config.method.kinds().iter().copied().find(|kind| kind.name() == name);
    let kind = among_kinds.and_then(|found| named(&found.method)).unwrap_or(config.method.kinds()[0]);
    (recommendation, kind)
}

fn held_out_scores(field: &Samples, predicted: &[Predicted]) -> Vec<HeldOutScores> {
    let all: Vec<usize> = (0..field.count()).collect();
    let zero = held_out::candidates(field, &[], &all).remove(0).errors_m;
    let zero = Scores::of(&zero).map(|scores| HeldOutScores {
        method: ZERO.into(),
        points: zero.len(),
        scores,
        coverage_95: None,
    });
    let one = |p: &Predicted| {
        let errors: Vec<_> = p.errors_m.iter().flatten().copied().collect();
        let scores = Scores::of(&errors)?;
        let method = p.method();
        Some(HeldOutScores { method, points: errors.len(), scores, coverage_95: p.coverage_95() })
    };
    zero.into_iter().chain(predicted.iter().filter_map(one)).collect()
}

fn curves(state: &State, split: &Split, networks: &[ResidualMethod]) -> Vec<Curve> {
    let one = |(place, run): (usize, &Run)| {
        let kind = networks.get(place / split.folds)?;
        Some(Curve {
            kind: kind.name().to_owned(),
            member: place % split.folds,
            training_loss: run.training_loss.clone(),
            validation_loss: run.validation_loss.clone(),
            best_epoch: run.best_epoch,
        })
    };
    state.runs.iter().enumerate().filter_map(one).collect()
}

/// A seed of its own for each member (splitmix64).
pub(crate) fn seed_of(seed: u64, place: usize) -> u64 {
    let mut mixed = seed.wrapping_add((place as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    mixed ^ (mixed >> 31)
}

/// FNV-1a over the bits of all numbers: tells whether a state belongs to the data, no more.
fn fingerprint(field: &Samples) -> u64 {
    let lists = [Some(field.errors_m()), field.u_m()];
    let vectors = lists.into_iter().flatten().flatten().flat_map(|v| [v.x, v.y, v.z]);
    let numbers = field.points().flatten().copied().chain(vectors);
    let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
    numbers.flat_map(|n| n.to_bits().to_le_bytes()).fold(0xCBF2_9CE4_8422_2325, step)
}

#[cfg(test)]
mod tests;
