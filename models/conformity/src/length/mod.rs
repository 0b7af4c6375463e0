//! Length measurement errors after ISO 10360-2: E0 (tool offset 0), E150, and repeatability range R0.
//!
//! Place in the flow: measured lengths of gauge blocks or step gauges, or of [`measure()`] on a machine's error function,
//! go into [`evaluate()`]; out come errors by line and length, ranges, departures from the test, and a verdict.
//! Error of length measurement = measured − calibrated (m).
//!
//! Source: ISO 10360-2:2009: seven measuring lines (four body diagonals of the measuring volume required, parallels to
//! the axes by default), five lengths on each, each measured three times; the longest at least 66 % of the travel along
//! its line; R0 the range of three repeated measurements.

mod diagonal;
mod evaluate;
mod lines;
mod measure;
mod summary;

pub use evaluate::{LengthErrors, LengthSet, LengthVerdict, REPEATABILITY_RULE, evaluate};
pub use lines::{MeasuringLine, MeasuringVolume, OffsetPlane, e0_lines, offset_lines};
pub use measure::{End, LengthPlan, Touch, measure};
pub use summary::LineSummary;

use crate::quantity::ObservedError;
use std::collections::BTreeMap;

/// Measuring lines of a whole E0 test.
pub const LINES_E0: usize = 7;
/// Measuring lines of a whole test with a tool offset, such as E150.
pub const LINES_OFFSET: usize = 2;
/// Lengths on each line.
pub const LENGTHS: usize = 5;
/// Measurements of each length.
pub const REPEATS: usize = 3;
/// Least share of the travel along its line that the longest length has.
pub const LEAST_SHARE: f64 = 0.66;

/// How the ends of a length are probed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Probing {
    /// From opposite sides (gauge block, ball bar): errors of probe and tip diameter take part.
    Bidirectional,
    /// From the same side (step gauge face to face, laser): they cancel, so that it is no whole test.
    /// ISO 10360-2 has it supplemented by a short length, probed from opposite sides in the same place.
    Unidirectional,
}

impl Probing {
    /// The word for it.
    pub const fn word(self) -> &'static str {
        match self {
            Probing::Bidirectional => "bidirectional",
            Probing::Unidirectional => "unidirectional",
        }
    }
}

/// One measurement of one calibrated length.
#[derive(Debug, Clone, PartialEq)]
pub struct LengthMeasurement {
    /// Measuring line.
    pub line: String,
    /// Calibrated length (m).
    pub calibrated_m: f64,
    /// Number of the repeat.
    pub repeat: u32,
    /// Measured − calibrated.
    pub error: ObservedError,
}

/// What is known of the test beside its measurements.
#[derive(Debug, Clone, PartialEq)]
pub struct LengthTest {
    /// Distance of the tip from the ram axis (m): 0 for E0, 0.15 for E150.
    pub tool_offset_m: f64,
    /// How the lengths were probed.
    pub probing: Probing,
    /// Travel of the machine along each measuring line (m); lines that are missing here cannot be held against 66 %.
    pub travel_m: BTreeMap<String, f64>,
}

impl LengthTest {
    /// Name of the error that the test gives, such as `E0` or `E150`.
    pub fn symbol(&self) -> String {
        format!("E{}", (self.tool_offset_m * 1e6).round() / 1e3)
    }

    /// Lines of a whole test.
    fn lines_asked_for(&self) -> usize {
        if self.tool_offset_m == 0.0 { LINES_E0 } else { LINES_OFFSET }
    }
}
