//! Chapter "What the model lacked": what the monitor asked for, what the diagnosis said, which model took over.
//!
//! The same sentences stand on the terminal, under the page's title, on the PNG and in the JSON. They name the effect, its
//! size with its uncertainty, and what it could be confused with; where nothing was named, they say what was said instead.

use serde::{Deserialize, Serialize};

use super::DemoReport;
use super::build::heading;
use crate::diagnosis::{Both, Effect, ErrorFigures, Parameter, Rival, SetAside, readable};
use crate::sections::{Callout, Cell, Column, Section, TableSection, Tone};
use crate::stats::rms;
use crate::text::{fixed, integer, listed, significant};

/// Parameters of an effect, rivals and candidates set aside that a sentence names at most; the tables have all.
const NAMED: usize = 3;
/// From this share on an effect is said to be partly like geometry.
const PARTLY_ABSORBED: f64 = 0.5;

/// How the loop went.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Closing {
    /// What came of the diagnosis, as the monitor told it; that there was none, and why.
    pub outcome: String,
    /// The diagnosis's own answer; missing where there was none, or it failed.
    pub verdict: Option<String>,
    /// Effects that the model lacked.
    pub effects: Vec<Effect>,
    /// Candidates that explain the residual but stay out of the model.
    pub set_aside: Vec<SetAside>,
    /// Error on data left out and residual of the fit, with the model as it was and with everything found.
    pub errors: Option<Both<ErrorFigures>>,
    /// The model that took over; missing where none did.
    pub in_use: Option<InUse>,
    /// Folder of the diagnosis beside this report; it has a report of its own.
    pub folder: Option<String>,
}

/// The model that took over while the nodes ran.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct InUse {
    /// Hash of the model.
    pub model_hash: String,
    /// Number of the first sample that it corrected.
    pub first_sample: u64,
}

impl Closing {
    /// What was found, in sentences.
    pub fn sentences(&self) -> Vec<String> {
        let mut sentences: Vec<String> = self.effects.iter().flat_map(lacked).collect();
        if self.effects.is_empty() {
            sentences.push(self.verdict.clone().unwrap_or_else(|| format!("{}.", self.outcome)));
        } else if !self.set_aside.is_empty() {
            let titles: Vec<&str> = self.set_aside.iter().map(|aside| aside.title.as_str()).collect();
            sentences.push(format!("Set aside, with the reasons in the table: {}.", listed(&titles, NAMED, "; ")));
        }
        sentences
    }

    /// What the nodes did with the model that came out.
    fn taken_over(&self) -> String {
        match &self.in_use {
            Some(InUse { model_hash, first_sample }) => format!(
                "Model {} corrects from sample {} on; it went in while the nodes ran.",
                model_hash.chars().take(12).collect::<String>(),
                integer(i64::try_from(*first_sample).unwrap_or(i64::MAX))
            ),
            None => "The model in use stayed the same.".to_owned(),
        }
    }
}

/// What an effect is, how large, and what it looks like.
fn lacked(effect: &Effect) -> Vec<String> {
    let unexplained = if effect.kind == "empirical" { " (a dependence without a known cause)" } else { "" };
    let rms_um = effect.size_um.map(|um| format!("{} µm rms in the readings", significant(um, 2)));
    // The surest first: few are named.
    let mut parameters: Vec<&Parameter> = effect.parameters.iter().collect();
    parameters.sort_by(|a, b| surety(b).total_cmp(&surety(a)));
    let sizes: Vec<String> = parameters.into_iter().filter_map(size).collect();
    let sizes = [rms_um, (!sizes.is_empty()).then(|| format!("{} (k = 1)", listed(&sizes, NAMED, "; ")))];
    let sizes = sizes.into_iter().flatten().collect::<Vec<_>>().join("; ");
    let mut sentences = vec![format!("The model lacked: {}{unexplained}, {sizes}.", effect.label())];
    let rivals: Vec<String> = effect.cannot_be_told_from.iter().map(Rival::label).collect();
    sentences.push(match rivals.is_empty() {
        true => "No other effect explains these data nearly as well.".to_owned(),
        false => format!("These data cannot tell it from: {}.", listed(&rivals, NAMED, "; ")),
    });
    let share = effect.alias_share.filter(|share| *share >= PARTLY_ABSORBED);
    sentences.extend(share.map(|share| {
        format!(
            "Geometry could imitate {} % of it, so that its presence is surer than its size.",
            fixed(100.0 * share, 0)
        )
    }));
    sentences
}

/// By how many standard uncertainties a parameter is there; 0 where that is not known.
fn surety(parameter: &Parameter) -> f64 {
    let (value, u, ..) = readable(parameter);
    value.zip(u).filter(|(_, u)| *u > 0.0).map_or(0.0, |(value, u)| (value / u).abs())
}

/// A parameter with its uncertainty.
fn size(parameter: &Parameter) -> Option<String> {
    let (value, u, _, unit, decimals) = readable(parameter);
    Some(format!("{} {} ± {} {unit}", parameter.name, fixed(value?, decimals), fixed(u?, decimals)))
}

