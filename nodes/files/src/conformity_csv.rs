//! Data of acceptance tests from CSV: measured lengths (ISO 10360-2) and points probed on a sphere (ISO 10360-5).
//!
//! Place in the flow: file → here → measurements in SI → `abbe_conformity`. Columns, units in the name:
//! - lengths: `line calibrated_mm repeat` and one of `deviation_um` (measured − calibrated) or `measured_mm`; optional
//!   `travel_mm`, the machine's travel along the line, the same in every row of a line;
//! - probed points: `x_mm y_mm z_mm`, tip radius taken off.
//!
//! Temperatures (`temp_…_c`) may stand beside them, for the head of a report; other columns are refused. Deviations that are all below what
//! but a handful of machines achieve, or above a millimetre, are taken for a slip of units. ISO 230-2 runs are read by [`crate::read_runs`].

use crate::columns::{Header, Known, LINE, READING};
use crate::csv_source::CsvSource;
use crate::error::FileError;
use crate::plausible::{refuse_millimetres, tell_of_metres};
use crate::study_csv::{Row, open, rows};
use crate::table_facts::is_temperature;
use abbe_conformity::ObservedError;
use abbe_conformity::length::LengthMeasurement;
use abbe_geometry::Vector3;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

const CALIBRATED: Known = Known::new("calibrated_mm", "calibrated", "millimetres");
const MEASURED: Known = Known::new("measured_mm", "measured", "millimetres");
const DEVIATION: Known = Known::new("deviation_um", "deviation", "micrometres");
const REPEAT: Known = Known::new("repeat", "repeat", "whole number");
const TRAVEL: Known = Known::new("travel_mm", "travel", "millimetres");
const LENGTHS: [Known; 6] = [LINE, CALIBRATED, REPEAT, DEVIATION, MEASURED, TRAVEL];
/// An error of length measurement beyond this is a slip of units (m).
const LARGEST_M: f64 = 1e-3;

/// Measured lengths of one file.
#[derive(Debug, Clone, PartialEq)]
pub struct LengthFile {
    /// In the order of the file.
    pub measurements: Vec<LengthMeasurement>,
    /// Travel along each line (m), where the file has it.
    pub travel_m: BTreeMap<String, f64>,
    /// SHA-256 of the bytes of the file.
    pub sha256: [u8; 32],
}

/// Points of one file.
#[derive(Debug, Clone, PartialEq)]
pub struct ProbedPoints {
    /// In the order of the file (m).
    pub points_m: Vec<Vector3<f64>>,
    /// SHA-256 of the bytes of the file.
    pub sha256: [u8; 32],
}

/// Reads measured lengths.
pub fn read_lengths_file(path: &Path) -> Result<LengthFile, FileError> {
    let (input, file) = open(path)?;
    read_lengths(input, &file)
}

/// Reads points probed on a sphere.
pub fn read_probed_points_file(path: &Path) -> Result<ProbedPoints, FileError> {
    let (input, file) = open(path)?;
    read_probed_points(input, &file)
}

/// Reads measured lengths from anything; `file` is its name in messages.
pub fn read_lengths(input: impl Read, file: &str) -> Result<LengthFile, FileError> {
    let source = CsvSource::new(input, file)?;
    let header = source.header();
    let require = |column| header.require(column, &LENGTHS);
    let [line, calibrated, repeat] = [require(LINE)?, require(CALIBRATED)?, require(REPEAT)?];
    let travel = header.optional(TRAVEL, &LENGTHS)?;
    let error = error_column(header)?;
    refuse_strangers(header, &LENGTHS)?;
    let header_place = header.place();
    let mut travel_m: BTreeMap<String, f64> = BTreeMap::new();
    let read = rows(source, |row| {
        let name = row.text(line)?;
        if let Some(column) = travel {
            note_travel(&mut travel_m, &name, row.number(column)? / 1e3, row, column)?;
        }
        let calibrated_m = row.number(calibrated)? / 1e3;
        let repeat = repeat_number(row, repeat)?;
        Ok(LengthMeasurement { line: name, calibrated_m, repeat, error: error.read(row, calibrated_m)? })
    })?;
    let largest_m = read.rows.iter().map(|m| m.error.magnitude_m()).fold(0.0, f64::max);
    match error {
        ErrorColumn::Deviation(_) => {
            let otherwise = ", else write measured_mm in their place";
            refuse_millimetres(largest_m, header_place.column(DEVIATION.name), otherwise)?;
        }
        ErrorColumn::Measured(_) => {
            let longest_m = read.rows.iter().map(|m| m.calibrated_m).fold(0.0, f64::max);
            tell_of_metres(file, longest_m, largest_m);
        }
    }
    Ok(LengthFile { measurements: read.rows, travel_m, sha256: read.sha256 })
}

