//! Diagnosis of a tracer campaign with the model that it belongs to.
//!
//! Place in the flow: model file and campaign in; report, JSON and the model with what was found out. The model's own
//! machine, instrument, effects and options are the start.

use super::scoring::Points;
use super::{MODEL, Product, Request, name_of, pictures, record};
use crate::identity;
use crate::pipeline::{LoadedCampaign, evidence_json, load_campaign, software};
use crate::provenance;
use crate::verdict::{self, Accept};
use abbe_diagnose::{
    ClockShift, Departure, DiagnoseOptions, Diagnosis, Late, MachineStep, Progress, Wander, diagnose, mended,
};
use abbe_files::{Doubt, MachineFile, ModelFile, hex};
use abbe_geometry::model::MachineModel;
use abbe_graph::capture::identify_options;
use abbe_identify::Evidence;
use abbe_identify::verdict::{Cause, Grade, Subject, Verdict, of_campaign, widened};
use abbe_report::diagnosis::{Both, DiagnosisReport, File, ModelOut, Record};
use abbe_report::{Identity, digits};
use anyhow::{Context, bail, ensure};
use serde_json::{Value, json};
use std::path::Path;

/// Expansion of a metre or turn from which it is said (m/m or rad, k = 2): less than most machines are specified to.
const LEAST_HIDDEN: f64 = 1e-6;

/// A model file as it was given.
struct Given {
    file: ModelFile,
    sha256: [u8; 32],
    bytes: Vec<u8>,
}

impl Given {
    fn read(path: &Path) -> anyhow::Result<Given> {
        let name = path.display().to_string();
        let bytes = std::fs::read(path).with_context(|| format!("{name}: the model cannot be read"))?;
        let (file, sha256) = ModelFile::from_bytes(&bytes, &name)?;
        if file.residual_network.is_some() {
            bail!(
                "{name}: the model names a residual network, which this version cannot apply; use the version that made it"
            );
        }
        Ok(Given { file, sha256, bytes })
    }

    /// The machine file that the model was identified with, as far as it matters here.
    fn machine(&self) -> MachineFile {
        MachineFile {
            machine: self.file.model.parts().machine.clone(),
            instrument: self.file.instrument,
            absolute_range: self.file.absolute_range,
            order: self.file.order,
            identity: None,
        }
    }

    /// Options of the diagnosis; the model's own where it says how it was identified.
    fn options(&self, request: &Request) -> DiagnoseOptions {
        let usual = DiagnoseOptions::default();
        let robust = self.file.options.get("robust").and_then(Value::as_bool).unwrap_or(usual.identify.robust);
        let abbe_identify::IdentifyOptions { order, absolute_range, .. } = identify_options(&self.machine());
        DiagnoseOptions {
            identify: abbe_identify::IdentifyOptions { order, robust, absolute_range, ..usual.identify },
            folds: request.folds.unwrap_or(usual.folds),
            seed: request.seed,
            ..usual
        }
    }

    /// The same kind of file with another model in it.
    fn with(
        &self,
        model: MachineModel,
        loaded: &LoadedCampaign,
        options: &DiagnoseOptions,
        evidence: Value,
    ) -> ModelFile {
        ModelFile {
            model,
            order: self.file.order,
            instrument: self.file.instrument,
            absolute_range: self.file.absolute_range,
            residual_network: None,
            data: vec![loaded.source.clone()],
            seed: Some(options.seed),
            options: options_json(options),
            evidence,
            doubts: Vec::new(),
            software: software(),
        }
    }

    /// Whether its user accepted that it contradicts its data.
    fn was_accepted(&self) -> bool {
        self.file.doubts.iter().any(|doubt| doubt.grade == Grade::Refusal.name())
    }

    /// Whether the model that came out is the one that went in: the same structure from the same data.
    fn is_kept(&self, diagnosis: &Diagnosis, loaded: &LoadedCampaign) -> bool {
        let same_data = matches!(self.file.data.as_slice(), [only] if only.sha256 == loaded.source.sha256);
        let holds_slow = diagnosis.may_wander.is_none() || self.file.model.parts().quality.wanders.is_some();
        let nothing_new = diagnosis.found.is_empty()
            && holds_slow
            && !diagnosis.enriched
            && diagnosis.after.correlation.is_none()
            && diagnosis.machine_step.is_none()
            && diagnosis.wander.is_none()
            && diagnosis.clock.is_none()
            && !diagnosis.holds_aside;
        nothing_new && same_data
    }
}