impl DemoReport {
    /// Adds the chapter where there is something to say.
    pub(super) fn add_closing(&self, sections: &mut Vec<Section>) {
        let Some(closing) = &self.closing else { return };
        let intro = "The monitor compares measured with predicted ranges while the nodes correct. A diagnosis of the readings \
                     that it kept looks for the cause; the verification points take no part in it.";
        sections.push(heading("What the model lacked", Some(intro)));
        let tone = if closing.in_use.is_some() { Tone::Good } else { Tone::Warning };
        let text = format!("{} {}", closing.sentences().join(" "), closing.taken_over());
        sections.push(Section::Callout(Callout { tone, title: String::new(), text }));
        sections.push(Section::Table(self.steps_of_the_loop(closing)));
        if !closing.effects.is_empty() {
            sections.push(Section::Table(parameters(closing)));
        }
        if closing.effects.iter().any(|effect| !effect.cannot_be_told_from.is_empty()) {
            sections.push(Section::Table(rivals(closing)));
        }
        if !closing.set_aside.is_empty() {
            sections.push(Section::Table(set_aside(closing)));
        }
        let report = closing.folder.as_ref().map(|folder| Callout {
            tone: Tone::Neutral,
            title: String::new(),
            text: format!("The diagnosis has a report of its own: {folder}/report.html."),
        });
        sections.extend(report.map(Section::Callout));
    }

    fn steps_of_the_loop(&self, closing: &Closing) -> TableSection {
        let verified: Vec<Option<f64>> = self.errors_by_state_um().iter().map(|(_, errors)| rms(errors)).collect();
        let figure = |of: fn(&ErrorFigures) -> Option<f64>| {
            closing.errors.as_ref().map_or([None, None], |e| [of(&e.before), of(&e.after)])
        };
        let row = |name: &str, [before, after]: [Option<f64>; 2]| {
            vec![Cell::text(name), Cell::result(before), Cell::result(after)]
        };
        let after_loop = verified.get(2).copied().flatten();
        TableSection {
            title: "Error with the model as it was, and with what was found".to_owned(),
            note: Some("Verification points score only: nothing was fitted, chosen or stopped by them.".to_owned()),
            columns: vec![
                Column::text("figure"),
                Column::number("geometry", "µm"),
                Column::number("with what was found", "µm"),
            ],
            rows: vec![
                row("verification error, 3-D, rms", [verified.get(1).copied().flatten(), after_loop]),
                row("range error on lines that no step of the search saw, rms", figure(|e| e.held_out_rms_um)),
                row("range residual of the fit, rms", figure(|e| e.residual_rms_um)),
                row("χ² per degree of freedom, declared noise (no unit)", figure(|e| e.chi2_per_dof)),
            ],
            total_rows: None,
        }
    }
}

fn parameters(closing: &Closing) -> TableSection {
    let all = closing.effects.iter().flat_map(|effect| effect.parameters.iter().map(move |p| (effect, p)));
    let row = |(effect, parameter): (&Effect, &crate::diagnosis::Parameter)| {
        let (value, u, _, unit, decimals) = readable(parameter);
        vec![
            Cell::text(effect.label()),
            Cell::text(&parameter.name),
            value.and_then(|value| Cell::text(fixed(value, decimals))),
            u.and_then(|u| Cell::text(fixed(u, decimals))),
            Cell::text(unit),
        ]
    };
    TableSection {
        title: "Size of what the model lacked".to_owned(),
        note: Some("u is the standard uncertainty (k = 1).".to_owned()),
        columns: vec![
            Column::text("effect"),
            Column::text("parameter"),
            Column::text("value"),
            Column::text("u"),
            Column::text("unit"),
        ],
        rows: all.map(row).collect(),
        total_rows: None,
    }
}

fn rivals(closing: &Closing) -> TableSection {
    let all = closing.effects.iter().flat_map(|e| e.cannot_be_told_from.iter().map(move |rival| (e, rival)));
    let row = |(effect, rival): (&Effect, &Rival)| {
        vec![Cell::text(effect.label()), Cell::text(rival.label()), Cell::maybe(rival.evidence_behind, 1)]
    };
    TableSection {
        title: "What it could be confused with".to_owned(),
        note: Some(
            "Each explains these data nearly as well; behind is twice the log likelihood that it lacks.".to_owned(),
        ),
        columns: vec![Column::text("found"), Column::text("rival"), Column::number("behind", "1")],
        rows: all.map(row).collect(),
        total_rows: None,
    }
}

fn set_aside(closing: &Closing) -> TableSection {
    let row = |aside: &SetAside| vec![Cell::text(&aside.title), Cell::text(&aside.because)];
    TableSection {
        title: "Set aside".to_owned(),
        note: None,
        columns: vec![Column::text("candidate"), Column::text("because")],
        rows: closing.set_aside.iter().map(row).collect(),
        total_rows: None,
    }
}
