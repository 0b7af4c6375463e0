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
    let Some((_, first)) = models.first().filter(|_| sound) else {
        return Err(ModelError::Mixture { what: "weights" });
    };
    let mut effects: Vec<FittedEffect> = Vec::new();
    for fitted in models.iter().flat_map(|(_, model)| &model.parts().effects) {
        if place(&effects, fitted).is_none() {
            effects.push(FittedEffect { parameters: vec![0.0; fitted.parameters.len()], ..fitted.clone() });
        }
    }
    let members: Vec<Member> = models
        .iter()
        .map(|(weight, model)| Member::of(weight / total, model, first, &effects))
        .collect::<Result<_, _>>()?;
    let count = first.layout().len() + length(&effects) + 4 * first.parts().stations.len();
    let mut mean = vec![0.0; count];
    for member in &members {
        member.places.iter().zip(&member.values).for_each(|(place, value)| mean[*place] += member.weight * value);
    }
    let spread = |member: &Member| -> Vec<f64> {
        let mut own: Vec<f64> = mean.iter().map(|mean| -mean).collect();
        member.places.iter().zip(&member.values).for_each(|(place, value)| own[*place] += value);
        own
    };
    let (mut covariance, mut chords) = (vec![0.0; count * (count + 1) / 2], Vec::new());
    for (member, (_, model)) in members.iter().zip(models) {
        member.add(&mut covariance, &model.parts().covariance);
        add_outer(&mut covariance, member.weight, &spread(member));
        if !model.parts().chord_covariance.is_empty() {
            chords.resize(covariance.len(), 0.0);
            member.add(&mut chords, &model.parts().chord_covariance);
        }
    }
    let mut parts = ModelParts { covariance, chord_covariance: chords, ..first.parts().clone() };
    if let Some(member) = members.first() {
        parts
            .quality
            .unseen_expansions
            .absorbed
            .iter_mut()
            .for_each(|absorbed| *absorbed = member.spread_over(absorbed, count));
    }
    let mut values = mean.into_iter();
    parts.coefficients = values.by_ref().take(first.layout().len()).collect();
    effects.iter_mut().for_each(|fitted| fitted.parameters = values.by_ref().take(fitted.parameters.len()).collect());
    parts.effects = effects;
    for station in &mut parts.stations {
        let own: Vec<f64> = values.by_ref().take(4).collect();
        *station = Station { position_m: [own[0], own[1], own[2]].into(), dead_path_m: own[3], ..station.clone() };
    }
    for (_, model) in models {
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

/// One of the models, in the order of the parameters of all.
struct Member {
    weight: f64,
    /// Of each of its parameters, the place among those of all.
    places: Vec<usize>,
    values: Vec<f64>,
}

impl Member {
    fn of(weight: f64, model: &MachineModel, first: &MachineModel, all: &[FittedEffect]) -> Result<Member, ModelError> {
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
        Ok(Member { weight, places, values })
    }

    /// Values of its own parameters among those of all.
    fn spread_over(&self, own: &[f64], count: usize) -> Vec<f64> {
        let mut all = vec![0.0; count];
        self.places.iter().zip(own).for_each(|(place, value)| all[*place] = *value);
        all
    }

    /// Adds its share of a packed covariance of its own parameters to that of all.
    fn add(&self, all: &mut [f64], own: &[f64]) {
        let mut entries = own.iter();
        for (row, a) in self.places.iter().enumerate() {
            for (b, value) in self.places[..=row].iter().zip(entries.by_ref()) {
                all[packed(*a, *b)] += self.weight * value;
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