/// Reads probed points from anything; `file` is its name in messages.
pub fn read_probed_points(input: impl Read, file: &str) -> Result<ProbedPoints, FileError> {
    let source = CsvSource::new(input, file)?;
    let header = source.header();
    let require = |k: usize| header.require(READING[k], &READING);
    let columns = [require(0)?, require(1)?, require(2)?];
    refuse_strangers(header, &READING)?;
    let read = rows(source, |row| Ok(Vector3::from(row.three(columns, 1e3)?)))?;
    Ok(ProbedPoints { points_m: read.rows, sha256: read.sha256 })
}

/// Where a row's error comes from.
#[derive(Debug, Clone, Copy)]
enum ErrorColumn {
    Deviation(usize),
    Measured(usize),
}

impl ErrorColumn {
    fn read(self, row: &Row, calibrated_m: f64) -> Result<ObservedError, FileError> {
        let (error_m, column) = match self {
            ErrorColumn::Deviation(column) => (row.number(column)? / 1e6, column),
            // In millimetres first, where both stand with their last digit.
            ErrorColumn::Measured(column) => ((row.number(column)? - calibrated_m * 1e3) / 1e3, column),
        };
        if error_m.abs() > LARGEST_M {
            let problem = format!("an error of {:.3} mm is that of another gauge or another unit", error_m * 1e3);
            let remedy = "check the unit of the column and the calibrated length";
            return Err(FileError::content(row.place(column), problem, remedy));
        }
        Ok(ObservedError::from_metres(error_m))
    }
}

fn error_column(header: &Header) -> Result<ErrorColumn, FileError> {
    match (header.optional(DEVIATION, &LENGTHS)?, header.optional(MEASURED, &LENGTHS)?) {
        (Some(column), None) => Ok(ErrorColumn::Deviation(column)),
        (None, Some(column)) => Ok(ErrorColumn::Measured(column)),
        (Some(_), Some(_)) => {
            let problem = "deviation_um and measured_mm say the same";
            Err(FileError::content(header.place().column(MEASURED.name), problem, "remove one of the two"))
        }
        (None, None) => {
            let remedy = "add the column deviation_um (measured - calibrated, micrometres) or measured_mm";
            Err(FileError::content(header.place().column(DEVIATION.name), "the column is missing", remedy))
        }
    }
}

fn note_travel(
    travel_m: &mut BTreeMap<String, f64>,
    line: &str,
    value_m: f64,
    row: &Row,
    column: usize,
) -> Result<(), FileError> {
    match travel_m.insert(line.to_owned(), value_m) {
        Some(other) if other != value_m => {
            let problem = format!("line {line} has another travel here than above");
            Err(FileError::content(row.place(column), problem, "give one travel a line"))
        }
        _ => Ok(()),
    }
}

fn repeat_number(row: &Row, column: usize) -> Result<u32, FileError> {
    let value = row.whole(column)?;
    u32::try_from(value).ok().filter(|value| *value > 0).ok_or_else(|| {
        let problem = format!("{value} numbers no repeat");
        FileError::content(row.place(column), problem, "number the repeats of a length 1, 2, 3")
    })
}

