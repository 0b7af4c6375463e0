//! From a diagnosis to its page: the answer, the figures, the pictures, then evidence and limits.

use super::DiagnosisReport;
use super::names::for_readers;
use super::record::{Effect, Record};
use super::tables::label;
use crate::report::{MetaItem, Report};
use crate::sections::{Callout, Heading, KeyFigure, KeyFigures, Quantity, Section, Tone};
use crate::text::{listed, significant};

/// Effects that a sentence names.
const NAMED: usize = 4;
/// Share of an effect that the model's own parameters could imitate from which its size is doubted on the first screen.
const MOSTLY_GEOMETRY: f64 = 0.5;

pub(super) fn report(diagnosis: &DiagnosisReport) -> Report {
    let told = DiagnosisReport { record: for_readers(&diagnosis.record), ..diagnosis.clone() };
    let (diagnosis, record) = (&told, &told.record);
    let mut sections = vec![Section::Callout(record.answer()), Section::KeyFigures(record.key_figures())];
    sections.extend(record.warnings().into_iter().chain(record.not_told()).map(Section::Callout));
    effects(diagnosis, &mut sections);
    evidence(diagnosis, &mut sections);
    limits(record, &mut sections);
    search(record, &mut sections);
    Report {
        title: "Diagnosis".to_owned(),
        lead: Some(format!("What the model lacks, from {} ({}).", record.data.file, record.data_kind)),
        identity: diagnosis.identity.clone(),
        next: diagnosis.next.clone(),
        meta: record.meta(),
        main_plot: None,
        footer: Some(record.footer()),
        sections,
    }
}

fn heading(title: &str, intro: Option<&str>) -> Section {
    Section::Heading(Heading { title: title.to_owned(), intro: intro.map(str::to_owned) })
}

fn effects(diagnosis: &DiagnosisReport, sections: &mut Vec<Section>) {
    let record = &diagnosis.record;
    if record.effects.is_empty() {
        return;
    }
    sections.push(heading("What was found", None));
    if let Some(residuals) = &diagnosis.residuals {
        sections.extend(residuals.effects());
    }
    sections.push(record.effects_table());
    sections.push(record.parameters_table());
    sections.push(record.formulas_table());
    sections.extend(record.placebo_table());
    sections.extend(record.predicts_table());
    sections.extend(record.rivals_table());
    sections.extend(record.averaged_table());
    sections.extend(record.ladder_table());
    sections.extend(record.alternatives_table());
}

fn evidence(diagnosis: &DiagnosisReport, sections: &mut Vec<Section>) {
    let record = &diagnosis.record;
    sections.push(heading("Is the residual noise?", Some(&record.detection_words())));
    sections.extend(record.detection_table());
    sections.extend(diagnosis.figures.iter().cloned());
    if let Some(residuals) = &diagnosis.residuals {
        sections.extend(residuals.by_group(record.is_one_state()));
        sections.extend(residuals.over_time(record.is_one_state()));
    }
    sections.extend(record.groups_table());
    sections.extend(record.blocked_table());
}

fn limits(record: &Record, sections: &mut Vec<Section>) {
    sections.push(heading("What these data cannot tell", None));
    sections.extend(record.set_aside_table());
    sections.push(record.not_identifiable_table());
    sections.push(record.untestable_table());
    let note = "Most useful first.";
    let empty = "No measurement was found that would decide more.";
    sections.push(Record::list_or("Next measurements", Some(note), "measurement", &record.next_measurements, empty));
}

fn search(record: &Record, sections: &mut Vec<Section>) {
    sections.push(heading("How it was found", None));
    let empty = "Nothing was added: no candidate explains more than chance does.";
    sections.push(Record::list_or("Steps of the search", None, "step", &record.steps, empty));
    sections.extend(record.considered_table());
    if !record.notes.is_empty() {
        sections.push(Record::list("Notes", None, "note", &record.notes));
    }
}

/// Parameters of an effect beyond what is plausible.
fn implausible(effect: &Effect) -> Vec<String> {
    let beyond = effect.parameters.iter().filter(|parameter| !parameter.is_plausible);
    beyond.map(|parameter| format!("{} of {}", parameter.name, label(effect))).collect()
}

