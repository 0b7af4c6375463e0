//! A diagnosis of the library as a record for report and JSON: metres to µm, figures that are none to `None`.
//!
//! Place in the flow: between `abbe-diagnose` and `abbe-report`, which do not know each other.

use abbe_diagnose as library;
use abbe_geometry::effects::{Shape, ShapeValue, known};
use abbe_report::diagnosis as shown;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// What each row of a campaign's held-out error was left out with.
const UNSEEN: &str = "lines that no step of the search saw";
const PLACEBO_UNIT: &str = "reduction of the mean square on lines left out, in units of the noise";

/// A number that JSON can hold.
pub(super) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Metres as micrometres.
pub(super) fn um(metres: f64) -> Option<f64> {
    finite(metres * 1e6)
}

pub(super) fn interval(scale: f64, (low, high): (f64, f64)) -> Option<(f64, f64)> {
    Some((finite(low * scale)?, finite(high * scale)?))
}

/// Effects of a campaign.
pub(super) fn effects(diagnosis: &library::Diagnosis) -> Vec<shown::Effect> {
    diagnosis.found.iter().map(effect).collect()
}

fn effect(found: &library::Found) -> shown::Effect {
    shown::Effect {
        name: found.name.to_owned(),
        title: found.title.to_owned(),
        kind: match found.kind {
            library::Explanation::Attributed => "attributed".to_owned(),
            library::Explanation::Empirical => "empirical".to_owned(),
        },
        formula: found.formula.to_owned(),
        shape: shape(&found.shape),
        covariates: found.covariates.clone(),
        p_value: finite(found.p_value),
        evidence: finite(found.evidence),
        alias_share: finite(found.alias_share),
        parameters: found.parameters.iter().map(parameter).collect(),
        held_out_gain_um: found.held_out_gain_m.and_then(um),
        placebo: found.placebo.as_ref().map_or_else(no_placebo, placebo),
        cannot_be_told_from: found.rivals.iter().map(rival).collect(),
        corrects: found.corrects,
        averaged_with: found.competing.iter().map(averaged).collect(),
        size_um: um(found.size_m),
        predicts: predicts(&found.gate),
    }
}

/// How an effect predicts what it was not fitted to.
fn predicts(verdict: &library::Verdict) -> shown::Predicts {
    let judged = |judged: &library::Judged| shown::LeftOut {
        by: judged.by.clone(),
        blocks: judged.blocks,
        without: finite(judged.before),
        with: finite(judged.after),
        deviations: finite(judged.deviations),
    };
    shown::Predicts { left_out: verdict.judged.iter().map(judged).collect(), not_judged: verdict.missing.clone() }
}

/// Candidates that stay out.
pub(super) fn set_aside(diagnosis: &library::Diagnosis) -> Vec<shown::SetAside> {
    let entry = |s: &library::SetAside| shown::SetAside {
        name: s.name.clone(),
        title: s.title.to_owned(),
        shape: shape(&s.shape),
        because: s.because.clone(),
    };
    diagnosis.set_aside.iter().map(entry).collect()
}

fn no_placebo() -> shown::Placebo {
    shown::Placebo {
        gain: None,
        unit: PLACEBO_UNIT.to_owned(),
        draws: 0,
        median: None,
        quantile_95: None,
        share_as_good: None,
    }
}

fn parameter(found: &library::FoundParameter) -> shown::Parameter {
    shown::Parameter {
        name: found.name.clone(),
        value: finite(found.value),
        unit: found.unit.to_owned(),
        u: finite(found.u),
        plausible: finite(found.plausible),
        is_plausible: found.is_plausible(),
    }
}

/// Name for readers of an effect of the registry.
pub(crate) fn title(name: &str) -> String {
    known(name).map_or(name, |known| known.title).to_owned()
}

fn rival(rival: &library::Rival) -> shown::Rival {
    let evidence_behind = finite(rival.evidence_behind);
    let (name, title) = (rival.name.to_owned(), title(rival.name));
    shown::Rival { name, title, shape: shape(&rival.shape), evidence_behind }
}

fn averaged(competing: &library::Competing) -> shown::Averaged {
    let (name, shape) = (competing.name.to_owned(), shape(&competing.shape));
    shown::Averaged { name, title: title(competing.name), shape, share: finite(competing.weight) }
}

