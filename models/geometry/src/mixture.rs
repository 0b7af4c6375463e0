//! Several models of one machine that explain the same data, as one.
//!
//! Place in the flow: the end of a diagnosis, where effects compete and the data do not tell which of them acts. Coordinates are
//! linear in the parameters, so that the mean of what the models say is itself a model: it has the effects of all, each as strong as
//! its model is likely. Its covariance is that of the mixture,
//!
//! C = Σ w (Cₖ + (θₖ − θ̄)(θₖ − θ̄)ᵀ),   θ̄ = Σ w θₖ,
//!
//! so that a coordinate is as uncertain as the models disagree on it: where an effect stands as it did in the campaign they agree,
//! elsewhere they part (J. A. Hoeting et al., Bayesian model averaging: a tutorial, Statistical Science 14, 1999, equations 1 to 3).
//! SI; parameters that a model lacks are zero in it.

use crate::model::{FittedEffect, MachineModel, ModelError, ModelParts, Station, packed};

/// The mean of some models with these weights, which need not add up to one. All share machine and stations, as the first has them;
/// so do data and quality.
///
/// # Errors
/// [`ModelError`] where the models do not belong to one machine and campaign, or no weight is positive.
pub fn mixture(models: &[(f64, &MachineModel)]) -> Result<MachineModel, ModelError> {
    let total: f64 = models.iter().map(|(weight, _)| weight).sum();
    let sound = total.is_finite() && total > 0.0 && models.iter().all(|(weight, _)| *weight >= 0.0);
    if !sound {
        return Err(ModelError::Mixture { what: "weights" });
    }
    let mut sum = Sum::of(models.iter().map(|(_, model)| *model).collect())?;
    let weight = |k: usize| models[k].0 / total;
    let mut mean = vec![0.0; sum.count];
    for (k, member) in sum.members.iter().enumerate() {
        member.places.iter().zip(&member.values).for_each(|(place, value)| mean[*place] += weight(k) * value);
    }
    for k in 0..models.len() {
        sum.add_covariance(k, weight(k));
        let spread: Vec<f64> = sum.values(k).iter().zip(&mean).map(|(own, mean)| own - mean).collect();
        add_outer(&mut sum.covariance, weight(k), &spread);
    }
    sum.model(mean)
}

/// The first model as it is, with what a term does that it lacks in its covariance: `without` and `with` are fits of the same data without
/// the term and with it. It may do what the second fit moves, and is as uncertain there as this share (of a variance) of the second fit:
///
/// > C' = C + (θ₂ − θ₁)(θ₂ − θ₁)ᵀ + share · C₂.
///
/// # Errors
/// [`ModelError`] where the models do not belong to one machine and campaign.
pub fn beside(
    model: &MachineModel,
    (without, with): (&MachineModel, &MachineModel),
    share: f64,
) -> Result<MachineModel, ModelError> {
    let mut sum = Sum::of(vec![model, without, with])?;
    sum.add_covariance(0, 1.0);
    sum.add_covariance(2, share);
    let moved: Vec<f64> = sum.values(2).iter().zip(sum.values(1)).map(|(with, without)| with - without).collect();
    add_outer(&mut sum.covariance, 1.0, &moved);
    let mean = sum.values(0);
    sum.model(mean)
}

/// Models over the parameters of all of them, and the covariance of what they come to.
struct Sum<'a> {
    models: Vec<&'a MachineModel>,
    /// Of all models, with no size yet.
    effects: Vec<FittedEffect>,
    members: Vec<Member>,
    /// Parameters in all.
    count: usize,
    /// Packed.
    covariance: Vec<f64>,
    chords: Vec<f64>,
}

