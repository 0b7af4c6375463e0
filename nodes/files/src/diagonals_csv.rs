//! Positioning along body diagonals as an interferometer measured it, from CSV.
//!
//! Place in the flow: `abbe volumetric` holds a model against it. Columns: `diagonal` (PPP, NPP …), `distance_mm` from the
//! first target, `deviation_um` (actual − target, mean of the runs), `u_um` (standard uncertainty, k = 1). Optional: `start_mm`,
//! how far the first target of a diagonal lies on it from the end of the stroke, and `runs`, of how many the row is the mean. Behind it SI.

use crate::columns::{Header, Known};
use crate::csv_source::CsvSource;
use crate::error::{FileError, Place};
use crate::plausible::refuse_millimetres;
use abbe_geometry::volumetric::Diagonal;
use csv::ByteRecord;
use std::fs::File;
use std::io::Read;
use std::path::Path;

const NUMBER_REMEDY: &str = "write a number with a decimal point, or remove the row";
const DIAGONAL: Known = Known::new("diagonal", "diagonal", "text");
const DISTANCE: Known = Known::new("distance_mm", "distance", "millimetres");
const DEVIATION: Known = Known::new("deviation_um", "deviation", "micrometres");
const U: Known = Known::new("u_um", "u", "micrometres");
const START: Known = Known::new("start_mm", "start", "millimetres");
const RUNS: Known = Known::new("runs", "runs", "number");
const COLUMNS: [Known; 6] = [DIAGONAL, DISTANCE, DEVIATION, U, START, RUNS];

/// One measured target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiagonalReading {
    /// The diagonal.
    pub diagonal: Diagonal,
    /// Nominal distance from the first target (m).
    pub distance_m: f64,
    /// Actual minus nominal distance (m).
    pub deviation_m: f64,
    /// Its standard uncertainty (m, k = 1).
    pub u_m: f64,
    /// Way on the diagonal from the end of the stroke to the first target (m), where it was given.
    pub start_m: Option<f64>,
    /// Runs whose mean it is, where that was given.
    pub runs: Option<usize>,
}

/// Reads measured diagonals.
///
/// # Errors
/// File, line and column of what is wrong.
pub fn read_diagonals_file(path: &Path) -> Result<Vec<DiagonalReading>, FileError> {
    let file = path.display().to_string();
    read_diagonals(File::open(path).map_err(FileError::io(&file, "open the data"))?, &file)
}

/// Reads measured diagonals from anything; `file` is its name in messages.
///
/// # Errors
/// File, line and column of what is wrong.
pub fn read_diagonals(input: impl Read, file: &str) -> Result<Vec<DiagonalReading>, FileError> {
    let mut source = CsvSource::new(input, file)?;
    let mut required = [0; 4];
    for (place, known) in required.iter_mut().zip(COLUMNS) {
        *place = source.header().require(known, &COLUMNS)?;
    }
    let optional = |known| source.header().optional(known, &COLUMNS);
    let columns = Columns { required, start: optional(START)?, runs: optional(RUNS)? };
    let mut readings: Vec<DiagonalReading> = Vec::new();
    let mut record = ByteRecord::new();
    while let Some(line) = source.next(&mut record)? {
        let reading = reading(source.header(), &record, line, &columns)?;
        if readings.iter().any(|r| r.diagonal == reading.diagonal && r.distance_m == reading.distance_m) {
            let place = source.header().cell(line, columns.required[1]);
            let remedy = "give the mean of the runs, one row a target";
            return Err(FileError::content(place, "this target of this diagonal was given before", remedy));
        }
        let same = readings.iter().find(|r| r.diagonal == reading.diagonal);
        if let Some(column) = columns.start.filter(|_| same.is_some_and(|r| r.start_m != reading.start_m)) {
            let remedy = "a diagonal has one first target: write the same in all of its rows";
            return Err(FileError::content(
                source.header().cell(line, column),
                "another start of this diagonal",
                remedy,
            ));
        }
        readings.push(reading);
    }
    if readings.is_empty() {
        let remedy = "give one row for each target";
        return Err(FileError::content(Place::file(file), "the file holds a header but no row", remedy));
    }
    let largest_m = readings.iter().map(|reading| reading.deviation_m.abs()).fold(0.0, f64::max);
    refuse_millimetres(largest_m, source.header().place().column(DEVIATION.name), "")?;
    Ok(readings)
}

struct Columns {
    /// Diagonal, distance, deviation, u.
    required: [usize; 4],
    start: Option<usize>,
    runs: Option<usize>,
}

