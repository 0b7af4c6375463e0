//! The demo's figures in the form that the report crate draws.
//!
//! Place in the flow: last step. Verification errors are those of the samples taken from the live topic, not of an
//! offline correction.

use super::closing::Loop;
use super::live::{DIAGNOSES, Live};
use super::{MODEL, MODEL_IN_USE};
use crate::fitted::Fitted;
use crate::next::Next;
use crate::pipeline::{Identification, LoadedCampaign};
use crate::provenance;
use crate::verdict;
use crate::verification::{VerificationPoints, Verified, errors};
use abbe_files::{MachineFile, ModelFile, hex};
use abbe_geometry::Vector3;
use abbe_graph::launch::NodeName;
use abbe_identify::verdict::{Finding, Subject};
use abbe_msgs::CorrectedCoordinates;
use abbe_report::diagnosis::Both;
use abbe_report::{
    Callout, Closing, DemoReport, FileEntry, Identity, InUse, LiveFigures, RunHeader, StepDuration, Tone,
    VerificationPoint, digits, max_abs, rms,
};
use anyhow::ensure;
use std::path::Path;

/// Everything that was found.
pub(super) struct Facts<'a> {
    pub(super) who: Identity,
    pub(super) machine: &'a MachineFile,
    pub(super) loaded: &'a LoadedCampaign,
    pub(super) model: &'a ModelFile,
    pub(super) model_sha256: &'a [u8; 32],
    pub(super) found: &'a Identification,
    pub(super) points: &'a VerificationPoints,
    /// The same with the model that took over, where one did.
    pub(super) points_after_loop: Option<&'a VerificationPoints>,
    pub(super) live: &'a Live,
    pub(super) steps: &'a [(&'static str, f64)],
    pub(super) dds: bool,
    /// What to do next.
    pub(super) next: &'a Next,
}

/// The report's data.
pub(super) fn data(facts: &Facts) -> anyhow::Result<DemoReport> {
    let verified = live_errors(facts.points, &facts.live.points)?;
    let taken_over = facts.live.closing.as_ref().and_then(|closing| closing.taken_over.as_ref());
    let after_loop = match facts.points_after_loop.zip(taken_over) {
        Some((points, taken_over)) => live_errors(points, &taken_over.points)?,
        None => Vec::new(),
    };
    let closing = facts.live.closing.as_ref().map(closing);
    let point = |(k, verified): (usize, &Verified)| verification_point(verified, after_loop.get(k));
    Ok(DemoReport {
        header: header(facts, closing.as_ref()),
        verification: verified.iter().enumerate().map(point).collect(),
        verification_note: Some(
            "Points of another day that took no part in the fit, aligned rigidly to their reference before comparison. \
             The corrected positions are the samples received live from the corrected topic."
                .to_owned(),
        ),
        steps: facts.steps.iter().map(|(name, s)| StepDuration { name: (*name).to_owned(), duration_s: Some(*s) }).collect(),
        live: Some(live(facts)),
        closing,
        remarks: remarks(facts),
        ..Fitted { loaded: facts.loaded, model: facts.model, found: facts.found }.report()
    })
}

/// A short summary on standard output: the answer first.
pub(super) fn print(data: &DemoReport, out: &Path, next: &Next) {
    println!("3-D error at {} points that took no part in any fit (µm):", data.verification.len());
    for (state, errors) in data.errors_by_state_um() {
        let [rms, max] = [rms(&errors), max_abs(&errors)].map(|um| um.map_or_else(|| "-".to_owned(), digits::result));
        println!("  {state:<15} rms {rms:>6}  max {max:>6}");
    }
    for sentence in data.closing.iter().flat_map(Closing::sentences) {
        println!("{sentence}");
    }
    for remark in &data.remarks {
        println!("  {}: {}", remark.tone.word().to_lowercase(), remark.text);
    }
    println!("report: {}", out.join("report.html").display());
    next.print();
}

/// Verification errors, once the corrected positions that came over the live topic are those of the file.
fn live_errors(points: &VerificationPoints, live: &[CorrectedCoordinates]) -> anyhow::Result<Vec<Verified>> {
    ensure!(
        live.len() == points.corrected_m.len(),
        "{} of {} verification points came back from the live graph",
        live.len(),
        points.corrected_m.len()
    );
    for (number, (offline_m, sample)) in points.corrected_m.iter().zip(live).enumerate() {
        let live_m = sample.corrected_point_in_machine_m().map(Vector3::from);
        let same = live_m == Some(*offline_m);
        ensure!(same, "point {number}: live and offline correction differ; this must never happen");
    }
    errors(points)
}

fn verification_point(verified: &Verified, after_loop: Option<&Verified>) -> VerificationPoint {
    VerificationPoint {
        position_mm: verified.reading_m.map(|v| v * 1e3),
        before_um: (verified.before_m * 1e6).into(),
        after_um: Some((verified.after_m * 1e6).into()),
        after_loop_um: after_loop.map(|verified| (verified.after_m * 1e6).into()),
    }
}

