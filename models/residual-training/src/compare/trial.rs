//! One split of a comparison: every method taught by the same points, stopped by the same, and judged on the same.
//!
//! Place in the flow: under [`super::compare`]; a trial has either the position of the points or all their inputs.

use super::{Judged, Rival};
use crate::attention::Attention;
use crate::belief;
use crate::config::Config;
use crate::device::Device;
use crate::error::TrainingError;
use crate::kriging::fitted_kriging;
use crate::networks::{Networks, input_scale};
use crate::optimise::{Examples, Network, Training, outputs};
use crate::perceptron::Perceptron;
use crate::swarm::Swarm;
use crate::views::{Material, Positions, ViewError, normaliser};
use abbe_field::idw::{EXPONENT, Reference};
use abbe_field::{Idw, Interpolator, MeasuredField, Samples, Trilinear, place_of};
use abbe_residual_net::network::{Normaliser, Parameters};
use abbe_residual_net::{Calibration, Ensemble, Kriging, PositionEnsemble, ResidualMethod, place, place_box};
use nalgebra::Vector3;

/// Parts that say when to stop; part 0 judges.
const STOPPING: [usize; 2] = [1, 2];
/// Width of the plain network on the position.
const WIDTH: usize = 64;

/// One split.
pub(super) struct Trial<'a> {
    field: &'a Samples,
    measured: [bool; 3],
    config: &'a Config,
    seed: u64,
    teaching: Vec<usize>,
    stopping: Vec<usize>,
    judging: Vec<usize>,
    /// Everything but what judges.
    known: Samples,
    /// Scale of each input.
    scale: Vec<f64>,
    normaliser: Normaliser,
    /// Kriging of what is known, and the time its fit took (s).
    kriging: Kriging,
    kriging_s: f64,
    clock: &'a dyn Fn() -> f64,
}

type Predictor = Box<dyn Fn(&[f64]) -> Result<Vector3<f64>, String>>;