/// One sentence for what limits several effects in the same way; nothing where it limits none.
fn together(effects: &[Effect], said: &str, of: impl Fn(&Effect) -> Option<String>) -> Option<String> {
    let list: Vec<String> = effects.iter().filter_map(of).collect();
    (!list.is_empty()).then(|| format!("{said}: {}.", list.join("; ")))
}

impl Record {
    fn answer(&self) -> Callout {
        let (tone, title) = match (self.effects.is_empty() && !self.enriched, self.consistent_with_noise) {
            (true, true) => (Tone::Good, "Consistent with noise"),
            (true, false) if self.only_correlated => (Tone::Neutral, "Correlated noise, and no effect"),
            (true, false) => (Tone::Warning, "Not noise, and not attributed"),
            (false, _) if self.effects.is_empty() => (Tone::Neutral, "Finer error functions"),
            (false, _) => (Tone::Neutral, "The model lacks something"),
        };
        // What the sentence begins with is not said twice.
        let is_said = ["Consistent with noise", "The model lacks"].iter().any(|begin| self.verdict.starts_with(begin));
        let title = if is_said { String::new() } else { title.to_owned() };
        Callout { tone, title, text: self.verdict.clone() }
    }

    fn key_figures(&self) -> KeyFigures {
        let quantity = |value: Option<f64>| value.map(Quantity::result);
        let interval = |before: Option<(f64, f64)>, after: Option<(f64, f64)>| {
            let one = |(low, high)| format!("{} to {}", significant(low, 3), significant(high, 3));
            match (before, after) {
                (Some(before), Some(after)) if before == after => format!("95 %: {}", one(after)),
                (Some(before), Some(after)) => format!("95 %: {} → {}", one(before), one(after)),
                _ => "no interval".to_owned(),
            }
        };
        let (before, after) = (&self.before, &self.after);
        let held_out = match &self.held_out.missing_because {
            Some(reason) => reason.clone(),
            None => format!(
                "{}; {}",
                self.held_out.blocks,
                interval(before.held_out_interval_um, after.held_out_interval_um)
            ),
        };
        // Where nothing was added, before and after are one.
        let is_same = self.is_one_state();
        let figure = |label: &str, b: Option<f64>, a: Option<f64>, unit: &str, detail: String| KeyFigure {
            label: label.to_owned(),
            before: quantity(b).filter(|_| !is_same),
            value: quantity(a),
            unit: unit.to_owned(),
            detail: Some(detail),
            tone: Tone::Neutral,
        };
        let (b, a) = (before.held_out_rms_um, after.held_out_rms_um);
        let mut figures = vec![figure("Error on data left out, rms", b, a, "µm", held_out)];
        if let Some(verification) = &self.verification {
            let detail = format!(
                "3-D, {} points of {}; {}",
                verification.points,
                verification.file.file,
                interval(before.verify_interval_um, after.verify_interval_um)
            );
            let (b, a) = (before.verify_rms_um, after.verify_rms_um);
            figures.push(figure("Verification error, rms", b, a, "µm", detail));
            let (b, a) = (before.verify_max_um, after.verify_max_um);
            figures.push(figure("Verification error, largest", b, a, "µm", "the same points".to_owned()));
        }
        let (b, a) = (before.chi2_per_dof, after.chi2_per_dof);
        let detail = "1 where the declared uncertainties explain the residual".to_owned();
        figures.push(figure("χ² per degree of freedom", b, a, "", detail));
        let (b, a) = (before.residual_rms_um, after.residual_rms_um);
        let detail = format!("{} used, {} rejected", self.detection.after.used, self.detection.after.rejected);
        figures.push(figure("Residual of the fit, rms", b, a, "µm", detail));
        // A figure that these data do not give tells nothing.
        figures.retain(|figure| figure.value.is_some());
        KeyFigures { title: "Key figures".to_owned(), figures }
    }

