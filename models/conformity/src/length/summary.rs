//! What one measuring line of a length test says.
//!
//! Place in the flow: [`super::evaluate()`] makes one a line; departures and reports read them. SI.

use crate::quantity::ObservedError;

/// What one measuring line says.
#[derive(Debug, Clone, PartialEq)]
pub struct LineSummary {
    /// Name.
    pub line: String,
    /// Number of different lengths.
    pub lengths: usize,
    /// Longest length (m).
    pub longest_m: f64,
    /// Travel along the line (m), where it is known.
    pub travel_m: Option<f64>,
    /// Error with the largest magnitude, and the length it stands at (m).
    pub largest: (ObservedError, f64),
    /// Largest repeatability range.
    pub range: Option<ObservedError>,
}
