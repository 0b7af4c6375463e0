//! From settled passes to a model and its evidence.
//!
//! Place in the flow: the last step of [`crate::solve`]; nothing is estimated here any more.

use crate::chords::Chords;
use crate::design::{Row, places};
use crate::error::IdentifyError;
use crate::evidence::{self, CorrelatedNoise, ErrorEvidence, Evidence, RejectedReading, StationEvidence};
use crate::identified::{Ended, Identified};
use crate::observability::Observability;
use crate::smoothing::{Solution, noise_factor_for_covariance};
use crate::solve::{Fit, Settled};
use crate::term::{CampaignRow, EffectTerm};
use crate::unexplained::{Excess, by_axis};
use abbe_geometry::between_nodes::BetweenNodes;
use abbe_geometry::effects::{CovariateSource, CovariateValue, is_derived};
use abbe_geometry::model::{
    Difference, FitQuality, FittedEffect, IdentifiedVolume, MachineModel, ModelParts, Station, packed,
};
use abbe_geometry::seen::TEMPERATURE;
use abbe_geometry::{ErrorId, Vector3};
use abbe_measurement::campaign::RangeReading;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

impl Fit<'_> {
    /// The model with its covariance, and what the fit says about itself.
    pub(crate) fn finish(self, settled: Settled) -> Result<Identified, IdentifyError> {
        let evidence = self.evidence(&settled);
        let correlation = self.correlation;
        let model = self.model(&settled)?;
        let (residuals_m, u_m) = settled.residuals.iter().copied().unzip();
        let ended = Ended { free: self.free, smoothness: self.smoothness, noise_factor: self.noise_factor };
        Ok(Identified { model, evidence, residuals_m, u_m, weights: settled.weights, correlation, ended })
    }

    fn evidence(&self, settled: &Settled) -> Evidence {
        let solution = &settled.solution;
        let seen = self.observability.unwrap_or(Observability { rank: 0, unknowns: 0, condition: f64::INFINITY });
        Evidence {
            passes: self.passes,
            largest_step: settled.largest_step,
            unknowns: self.free.len(),
            effective_unknowns: solution.effective.iter().sum(),
            chi2_per_dof: solution.noise_factor,
            minus_two_log_likelihood: solution.minus_two_log_likelihood,
            robust_scale: settled.scale,
            rank: seen.rank,
            low_order_unknowns: seen.unknowns,
            condition: seen.condition,
            errors: self.error_evidence(solution),
            stations: self.station_evidence(settled),
            correlated: evidence::correlated(&self.setup, solution, &self.free, &self.campaign.stations),
            noise: self.correlation.map(|c| CorrelatedNoise::of(&c, self.campaign, &settled.weights)),
            rejected: self.rejected(settled),
            refinement_given_up: None,
        }
    }

    fn error_evidence(&self, solution: &Solution) -> Vec<ErrorEvidence> {
        let places = |range: std::ops::Range<usize>| {
            self.free.iter().enumerate().filter(move |(_, k)| range.contains(k)).map(|(place, _)| place)
        };
        let of = |id: ErrorId| {
            let range = self.setup.layout.range(id);
            ErrorEvidence {
                name: id.name(),
                coefficients: places(range.clone()).count(),
                effective: places(range.clone()).map(|k| solution.effective[k]).sum(),
                penalty: self.smoothness.penalties.iter().find(|p| p.range == range).map(|p| p.lambda),
            }
        };
        ErrorId::all().filter(|id| self.setup.layout.basis(*id).is_some()).map(of).collect()
    }

    fn station_evidence(&self, settled: &Settled) -> Vec<StationEvidence> {
        let of = |(station, name): (usize, &String)| {
            let own = self.campaign.readings.iter().zip(&settled.residuals).zip(&settled.weights);
            let own: Vec<_> = own.filter(|((reading, _), _)| reading.station as usize == station).collect();
            let kept = own.iter().filter(|(_, weight)| **weight > 0.0);
            let (count, square) = kept.fold((0, 0.0), |(n, s), ((_, (r, _)), _)| (n + 1, s + r * r));
            let u_m = std::array::from_fn(|d| self.u_of(settled, self.setup.machine_parameters() + 4 * station + d));
            StationEvidence {
                name: name.clone(),
                readings: own.len(),
                residual_rms_m: (square / f64::from(count.max(1))).sqrt(),
                u_m,
            }
        };
        self.campaign.stations.iter().enumerate().map(of).collect()
    }

    fn u_of(&self, settled: &Settled, index: usize) -> f64 {
        let place = self.free.iter().position(|k| *k == index);
        place.map_or(0.0, |k| settled.solution.covariance[(k, k)].sqrt())
    }

    fn rejected(&self, settled: &Settled) -> Vec<RejectedReading> {
        let listed = self.campaign.readings.iter().zip(&settled.residuals).zip(&settled.weights).enumerate();
        listed
            .filter(|(_, (_, weight))| **weight == 0.0)
            .map(|(index, ((reading, (residual_m, u_m)), _))| RejectedReading {
                reading: index + 1,
                station: self.campaign.stations[reading.station as usize].clone(),
                line: self.campaign.lines[reading.line as usize].clone(),
                residual_m: *residual_m,
                standardised: residual_m / u_m / settled.scale,
            })
            .collect()
    }

    fn model(&self, settled: &Settled) -> Result<MachineModel, IdentifyError> {
        let geometric = self.setup.layout.len();
        let stations = self.setup.machine_parameters();
        let station = |(k, name): (usize, &String)| {
            let own = &self.parameters[stations + 4 * k..stations + 4 * k + 4];
            Station { name: name.clone(), position_m: Vector3::new(own[0], own[1], own[2]), dead_path_m: own[3] }
        };
        let covariance = self.packed_covariance(&settled.solution);
        let kept = settled.residuals.iter().zip(&settled.weights).filter(|(_, weight)| **weight > 0.0);
        let (used, square_m2) = kept.fold((0_usize, 0.0), |(n, sum), ((r, _), _)| (n + 1, sum + r * r));
        let degrees = settled.weights.iter().sum::<f64>() - settled.solution.effective.iter().sum::<f64>();
        let parts = ModelParts {
            machine: self.setup.machine.clone(),
            coefficients: self.parameters[..geometric].to_vec(),
            offset_centre_m: self.setup.layout.offset_centre_m(),
            effects: self.effects(),
            stations: self.campaign.stations.iter().enumerate().map(station).collect(),
            chord_covariance: self.chord_covariance(settled, &covariance),
            covariance,
            identified: IdentifiedVolume {
                covariates: self.covariate_ranges(&settled.weights),
                differences: self.differences(&settled.weights),
                ..identified_volume(&self.campaign.readings, &settled.weights)
            },
            quality: FitQuality {
                readings: used,
                rejected: self.campaign.readings.len() - used,
                chi2_per_dof: settled.solution.noise_factor,
                residual_rms_m: (square_m2 / used.max(1) as f64).sqrt(),
                unexplained_m: self.unexplained_m(settled, square_m2, degrees),
                wanders: None,
                unseen_expansions: Default::default(),
            },
        };
        Ok(MachineModel::new(parts)?)
    }

    /// What is unexplained along each axis (m), of residuals with this sum of squares (m²).
    fn unexplained_m(&self, settled: &Settled, square_m2: f64, degrees: f64) -> [f64; 3] {
        let total_m = FitQuality::unexplained_of(settled.solution.noise_factor, square_m2, degrees);
        if total_m == 0.0 {
            return [0.0; 3];
        }
        let estimate = self.estimate();
        let used = settled.weights.iter().filter(|weight| **weight > 0.0).count() as f64;
        let mut excess = Vec::with_capacity(settled.weights.len());
        for (index, (reading, (residual_m, u_m))) in self.campaign.readings.iter().zip(&settled.residuals).enumerate() {
            if settled.weights[index] > 0.0 {
                let (_, ray) = estimate.residual(index);
                // What the fit takes of all readings it takes of each.
                let square_m2 = residual_m.powi(2) * used / degrees.max(1.0) - u_m.powi(2);
                excess.push(Excess { direction: ray.direction, square_m2, line: reading.line });
            }
        }
        by_axis(&excess, total_m)
    }

    /// What straight lines between nodes add to the packed covariance.
    fn chord_covariance(&self, settled: &Settled, covariance: &[f64]) -> Vec<f64> {
        let of = |a: usize, b: usize| covariance[packed(a, b)];
        let between_nodes = BetweenNodes::new(self.setup.layout, &self.parameters, of);
        if between_nodes.is_empty() {
            return Vec::new();
        }
        let estimate = self.estimate();
        let (mut chords, mut row) = (Chords::new(self.parameters.len(), &between_nodes), Row::new());
        for (index, (weight, (_, u_m))) in settled.weights.iter().zip(&settled.residuals).enumerate() {
            let point = estimate.row(index, &mut row);
            let information = weight / (u_m * u_m);
            estimate.visit_departures(index, (&between_nodes, &row.ray, &point), |departure, partial| {
                for (first, values) in row.segments() {
                    for (k, value) in values.iter().enumerate() {
                        chords.add(first + k, departure, information * value * partial);
                    }
                }
            });
        }
        // The covariance is (JᵀWJ + P)⁻¹, widened by misfit.
        let widened = noise_factor_for_covariance(settled.solution.noise_factor);
        let inverse = faer::Scale(1.0 / widened) * &settled.solution.covariance;
        chords.packed(&between_nodes, (&self.free, &inverse), self.parameters.len())
    }

    fn effects(&self) -> Vec<FittedEffect> {
        let mut first = self.setup.layout.len();
        let fitted = |term: &EffectTerm| {
            let parameters = self.parameters[first..first + term.len()].to_vec();
            first += term.len();
            FittedEffect { effect: Arc::clone(&term.effect), shape: term.shape.clone(), parameters }
        };
        self.setup.terms.iter().map(fitted).collect()
    }

    /// Range of every covariate that a corrected sample or a predicted length needs, and of those logged, over the readings used.
    fn covariate_ranges(&self, weights: &[f64]) -> BTreeMap<String, (f64, f64)> {
        let read = self.setup.terms.iter().flat_map(|term| term.effect.reads());
        // What lags, or follows over a travel, is made from what is logged.
        let logged = self.campaign.covariates.iter().map(|column| column.name.clone());
        let logged = logged.filter(|name| !is_derived(name));
        let of = |name: String| {
            let used = (0..weights.len()).filter(|k| weights[*k] > 0.0);
            let values =
                used.filter_map(|reading| match (CampaignRow { campaign: self.campaign, reading }).covariate(&name) {
                    CovariateValue::Fresh(value) => Some(value),
                    CovariateValue::Stale | CovariateValue::Missing => None,
                });
            let range = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            (name, range)
        };
        let known = |(_, (low, high)): &(String, (f64, f64))| low <= high;
        read.map(of).chain(logged.map(of).filter(known)).collect()
    }

    /// How far each temperature that an effect reads stood from the others logged, over the readings used.
    fn differences(&self, weights: &[f64]) -> Vec<Difference> {
        let is_temperature = |name: &String| name.ends_with(TEMPERATURE);
        let read: BTreeSet<String> =
            self.setup.terms.iter().flat_map(|term| term.effect.covariates()).filter(is_temperature).collect();
        let logged = self.campaign.covariates.iter().map(|column| column.name.clone());
        let logged: Vec<String> = logged.filter(|name| is_temperature(name) && !is_derived(name)).collect();
        let pairs = read.iter().flat_map(|name| logged.iter().map(move |less| (name, less)));
        let of = |(name, less): (&String, &String)| {
            let used = (0..weights.len()).filter(|k| weights[*k] > 0.0);
            let values = used.filter_map(|reading| {
                let row = CampaignRow { campaign: self.campaign, reading };
                match (row.covariate(name), row.covariate(less)) {
                    (CovariateValue::Fresh(own), CovariateValue::Fresh(other)) => Some(own - other),
                    _ => None,
                }
            });
            let range = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            (range.0 <= range.1).then(|| Difference { name: name.clone(), less: less.clone(), range })
        };
        pairs.filter(|(name, less)| name != less).filter_map(of).collect()
    }

    /// Lower triangle over all parameters; those that were not free have no variance.
    fn packed_covariance(&self, solution: &Solution) -> Vec<f64> {
        let place = places(&self.free, self.parameters.len());
        let entry = |row: usize, column: usize| match (place[row], place[column]) {
            (Some(a), Some(b)) => solution.covariance[(a, b)],
            _ => 0.0,
        };
        (0..self.parameters.len())
            .flat_map(|row| (0..=row).map(move |column| (row, column)))
            .map(|(r, c)| entry(r, c))
            .collect()
    }
}

fn identified_volume(readings: &[RangeReading], weights: &[f64]) -> IdentifiedVolume {
    let mut reading_m = [(f64::INFINITY, f64::NEG_INFINITY); 3];
    let mut offset_m = reading_m;
    for (reading, _) in readings.iter().zip(weights).filter(|(_, weight)| **weight > 0.0) {
        for d in 0..3 {
            reading_m[d] = (reading_m[d].0.min(reading.reading_m[d]), reading_m[d].1.max(reading.reading_m[d]));
            offset_m[d] = (offset_m[d].0.min(reading.offset_m[d]), offset_m[d].1.max(reading.offset_m[d]));
        }
    }
    IdentifiedVolume { reading_m, offset_m, covariates: BTreeMap::new(), differences: Vec::new() }
}
