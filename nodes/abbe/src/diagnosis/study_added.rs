//! What residual vectors show beyond a model, added to that model.
//!
//! Place in the flow: beside `study_model`, where the vectors are what a model leaves and say so in their head. Errors found in them are those
//! of the machine less what the model corrects: alone they are no model of it. Sum of corrections, sum of covariances: what was found is
//! taken to be independent of the model. Where the vectors are of the model's own data, their noise is in both, and U is too large. What the
//! references of both have in common, such as one tracker's wavelength, is in neither.

use crate::pipeline::software;
use abbe_diagnose::study::{StudyDiagnosis, Terms};
use abbe_files::{DataSource, Doubt, ModelFile};
use abbe_geometry::Axis;
use abbe_geometry::model::{FittedEffect, IdentifiedVolume, MachineModel, ModelParts, packed};
use anyhow::Context;
use serde_json::{Value, json};

/// Covariate whose zero is the first row of the data, each time another.
const TIME: &str = "time_s";
/// How far a position of a vector may stand from the reading that it was corrected from (m).
const CORRECTED_M: f64 = 1e-4;

/// A model with what its residual vectors showed beside it; `None` where that is nothing, words where it cannot be done.
pub(super) fn model(
    given: &ModelFile,
    diagnosis: &StudyDiagnosis,
    source: DataSource,
    options: Value,
    doubts: Vec<Doubt>,
) -> anyhow::Result<Result<Option<ModelFile>, String>> {
    if diagnosis.terms.list.is_empty() {
        return Ok(Ok(None));
    }
    let words =
        || format!("{}: what was found does not fit the model of {}", source.file, given.model.parts().machine.name);
    let parts = match parts(given, &diagnosis.terms).with_context(words)? {
        Ok(parts) => parts,
        Err(why) => return Ok(Err(why)),
    };
    let model = MachineModel::new(parts).with_context(words)?;
    let effects: Vec<Value> =
        diagnosis.effects.iter().map(|e| json!({ "name": e.name, "p_value": e.p_value })).collect();
    let evidence = json!({
        "model": given.evidence,
        "added": { "study": diagnosis.of, "file": source.file, "effects": effects },
    });
    Ok(Ok(Some(ModelFile {
        model,
        order: given.order,
        instrument: given.instrument,
        absolute_range: given.absolute_range,
        residual_network: None,
        data: given.data.iter().cloned().chain([source]).collect(),
        seed: given.seed,
        options: with(&given.options, options),
        evidence,
        doubts: given.doubts.iter().cloned().chain(doubts).collect(),
        software: software(),
    })))
}

/// How the model was identified, which a later diagnosis goes by, and beside it how more was found.
fn with(given: &Value, added: Value) -> Value {
    let mut options = given.clone();
    match &mut options {
        Value::Object(keys) => drop(keys.insert("added".to_owned(), added)),
        _ => options = json!({ "model": given, "added": added }),
    }
    options
}

