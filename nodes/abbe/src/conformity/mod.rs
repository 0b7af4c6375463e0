//! Acceptance tests: figures of ISO 10360-2, -5 and ISO 230-2, -6 from files or from the virtual machine.
//!
//! Place in the flow: `abbe conformity` calls one of [`lengths`], [`sphere`], [`runs`] and [`simulated`]; each gives a
//! [`Product`]: words for the terminal, JSON, and a report. Observed figures come first and stand without any limit.

pub(crate) mod dcc;
pub(crate) mod lengths;
pub(crate) mod pictures;
pub(crate) mod runs;
pub(crate) mod simulated;
pub(crate) mod sphere;

use crate::exit::Ended;
use abbe_conformity::{DecisionRule, Departure, MaximumPermissibleError, PermissibleError, TestUncertainty, Verdict};
use abbe_files::AtomicFile;
use abbe_report::{Callout, Report, Section, Tone};
use anyhow::{Context, ensure};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// Names in the output folder.
pub(crate) const REPORT: &str = "report.html";
pub(crate) const FIGURES: &str = "conformity.json";

/// What a test gives.
pub(crate) struct Product {
    /// Summary for a terminal.
    pub(crate) words: String,
    /// All figures.
    pub(crate) json: Value,
    /// The report.
    pub(crate) report: Report,
    /// The verdict on all limits that were given.
    pub(crate) verdict: Option<Verdict>,
    /// What the touches that a model corrected were worth, where not all are inside what it knows.
    pub(crate) outside: Option<Outside>,
    /// Figures for a certificate.
    pub(crate) figures: Vec<Figure>,
    /// The standard whose test it is, and what a whole test after it has and the data lack.
    pub(crate) method: (&'static str, Vec<String>),
}

/// A figure of a certificate.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Figure {
    /// What it is.
    pub(crate) name: String,
    /// Its value (m).
    pub(crate) value_m: f64,
    /// Expanded uncertainty of the test (m, k = 2), where it was stated.
    pub(crate) expanded_m: Option<f64>,
    /// Limit that was given (m), and what the verdict is.
    pub(crate) limit_m: Option<f64>,
    /// The verdict on this limit, and the rule that it was decided by.
    pub(crate) verdict: Option<(Verdict, DecisionRule)>,
}

/// Touches outside what a model knows.
pub(crate) struct Outside {
    pub(crate) words: String,
    /// An error where all of them are, by a model that was given.
    pub(crate) judged: Result<(), Ended>,
}

/// The verdict on several limits: one that is not kept decides, then one that is not proved.
pub(crate) fn worst(verdicts: impl IntoIterator<Item = Option<Verdict>>) -> Option<Verdict> {
    verdicts.into_iter().flatten().max()
}

/// Limits as the user stated them, all optional.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Limits {
    pub(crate) length: Option<MaximumPermissibleError>,
    pub(crate) repeatability: Option<PermissibleError>,
    pub(crate) form: Option<PermissibleError>,
    pub(crate) size: Option<PermissibleError>,
}

/// The decision rule: with an uncertainty of the test, ISO 14253-1; without one, simple acceptance.
pub(crate) fn rule(uncertainty: Option<&str>) -> anyhow::Result<DecisionRule> {
    let Some(text) = uncertainty else { return Ok(DecisionRule::SimpleAcceptance) };
    let form = MaximumPermissibleError::from_text(text).context("--uncertainty")?;
    ensure!(form.cap_m().is_none(), "--uncertainty {text:?}: min( ) makes no sense for an uncertainty; write A+L/K");
    Ok(DecisionRule::GuardBand(TestUncertainty::expanded(form.constant_m(), form.per_metre())?))
}

/// A limit in micrometres from an option.
pub(crate) fn limit_um(option: &str, value: Option<f64>) -> anyhow::Result<Option<PermissibleError>> {
    value
        .map(|um| {
            ensure!(
                um.is_finite() && um > 0.0 && um < 1000.0,
                "{option} {um}: give a limit in micrometres, above zero"
            );
            Ok(PermissibleError::from_metres(um / 1e6))
        })
        .transpose()
}

