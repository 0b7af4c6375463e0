//! A report: title, what it is about, sections; and its three forms HTML, PNG and JSON.

use serde::{Deserialize, Serialize};

use crate::error::ReportError;
use crate::finite::check_finite;
use crate::identity::Identity;
use crate::sections::{Section, Tone};
use crate::text::capital;

/// What a page was made from: a file, a hash, a version.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct MetaItem {
    /// Name of the item.
    pub label: String,
    /// Its text; where it is missing, the line is left out of the page.
    pub value: Option<String>,
}

impl MetaItem {
    /// What is known.
    pub fn new(label: impl Into<String>, value: impl Into<String>) -> Self {
        Self { label: label.into(), value: Some(value.into()) }
    }

    /// A file by its name, without folder, with its hash where that is known.
    pub fn file(label: impl Into<String>, name: &str, sha256: Option<&str>) -> Self {
        let hash = sha256.map_or_else(String::new, |hash| format!(", SHA-256 {hash}"));
        Self::new(label, format!("{name}{hash}"))
    }

    /// Name and version of the program.
    pub fn software(name: impl Into<String>) -> Self {
        Self::new("Software", name)
    }
}

/// The one sensible thing to do with the answer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NextStep {
    /// What it is for, as the rest of a sentence: `to hold it against known points`.
    pub what_for: String,
    /// The command, with files by their names; what nobody can know but the reader stands in capitals.
    pub command: String,
}

/// A report.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Title of page and PNG.
    pub title: String,
    /// One sentence under the title.
    pub lead: Option<String>,
    /// Who, when and which, right under the title.
    #[serde(default)]
    pub identity: Identity,
    /// What to do next, right after the answer and what limits it.
    #[serde(default)]
    pub next: Option<NextStep>,
    /// What the page was made from, at its end.
    pub meta: Vec<MetaItem>,
    /// Index of the section that the PNG shows; it must be a figure.
    pub main_plot: Option<usize>,
    /// Last line of PNG and PDF, e.g. software version and hashes; of the page where nothing is told of what it was made from.
    pub footer: Option<String>,
    /// Sections in reading order.
    pub sections: Vec<Section>,
}

/// Callouts before the next command, so that it stands on the first screen; further ones follow it.
const CALLOUTS: usize = 3;

impl Report {
    /// Refuses numbers that are not finite and parts that do not fit together.
    ///
    /// # Errors
    /// [`ReportError`] naming the section and the place in it.
    pub fn check(&self) -> Result<(), ReportError> {
        check_finite(&self.title, &self.identity)?;
        self.sections.iter().try_for_each(Section::check)
    }

    /// Sections that hold the answer and its limits: key figures and callouts before anything else.
    pub(crate) fn opening(&self) -> usize {
        let is_opening = |section: &&Section| matches!(section, Section::KeyFigures(_) | Section::Callout(_));
        self.sections.iter().take_while(is_opening).count()
    }

    /// Sections before the next command and right after it, by their places: the answer, what failed and the first callouts that
    /// limit it stand before it. A callout above the figures is the answer itself.
    pub(crate) fn first_screen(&self) -> (Vec<usize>, Vec<usize>) {
        let opening = 0..self.opening();
        let figures = opening.clone().find(|place| matches!(self.sections[*place], Section::KeyFigures(_)));
        let mut callouts = 0;
        opening.partition(|place| match &self.sections[*place] {
            Section::Callout(callout) if figures.is_none_or(|figures| figures < *place) => {
                callouts += 1;
                callouts <= CALLOUTS || callout.tone == Tone::Bad
            }
            _ => true,
        })
    }

    /// What the page was made from, as far as it is known: label and text.
    pub(crate) fn made_from(&self) -> Vec<(String, &str)> {
        self.meta.iter().filter_map(|item| Some((capital(&item.label), item.value.as_deref()?))).collect()
    }

    /// The report's sections as JSON, missing values as `null`.
    ///
    /// # Errors
    /// As [`Report::check`].
    pub fn json(&self) -> Result<String, ReportError> {
        self.check()?;
        to_json(&self.title, self)
    }
}

/// Any data as indented JSON that ends with a newline; refuses numbers that are not finite.
///
/// # Errors
/// [`ReportError::NotFinite`] naming `name` and the path; [`ReportError::Serialise`] for maps without text keys.
pub fn to_json<T: Serialize>(name: &str, data: &T) -> Result<String, ReportError> {
    check_finite(name, data)?;
    let mut text = serde_json::to_string_pretty(data)
        .map_err(|error| ReportError::Serialise { section: name.to_owned(), what: error.to_string() })?;
    text.push('\n');
    Ok(text)
}
