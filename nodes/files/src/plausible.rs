//! Which deviations are those of a machine, and which are in another unit than their column says.
//!
//! Place in the flow: readers of lengths, of runs and of diagonals ask here once they have all rows.

use crate::error::{FileError, Place};
use crate::notice::tell_once;

/// Where all deviations in micrometres are below this, they are millimetres (m): a machine at which nothing is off by more is one of a
/// handful, and one that is off by up to 100 µm is any other.
const SMALLEST_M: f64 = 0.1e-6;
/// What rounding of a position may take off a deviation.
const ROUNDING: f64 = 1e-6;
/// Lengths up to here are those of most machines as metres (m).
const SHORT_M: f64 = 0.1;

/// Refuses a column of deviations that are millimetres; `otherwise` says how whoever has so good a machine writes them. Nothing but zeros
/// has no unit.
pub(crate) fn refuse_millimetres(largest_m: f64, column: Place, otherwise: &str) -> Result<(), FileError> {
    if largest_m == 0.0 || largest_m >= SMALLEST_M * (1.0 - ROUNDING) {
        return Ok(());
    }
    let problem =
        format!("the largest of all deviations is {:.2e} µm, and few machines are that good", largest_m * 1e6);
    let remedy = format!("multiply the numbers by 1000 if they are millimetres{otherwise}");
    Err(FileError::content(column, problem, remedy))
}

/// Tells of positions that may be metres: as millimetres they are short, and the errors between them too small for most machines. Those
/// of a small stage are like that.
pub(crate) fn tell_of_metres(file: &str, longest_m: f64, largest_m: f64) {
    if largest_m > 0.0 && largest_m < SMALLEST_M && longest_m < SHORT_M {
        tell_once(format!(
            "{file}: {:.4} mm at the longest, with errors up to {:.2e} µm: if the numbers are metres, both are a thousand times that",
            longest_m * 1e3,
            largest_m * 1e6
        ));
    }
}
