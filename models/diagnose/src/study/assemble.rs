//! From the effects found to the diagnosis: ladder, gains, placebos, rivals, what to measure next.
//!
//! Place in the flow: last step of every study.

use super::candidate::Study;
use super::diagnosis::{Ambiguity, Blocks, Effect, Judgement, LackOfFit, Parameter, Rung, StudyDiagnosis};
use super::fit::{Fit, Fitted};
use super::judge::judge;
use super::placebo::placebo;
use super::search::{COMPARABLE, Found, Options, score_all, search};
use crate::error::DiagnoseError;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Alias share from which an effect found is mostly the model's own.
pub(super) const ALIASED: f64 = 0.95;

/// Searches and says what was found.
pub(super) fn diagnose(study: &mut dyn Study, options: &Options) -> Result<StudyDiagnosis, DiagnoseError> {
    let found = search(study, options)?;
    let study: &dyn Study = study;
    let base = Fit::settle(study, &[])?;
    let last = Fit::settle(study, &found.set)?;
    let effects = effects(study, &last, options)?;
    let ladder = ladder(study, &found.set)?;
    let (before, after) = (judge(study, &base.linear), judge(study, &last.linear));
    let lack_of_fit = lack_of_fit(study, &base, &last);
    let not_identifiable = not_identifiable(study, &effects, &found);
    let consistent_with_noise = effects.is_empty()
        && lack_of_fit.as_ref().is_none_or(|test| test.p_before > options.significance)
        && scatter_is_as_declared(&before, options.significance);
    let next_measurements = next_measurements(&not_identifiable);
    Ok(StudyDiagnosis {
        of: study.of(),
        rows: base.linear.residuals().len(),
        blocks: Blocks { what: study.block_word().to_owned(), count: study.blocks().len() },
        consistent_with_noise,
        effects,
        before,
        after,
        ladder,
        considered: found.considered,
        alternatives: Vec::new(),
        lack_of_fit,
        not_identifiable,
        untestable: study.untestable(),
        next_measurements,
        notes: study.notes(),
    })
}

/// Parameters of a candidate in a fit.
pub(super) fn parameters(study: &dyn Study, fitted: &Fitted) -> Vec<Parameter> {
    let specs = &study.candidates()[fitted.candidate].parameters;
    let parameter = |(k, spec): (usize, &abbe_geometry::effects::ParameterSpec)| Parameter {
        name: spec.name.clone(),
        value: fitted.values[k],
        unit: spec.unit,
        u: fitted.u[k],
        plausible: spec.plausible,
    };
    specs.iter().enumerate().map(parameter).collect()
}

fn effects(study: &dyn Study, last: &Fit, options: &Options) -> Result<Vec<Effect>, DiagnoseError> {
    let set = last.set();
    let after = judge(study, &last.linear);
    let mut effects = Vec::with_capacity(set.len());
    for (k, fitted) in last.added.iter().enumerate() {
        let mut rest = set.clone();
        rest.remove(k);
        let without = Fit::settle(study, &rest)?;
        let all = score_all(study, &without);
        let Some(own) = all.iter().find(|scored| scored.candidate == fitted.candidate) else { continue };
        let candidate = &study.candidates()[fitted.candidate];
        let is_rival = |other: &&super::search::Scored| {
            let is_other = !set.contains(&other.candidate);
            is_other
                && own.evidence - other.evidence < COMPARABLE
                && study.candidates()[other.candidate].family != candidate.family
        };
        let mut rivals: Vec<_> = all.iter().filter(is_rival).collect();
        rivals.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let columns = study.columns(&without.point, fitted.candidate);
        effects.push(Effect {
            name: candidate.name.clone(),
            formula: candidate.formula.clone(),
            kind: candidate.kind,
            covariates: candidate.covariates.clone(),
            p_value: (own.score.p_value * study.candidates().len() as f64).min(1.0),
            alias_share: own.score.alias_share,
            parameters: parameters(study, fitted),
            held_out_gain_um: judge(study, &without.linear).held_out.rms_um - after.held_out.rms_um,
            placebo: placebo(study, &without, &columns, options.placebo_draws, options.seed)?,
            rivals: rivals.iter().map(|scored| study.candidates()[scored.candidate].name.clone()).collect(),
        });
    }
    Ok(effects)
}

