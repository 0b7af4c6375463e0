//! Findings of `abbe_identify::verdict` on their way to the user: refused, printed, stored.
//!
//! Place in the flow: every command whose fit can contradict itself asks here before it writes anything. A refusal is an
//! error (exit code 1) unless the user passed `--accept-misfit`; then it is a doubt in the model file, and whoever loads the
//! model reads it again.

use abbe_files::Doubt;
use abbe_identify::verdict::{Cause, Counted, Finding, Grade, Verdict, of_noise, of_rejected};
use abbe_report::{Callout, Section, Tone};
use serde_json::{Value, json};
use std::fmt;

/// The option that overrides a refusal.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(crate) struct Accept {
    /// Go on although the data contradict themselves; uncertainties are widened, and the result says so wherever it is used
    #[arg(long)]
    pub(crate) accept_misfit: bool,
}

/// Refuses what the verdict refuses, unless that is accepted; `rest` goes into the JSON of the refusal.
pub(crate) fn check(verdict: &Verdict, accept: Accept, source: &str, rest: impl Fn() -> Value) -> Result<(), Refused> {
    match verdict.refusal() {
        Some(reason) if !accept.accept_misfit => {
            let json = json!({ "refused": true, "findings": json(&verdict.findings), "evidence": rest() });
            Err(Refused { source_name: source.to_owned(), reason, json })
        }
        _ => Ok(()),
    }
}

/// What a command finds against its result beyond the findings that all fits have.
#[derive(Debug, Clone)]
pub(crate) struct Objection {
    /// How much it weighs.
    pub(crate) grade: Grade,
    /// What was found.
    pub(crate) finding: String,
    /// What would explain it, and what to do.
    pub(crate) causes: Vec<String>,
}

impl Objection {
    /// Refuses what is graded so, unless that is accepted; `rest` goes into the JSON of the refusal.
    pub(crate) fn check(&self, accept: Accept, source: &str, rest: impl Fn() -> Value) -> Result<(), Refused> {
        if self.grade < Grade::Refusal || accept.accept_misfit {
            return Ok(());
        }
        let json = json!({ "refused": true, "findings": [self.json()], "evidence": rest() });
        Err(Refused { source_name: source.to_owned(), reason: self.to_string(), json })
    }

    /// As one of the findings.
    pub(crate) fn json(&self) -> Value {
        json!({ "grade": self.grade.name(), "finding": self.finding, "likely_causes": self.causes })
    }

    /// A line for the terminal.
    pub(crate) fn words(&self) -> String {
        format!("  {:<17} {self}\n", in_capitals(self.grade))
    }

    /// The same for a report.
    pub(crate) fn callout(&self) -> Section {
        let text = self.to_string();
        Section::Callout(Callout { tone: tone(self.grade), title: title(self.grade).to_owned(), text })
    }
}

impl fmt::Display for Objection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.finding, self.causes.join("; "))
    }
}

/// Findings and objections together, for JSON.
pub(crate) fn with_objection(objection: Option<&Objection>, findings: &[Finding]) -> Value {
    let Value::Array(mut all) = json(findings) else { return Value::Null };
    all.splice(0..0, objection.map(Objection::json));
    Value::Array(all)
}

/// How a report heads a grade.
fn title(grade: Grade) -> &'static str {
    match grade {
        Grade::Message => "What the data say of themselves",
        Grade::Warning => "What speaks against it",
        Grade::Refusal => "Refused, and accepted all the same",
    }
}

/// How a terminal takes a grade.
fn in_capitals(grade: Grade) -> &'static str {
    match grade {
        Grade::Message => "note",
        Grade::Warning => "WARNING",
        Grade::Refusal => "ACCEPTED",
    }
}

/// Who asked for JSON gets all findings of a refusal; nothing else is written.
pub(crate) fn shown<T>(result: anyhow::Result<T>, as_json: bool) -> anyhow::Result<T> {
    if let Some(refused) = result.as_ref().err().and_then(|error| error.downcast_ref::<Refused>()).filter(|_| as_json) {
        println!("{}", serde_json::to_string_pretty(&refused.json)?);
    }
    result
}

/// A result that is not given.
#[derive(Debug)]
pub(crate) struct Refused {
    /// The file.
    source_name: String,
    reason: String,
    /// The findings as JSON, with what belongs to them.
    json: Value,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: refused: {}. Where that is known and meant (to let abbe diagnose look for the cause, say), --accept-misfit goes on all \
             the same: uncertainties are widened, and the result says so wherever it is used",
            self.source_name, self.reason
        )
    }
}

impl std::error::Error for Refused {}

/// The verdict of a fit that knows its noise and what it left out, and no more.
pub(crate) fn of_fit(noise: Option<(f64, usize)>, counted: Option<Counted>) -> Verdict {
    of_fit_because(noise, counted, vec![Cause::Scattered, Cause::Understated])
}

/// The same where the fit knows what may be behind what it left out.
pub(crate) fn of_fit_because(noise: Option<(f64, usize)>, counted: Option<Counted>, rejected: Vec<Cause>) -> Verdict {
    let noise = noise.and_then(|(chi2_per_dof, degrees)| {
        let causes = match chi2_per_dof > 1.0 {
            true => vec![Cause::Understated, Cause::Scattered],
            false => vec![Cause::Overstated, Cause::Computed],
        };
        of_noise(chi2_per_dof, degrees as f64, causes)
    });
    let rejected = counted.and_then(|counted| of_rejected(counted, rejected));
    Verdict::new([rejected, noise].into_iter().flatten().collect(), 1.0)
}

/// What a model file keeps: warnings, and refusals that were accepted.
pub(crate) fn doubts(verdict: &Verdict) -> Vec<Doubt> {
    let kept = verdict.findings.iter().filter(|finding| finding.grade > Grade::Message);
    kept.map(|finding| Doubt { grade: finding.grade.name().to_owned(), text: finding.to_string() }).collect()
}

/// The findings, gravest first.
pub(crate) fn json(findings: &[Finding]) -> Value {
    let one = |finding: &Finding| {
        json!({
            "grade": finding.grade.name(),
            "finding": finding.subject.to_string(),
            "likely_causes": finding.causes.iter().map(ToString::to_string).collect::<Vec<_>>(),
        })
    };
    Value::Array(findings.iter().map(one).collect())
}

/// How a report takes a grade: a note is no warning there either.
pub(crate) fn tone(grade: Grade) -> Tone {
    match grade {
        Grade::Message => Tone::Neutral,
        Grade::Warning => Tone::Warning,
        Grade::Refusal => Tone::Bad,
    }
}

/// A finding among others, for a report.
pub(crate) fn remark(finding: &Finding) -> Callout {
    let text = finding.to_string();
    Callout { tone: tone(finding.grade), title: String::new(), text }
}

/// One sentence a finding, for a report.
pub(crate) fn callouts(findings: &[Finding]) -> impl Iterator<Item = Section> {
    findings.iter().map(|finding| {
        let text = finding.to_string();
        Section::Callout(Callout { tone: tone(finding.grade), title: title(finding.grade).to_owned(), text })
    })
}

/// One line a finding, for the terminal.
pub(crate) fn words(findings: &[Finding]) -> String {
    let line = |finding: &Finding| format!("  {:<17} {}\n", in_capitals(finding.grade), finding);
    findings.iter().map(line).collect()
}
