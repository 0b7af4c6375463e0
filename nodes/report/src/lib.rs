//! Self-contained HTML report, PNG of the main plot and JSON of a run.
//!
//! In: plain data in the units that readers use (mm, µm, µrad, named in each field or axis); the time of the run,
//! machine name and hashes as text, since this crate knows no clock, no host and no file. Out: text and bytes for
//! the caller to write. Same data, same bytes.
//!
//! A [`Report`] is a list of [`Section`]s; every command composes its own from the same kinds. [`DemoReport`] is the
//! one for a corrected campaign: it holds the run's data and builds the sections from them. [`diagnosis::DiagnosisReport`]
//! is the one for what a model lacks.
//!
//! ```
//! use abbe_report::{KeyFigure, KeyFigures, Quantity, Report, Section};
//!
//! let figures = vec![KeyFigure {
//!     label: "residual σ".into(),
//!     value: Some(Quantity::new(0.31, 2)),
//!     unit: "µm".into(),
//!     ..KeyFigure::default()
//! }];
//! let key = KeyFigures { title: "At a glance".into(), figures };
//! let report = Report { title: "Check".into(), sections: vec![Section::KeyFigures(key)], ..Report::default() };
//! assert!(report.html()?.contains("0.31"));
//! # Ok::<(), abbe_report::ReportError>(())
//! ```

mod demo;
pub mod diagnosis;
pub mod digits;
mod error;
mod finite;
mod frame;
mod html;
mod identity;
mod pdf;
mod png;
mod report;
mod scale;
mod sections;
mod stats;
mod svg;
mod text;
mod theme;

pub use demo::{
    Closing, Correlation, DemoReport, ErrorCurve, ErrorCurveSet, ErrorKind, FileEntry, FitSummary, Identifiability,
    InUse, LiveFigures, MeasuredLine, MeasuringVolume, OrderChoice, RejectedReading, Residual, RunHeader,
    SquarenessError, StationEntry, StepDuration, VerificationPoint,
};
pub use error::ReportError;
pub use finite::check_finite;
pub use identity::Identity;
pub use report::{MetaItem, NextStep, Report, to_json};
pub use sections::{
    Axis, Bar, Bars, BoxGroup, BoxPlot, Callout, Cell, CellMap, CellPanel, Column, Comparison, ComparisonGroup, Curve,
    CurveStyle, Heading, Histogram, HistogramPanel, IsoLine, IsoPoint, Isometric, KeyFigure, KeyFigures, LinePanel,
    LinePlot, MapPanel, MapPoint, Quantity, ResidualMap, Section, State, TableSection, Tone, Vector, Vectors,
};
pub use stats::{BoxStats, max_abs, quantile_sorted, rms, sorted};
