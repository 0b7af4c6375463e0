//! A study of the library as a record for report and JSON.
//!
//! Place in the flow: as `record`, for data without a tracer. Root mean squares come in µm already.

use super::record::finite;
use abbe_diagnose::study as library;
use abbe_report::diagnosis as shown;
use serde_json::json;
use std::collections::BTreeMap;

const PLACEBO_UNIT: &str = "reduction of the rms on blocks left out, in um";

/// Everything but the pictures.
pub(super) fn record(
    diagnosis: &library::StudyDiagnosis,
    data: shown::File,
    options: &library::Options,
    software: String,
) -> shown::Record {
    let mut record = shown::Record {
        verdict: String::new(),
        consistent_with_noise: diagnosis.consistent_with_noise,
        enriched: false,
        effects: diagnosis.effects.iter().map(effect).collect(),
        set_aside: Vec::new(),
        not_adopted: None,
        before: errors(&diagnosis.before),
        after: errors(&diagnosis.after),
        held_out: held_out(diagnosis),
        verification: None,
        not_identifiable: diagnosis.not_identifiable.iter().map(not_identifiable).collect(),
        untestable: diagnosis.untestable.iter().map(untestable).collect(),
        next_measurements: diagnosis.next_measurements.clone(),
        detection: detection(diagnosis),
        steps: steps(diagnosis),
        ladder: diagnosis.ladder.iter().map(rung).collect(),
        considered: diagnosis.considered.iter().map(considered).collect(),
        alternatives: diagnosis.alternatives.iter().map(alternative).collect(),
        notes: diagnosis.notes.clone(),
        data_kind: diagnosis.of.to_owned(),
        about: Vec::new(),
        machine: None,
        model: None,
        data,
        model_out: None,
        seed: options.seed,
        options: json!({
            "significance": options.significance,
            "placebo_draws": options.placebo_draws,
            "most_effects": options.most_effects,
        }),
        software,
    };
    record.verdict = record.words();
    record
}

fn effect(effect: &library::Effect) -> shown::Effect {
    let rival = |name: &String| shown::Rival { name: name.clone(), shape: BTreeMap::new(), evidence_behind: None };
    shown::Effect {
        name: effect.name.clone(),
        title: effect.name.clone(),
        kind: effect.kind.word().to_owned(),
        formula: effect.formula.clone(),
        shape: BTreeMap::new(),
        covariates: effect.covariates.clone(),
        p_value: finite(effect.p_value),
        evidence: None,
        alias_share: finite(effect.alias_share),
        parameters: effect.parameters.iter().map(parameter).collect(),
        held_out_gain_um: finite(effect.held_out_gain_um),
        placebo: shown::Placebo {
            gain: finite(effect.held_out_gain_um),
            unit: PLACEBO_UNIT.to_owned(),
            draws: effect.placebo.draws,
            median: finite(effect.placebo.median_gain_um),
            quantile_95: finite(effect.placebo.gain_95_um),
            share_as_good: finite(effect.placebo.share_as_good),
        },
        cannot_be_told_from: effect.rivals.iter().map(rival).collect(),
        size_um: None,
        predicts: shown::Predicts::default(),
    }
}

fn parameter(parameter: &library::Parameter) -> shown::Parameter {
    shown::Parameter {
        name: parameter.name.clone(),
        value: finite(parameter.value),
        unit: parameter.unit.to_owned(),
        u: finite(parameter.u),
        plausible: finite(parameter.plausible),
        is_plausible: parameter.is_plausible(),
    }
}

fn interval(interval: Option<(f64, f64)>) -> Option<(f64, f64)> {
    interval.and_then(|(low, high)| Some((finite(low)?, finite(high)?)))
}

fn errors(judgement: &library::Judgement) -> shown::ErrorFigures {
    shown::ErrorFigures {
        held_out_rms_um: finite(judgement.held_out.rms_um),
        held_out_interval_um: interval(judgement.held_out.interval_um),
        chi2_per_dof: judgement.chi2_per_dof.and_then(finite),
        residual_rms_um: finite(judgement.rms_um),
        ..shown::ErrorFigures::default()
    }
}

