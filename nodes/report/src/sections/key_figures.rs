//! Large figures side by side: the answer before the details.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::Tone;
use crate::digits;
use crate::text::{MISSING, capital, escape, fixed, prose};

/// A number and how many decimals of it are shown.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quantity {
    /// The number, in the unit named beside it.
    pub value: f64,
    /// Decimals shown.
    pub decimals: u8,
}

impl Quantity {
    /// A result without an uncertainty: three significant digits.
    pub fn result(value: f64) -> Self {
        Self { value, decimals: digits::of_result(value) }
    }

    /// An uncertainty: two significant digits.
    pub fn uncertainty(u: f64) -> Self {
        Self { value: u, decimals: digits::of_uncertainty(u) }
    }

    /// A value with the decimals of its uncertainty, or a result where that is not known.
    pub fn with(value: f64, uncertainty: Option<f64>) -> Self {
        Self { value, decimals: digits::of(value, uncertainty) }
    }

    /// The number as a page shows it.
    pub fn text(&self) -> String {
        fixed(self.value, self.decimals)
    }

    /// A number with its decimals.
    pub fn new(value: f64, decimals: u8) -> Self {
        Self { value, decimals }
    }
}

/// One large figure.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct KeyFigure {
    /// What it is.
    pub label: String,
    /// The same figure before the work, shown small in front of an arrow.
    pub before: Option<Quantity>,
    /// The figure; missing is shown as a dash.
    pub value: Option<Quantity>,
    /// Its unit; empty for a count or a ratio.
    pub unit: String,
    /// One line of context.
    pub detail: Option<String>,
    /// How it is to be taken.
    pub tone: Tone,
}

/// Large figures side by side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KeyFigures {
    /// Title, for errors and for screen readers.
    pub title: String,
    /// The figures in reading order.
    pub figures: Vec<KeyFigure>,
}

impl KeyFigures {
    /// HTML of the cards.
    pub(crate) fn html(&self) -> String {
        let mut out = format!("<section class=\"cards\" aria-label=\"{}\">\n", escape(&self.title));
        for figure in &self.figures {
            out.push_str(&figure.html());
        }
        out.push_str("</section>\n");
        out
    }
}

impl KeyFigure {
    /// The label as a page writes it: as a sentence begins.
    pub(crate) fn heading(&self) -> String {
        capital(&prose(&self.label))
    }

    fn html(&self) -> String {
        let mut out = format!(
            "<div class=\"card{}\"><div class=\"k\">{}</div><div class=\"v\">",
            self.tone.class(),
            escape(&self.heading())
        );
        if let Some(before) = self.before {
            let _ = write!(out, "<span class=\"b\">{} → </span>", fixed(before.value, before.decimals));
        }
        match self.value {
            Some(value) => out.push_str(&fixed(value.value, value.decimals)),
            None => out.push_str(MISSING),
        }
        if !self.unit.is_empty() {
            let _ = write!(out, "<span class=\"u\">{}</span>", escape(&self.unit));
        }
        out.push_str("</div>");
        if let Some(detail) = &self.detail {
            let _ = write!(out, "<div class=\"d\">{}</div>", escape(&prose(detail)));
        }
        out.push_str("</div>\n");
        out
    }
}
