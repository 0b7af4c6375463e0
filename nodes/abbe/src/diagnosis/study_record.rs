//! A study of the library as a record for report and JSON.
//!
//! Place in the flow: as `record`, for data without a tracer. Root mean squares come in µm already.

use super::record::finite;
use abbe_diagnose::study as library;
use abbe_report::{diagnosis as shown, digits};
use serde_json::json;
use std::collections::BTreeMap;

const GAIN_UNIT: &str = "reduction of the rms on blocks left out, in µm";

/// Everything but the pictures.
pub(super) fn record(
    diagnosis: &library::StudyDiagnosis,
    data: shown::File,
    options: &library::StudyOptions,
    seed: u64,
    software: String,
) -> shown::Record {
    let mut record = shown::Record {
        verdict: String::new(),
        consistent_with_noise: diagnosis.consistent_with_noise,
        only_correlated: false,
        enriched: false,
        effects: diagnosis.effects.iter().map(effect).collect(),
        set_aside: Vec::new(),
        not_adopted: None,
        before: errors(&diagnosis.before, diagnosis.unseen.before.as_ref()),
        after: errors(&diagnosis.after, diagnosis.unseen.after.as_ref()),
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
        notes: notes(diagnosis),
        data_kind: diagnosis.of.to_owned(),
        about: Vec::new(),
        machine: None,
        model: None,
        data,
        model_out: None,
        seed,
        options: json!({
            "significance": options.significance,
            "most_effects": options.most_effects,
            "instrument_checked": options.instrument_checked,
        }),
        software,
    };
    record.verdict = verdict(&record, diagnosis);
    record
}

/// The answer, and on what it rests.
fn verdict(record: &shown::Record, diagnosis: &library::StudyDiagnosis) -> String {
    let mut words = record.words();
    let is_open = |look: &&library::Look| look.is_noise != Some(true);
    let open: Vec<String> = diagnosis.looked.iter().filter(is_open).map(look).collect();
    if diagnosis.consistent_with_noise && !open.is_empty() {
        words = format!("{words} Not all is told by them: {}.", open.join("; "));
    } else if diagnosis.effects.is_empty() && !open.is_empty() {
        words = format!("{words} Looked at: {}.", open.join("; "));
    }
    if diagnosis.consistent_with_noise {
        words.extend(diagnosis.noise.iter().filter_map(hangs_together));
    } else if !diagnosis.effects.is_empty() && diagnosis.unseen.is_sure == Some(false) {
        words.push_str(" That gain is not sure: the parts differ by as much.");
    }
    if !diagnosis.contradictions.is_empty() {
        words = format!("{words} The data contradict themselves: {}.", diagnosis.contradictions.join("; "));
        if !diagnosis.effects.is_empty() {
            words.push_str(" What was found is a mean of these, and its u knows nothing of that.");
        }
    }
    words.extend(diagnosis.hidden.iter().map(|what| format!(" Not seen, and in no uncertainty: {what}.")));
    // A row of a file of vectors has three.
    let what = if diagnosis.of == library::vectors::OF { "components" } else { "rows" };
    match diagnosis.rejected.len() {
        0 => words,
        count => format!("{words} {count} of {} {what} were rejected as gross errors.", diagnosis.rows),
    }
}

/// What noise is called so although neighbours are alike: nothing is said of it where they may be independent.
fn hangs_together(noise: &library::SeriesNoise) -> Option<String> {
    let found = noise.neighbours.filter(|found| found.interval.0 > 0.0)?;
    Some(format!(
        " The noise of {} is {} µm a row, and neighbours in order of measurement correlate by {:.2} (95 %: {:.2} to {:.2}): a drift \
         or a jump as slow as that would look the same.",
        noise.of,
        two_digits(noise.sigma_um),
        found.value,
        found.interval.0,
        found.interval.1
    ))
}

fn two_digits(value: f64) -> String {
    let decimals = if value >= 10.0 { 0 } else { usize::from(value < 1.0) + 1 };
    format!("{value:.decimals$}")
}

fn look(look: &library::Look) -> String {
    format!("{}: {}", look.what, look.says)
}