/// How the loop went, for report and terminal.
fn closing(closing: &Loop) -> Closing {
    let without = "The monitor judged every reading and asked for no diagnosis";
    let outcome = closing.outcome.as_ref().map_or_else(|| without.to_owned(), |outcome| outcome.words.clone());
    let in_use = closing
        .taken_over
        .as_ref()
        .map(|taken_over| InUse { model_hash: taken_over.sha256.clone(), first_sample: taken_over.first_sample });
    let Some(record) = &closing.record else { return Closing { outcome, in_use, ..Closing::default() } };
    Closing {
        outcome,
        in_use,
        verdict: Some(record.verdict.clone()),
        effects: record.effects.clone(),
        set_aside: record.set_aside.clone(),
        errors: Some(Both { before: record.before.clone(), after: record.after.clone() }),
        folder: Some(format!("{DIAGNOSES}/0001")),
    }
}

fn header(facts: &Facts, closing: Option<&Closing>) -> RunHeader {
    let entry = |role: &str, name: &str| FileEntry { role: role.to_owned(), name: name.to_owned() };
    let in_use =
        closing.and_then(|closing| closing.in_use.as_ref()).map(|_| entry("model after the loop", MODEL_IN_USE));
    let mut what =
        "A tracer campaign identified the machine; the recording was then played through the nodes, and their \
                    corrected coordinates were compared with points whose position is known."
            .to_owned();
    for sentence in closing.iter().flat_map(|closing| closing.sentences()) {
        what = format!("{what} {sentence}");
    }
    RunHeader {
        title: format!("Live correction of {}", facts.machine.machine.name),
        what,
        identity: facts.who.clone(),
        next: Some(facts.next.step()),
        about: provenance::of_campaign(&facts.loaded.campaign, facts.machine.instrument)
            .iter()
            .map(|(what, words)| entry(what, words))
            .collect(),
        files: [
            Some(entry("campaign", &facts.loaded.source.file)),
            Some(entry("model", MODEL)),
            in_use,
            Some(entry("launch file", "launch.toml")),
            Some(entry("recording played", "recording")),
            Some(entry("recording of all topics", "corrected")),
        ]
        .into_iter()
        .flatten()
        .collect(),
        data_hash: Some(facts.loaded.source.sha256.clone()),
        model_hash: Some(hex(facts.model_sha256)),
        software_version: facts.model.software.clone(),
    }
}

fn live(facts: &Facts) -> LiveFigures {
    let sorted = &facts.live.latencies_us;
    let quantile = |share: f64| sorted.get((sorted.len() as f64 * share) as usize).copied();
    let transport = if facts.dds { "shared memory between the nodes, DDS for everyone else" } else { "shared memory" };
    LiveFigures {
        samples_sent: Some(facts.live.sent),
        samples_received: Some(facts.live.received),
        samples_lost: Some(facts.live.lost + facts.live.summaries.iter().map(|s| s.lost).sum::<u64>()),
        latency_p50_us: quantile(0.5),
        latency_p99_us: quantile(0.99),
        latency_p999_us: quantile(0.999),
        transport: Some(format!("{transport}; timed from the instant a sample was due at the scale node")),
    }
}

fn remarks(facts: &Facts) -> Vec<Callout> {
    let is_closed = facts.points_after_loop.is_some();
    let warning = |text: String| Callout { tone: Tone::Warning, title: String::new(), text };
    // What another model has answered.
    let is_answered = |finding: &&Finding| matches!(finding.subject, Subject::Noise { .. }) && is_closed;
    let findings = facts.found.verdict.findings.iter().filter(|finding| !is_answered(finding));
    let mut remarks: Vec<Callout> = findings.map(verdict::remark).collect();
    let extrapolated = facts.points.extrapolated();
    if extrapolated > 0 {
        remarks
            .push(warning(format!("{extrapolated} verification points lie outside the identified volume or offsets.")));
    }
    let after_loop = facts.points_after_loop.map_or(0, VerificationPoints::extrapolated);
    if after_loop > extrapolated {
        remarks.push(warning(format!(
            "{after_loop} verification points are extrapolated with the model after the loop: what it corrects by was \
             outside of the campaign's range there, and their uncertainty is a lower bound."
        )));
    }
    remarks.extend(failed_diagnoses(facts).map(warning));
    remarks
}

/// Diagnoses that the monitor could not even start.
fn failed_diagnoses(facts: &Facts) -> Option<String> {
    let monitor = facts.live.summaries.iter().find(|summary| summary.node == NodeName::Monitor.name())?;
    let failed = monitor.figures.get("diagnoses_failed").filter(|failed| **failed > 0.0)?;
    Some(format!("{failed} diagnoses of the monitor failed; its lines in the log say why."))
}