/// Of quantities with one value at each station those that the model that comes out reads are told as what was found, or set aside.
fn without_what_is_read(verdict: &mut Verdict, reads: &[String]) {
    for finding in &mut verdict.findings {
        if let Subject::ByStation { names } = &mut finding.subject {
            names.retain(|name| !reads.contains(name));
        }
    }
    verdict.findings.retain(|finding| !matches!(&finding.subject, Subject::ByStation { names } if names.is_empty()));
}

/// That the machine changed, before the rest: no model is right on both sides of it.
fn stepped(diagnosis: &Diagnosis) -> Option<String> {
    diagnosis.machine_step.as_ref().map(MachineStep::words)
}

/// That a log goes by another clock: what follows it is no evidence.
fn out_of_time(diagnosis: &Diagnosis) -> Option<String> {
    diagnosis.clock.as_ref().map(ClockShift::words)
}

/// That it wanders, beside what was found.
fn wandered(diagnosis: &Diagnosis) -> Option<String> {
    diagnosis.wander.as_ref().map(Wander::words)
}

/// That it may wander, where noise explains that as well.
fn may_wander(diagnosis: &Diagnosis) -> Option<String> {
    diagnosis.may_wander.as_ref().map(Wander::words_of_doubt)
}

/// That what was found may be slow.
fn may_be_slow(diagnosis: &Diagnosis) -> Option<String> {
    diagnosis.slow.words()
}

/// That the last lines are off, and nothing was measured after them.
fn late(diagnosis: &Diagnosis) -> Option<String> {
    diagnosis.late.as_ref().map(Late::words)
}

/// That the machine is another one than the model says: the fit that a diagnosis begins with is a new one, and fits whatever somebody ran into.
fn is_another(departure: &Departure) -> String {
    format!(
        "The machine is not what the model given says: on this campaign its corrected points are {} µm from those of the model that comes out (rms, but \
         for a rigid motion), and {} µm is what both uncertainties let expect. What follows is said of a new fit. Find what changed the machine, and \
         use the model that is written here, or identify again.",
        digits::result(departure.rms_m * 1e6),
        digits::result(departure.expected_m * 1e6)
    )
}

/// How far the model given is from what this campaign shows; `None` where it was made of it.
fn departure(given: &Given, fit: &MachineModel, loaded: &LoadedCampaign) -> Option<Departure> {
    let is_its_own = given.file.data.iter().any(|data| data.sha256 == loaded.source.sha256);
    if is_its_own { None } else { Departure::of(&given.file.model, fit, &loaded.campaign) }
}

/// What expansions and turns may be hidden: it stands in U where the temperature is another one.
fn hidden(model: &MachineModel) -> Option<String> {
    let stretched = hidden_by(model.unseen_expansion_at_the_ends(), |[x, y, z]| {
        format!("the scales may stretch by {x}, {y} and {z} µm per metre of X, Y and Z")
    });
    let squareness = &model.parts().machine.squareness;
    let turned = hidden_by(model.unseen_turn_at_the_ends(), |values| {
        let each = squareness.iter().zip(values).map(|(own, value)| format!("{} by {value}", own.name));
        format!("squareness may change, {} µrad", each.collect::<Vec<String>>().join(", "))
    });
    let all: Vec<String> = stretched.into_iter().chain(turned).collect();
    (!all.is_empty()).then(|| {
        format!(
            "What goes with the temperature may hide in these data: at the coldest or warmest that was logged, {} (k = 2). U holds it there and \
             beyond, but for a shift that all points share, which the datum of a part takes out.",
            all.join(", and ")
        )
    })
}

/// Says what of three is worth saying (m/m or rad, k = 1).
fn hidden_by(open: [f64; 3], say: impl FnOnce([String; 3]) -> String) -> Option<String> {
    let is_worth = open.iter().any(|own| 2.0 * own >= LEAST_HIDDEN);
    is_worth.then(|| say(open.map(|own| digits::result(2e6 * own))))
}