fn placebo(placebo: &library::Placebo) -> shown::Placebo {
    let gains = abbe_report::sorted(&placebo.placebo_gains);
    let as_good = gains.iter().filter(|gain| **gain >= placebo.gain).count();
    shown::Placebo {
        gain: finite(placebo.gain),
        unit: PLACEBO_UNIT.to_owned(),
        draws: gains.len(),
        median: abbe_report::quantile_sorted(&gains, 0.5).and_then(finite),
        quantile_95: abbe_report::quantile_sorted(&gains, 0.95).and_then(finite),
        share_as_good: (!gains.is_empty()).then(|| (as_good + 1) as f64 / (gains.len() + 1) as f64),
    }
}

/// A shape as in the model file: figures in SI, names.
pub(crate) fn shape(shape: &Shape) -> BTreeMap<String, Value> {
    let value = |value: &ShapeValue| match value {
        ShapeValue::Number(number) => json!(number),
        ShapeValue::Text(text) => json!(text),
        ShapeValue::Numbers(numbers) => json!(numbers),
        ShapeValue::Texts(texts) => json!(texts),
    };
    shape.0.iter().map(|(key, entry)| (key.clone(), value(entry))).collect()
}

/// Error of both models but for verification points.
pub(super) fn errors(diagnosis: &library::Diagnosis) -> (shown::ErrorFigures, shown::ErrorFigures) {
    let of = |fit: &library::Detection, unseen: Option<library::HeldOutError>| shown::ErrorFigures {
        held_out_rms_um: unseen.and_then(|error| um(error.rms_m)),
        held_out_interval_um: unseen.and_then(|error| interval(1e6, error.interval_m)),
        chi2_per_dof: finite(fit.chi2_per_dof),
        residual_rms_um: um(fit.rms_m),
        ..shown::ErrorFigures::default()
    };
    let unseen = diagnosis.unseen.as_ref();
    let before = of(&diagnosis.detection_before, unseen.map(|u| u.before));
    (before, of(&diagnosis.detection_after, unseen.map(|u| u.after)))
}

/// How the error on unseen lines came about.
pub(super) fn held_out(diagnosis: &library::Diagnosis) -> shown::HeldOut {
    let blocked =
        |b: &library::Blocked| shown::Blocked { by: b.by.clone(), before: finite(b.before), after: finite(b.after) };
    let unseen = diagnosis.unseen.as_ref();
    shown::HeldOut {
        blocks: UNSEEN.to_owned(),
        missing_because: diagnosis.unseen_missing.clone(),
        not_judged: unseen.map_or_else(Vec::new, |u| u.not_judged.clone()),
        gain_interval_um2: unseen.and_then(|u| interval(1e12, u.gain_m2)),
        found_by_part: unseen.map_or_else(Vec::new, |u| u.found.clone()),
        blocked: diagnosis.blocked.iter().map(blocked).collect(),
    }
}

/// What the residual says of itself.
pub(super) fn detection(detection: &library::Detection) -> shown::Detection {
    let structure = |s: library::Structure| shown::Structure { value: finite(s.value), p_value: finite(s.p_value) };
    let group = |g: &library::Group| shown::Group {
        name: g.name.clone(),
        count: g.readings,
        mean_um: um(g.mean_m),
        mean_square: finite(g.mean_square),
    };
    shown::Detection {
        words: detection.verdict(),
        has_structure: Some(detection.has_structure()),
        chi2_per_dof: finite(detection.chi2_per_dof),
        p_declared: finite(detection.p_declared),
        estimated_over_declared: finite(detection.estimated_over_declared),
        estimated_sigma_um: None,
        rms_um: um(detection.rms_m),
        used: detection.readings.0,
        rejected: detection.readings.1,
        along_lines: Some(structure(detection.along_lines)),
        between_lines: Some(structure(detection.between_lines)),
        lack_of_fit: detection.lack_of_fit.map(structure),
        groups: detection.groups.iter().map(group).collect(),
    }
}

/// What the plan cannot tell.
pub(super) fn not_identifiable(diagnosis: &library::Diagnosis) -> Vec<shown::NotIdentifiable> {
    let entry = |n: &library::NotIdentifiable| shown::NotIdentifiable {
        name: n.name.to_owned(),
        title: title(n.name),
        shape: shape(&n.shape),
        alias_share: finite(n.alias_share),
        aliased_with: n.aliased_with.clone(),
        because: None,
        decided_by: n.decided_by.to_owned(),
    };
    diagnosis.not_identifiable.iter().map(entry).collect()
}

/// What needs a sensor.
pub(super) fn untestable(diagnosis: &library::Diagnosis) -> Vec<shown::Untestable> {
    let entry = |u: &library::Untestable| shown::Untestable {
        name: u.name.clone(),
        title: u.title.clone(),
        needs: u.needs.clone(),
    };
    diagnosis.untestable.iter().map(entry).collect()
}