fn held_out(diagnosis: &library::StudyDiagnosis) -> shown::HeldOut {
    let blocks = &diagnosis.blocks;
    shown::HeldOut {
        // The effects were chosen on all the data: few data cannot spare a part of them for that as well.
        blocks: format!(
            "data left out of the fit, {} of {} at a time (the choice of effects saw them)",
            blocks.what, blocks.count
        ),
        ..shown::HeldOut::default()
    }
}

fn detection(diagnosis: &library::StudyDiagnosis) -> shown::Both<shown::Detection> {
    let test = diagnosis.lack_of_fit.as_ref();
    let p_value = |p: f64| shown::Structure { value: None, p_value: finite(p) };
    let of = |judgement: &library::Judgement, p: Option<f64>| shown::Detection {
        words: words(judgement, test.map(|t| t.of.as_str()), p),
        has_structure: None,
        chi2_per_dof: judgement.chi2_per_dof.and_then(finite),
        estimated_sigma_um: finite(judgement.estimated_sigma_um),
        rms_um: finite(judgement.rms_um),
        used: diagnosis.rows,
        lack_of_fit: p.map(p_value),
        ..shown::Detection::default()
    };
    shown::Both {
        before: of(&diagnosis.before, test.map(|t| t.p_before)),
        after: of(&diagnosis.after, test.and_then(|t| t.p_after)),
    }
}

fn words(judgement: &library::Judgement, replicates: Option<&str>, p: Option<f64>) -> String {
    let scatter = format!("The residual is {:.3} um rms", judgement.rms_um);
    let declared = match judgement.chi2_per_dof {
        Some(chi2) => format!("{scatter}, chi2/dof {chi2:.3} with the declared uncertainties"),
        None => format!("{scatter}; no uncertainties are declared"),
    };
    match (replicates, p) {
        (Some(of), Some(p)) => format!("{declared}; against {of} the misfit has probability {p:.1e} by chance."),
        _ => format!("{declared}."),
    }
}

fn steps(diagnosis: &library::StudyDiagnosis) -> Vec<String> {
    let step = |rung: &library::Rung| {
        let added = rung.added.as_ref()?;
        let p = rung.p_value.map_or_else(String::new, |p| format!(" at p = {p:.1e}"));
        Some(format!("added {added}{p}: error on blocks left out {:.3} um", rung.judgement.held_out.rms_um))
    };
    diagnosis.ladder.iter().filter_map(step).collect()
}

fn rung(rung: &library::Rung) -> shown::Rung {
    shown::Rung {
        added: rung.added.clone(),
        held_out_rms_um: finite(rung.judgement.held_out.rms_um),
        held_out_interval_um: interval(rung.judgement.held_out.interval_um),
        residual_rms_um: finite(rung.judgement.rms_um),
        p_value: rung.p_value.and_then(finite),
        alias_share: rung.alias_share.and_then(finite),
        parameters: rung.parameters.iter().map(parameter).collect(),
    }
}

fn considered(considered: &library::Considered) -> shown::Considered {
    shown::Considered {
        name: considered.name.clone(),
        kind: considered.kind.word().to_owned(),
        tested: considered.tested,
        p_value: finite(considered.p_value),
        p_holm: finite(considered.p_holm),
        evidence: finite(considered.evidence),
        alias_share: finite(considered.alias_share),
    }
}

fn alternative(alternative: &library::Alternative) -> shown::Alternative {
    shown::Alternative {
        effects: alternative.effects.clone(),
        held_out_rms_um: finite(alternative.judgement.held_out.rms_um),
        held_out_interval_um: interval(alternative.judgement.held_out.interval_um),
        p_value: finite(alternative.p_value),
        evidence: finite(alternative.evidence),
    }
}

fn not_identifiable(ambiguity: &library::Ambiguity) -> shown::NotIdentifiable {
    let mut names = ambiguity.effects.iter().cloned();
    shown::NotIdentifiable {
        name: names.next().unwrap_or_default(),
        shape: BTreeMap::new(),
        alias_share: None,
        aliased_with: names.collect(),
        because: Some(ambiguity.because.clone()),
        decided_by: ambiguity.decided_by.clone(),
    }
}

fn untestable(untestable: &library::Untestable) -> shown::Untestable {
    shown::Untestable { name: untestable.name.clone(), needs: untestable.needs.clone() }
}