fn parts(given: &ModelFile, terms: &Terms) -> anyhow::Result<Result<ModelParts, String>> {
    if given.residual_network.is_some() {
        let why = "the model has a residual model of its own, which was made for what it leaves: train that again beside the model found with \
                   abbe diagnose --campaign";
        return Ok(Err(why.to_owned()));
    }
    let model = &given.model;
    let mut parts = model.parts().clone();
    if !has_one_offset(&parts) {
        let why = "the vectors do not say with which offset of the tip they were measured, and the model was identified with others than the \
                   machine's own: give the data that the vectors come of, with abbe diagnose --model and --campaign";
        return Ok(Err(why.to_owned()));
    }
    let new = terms
        .list
        .iter()
        .map(|term| MachineModel::fitted_effect(term.effect, term.shape.clone(), &parts.machine, term.values.clone()));
    let new = new.collect::<Result<Vec<FittedEffect>, _>>()?;
    if new.iter().any(|fitted| fitted.effect.covariates().iter().any(|name| name == TIME)) {
        return Ok(Err(
            "what was found goes with the time since the first vector, and the model counts its own time".to_owned()
        ));
    }
    let count: usize = new.iter().map(|fitted| fitted.parameters.len()).sum();
    let first = model.machine_parameters();
    let total = first + 4 * parts.stations.len();
    parts.covariance = with_block(&parts.covariance, (first, total), count, &terms.covariance);
    if !parts.chord_covariance.is_empty() {
        let nothing = vec![0.0; count * (count + 1) / 2];
        parts.chord_covariance = with_block(&parts.chord_covariance, (first, total), count, &nothing);
    }
    for absorbed in &mut parts.quality.unseen_expansions.absorbed {
        absorbed.splice(first..first, std::iter::repeat_n(0.0, count));
    }
    parts.effects.extend(new);
    for (repeatability_m, deviation_m) in parts.machine.repeatability_m.iter_mut().zip(terms.deviations_m) {
        *repeatability_m = deviation_m.map_or(*repeatability_m, |own| repeatability_m.max(own));
    }
    parts.identified.differences.extend(terms.differences.iter().cloned());
    Ok(narrowed(&mut parts.identified, terms).map(|()| parts))
}

/// Whether positions of vectors are those of readings: all were measured with the offset that the machine declares, or with none.
fn has_one_offset(parts: &ModelParts) -> bool {
    let own_m = parts.machine.default_offset_m.unwrap_or([0.0; 3]);
    let is_own = |((low_m, high_m), own_m): (&(f64, f64), f64)| {
        (low_m - own_m).abs() < CORRECTED_M && (high_m - own_m).abs() < CORRECTED_M
    };
    parts.identified.offset_m.iter().zip(own_m).all(is_own)
}

/// Both are known only where both were measured.
fn narrowed(identified: &mut IdentifiedVolume, terms: &Terms) -> Result<(), String> {
    let both = |what: &str, (low, high): (f64, f64), (from, to): (f64, f64)| {
        let (low, high) = (low.max(from), high.min(to));
        match low <= high {
            true => Ok((low, high)),
            false => Err(format!("the model and these vectors were measured at different {what}")),
        }
    };
    for axis in Axis::ALL {
        if let Some((low_m, high_m)) = terms.readings_m[axis.index()] {
            let own = &mut identified.reading_m[axis.index()];
            let range_m = (low_m - CORRECTED_M, high_m + CORRECTED_M);
            *own = both(&format!("positions along {}", axis.letter()), *own, range_m)?;
        }
    }
    for (name, range) in terms.covariates.iter().filter(|(name, _)| *name != TIME) {
        let own = identified.covariates.entry(name.clone()).or_insert(*range);
        *own = both(&format!("values of {name}"), *own, *range)?;
    }
    Ok(())
}

/// A packed covariance of `total` parameters with `count` more, before the one numbered `first`, that go with no other; their own is packed, too.
fn with_block(own: &[f64], (first, total): (usize, usize), count: usize, block: &[f64]) -> Vec<f64> {
    let old = |k: usize| if k < first { Some(k) } else { k.checked_sub(first + count).map(|k| first + k) };
    let mut all = Vec::with_capacity((total + count) * (total + count + 1) / 2);
    for row in 0..total + count {
        for column in 0..=row {
            all.push(match (old(row), old(column)) {
                (Some(a), Some(b)) => own[packed(a, b)],
                (None, None) => block[packed(row - first, column - first)],
                _ => 0.0,
            });
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: a machine of one parameter and a station of one, two new ones between them.
    #[test]
    fn a_block_stands_between_those_before_and_behind_it_and_goes_with_neither() {
        let own = [1.0, 0.5, 2.0];
        let all = with_block(&own, (1, 2), 2, &[3.0, 0.25, 4.0]);
        assert_eq!(all, [1.0, 0.0, 3.0, 0.0, 0.25, 4.0, 0.5, 0.0, 0.0, 2.0]);
    }
}