fn refuse_strangers(header: &Header, known: &[Known]) -> Result<(), FileError> {
    match header.names().iter().find(|name| !is_temperature(name) && known.iter().all(|k| k.name != **name)) {
        None => Ok(()),
        Some(stranger) => {
            let problem = "the column is not known here";
            Err(FileError::content(header.place().column(stranger), problem, "remove it, or correct its name"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str, says: &[&str]) {
        let told = read_lengths(text.as_bytes(), "lengths.csv").unwrap_err().to_string();
        assert!(says.iter().all(|s| told.contains(s)), "{told}");
    }

    #[test]
    fn deviations_and_measured_lengths_say_the_same() {
        let one = "line,travel_mm,calibrated_mm,repeat,deviation_um\nX,800,100.0177,1,-0.11\n";
        let other = "line,travel_mm,calibrated_mm,repeat,measured_mm\nX,800,100.0177,1,100.01759\n";
        let [one, other] = [one, other].map(|text| read_lengths(text.as_bytes(), "a.csv").unwrap());
        assert_eq!(one.measurements[0].calibrated_m, 0.1000177);
        assert_eq!(one.measurements[0].error.metres(), -0.11e-6);
        // A tenth of a picometre: rounding of 100 mm.
        assert!((other.measurements[0].error.metres() + 0.11e-6).abs() < 1e-13);
        assert_eq!(one.travel_m["X"], 0.8);
        assert_ne!(one.sha256, other.sha256);
    }

    #[test]
    fn wrong_cells_and_columns_are_refused_by_line_and_column() {
        let head = "line,calibrated_mm,repeat,deviation_um\n";
        refused(&format!("{head}X,100,1,nan\n"), &["line 2", "deviation_um", "not a finite number"]);
        refused(&format!("{head}X,100,0,0.1\n"), &["line 2", "repeat", "0 numbers no repeat"]);
        refused(&format!("{head}X,100,1.5,0.1\n"), &["not a whole number"]);
        refused(&format!("{head},100,1,0.1\n"), &["column line", "empty"]);
        refused(&format!("{head}X,100,1,1500\n"), &["line 2", "1.500 mm", "unit"]);
        refused(
            &format!("{head}X,100,1,0.0002\nX,100,2,-0.0003\n"),
            &["deviation_um", "3.00e-4 µm", "multiply the numbers by 1000", "measured_mm"],
        );
        // Millimetres of a machine that is off by 15 µm.
        refused(&format!("{head}X,100,1,0.012\nX,200,1,-0.0153\n"), &["line 1", "deviation_um", "1.53e-2 µm"]);
        refused(head, &["no row"]);
        refused("line,calibrated_mm,repeat\nX,100,1\n", &["deviation_um", "missing"]);
        refused("line,calibrated_mm,repeat,deviation_mm\nX,100,1,0.1\n", &["deviation_mm", "micrometres"]);
        refused("line,calibrated_mm,repeat,deviation_um,measured_mm\nX,100,1,0,100\n", &["say the same"]);
        refused("line,calibrated_mm,repeat,deviation_um,colour\nX,100,1,0,red\n", &["colour", "not known"]);
        let travel = "line,travel_mm,calibrated_mm,repeat,deviation_um\nX,800,100,1,0.1\nX,900,100,2,0.1\n";
        refused(travel, &["line 3", "travel_mm", "another travel"]);
        refused("line,calibrated_mm,repeat,measured_mm\nX,100,1,1.0001\n", &["line 2", "measured_mm", "another gauge"]);
    }

    #[test]
    fn probed_points_are_metres_behind_the_reader() {
        let points = read_probed_points("x_mm,y_mm,z_mm\n1,2,3\n".as_bytes(), "points.csv").unwrap();
        assert_eq!(points.points_m, [Vector3::new(0.001, 0.002, 0.003)]);
        let told = read_probed_points("x_mm,y_mm,z_um\n1,2,3\n".as_bytes(), "points.csv").unwrap_err().to_string();
        assert!(told.contains("z_um") && told.contains("millimetres"), "{told}");
    }
}