fn reading(header: &Header, record: &ByteRecord, line: u64, columns: &Columns) -> Result<DiagonalReading, FileError> {
    let Columns { required, start, runs } = columns;
    let of = |column: usize| header.number(record, column, line, NUMBER_REMEDY);
    let number = |k: usize| of(required[k]);
    let refused =
        |column: usize, what: String, remedy: &str| Err(FileError::content(header.cell(line, column), what, remedy));
    let text = std::str::from_utf8(record.get(required[0]).unwrap_or_default()).unwrap_or_default().trim();
    let diagonal = Diagonal::from_name(text).ok_or_else(|| {
        let remedy = "name it by the signs of the motion of X, Y and Z, such as NPP";
        FileError::content(header.cell(line, required[0]), format!("{text:?} is no body diagonal"), remedy)
    })?;
    let u_um = number(3)?;
    if u_um <= 0.0 {
        let remedy = "write the standard uncertainty (k = 1) of the deviation";
        return refused(required[3], format!("the uncertainty {u_um} is not above zero"), remedy);
    }
    let start_mm = start.map(of).transpose()?;
    if let Some((column, mm)) = start.zip(start_mm).filter(|(_, mm)| *mm < 0.0) {
        let remedy = "write the way on the diagonal from the end of the stroke to the first target, or 0";
        return refused(column, format!("the first target would lie {} mm before the end of the stroke", -mm), remedy);
    }
    let count = runs.map(of).transpose()?;
    if let Some((column, count)) = runs.zip(count).filter(|(_, count)| *count < 1.0 || count.fract() != 0.0) {
        let remedy = "write the number of runs whose mean the deviation is, 1 or more";
        return refused(column, format!("{count} is no number of runs"), remedy);
    }
    let distance_mm = number(1)?;
    if distance_mm < 0.0 {
        let remedy = "distances count from the first target on, in the direction that the diagonal is named by";
        return refused(required[1], format!("the distance {distance_mm} is below zero"), remedy);
    }
    Ok(DiagonalReading {
        diagonal,
        distance_m: distance_mm / 1e3,
        deviation_m: number(2)? / 1e6,
        u_m: u_um / 1e6,
        start_m: start_mm.map(|mm| mm / 1e3),
        // Whole and above zero, as was shown; beyond all numbers it is the largest.
        runs: count.map(|count| count as usize),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<DiagonalReading>, String> {
        read_diagonals(text.as_bytes(), "d.csv").map_err(|error| error.to_string())
    }

    #[test]
    fn rows_become_metres() {
        let rows = read("diagonal,distance_mm,deviation_um,u_um\nNPP,0,0,0.1\nNPP,100,-2.5,0.2\n").unwrap();
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[1].diagonal.name(), "NPP");
        assert_eq!((rows[1].distance_m, rows[1].deviation_m, rows[1].u_m), (0.1, -2.5 / 1e6, 0.2 / 1e6));
    }

    #[test]
    fn what_is_wrong_is_named_with_line_and_column() {
        let header = "diagonal,distance_mm,deviation_um,u_um\n";
        for (row, expected) in [
            ("NPQ,0,0,0.1", "line 2, column diagonal"),
            ("NPP,x,0,0.1", "line 2, column distance_mm"),
            ("NPP,0,nan,0.1", "line 2, column deviation_um"),
            ("NPP,0,0,0", "line 2, column u_um"),
            ("NPP,-100,0,1", "line 2, column distance_mm: the distance -100 is below zero"),
            ("NPP,0,0", "line 2"),
            ("NPP,0,0,1\nNPP,0,1,1", "line 3, column distance_mm"),
            ("", "no row"),
            (
                "NPP,0,0,0.1\nNPP,100,-0.025,0.1",
                "line 1, column deviation_um: the largest of all deviations is 2.50e-2 µm",
            ),
        ] {
            let problem = read(&format!("{header}{row}")).unwrap_err();
            assert!(problem.contains(expected), "{problem}");
        }
        assert!(read("diagonal,distance_mm,deviation_um\n").unwrap_err().contains("u_um"));
        let header = "diagonal,distance_mm,deviation_um,u_um,start_mm,runs\n";
        for (row, expected) in [
            ("NPP,0,0,0.1,-5,3", "line 2, column start_mm: the first target would lie 5 mm before"),
            ("NPP,0,0,0.1,5,0", "line 2, column runs"),
            ("NPP,0,0,0.1,5,2.5", "line 2, column runs"),
            ("NPP,0,0,0.1,5,3\nNPP,100,1,0.1,6,3", "line 3, column start_mm: another start"),
        ] {
            let problem = read(&format!("{header}{row}")).unwrap_err();
            assert!(problem.contains(expected), "{problem}");
        }
        let rows = read(&format!("{header}NPP,100,1,0.1,5,3\n")).unwrap();
        assert_eq!((rows[0].start_m, rows[0].runs), (Some(0.005), Some(3)));
        // A wrong unit in a name is not taken for the right one.
        assert!(read("diagonal,distance_m,deviation_um,u_um\n").unwrap_err().contains("distance_mm"));
    }
}
