//! Training of all members of one kind of network.
//!
//! Place in the flow: folds and kriging without each in, trained members out; each epoch is told, and what is told can stop it.

use super::{Config, Go, Progress, State, TrainingError, seed_of};
use crate::attention::Attention;
use crate::device::Device;
use crate::networks::Networks;
use crate::optimise::{Examples, Network, Training};
use crate::perceptron::Perceptron;
use crate::views::{Material, Positions, normaliser};
use abbe_field::Samples;
use abbe_residual_net::network::{Normaliser, Parameters};
use abbe_residual_net::{Ensemble, Kriging, ResidualMethod};

/// One kind to be trained.
pub(super) struct Task<'a> {
    pub(super) field: &'a Samples,
    pub(super) scale: &'a [f64],
    pub(super) config: &'a Config,
    pub(super) device: &'a Device,
    pub(super) kriging: &'a Kriging,
    /// Kriging without each fold.
    pub(super) without: &'a [Kriging],
    pub(super) fold: &'a [usize],
    pub(super) kind: ResidualMethod,
    /// Which of the kinds with networks, from 0.
    pub(super) number: usize,
    /// How many there are.
    pub(super) kinds: usize,
}

/// Points that a member learns from, and those that say when to stop.
struct Parts {
    training: Vec<usize>,
    stopping: Vec<usize>,
}

impl Task<'_> {
    /// All members, or those until it was stopped; whether it was not.
    pub(super) fn networks(
        &self,
        state: &mut State,
        observe: &mut dyn FnMut(&Progress) -> Go,
    ) -> Result<(Networks, bool), TrainingError> {
        let normaliser = self.normaliser()?;
        let mut members = Vec::new();
        let mut done = true;
        for member in 0..self.config.split.folds {
            done = self.member(member, &normaliser, state, observe)?;
            members.push(state.runs[self.place(member)].best.clone());
            if !done {
                break;
            }
        }
        let networks = if self.kind.has_trend() {
            Networks::Position(self.positions(&normaliser).ensemble(self.config.perceptron, members))
        } else {
            let config = self.config.network;
            let members = members
                .into_iter()
                .map(|m| Parameters::new(&config, self.field.size(), m))
                .collect::<Result<_, _>>()?;
            Networks::Neighbourhood(Ensemble { config, normaliser, members })
        };
        Ok((networks, done))
    }

    /// Place of a member among those of all kinds.
    fn place(&self, member: usize) -> usize {
        self.number * self.config.split.folds + member
    }

    fn material<'b>(&'b self, kriging: &'b Kriging, normaliser: &'b Normaliser) -> Material<'b> {
        Material {
            kind: self.kind,
            field: self.field,
            scale: self.scale,
            kriging,
            config: &self.config.network,
            normaliser,
            split: &self.config.split,
        }
    }

    fn positions<'b>(&'b self, normaliser: &'b Normaliser) -> Positions<'b> {
        Positions::new(self.field, self.field, normaliser)
    }

    /// Units of what this kind of network learns.
    fn normaliser(&self) -> Result<Normaliser, TrainingError> {
        let own = normaliser(self.field, self.scale, self.field.errors_m());
        if self.kind != ResidualMethod::KrigingNetwork {
            return Ok(own);
        }
        let all: Vec<usize> = (0..self.fold.len()).collect();
        let left = self.material(self.kriging, &own).left_by_kriging(&all, self.config.seed)?;
        Ok(normaliser(self.field, self.scale, &left))
    }

    /// Member k does not see fold k; fold k + 1 says when to stop.
    fn parts(&self, member: usize) -> Parts {
        let stopping = (member + 1) % self.config.split.folds;
        let of =
            |wanted: &dyn Fn(usize) -> bool| (0..self.fold.len()).filter(|k| wanted(self.fold[*k])).collect::<Vec<_>>();
        Parts { training: of(&|f| f != member && f != stopping), stopping: of(&|f| f == stopping) }
    }

    /// Trains one member to its end, or until it is stopped.
    fn member(
        &self,
        member: usize,
        normaliser: &Normaliser,
        state: &mut State,
        observe: &mut dyn FnMut(&Progress) -> Go,
    ) -> Result<bool, TrainingError> {
        let place = self.place(member);
        if state.runs.get(place).is_some_and(|run| run.is_over(&self.config.optimiser)) {
            return Ok(true);
        }
        let seed = seed_of(self.config.seed, place);
        let Parts { training, stopping } = self.parts(member);
        if self.kind.has_trend() {
            let examples = self.positions(normaliser).examples(&training, &stopping);
            return self.epochs(
                &Perceptron::residual(&self.config.perceptron, self.field.size()),
                &examples,
                place,
                state,
                observe,
            );
        }
        let examples = self.material(&self.without[member], normaliser).examples(&training, &stopping, seed)?;
        let (config, inputs) = (self.config.network, self.field.size());
        let network = Attention { config, inputs, starts_at_zero: self.kind == ResidualMethod::KrigingNetwork };
        self.epochs(&network, &examples, place, state, observe)
    }

    fn epochs<N: Network>(
        &self,
        network: &N,
        examples: &Examples,
        place: usize,
        state: &mut State,
        observe: &mut dyn FnMut(&Progress) -> Go,
    ) -> Result<bool, TrainingError> {
        let Config { optimiser, split, seed, .. } = self.config;
        let members = self.kinds * split.folds;
        let failed = |source| TrainingError::Member { kind: self.kind.name(), member: place % split.folds, source };
        let seed = seed_of(*seed, place);
        let training = Training::new(network, examples, optimiser, seed, self.device).map_err(failed)?;
        if state.runs.len() == place {
            state.runs.push(training.start().map_err(failed)?);
        }
        let is_over = |state: &State| state.runs.get(place).is_some_and(|run| run.is_over(optimiser));
        while !is_over(state) {
            let run = state.runs.get_mut(place).ok_or(TrainingError::State("order of members"))?;
            training.epoch(run).map_err(failed)?;
            let run = &state.runs[place];
            let last = |list: &[f64]| list.last().copied().unwrap_or(f64::NAN);
            let progress = Progress {
                kind: self.kind,
                member: place,
                members,
                epoch: run.epochs().saturating_sub(1),
                epochs: optimiser.epochs,
                training_loss: last(&run.training_loss),
                validation_loss: last(&run.validation_loss),
                best_validation_loss: run.best_loss(),
                state,
            };
            if observe(&progress) == Go::Stop {
                return Ok(is_over(state) && place + 1 == members);
            }
        }
        Ok(true)
    }
}
