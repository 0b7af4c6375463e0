//! The diagnosis under trial, as the bench asks it.
//!
//! Place in the flow: the bench's campaign goes into `abbe_diagnose::diagnose` with nothing else; what was found comes
//! back as name, shape and words.

use abbe_diagnose::{DiagnoseOptions, Diagnosis, Explanation, Found, diagnose};
use abbe_geometry::effects::{Shape, ShapeValue};
use abbe_geometry::machine::Machine;
use abbe_identify::OrderChoice;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_trials::{Diagnoser, Finding, TrialError, Verdict};

/// The project's diagnosis.
pub(crate) struct Real {
    /// Whether it also judges what it found on lines left out and against placebos, which takes most of its time and
    /// changes neither what is found nor the model.
    pub(crate) judges: bool,
}

impl Diagnoser for Real {
    fn diagnose(
        &self,
        machine: &Machine,
        instrument: RangeUncertainty,
        campaign: &Campaign,
        order: OrderChoice,
    ) -> Result<Verdict, TrialError> {
        let mut options = DiagnoseOptions::default();
        options.identify.order = order;
        if !self.judges {
            (options.folds, options.placebos) = (1, 0);
        }
        let diagnosis = diagnose(machine, &[], instrument, campaign, &options, &mut |_| true)
            .map_err(|problem| TrialError::Diagnosis(problem.to_string()))?;
        Ok(verdict(diagnosis))
    }
}

fn verdict(diagnosis: Diagnosis) -> Verdict {
    let not_identifiable = diagnosis
        .not_identifiable
        .iter()
        .map(|alias| format!("{} {} by {:.0} %", alias.name, words(&alias.shape), alias.alias_share * 100.0));
    Verdict {
        consistent_with_noise: diagnosis.consistent_with_noise,
        findings: diagnosis.found.iter().map(finding).collect(),
        not_identifiable: not_identifiable.collect(),
        steps: diagnosis.steps,
        chi2_per_dof: [diagnosis.before.evidence.chi2_per_dof, diagnosis.after.evidence.chi2_per_dof],
        model: diagnosis.model,
    }
}

fn finding(found: &Found) -> Finding {
    let rivals: Vec<String> = found
        .rivals
        .iter()
        .map(|rival| format!("{} {} {:.0} behind", rival.name, words(&rival.shape), rival.evidence_behind))
        .collect();
    let values: Vec<String> =
        found.parameters.iter().map(|p| format!("{} {:.3e} u {:.1e} {}", p.name, p.value, p.u, p.unit)).collect();
    Finding {
        effect: found.name.to_owned(),
        attributed: found.kind == Explanation::Attributed,
        shape: found.shape.0.iter().map(|(key, value)| (key.clone(), text(value))).collect(),
        detail: format!(
            "{} [{}] p {:.1e}, evidence {:.1}, alias {:.2}, {:.3} um; {}; rivals: {}",
            found.name,
            words(&found.shape),
            found.p_value,
            found.evidence,
            found.alias_share,
            found.size_m * 1e6,
            values.join(", "),
            if rivals.is_empty() { "none".to_owned() } else { rivals.join(", ") }
        ),
    }
}

fn words(shape: &Shape) -> String {
    shape.0.iter().map(|(key, value)| format!("{key}={}", text(value))).collect::<Vec<_>>().join(" ")
}

fn text(value: &ShapeValue) -> String {
    match value {
        ShapeValue::Number(number) => number.to_string(),
        ShapeValue::Text(text) => text.clone(),
        ShapeValue::Numbers(numbers) => numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(","),
        ShapeValue::Texts(texts) => texts.join(","),
    }
}