    fn warnings(&self) -> Vec<Callout> {
        let warning = |text: String| Callout { tone: Tone::Warning, title: String::new(), text };
        let mut all: Vec<Callout> = Vec::new();
        let implausible: Vec<String> = self.effects.iter().flat_map(implausible).collect();
        all.extend((!implausible.is_empty()).then(|| {
            warning(format!(
                "Outside what such a parameter can be, so that another cause may look like it: {}.",
                implausible.join("; ")
            ))
        }));
        let rivals = |e: &Effect| Some(format!("{} from {}", label(e), e.rivals()?));
        all.extend(together(&self.effects, "The data do not tell what explains them best", rivals).map(warning));
        let imitated = |e: &Effect| {
            let share = e.alias_share.filter(|share| *share >= MOSTLY_GEOMETRY)?;
            Some(format!("{:.0} % of {}", 100.0 * share, label(e)))
        };
        let said = "Geometry could imitate much of what was found, so that its presence is surer than its size";
        all.extend(together(&self.effects, said, imitated).map(warning));
        let not_judged = |e: &Effect| {
            let words = e.predicts.not_judged.join("; ");
            (!words.is_empty()).then(|| format!("{}, {words}", label(e)))
        };
        all.extend(together(&self.effects, "Not judged where it was not fitted", not_judged).map(warning));
        all.extend(self.held_out.not_judged.iter().cloned().map(warning));
        if let Some(v) = self.verification.as_ref().filter(|v| v.covariate_missing > 0) {
            all.push(warning(format!(
                "{} of {} verification points lack a covariate that the model needs; they count, corrected without \
                 the effect.",
                v.covariate_missing, v.points
            )));
        }
        if let Some(v) = self.verification.as_ref().filter(|v| v.extrapolated > 0) {
            all.push(warning(format!(
                "{} of {} verification points are extrapolated: a reading, an offset or a logged quantity is beyond what the model was identified \
                 in. abbe verify says which.",
                v.extrapolated, v.points
            )));
        }
        all
    }

    /// What these data cannot tell, in short: the tables of the last chapters have all of it.
    fn not_told(&self) -> Option<Callout> {
        let mut hidden: Vec<&str> = self.not_identifiable.iter().map(|hidden| hidden.name.as_str()).collect();
        // An effect of several axes stands once.
        hidden.dedup();
        let untested: Vec<&str> = self.untestable.iter().map(|effect| effect.name.as_str()).collect();
        let said = |what: &str, names: &[&str]| {
            (!names.is_empty()).then(|| format!("{what}: {}.", listed(names, NAMED, ", ")))
        };
        let parts = [
            said("Taken up by the model's own parameters if they are there", &hidden),
            said("Not tested, for want of a sensor, a column or a move", &untested),
            self.next_measurements.first().map(|next| format!("Most useful next: {next}.")),
        ];
        let text = parts.into_iter().flatten().collect::<Vec<_>>().join(" ");
        let title = "What these data cannot tell".to_owned();
        (!text.is_empty()).then_some(Callout { tone: Tone::Neutral, title, text })
    }

    fn meta(&self) -> Vec<MetaItem> {
        let file = |label: &str, file: &super::File| MetaItem::file(label, &file.file, Some(&file.sha256));
        let mut meta = vec![MetaItem::new("Kind of data", &self.data_kind)];
        meta.extend(self.about.iter().map(|(what, words)| MetaItem::new(what, words)));
        meta.push(file("Data", &self.data));
        meta.extend(self.model.iter().map(|model| file("Model before", model)));
        meta.extend(self.model_out.iter().map(|out| match out.is_the_one_given {
            true => MetaItem::new("Model after", "the model given"),
            false => file("Model after", &out.file),
        }));
        meta.extend(self.verification.iter().map(|points| file("Verification (scoring only)", &points.file)));
        meta.push(MetaItem::new("Seed", self.seed.to_string()));
        meta.push(MetaItem::software(&self.software));
        meta
    }

    fn footer(&self) -> String {
        let short = |hash: &str| hash.chars().take(16).collect::<String>();
        let mut parts = vec![self.software.clone(), format!("data {}", short(&self.data.sha256))];
        parts.extend(self.model.iter().map(|model| format!("model before {}", short(&model.sha256))));
        parts.extend(self.model_out.iter().map(|model| format!("model after {}", short(&model.file.sha256))));
        parts.join("  ·  ")
    }
}
