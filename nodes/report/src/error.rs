//! What can be wrong with the data of a report.
//!
//! Every variant names the section (and the place in it), what is wrong and what to do.

use thiserror::Error;

/// Why a report could not be made.
#[derive(Debug, Error)]
pub enum ReportError {
    /// A number is NaN or infinite.
    #[error("section '{section}': {path} is {value}; a report shows finite numbers only, pass a missing value as None")]
    NotFinite {
        /// Title of the section.
        section: String,
        /// Path of the number inside the section.
        path: String,
        /// The number as text (`NaN`, `inf`, `-inf`).
        value: String,
    },
    /// The parts of a section do not fit together.
    #[error("section '{section}': {what}; {remedy}")]
    Shape {
        /// Title of the section.
        section: String,
        /// What does not fit.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// Finite numbers so large that a coordinate of the drawing overflowed.
    #[error(
        "section '{section}': a drawing coordinate overflowed; the numbers span too wide a range, check their unit"
    )]
    Overflow {
        /// Title of the section.
        section: String,
    },
    /// The report names no drawable main plot.
    #[error("main plot: {what}; set `main_plot` to the index of a section that is a figure")]
    MainPlot {
        /// What is wrong with the choice.
        what: String,
    },
    /// The main plot could not be rasterised.
    #[error("main plot: cannot rasterise to PNG: {what}; report this as a defect")]
    Raster {
        /// Message of the rasteriser.
        what: String,
    },
    /// The report could not be set as PDF.
    #[error("PDF: {what}")]
    Pdf {
        /// What is wrong, and what to do.
        what: String,
    },
    /// The data could not be serialised.
    #[error("'{section}': cannot serialise: {what}; use plain structs with text keys")]
    Serialise {
        /// Title of the section or data set.
        section: String,
        /// Message of the serialiser.
        what: String,
    },
}

impl ReportError {
    /// A shape error, shorter to write.
    pub(crate) fn shape(section: &str, what: impl Into<String>, remedy: &str) -> Self {
        Self::Shape { section: section.to_owned(), what: what.into(), remedy: remedy.to_owned() }
    }
}