/// Diagnoses a campaign; `observe` sees the progress and returns false to stop.
pub(crate) fn run(
    model: &Path,
    campaign: &Path,
    request: &Request,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> anyhow::Result<Product> {
    let given = Given::read(model)?;
    let mut loaded = load_campaign(campaign, &given.machine(), request.join)?;
    let (campaign, logs) = mended(&loaded.campaign);
    loaded.campaign = campaign;
    let options = given.options(request);
    ensure!(options.folds > 1, "--folds must be at least 2: one part is left out, the others are fitted");
    let points = request.verify.map(|path| Points::read(path, &given.file)).transpose()?;
    let parts = given.file.model.parts();
    let instrument = given.file.instrument;
    let diagnosis = diagnose(&parts.machine, &parts.effects, instrument, &loaded.campaign, &options, observe)
        .with_context(|| format!("{} with {}", loaded.source.file, name_of(model)))?;
    let mut verdict = of_campaign(&loaded.campaign, &diagnosis.after);
    // A model that was accepted with its misfit is diagnosed to find the cause of it: what is left then is said, not refused.
    let accept = Accept { accept_misfit: request.accept.accept_misfit || given.was_accepted() };
    verdict::check(&verdict, accept, &loaded.source.file, || evidence_json(&diagnosis.after.evidence))?;
    if let Some(step) = &diagnosis.machine_step {
        verdict.findings.iter_mut().for_each(|finding| finding.causes.retain(|cause| !is_within(cause, step)));
        // What readings across it contradict each other by is the step, which stands in U as it is.
        verdict.widening = 1.0;
    }
    without_what_is_read(&mut verdict, &diagnosis.model.reads());
    let identity = Identity {
        measured: loaded.days.map(|days| days.to_string()),
        temperature_c: identity::temperature_c(&loaded.campaign),
        ..Identity::default()
    };
    let mut record = recorded(&diagnosis, &given, model, &loaded, &options);
    record.verdict = std::iter::once(record.verdict.clone()).chain(logs).collect::<Vec<_>>().join(" ");
    caution(&mut record, &verdict);
    // A step of the machine is told as one; of what was found beside it, the model that comes out holds its share.
    let departure = departure(&given, &diagnosis.model, &loaded).filter(|_| diagnosis.machine_step.is_none());
    if let Some(departure) = departure {
        match departure.is_another() {
            true => record.verdict = format!("{} {}", is_another(&departure), record.verdict),
            false => record.notes.push(format!(
                "These data do not contradict the model given: on this campaign its corrected points are {} µm from those of the model that comes out \
                 (rms, but for a rigid motion), and {} µm is what both uncertainties let expect.",
                digits::result(departure.rms_m * 1e6),
                digits::result(departure.expected_m * 1e6)
            )),
        }
    }
    let labels: Vec<String> = record.effects.iter().map(abbe_report::diagnosis::Effect::label).collect();
    let residuals = pictures::residuals(&diagnosis, instrument, &loaded.campaign, &labels)?;
    let changed: Vec<String> = [stepped, out_of_time, wandered, may_wander, may_be_slow, late]
        .into_iter()
        .filter_map(|said| said(&diagnosis))
        .collect();
    let kept = given.is_kept(&diagnosis, &loaded);
    let evidence = [&diagnosis.before.evidence, &diagnosis.after.evidence].map(|e| evidence_of(e, &record));
    let [of_before, of_after] = evidence;
    let before = given.with(diagnosis.before.model, &loaded, &options, of_before);
    let after = widened(diagnosis.model, verdict.widening)?;
    let changed = changed.into_iter().map(|text| Doubt { grade: Grade::Warning.name().to_owned(), text });
    let doubts = changed.chain(verdict::doubts(&verdict)).collect();
    let mut after = ModelFile { doubts, ..given.with(after, &loaded, &options, of_after) };
    if let Some(points) = points {
        points.score(&mut record, &before, &after)?;
    }
    if let Some(text) = record.grown() {
        record.verdict = format!("{text} {}", record.verdict);
        after.doubts.push(Doubt { grade: Grade::Warning.name().to_owned(), text });
    }
    let (bytes, sha256) = if kept { (given.bytes.clone(), given.sha256) } else { after.to_bytes(MODEL)? };
    record.model_out =
        Some(ModelOut { file: File { file: MODEL.to_owned(), sha256: hex(&sha256) }, is_the_one_given: kept });
    Ok(Product {
        report: DiagnosisReport { record, residuals: Some(residuals), figures: Vec::new(), identity, next: None },
        model: Some(bytes),
        without_model: Vec::new(),
        is_partial: false,
    })
}

/// Whether a station that moved or lost its zero is the step of the machine: seen from there both are the same, and only one of them is to
/// be mended.
fn is_within(cause: &Cause, step: &MachineStep) -> bool {
    let (before, after) = step.readings;
    matches!(cause, Cause::Step { readings: (last, first), .. } if before < *last && *first <= after + 1)
}

/// What is still wrong with the whole stands before what was found in it.
fn caution(record: &mut Record, verdict: &Verdict) {
    // This is the command that may name it.
    let here = |text: String| text.replace(" that abbe diagnose may name", "");
    let doubts: Vec<String> = verdict::doubts(verdict).into_iter().map(|doubt| here(doubt.text)).collect();
    record.notes.extend(verdict.findings.iter().map(ToString::to_string));
    if !doubts.is_empty() {
        record.verdict = format!(
            "With care, since the data contradict themselves beside what follows: {}. {}",
            doubts.join("; "),
            record.verdict
        );
    }
}

/// Evidence of a fit, with what the diagnosis added to it.
fn evidence_of(evidence: &Evidence, record: &Record) -> Value {
    let mut value = evidence_json(evidence);
    let effects: Vec<Value> = record
        .effects
        .iter()
        .map(|e| json!({ "name": e.name, "kind": e.kind, "p_value": e.p_value, "alias_share": e.alias_share }))
        .collect();
    value["diagnosis"] = json!({ "verdict": record.verdict, "effects": effects });
    value
}

fn options_json(options: &DiagnoseOptions) -> Value {
    json!({
        "robust": options.identify.robust,
        "max_passes": options.identify.max_passes,
        "significance": options.significance,
        "least_evidence": options.least_evidence,
        "rival_margin": options.rival_margin,
        "folds": options.folds,
        "placebos": options.placebos,
    })
}

fn recorded(
    diagnosis: &Diagnosis,
    given: &Given,
    model: &Path,
    loaded: &LoadedCampaign,
    options: &DiagnoseOptions,
) -> Record {
    let (before, after) = record::errors(diagnosis);
    let mut record = Record {
        verdict: String::new(),
        consistent_with_noise: diagnosis.consistent_with_noise,
        only_correlated: diagnosis.only_correlated,
        enriched: diagnosis.enriched,
        effects: record::effects(diagnosis),
        set_aside: record::set_aside(diagnosis),
        not_adopted: diagnosis.not_adopted.clone(),
        before,
        after,
        held_out: record::held_out(diagnosis),
        verification: None,
        not_identifiable: record::not_identifiable(diagnosis),
        untestable: record::untestable(diagnosis),
        next_measurements: diagnosis.next_measurements.clone(),
        detection: Both {
            before: record::detection(&diagnosis.detection_before),
            after: record::detection(&diagnosis.detection_after),
        },
        steps: diagnosis.steps.clone(),
        ladder: Vec::new(),
        considered: Vec::new(),
        alternatives: Vec::new(),
        notes: hidden(&diagnosis.model).into_iter().collect(),
        data_kind: "tracer campaign".to_owned(),
        about: provenance::of_campaign(&loaded.campaign, given.file.instrument)
            .into_iter()
            .map(|(what, words)| (what.to_owned(), words))
            .collect(),
        machine: Some(given.file.model.parts().machine.name.clone()),
        model: Some(File { file: name_of(model), sha256: hex(&given.sha256) }),
        data: File { file: loaded.source.file.clone(), sha256: loaded.source.sha256.clone() },
        model_out: None,
        seed: options.seed,
        options: options_json(options),
        software: software(),
    };
    // Where something was found, the note has to do.
    let is_quiet = diagnosis.consistent_with_noise || diagnosis.only_correlated;
    let hidden = is_quiet.then(|| hidden(&diagnosis.model)).flatten();
    let sentences = [
        stepped(diagnosis),
        out_of_time(diagnosis),
        Some(record.words()),
        hidden,
        wandered(diagnosis),
        may_wander(diagnosis),
        may_be_slow(diagnosis),
        late(diagnosis),
    ];
    record.verdict = sentences.into_iter().flatten().collect::<Vec<_>>().join(" ");
    record
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_diagnose::Change;

    /// One verdict told to give the readings after a collision a station of their own, and to measure all of them again.
    #[test]
    fn regress_a_station_that_moved_where_the_machine_stepped_is_the_step() {
        let step = MachineStep {
            readings: (621, 647),
            times_s: (11_369.0, 11_788.0),
            change: Change::Angles,
            by: [(-60e-6, 1e-6); 3],
            p_value: 0.0,
            evidence: 900.0,
            size_m: 50e-6,
            outdoes_found: true,
        };
        let moved = |last: usize| Cause::Step {
            station: "S3".to_owned(),
            lines: ("S3-04".to_owned(), "S3-04".to_owned()),
            readings: (last, last + 1),
            times_s: (11_773.0, 11_788.0),
            moved_m: None,
            dead_path_m: 65e-6,
            explains: 52,
        };
        let is_the_step = |last: usize| is_within(&moved(last), &step);
        assert!(is_the_step(647) && is_the_step(622));
        assert!(!is_the_step(648) && !is_the_step(621));
    }
}
