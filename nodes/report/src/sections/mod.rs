//! Sections a report is made of: one file for each kind, holding its data, its checks and its drawing.
//!
//! In: numbers in the unit that the section's own axis or column names. Out: HTML or SVG elements.

mod bars;
mod boxes;
mod callout;
mod cell_map;
mod comparison;
mod histogram;
mod isometric;
mod key_figures;
mod line_plot;
mod map;
mod table;
mod vectors;

use serde::{Deserialize, Serialize};

pub use bars::{Bar, Bars};
pub use boxes::{BoxGroup, BoxPlot};
pub use callout::{Callout, Tone};
pub use cell_map::{CellMap, CellPanel};
pub use comparison::{Comparison, ComparisonGroup};
pub use histogram::{Histogram, HistogramPanel};
pub use isometric::{IsoLine, IsoPoint, Isometric};
pub use key_figures::{KeyFigure, KeyFigures, Quantity};
pub use line_plot::{Curve, CurveStyle, LinePanel, LinePlot, State};
pub use map::{MapPanel, MapPoint, ResidualMap};
pub(crate) use table::shown;
pub use table::{Cell, Column, TableSection};
pub use vectors::{Vector, Vectors};

use crate::error::ReportError;
use crate::finite::check_finite;
use crate::svg::Drawing;

/// Label and unit of an axis or of a colour scale; both are shown.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Axis {
    /// What the axis shows, e.g. `position x`.
    pub label: String,
    /// Its unit, e.g. `mm`; `1` for a pure number.
    pub unit: String,
}

impl Axis {
    /// An axis.
    pub fn new(label: impl Into<String>, unit: impl Into<String>) -> Self {
        Self { label: label.into(), unit: unit.into() }
    }
}

/// Begins a chapter: everything up to the next heading belongs to it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Heading {
    /// Title, also listed in the page's table of contents.
    pub title: String,
    /// Sentence or two under the title.
    pub intro: Option<String>,
}

/// One section of a report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Section {
    /// Begins a chapter.
    Heading(Heading),
    /// Large figures side by side.
    KeyFigures(KeyFigures),
    /// A table; every numeric column names its unit.
    Table(TableSection),
    /// Curves with bands, or points, in several panels.
    LinePlot(LinePlot),
    /// Positions coloured by a signed value.
    ResidualMap(ResidualMap),
    /// A grid of cells coloured by a magnitude, with the numbers in the cells.
    CellMap(CellMap),
    /// Histograms with an optional normal curve.
    Histogram(Histogram),
    /// Horizontal bars.
    Bars(Bars),
    /// Box plot of groups and series.
    BoxPlot(BoxPlot),
    /// Error before and after: boxes by axis and cumulative share.
    Comparison(Comparison),
    /// Volume, stations and lines in an isometric view.
    Isometric(Isometric),
    /// Error vectors over a volume, which can be turned and stretched.
    Vectors(Vectors),
    /// A sentence set apart: note, good news, warning, failure.
    Callout(Callout),
}

impl Section {
    /// Title of the section, as errors name it.
    pub fn title(&self) -> &str {
        match self {
            Self::Heading(s) => &s.title,
            Self::KeyFigures(s) => &s.title,
            Self::Table(s) => &s.title,
            Self::LinePlot(s) => &s.title,
            Self::ResidualMap(s) => &s.title,
            Self::CellMap(s) => &s.title,
            Self::Histogram(s) => &s.title,
            Self::Bars(s) => &s.title,
            Self::BoxPlot(s) => &s.title,
            Self::Comparison(s) => &s.title,
            Self::Isometric(s) => &s.title,
            Self::Vectors(s) => &s.title,
            Self::Callout(s) => &s.title,
        }
    }

    /// Refuses numbers that are not finite and parts that do not fit together.
    ///
    /// # Errors
    /// [`ReportError`] naming the section and the place in it.
    pub fn check(&self) -> Result<(), ReportError> {
        check_finite(self.title(), self)?;
        match self {
            Self::Table(s) => s.check(),
            Self::LinePlot(s) => s.check(),
            Self::ResidualMap(s) => s.check(),
            Self::CellMap(s) => s.check(),
            Self::Histogram(s) => s.check(),
            Self::Bars(s) => s.check(),
            Self::BoxPlot(s) => s.check(),
            Self::Comparison(s) => s.check(),
            Self::Isometric(s) => s.check(),
            Self::Vectors(s) => s.check(),
            Self::Heading(_) | Self::KeyFigures(_) | Self::Callout(_) => Ok(()),
        }
    }

    /// The drawing and the note under its title, for sections that are figures.
    pub(crate) fn drawing(&self) -> Option<Result<(Drawing, Option<String>), ReportError>> {
        let (drawing, note) = match self {
            Self::LinePlot(s) => (s.draw(), s.full_note()),
            Self::ResidualMap(s) => (s.draw(), s.full_note()),
            Self::CellMap(s) => (s.draw(), s.note.clone()),
            Self::Histogram(s) => (s.draw(), s.note.clone()),
            Self::Bars(s) => (s.draw(), s.note.clone()),
            Self::BoxPlot(s) => (s.draw(), s.full_note()),
            Self::Comparison(s) => (s.draw(), s.note.clone()),
            Self::Isometric(s) => (s.draw(), s.note.clone()),
            Self::Vectors(s) => (s.draw(), s.full_note()),
            Self::Heading(_) | Self::KeyFigures(_) | Self::Table(_) | Self::Callout(_) => return None,
        };
        Some(drawing.map(|d| (d, note)))
    }
}