impl<'a> Sum<'a> {
    fn of(models: Vec<&'a MachineModel>) -> Result<Sum<'a>, ModelError> {
        let first = *models.first().ok_or(ModelError::Mixture { what: "weights" })?;
        let mut effects: Vec<FittedEffect> = Vec::new();
        for fitted in models.iter().flat_map(|model| &model.parts().effects) {
            if place(&effects, fitted).is_none() {
                effects.push(FittedEffect { parameters: vec![0.0; fitted.parameters.len()], ..fitted.clone() });
            }
        }
        let of = |model: &&MachineModel| Member::of(model, first, &effects);
        let members = models.iter().map(of).collect::<Result<_, _>>()?;
        let count = first.layout().len() + length(&effects) + 4 * first.parts().stations.len();
        let covariance = vec![0.0; count * (count + 1) / 2];
        Ok(Sum { models, effects, members, count, covariance, chords: Vec::new() })
    }

    /// Values of a model, in the order of all.
    fn values(&self, k: usize) -> Vec<f64> {
        self.members[k].spread_over(&self.members[k].values, self.count)
    }

    /// Adds the covariance of a model so many times.
    fn add_covariance(&mut self, k: usize, weight: f64) {
        let (member, own) = (&self.members[k], self.models[k].parts());
        member.add(&mut self.covariance, weight, &own.covariance);
        if !own.chord_covariance.is_empty() {
            self.chords.resize(self.covariance.len(), 0.0);
            member.add(&mut self.chords, weight, &own.chord_covariance);
        }
    }

    /// The model with these values and the covariance that was added up; all else is that of the first.
    fn model(self, mean: Vec<f64>) -> Result<MachineModel, ModelError> {
        let first = self.models[0];
        let mut parts =
            ModelParts { covariance: self.covariance, chord_covariance: self.chords, ..first.parts().clone() };
        let absorbed = &mut parts.quality.unseen_expansions.absorbed;
        absorbed.iter_mut().for_each(|own| *own = self.members[0].spread_over(own, self.count));
        let mut values = mean.into_iter();
        parts.coefficients = values.by_ref().take(first.layout().len()).collect();
        parts.effects = self.effects;
        let sizes = parts.effects.iter_mut();
        sizes.for_each(|fitted| fitted.parameters = values.by_ref().take(fitted.parameters.len()).collect());
        for station in &mut parts.stations {
            let own: Vec<f64> = values.by_ref().take(4).collect();
            *station = Station { position_m: [own[0], own[1], own[2]].into(), dead_path_m: own[3], ..station.clone() };
        }
        for model in &self.models {
            for difference in &model.parts().identified.differences {
                if !parts.identified.differences.contains(difference) {
                    parts.identified.differences.push(difference.clone());
                }
            }
            let ranges = model.parts().identified.covariates.iter();
            ranges.for_each(|(name, range)| {
                parts.identified.covariates.entry(name.clone()).or_insert(*range);
            });
        }
        MachineModel::new(parts)
    }
}

/// One of the models, in the order of the parameters of all.
struct Member {
    /// Of each of its parameters, the place among those of all.
    places: Vec<usize>,
    values: Vec<f64>,
}

impl Member {
    fn of(model: &MachineModel, first: &MachineModel, all: &[FittedEffect]) -> Result<Member, ModelError> {
        let (parts, geometry) = (model.parts(), first.layout().len());
        let names = |model: &MachineModel| model.parts().stations.iter().map(|s| s.name.clone()).collect::<Vec<_>>();
        if model.layout().len() != geometry || parts.machine != first.parts().machine {
            return Err(ModelError::Mixture { what: "machines" });
        }
        if names(model) != names(first) || parts.offset_centre_m != first.parts().offset_centre_m {
            return Err(ModelError::Mixture { what: "campaigns" });
        }
        let mut places: Vec<usize> = (0..geometry).collect();
        let mut values = parts.coefficients.clone();
        for fitted in &parts.effects {
            let at = place(all, fitted).ok_or(ModelError::Mixture { what: "effects" })?;
            let begin = geometry + length(&all[..at]);
            places.extend(begin..begin + fitted.parameters.len());
            values.extend(&fitted.parameters);
        }
        let begin = geometry + length(all);
        places.extend(begin..begin + 4 * parts.stations.len());
        for station in &parts.stations {
            values.extend(station.position_m.iter());
            values.push(station.dead_path_m);
        }
        Ok(Member { places, values })
    }

    /// Values of its own parameters among those of all.
    fn spread_over(&self, own: &[f64], count: usize) -> Vec<f64> {
        let mut all = vec![0.0; count];
        self.places.iter().zip(own).for_each(|(place, value)| all[*place] = *value);
        all
    }

    /// Adds a share of a packed covariance of its own parameters to that of all.
    fn add(&self, all: &mut [f64], weight: f64, own: &[f64]) {
        let mut entries = own.iter();
        for (row, a) in self.places.iter().enumerate() {
            for (b, value) in self.places[..=row].iter().zip(entries.by_ref()) {
                all[packed(*a, *b)] += weight * value;
            }
        }
    }
}

fn add_outer(all: &mut [f64], weight: f64, spread: &[f64]) {
    let mut entries = all.iter_mut();
    for (row, a) in spread.iter().enumerate() {
        spread[..=row].iter().zip(entries.by_ref()).for_each(|(b, entry)| *entry += weight * a * b);
    }
}

fn place(effects: &[FittedEffect], fitted: &FittedEffect) -> Option<usize> {
    effects.iter().position(|known| known.effect.name() == fitted.effect.name() && known.shape == fitted.shape)
}

fn length(effects: &[FittedEffect]) -> usize {
    effects.iter().map(|fitted| fitted.parameters.len()).sum()
}

#[cfg(test)]
mod tests;