/// Expanded uncertainty of the test at a length (µm, k = 2), where it was stated.
pub(crate) fn expanded_um(rule: &DecisionRule, length_m: f64) -> Option<f64> {
    match rule {
        DecisionRule::GuardBand(uncertainty) => Some(um(uncertainty.at_m(length_m))),
        DecisionRule::SimpleAcceptance => None,
    }
}

/// A verdict as a word of JSON.
pub(crate) fn verdict_word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Conforms => "conforms",
        Verdict::Undecided => "undecided",
        Verdict::DoesNotConform => "does_not_conform",
    }
}

/// A verdict as people read it.
pub(crate) fn verdict_in_words(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Conforms => "conforms",
        Verdict::Undecided => "neither conformity nor nonconformity is proved",
        Verdict::DoesNotConform => "does not conform",
    }
}

/// A verdict as a tone.
pub(crate) fn tone(verdict: Verdict) -> Tone {
    match verdict {
        Verdict::Conforms => Tone::Good,
        Verdict::Undecided => Tone::Warning,
        Verdict::DoesNotConform => Tone::Bad,
    }
}

/// Micrometres.
pub(crate) fn um(metres: f64) -> f64 {
    metres * 1e6
}

/// Which file was judged, after what was found.
pub(crate) fn data_words(path: &Path) -> String {
    format!("  data           {}\n", path.display())
}

/// What a whole test after the standard has and the data lack, in words.
pub(crate) fn departure_words(standard: &str, departures: &[Departure]) -> String {
    if departures.is_empty() {
        return format!("  a whole test after {standard}\n");
    }
    let mut text = format!("  not a whole test after {standard}, so that nothing is verified by it:\n");
    for departure in departures {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "    {departure}");
    }
    text
}

/// The same for JSON.
pub(crate) fn departure_json(departures: &[Departure]) -> Value {
    departures.iter().map(|d| json!({ "place": d.place, "text": d.text })).collect()
}

/// The same for the report.
pub(crate) fn departure_callout(standard: &str, departures: &[Departure]) -> Section {
    let (tone, title, text) = if departures.is_empty() {
        (Tone::Good, "Whole test", format!("The data hold all that {standard} asks for."))
    } else {
        let list = by_text(departures).join("; ");
        (Tone::Warning, "Not a whole test", format!("Nothing is verified by it after {standard}, because of {list}."))
    };
    Section::Callout(Callout { tone, title: title.to_owned(), text })
}

/// Departures with the places that share each.
fn by_text(departures: &[Departure]) -> Vec<String> {
    let mut list: Vec<(String, &str)> = Vec::new();
    for Departure { place, text } in departures {
        match list.iter_mut().find(|(_, known)| known == text) {
            Some((places, _)) => *places = format!("{places}, {place}"),
            None => list.push((place.clone(), text)),
        }
    }
    list.into_iter().map(|(places, text)| format!("{places}: {text}")).collect()
}

/// Writes report and figures; each appears whole.
pub(crate) fn write(folder: &Path, product: &Product) -> anyhow::Result<()> {
    ensure!(!folder.exists() || folder.is_dir(), "--out {}: this is a file; name a folder", folder.display());
    let html = product.report.html()?;
    let json = serde_json::to_string_pretty(&product.json)? + "\n";
    std::fs::create_dir_all(folder).with_context(|| format!("{}: the folder cannot be made", folder.display()))?;
    let mut files = Vec::new();
    for (name, content) in [(REPORT, html), (FIGURES, json)] {
        let path = folder.join(name);
        let mut file = AtomicFile::create(&path)?;
        file.write_all(content.as_bytes()).with_context(|| format!("{}: cannot be written", path.display()))?;
        files.push(file);
    }
    Ok(files.into_iter().try_for_each(AtomicFile::commit)?)
}