fn ladder(study: &dyn Study, set: &[usize]) -> Result<Vec<Rung>, DiagnoseError> {
    let mut rungs = Vec::with_capacity(set.len() + 1);
    let mut below: Option<Fit> = None;
    for count in 0..=set.len() {
        let fit = Fit::settle(study, &set[..count])?;
        let judgement = judge(study, &fit.linear);
        let rung = match (&below, fit.added.last()) {
            (Some(below), Some(fitted)) => {
                let score = below.score(study, fitted.candidate);
                Rung {
                    added: Some(study.candidates()[fitted.candidate].name.clone()),
                    judgement,
                    p_value: Some((score.p_value * study.candidates().len() as f64).min(1.0)),
                    alias_share: Some(score.alias_share),
                    parameters: parameters(study, fitted),
                }
            }
            _ => Rung { added: None, judgement, p_value: None, alias_share: None, parameters: Vec::new() },
        };
        rungs.push(rung);
        below = Some(fit);
    }
    Ok(rungs)
}

fn lack_of_fit(study: &dyn Study, base: &Fit, last: &Fit) -> Option<LackOfFit> {
    let (of, before) = study.lack_of_fit(base)?;
    let (_, after) = study.lack_of_fit(last)?;
    let p_after = (!last.added.is_empty() && after.degrees > 0).then_some(after.p_value);
    (before.degrees > 0).then_some(LackOfFit { of, p_before: before.p_value, p_after })
}

/// χ² against the declared uncertainties; nothing to object where none are declared.
fn scatter_is_as_declared(before: &Judgement, significance: f64) -> bool {
    let Some(chi2_per_dof) = before.chi2_per_dof else { return true };
    let Ok(distribution) = ChiSquared::new(before.degrees_of_freedom) else { return true };
    distribution.sf(chi2_per_dof * before.degrees_of_freedom) > significance
}

fn not_identifiable(study: &dyn Study, effects: &[Effect], found: &Found) -> Vec<Ambiguity> {
    let decided_by = |name: &str| {
        let candidate = study.candidates().iter().find(|candidate| candidate.name == name);
        candidate.map_or_else(String::new, |candidate| candidate.decided_by.clone())
    };
    let mut list = Vec::new();
    for considered in found.considered.iter().filter(|considered| considered.tested == 0) {
        list.push(Ambiguity {
            effects: vec![considered.name.clone()],
            because: format!("{} contains it entirely", study.base_word()),
            decided_by: decided_by(&considered.name),
        });
    }
    for effect in effects {
        if !effect.rivals.is_empty() {
            let names = std::iter::once(effect.name.clone()).chain(effect.rivals.iter().cloned()).collect();
            let because = "each explains these data as well as the other, within odds of 20 to 1".to_owned();
            list.push(Ambiguity { effects: names, because, decided_by: decided_by(&effect.name) });
        }
        if effect.alias_share > ALIASED {
            let because = format!("{:.1} % of its signature is the model's own", effect.alias_share * 100.0);
            let decided_by = decided_by(&effect.name);
            list.push(Ambiguity { effects: vec![effect.name.clone()], because, decided_by });
        }
    }
    for (candidate, reason) in &found.refused {
        let name = study.candidates()[*candidate].name.clone();
        let decided_by = decided_by(&name);
        list.push(Ambiguity { effects: vec![name], because: format!("not claimed: {reason}"), decided_by });
    }
    list.extend(study.ambiguities(&found.set));
    list
}

fn next_measurements(not_identifiable: &[Ambiguity]) -> Vec<String> {
    let mut list: Vec<String> = Vec::new();
    for ambiguity in not_identifiable {
        if !ambiguity.decided_by.is_empty() && !list.contains(&ambiguity.decided_by) {
            list.push(ambiguity.decided_by.clone());
        }
    }
    list
}