/// What a reader must know: what was looked at, the noise, the rows rejected, and what the kind of data asks for.
fn notes(diagnosis: &library::StudyDiagnosis) -> Vec<String> {
    let mut notes = diagnosis.notes.clone();
    notes.extend(diagnosis.looked.iter().map(|own| format!("Looked at: {}.", look(own))));
    notes.extend(diagnosis.noise.iter().map(|noise| {
        let of = format!("Noise of {}: {} µm a row over {} rows", noise.of, digits::result(noise.sigma_um), noise.rows);
        match noise.neighbours {
            None => format!("{of}; too few to tell a correlation."),
            Some(found) => format!(
                "{of}, neighbours in order of measurement correlate by {:.2} (95 %: {:.2} to {:.2}); tests and \
                 uncertainties hold under that.",
                found.value, found.interval.0, found.interval.1
            ),
        }
    }));
    notes.extend(diagnosis.rejected.iter().map(|row| {
        format!(
            "Rejected: {}, {} µm off, {:.0} standard deviations.",
            row.name,
            digits::result(row.residual_um),
            row.deviations
        )
    }));
    notes
}

fn effect(effect: &library::Effect) -> shown::Effect {
    let rival = |name: &String| shown::Rival {
        name: name.clone(),
        title: String::new(),
        shape: BTreeMap::new(),
        evidence_behind: None,
    };
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
        // Tests in the noise found take the place of placebos here: few blocks cannot be exchanged often enough.
        placebo: shown::Placebo {
            gain: finite(effect.held_out_gain_um),
            unit: GAIN_UNIT.to_owned(),
            draws: 0,
            median: None,
            quantile_95: None,
            share_as_good: None,
        },
        cannot_be_told_from: effect.rivals.iter().map(rival).collect(),
        corrects: true,
        averaged_with: Vec::new(),
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

/// Error on blocks that no step of the search saw, beside figures of the fit to all.
fn errors(judgement: &library::Judgement, unseen: Option<&library::HeldOutRms>) -> shown::ErrorFigures {
    shown::ErrorFigures {
        held_out_rms_um: unseen.and_then(|unseen| finite(unseen.rms_um)),
        held_out_interval_um: unseen.and_then(|unseen| interval(unseen.interval_um)),
        chi2_per_dof: judgement.chi2_per_dof.and_then(finite),
        residual_rms_um: finite(judgement.rms_um),
        ..shown::ErrorFigures::default()
    }
}

fn held_out(diagnosis: &library::StudyDiagnosis) -> shown::HeldOut {
    let (blocks, unseen) = (&diagnosis.blocks, &diagnosis.unseen);
    let what = match unseen.chosen_on_all {
        false => "data that no step of the search saw",
        true => "data that its fit did not see, while the search that chose what to fit did",
    };
    let each = format!("{} in {} parts, each block a {}", blocks.count, unseen.folds, blocks.what);
    shown::HeldOut {
        blocks: format!("{what} ({each})"),
        missing_because: unseen.missing_because.clone(),
        not_judged: unseen.not_judged.clone(),
        found_by_part: unseen.found.clone(),
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
        used: diagnosis.rows - diagnosis.rejected.len(),
        rejected: diagnosis.rejected.len(),
        lack_of_fit: p.map(p_value),
        ..shown::Detection::default()
    };
    shown::Both {
        before: of(&diagnosis.before, test.map(|t| t.p_before)),
        after: of(&diagnosis.after, test.and_then(|t| t.p_after)),
    }
}

fn words(judgement: &library::Judgement, replicates: Option<&str>, p: Option<f64>) -> String {
    let scatter = format!("The residual is {} µm rms", digits::result(judgement.rms_um));
    let declared = match judgement.chi2_per_dof {
        Some(chi2) => {
            format!("{scatter}, χ² per degree of freedom {} with the declared uncertainties", digits::result(chi2))
        }
        None => format!("{scatter}; no uncertainties are declared"),
    };
    match (replicates, p) {
        (Some(of), Some(p)) => {
            format!("{declared}; against {of} the misfit has probability {} by chance.", digits::chance(p))
        }
        _ => format!("{declared}."),
    }
}

fn steps(diagnosis: &library::StudyDiagnosis) -> Vec<String> {
    let step = |rung: &library::Rung| {
        let added = rung.added.as_ref()?;
        let p = rung.p_value.map_or_else(String::new, |p| format!(", probability by chance {}", digits::chance(p)));
        Some(format!(
            "added {added}{p}: error on blocks left out {} µm (the choice of effects saw them)",
            digits::result(rung.judgement.held_out.rms_um)
        ))
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
        title: String::new(),
        shape: BTreeMap::new(),
        alias_share: None,
        aliased_with: names.collect(),
        because: Some(ambiguity.because.clone()),
        decided_by: ambiguity.decided_by.clone(),
    }
}

fn untestable(untestable: &library::Untestable) -> shown::Untestable {
    shown::Untestable { name: untestable.name.clone(), title: String::new(), needs: untestable.needs.clone() }
}
