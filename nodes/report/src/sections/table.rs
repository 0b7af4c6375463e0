//! A table: numbers aligned at the right, every numeric column with its unit, missing cells as a dash. A column of nothing but
//! dashes tells nothing and is left out of the page; the JSON has it.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use crate::error::ReportError;
use crate::text::{MISSING, escape, fixed, integer, prose};

/// Texts longer than this wrap inside their cell.
const WRAP_CHARS: usize = 30;

/// A column.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// Heading.
    pub name: String,
    /// Unit of a column of numbers (`1` for a pure number or a count); `None` for a column of text.
    pub unit: Option<String>,
}

impl Column {
    /// A column of text.
    pub fn text(name: impl Into<String>) -> Self {
        Self { name: name.into(), unit: None }
    }

    /// A column of numbers in a unit.
    pub fn number(name: impl Into<String>, unit: impl Into<String>) -> Self {
        Self { name: name.into(), unit: Some(unit.into()) }
    }
}

/// A cell that is not missing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell {
    /// Text, in a column without unit.
    Text(String),
    /// A whole number.
    Integer(i64),
    /// A number with its decimals.
    Number(super::Quantity),
}

impl Cell {
    /// A text cell.
    pub fn text(text: impl Into<String>) -> Option<Self> {
        Some(Self::Text(text.into()))
    }

    /// A number cell.
    pub fn number(value: f64, decimals: u8) -> Option<Self> {
        Some(Self::Number(super::Quantity { value, decimals }))
    }

    /// A result without an uncertainty: three significant digits; missing if the number is.
    pub fn result(value: Option<f64>) -> Option<Self> {
        value.map(|value| Self::Number(super::Quantity::result(value)))
    }

    /// An uncertainty: two significant digits; missing if the number is.
    pub fn uncertainty(u: Option<f64>) -> Option<Self> {
        u.map(|u| Self::Number(super::Quantity::uncertainty(u)))
    }

    /// A value with the decimals of its uncertainty, or a result where that is not known; missing if the number is.
    pub fn with(value: Option<f64>, uncertainty: Option<f64>) -> Option<Self> {
        value.map(|value| Self::Number(super::Quantity::with(value, uncertainty)))
    }

    /// A number cell, missing if the number is.
    pub fn maybe(value: Option<f64>, decimals: u8) -> Option<Self> {
        value.and_then(|v| Self::number(v, decimals))
    }

    /// A cell with a count.
    pub fn count(count: usize) -> Option<Self> {
        // A count beyond 9.2e18 cannot occur in memory.
        Some(Self::Integer(i64::try_from(count).unwrap_or(i64::MAX)))
    }
}

/// A table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TableSection {
    /// Title above the table.
    pub title: String,
    /// Sentence under the title.
    pub note: Option<String>,
    /// Columns.
    pub columns: Vec<Column>,
    /// Rows, one cell a column; `None` is a missing value.
    pub rows: Vec<Vec<Option<Cell>>>,
    /// Rows there are in all, when only the first ones are given here; the table then says so.
    pub total_rows: Option<usize>,
}

impl TableSection {
    /// Refuses rows of another length and numbers in a column without unit.
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        for (index, row) in self.rows.iter().enumerate() {
            if row.len() != self.columns.len() {
                let what = format!("row {index} has {} cells, there are {} columns", row.len(), self.columns.len());
                return Err(ReportError::shape(&self.title, what, "give every row one cell a column"));
            }
            for (column, cell) in self.columns.iter().zip(row) {
                let number = matches!(cell, Some(Cell::Number(_) | Cell::Integer(_)));
                if number && column.unit.as_deref().is_none_or(str::is_empty) {
                    let what = format!("column '{}' holds numbers but names no unit", column.name);
                    return Err(ReportError::shape(&self.title, what, "name the unit, '1' for a pure number"));
                }
            }
        }
        if self.total_rows.is_some_and(|total| total < self.rows.len()) {
            let what = format!("total_rows is below the {} rows given", self.rows.len());
            return Err(ReportError::shape(&self.title, what, "pass the count of all rows or None"));
        }
        Ok(())
    }

    /// HTML of the table.
    pub(crate) fn html(&self) -> String {
        let mut out = String::from("<section>\n");
        if !self.title.is_empty() {
            let _ = writeln!(out, "<h3>{}</h3>", escape(&self.title));
        }
        if let Some(note) = &self.note {
            let _ = writeln!(out, "<p class=\"note\">{}</p>", escape(&prose(note)));
        }
        if self.rows.is_empty() {
            out.push_str("<p class=\"missing\">None.</p>\n</section>\n");
            return out;
        }
        out.push_str("<div class=\"scroll\"><table>\n<thead><tr>");
        let is_told: Vec<bool> =
            (0..self.columns.len()).map(|k| self.rows.iter().any(|row| row[k].is_some())).collect();
        for (column, _) in self.columns.iter().zip(&is_told).filter(|(_, told)| **told) {
            out.push_str(&column.html());
        }
        out.push_str("</tr></thead>\n<tbody>\n");
        for row in &self.rows {
            out.push_str("<tr>");
            for (place, ((column, cell), _)) in
                self.columns.iter().zip(row).zip(&is_told).enumerate().filter(|(_, (_, told))| **told)
            {
                out.push_str(&cell_html(column, cell.as_ref(), place));
            }
            out.push_str("</tr>\n");
        }
        out.push_str("</tbody></table></div>\n");
        if let Some(total) = self.total_rows.filter(|&total| total > self.rows.len()) {
            let _ = writeln!(
                out,
                "<p class=\"note\">The first {} of {} rows; all of them are in the JSON file.</p>",
                self.rows.len(),
                total
            );
        }
        out.push_str("</section>\n");
        out
    }
}

impl Column {
    fn html(&self) -> String {
        match &self.unit {
            Some(unit) if unit == "1" => format!("<th scope=\"col\" class=\"num\">{}</th>", escape(&self.name)),
            Some(unit) => format!(
                "<th scope=\"col\" class=\"num\">{}<span class=\"u\">{}</span></th>",
                escape(&self.name),
                escape(unit)
            ),
            None => format!("<th scope=\"col\">{}</th>", escape(&self.name)),
        }
    }
}

/// A text in a column: the first column names what figures name too, and is left as it is.
pub(crate) fn shown(text: &str, column: usize) -> String {
    if column == 0 { text.to_owned() } else { prose(text) }
}

fn cell_html(column: &Column, cell: Option<&Cell>, place: usize) -> String {
    let class = if column.unit.is_some() { " class=\"num\"" } else { "" };
    match cell {
        None => format!("<td{class}><span class=\"missing\">{MISSING}</span></td>"),
        Some(Cell::Text(text)) if text.chars().count() > WRAP_CHARS => {
            format!("<td class=\"wrap\">{}</td>", escape(&shown(text, place)))
        }
        Some(Cell::Text(text)) => format!("<td{class}>{}</td>", escape(&shown(text, place))),
        Some(Cell::Integer(value)) => format!("<td{class}>{}</td>", integer(*value)),
        Some(Cell::Number(q)) => format!("<td{class}>{}</td>", fixed(q.value, q.decimals)),
    }
}