impl<'a> Trial<'a> {
    pub(super) fn new(
        field: &'a Samples,
        fold: &[usize],
        measured: [bool; 3],
        config: &'a Config,
        seed: u64,
        clock: &'a dyn Fn() -> f64,
    ) -> Result<Trial<'a>, TrainingError> {
        let of = |wanted: &dyn Fn(usize) -> bool| (0..fold.len()).filter(|k| wanted(fold[*k])).collect::<Vec<_>>();
        let (judging, stopping) = (of(&|f| f == 0), of(&|f| STOPPING.contains(&f)));
        let teaching = of(&|f| f != 0 && !STOPPING.contains(&f));
        let known = field.part(&of(&|f| f != 0)).map_err(ViewError::from)?;
        let start = clock();
        let kriging = fitted_kriging(&known)?;
        let kriging_s = clock() - start;
        let scale = input_scale(&known, &kriging);
        let normaliser = normaliser(&known, &scale, known.errors_m());
        Ok(Trial {
            field,
            measured,
            config,
            seed,
            teaching,
            stopping,
            judging,
            known,
            scale,
            normaliser,
            kriging,
            kriging_s,
            clock,
        })
    }

    pub(super) fn judge(&self, rival: Rival) -> Result<Result<Judged, String>, TrainingError> {
        let start = (self.clock)();
        let predictor = match self.predictor(rival)? {
            Ok(predictor) => predictor,
            Err(reason) => return Ok(Err(reason)),
        };
        let trained = (self.clock)();
        let predicted: Result<Vec<_>, String> = self.judging.iter().map(|k| predictor(self.field.point(*k))).collect();
        let end = (self.clock)();
        let shared_s =
            if rival.kind().is_some_and(|kind| kind != ResidualMethod::Network) { self.kriging_s } else { 0.0 };
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
        let interpolator = |make: fn(&MeasuredField) -> Result<Box<dyn Interpolator>, String>| {
            let field = self.known.field().ok_or("is for positions alone")?.map_err(|reason| reason.to_string())?;
            let made = make(&field)?;
            let at =
                move |p: &[f64]| made.at(&place_of(p)).map(|found| found.error_m).map_err(|reason| reason.to_string());
            Ok(Box::new(at) as Predictor)
        };
        Ok(match rival {
            Rival::Zero => Ok(Box::new(|_| Ok(Vector3::zeros()))),
            Rival::Trilinear => interpolator(|field| Ok(Box::new(Trilinear::new(field)))),
            Rival::Idw => interpolator(|field| {
                let made = Idw::new(field, Reference::Hexahedron, EXPONENT);
                made.map(|f| -> Box<dyn Interpolator> { Box::new(f) }).map_err(|e| e.to_string())
            }),
            Rival::Perceptron => Ok(self.on_position(Perceptron::plain(WIDTH))?),
            Rival::ResidualPerceptron => {
                Ok(self.on_position(Perceptron::residual(&self.config.perceptron, self.field.size()))?)
            }
            Rival::Belief => {
                Ok(self.on_position(belief::pretrained(&self.positions().view(&self.teaching).inputs, self.seed))?)
            }
            Rival::Swarm => Ok(self.swarm()),
            Rival::Kriging => Ok(self.model(ResidualMethod::Kriging)?),
            Rival::Network => Ok(self.model(ResidualMethod::Network)?),
            Rival::KrigingNetwork => Ok(self.model(ResidualMethod::KrigingNetwork)?),
            Rival::PerceptronKriging => Ok(self.model(ResidualMethod::PerceptronKriging)?),
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
        let ((low, high), normaliser) = (place_box(&self.known), self.normaliser);
        Ok(Box::new(move |p| {
            let at = place(p, &low, &high);
            let output = outputs(&network, &best, &at[..p.len()], &Device::cpu()).map_err(|e| e.to_string())?;
            Ok(normaliser.restore(&Vector3::from_fn(|k, _| f64::from(output[k]))))
        }))
    }

    fn swarm(&self) -> Predictor {
        let swarm = Swarm::train(&self.position_examples(), self.seed);
        let ((low, high), normaliser) = (place_box(&self.known), self.normaliser);
        Box::new(move |p| {
            let [x, y, z, ..] = place(p, &low, &high);
            Ok(normaliser.restore(&Vector3::from(swarm.output(&[x, y, z]))))
        })
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
    fn model(&self, kind: ResidualMethod) -> Result<Predictor, TrainingError> {
        let networks = match kind {
            ResidualMethod::Kriging => Networks::None,
            ResidualMethod::Network | ResidualMethod::KrigingNetwork => {
                Networks::Neighbourhood(self.ensemble(kind, &self.kriging)?)
            }
            ResidualMethod::PerceptronKriging => Networks::Position(self.trend()?),
        };
        let model = networks.model(kind, &self.known, &self.scale, &self.kriging, Calibration::none())?;
        Ok(Box::new(move |p| Ok(model.predict(p).residual_m)))
    }

    fn trend(&self) -> Result<PositionEnsemble, TrainingError> {
        let config = self.config.perceptron;
        let network = Perceptron::residual(&config, self.field.size());
        let best = self.trained(&network, &self.position_examples(), "perceptron-kriging")?;
        Ok(self.positions().ensemble(config, vec![best]))
    }

    fn ensemble(&self, kind: ResidualMethod, kriging: &Kriging) -> Result<Ensemble, TrainingError> {
        let config = self.config.network;
        let mut normaliser = self.normaliser;
        let material = |normaliser| Material {
            kind,
            field: self.field,
            scale: &self.scale,
            kriging,
            config: &self.config.network,
            normaliser,
            split: &self.config.split,
        };
        if kind == ResidualMethod::KrigingNetwork {
            let known: Vec<usize> = self.teaching.iter().chain(&self.stopping).copied().collect();
            let left = material(&self.normaliser).left_by_kriging(&known, self.seed)?;
            normaliser = crate::views::normaliser(&self.known, &self.scale, &left);
        }
        let examples = material(&normaliser).examples(&self.teaching, &self.stopping, self.seed)?;
        let (inputs, starts_at_zero) = (self.field.size(), kind == ResidualMethod::KrigingNetwork);
        let best = self.trained(&Attention { config, inputs, starts_at_zero }, &examples, kind.name())?;
        Ok(Ensemble { config, normaliser, members: vec![Parameters::new(&config, inputs, best)?] })
    }
}
