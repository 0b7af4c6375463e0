//! Positioning along body diagonals as an interferometer measured it, from CSV.
//!
//! Place in the flow: `abbe volumetric` holds a model against it. Columns: `diagonal` (PPP, NPP …), `distance_mm` from the
//! first target, `deviation_um` (actual − target, mean of the runs), `u_um` (standard uncertainty, k = 1). Behind it SI.

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
const COLUMNS: [Known; 4] = [DIAGONAL, DISTANCE, DEVIATION, U];

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
    let mut columns = [0; 4];
    for (place, known) in columns.iter_mut().zip(COLUMNS) {
        *place = source.header().require(known, &COLUMNS)?;
    }
    let mut readings: Vec<DiagonalReading> = Vec::new();
    let mut record = ByteRecord::new();
    while let Some(line) = source.next(&mut record)? {
        let reading = reading(source.header(), &record, line, columns)?;
        if readings.iter().any(|r| r.diagonal == reading.diagonal && r.distance_m == reading.distance_m) {
            let place = source.header().cell(line, columns[1]);
            let remedy = "give the mean of the runs, one row a target";
            return Err(FileError::content(place, "this target of this diagonal was given before", remedy));
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

fn reading(header: &Header, record: &ByteRecord, line: u64, columns: [usize; 4]) -> Result<DiagonalReading, FileError> {
    let number = |k: usize| header.number(record, columns[k], line, NUMBER_REMEDY);
    let text = std::str::from_utf8(record.get(columns[0]).unwrap_or_default()).unwrap_or_default().trim();
    let diagonal = Diagonal::from_name(text).ok_or_else(|| {
        let remedy = "name it by the signs of the motion of X, Y and Z, such as NPP";
        FileError::content(header.cell(line, columns[0]), format!("{text:?} is no body diagonal"), remedy)
    })?;
    let u_um = number(3)?;
    if u_um <= 0.0 {
        let remedy = "write the standard uncertainty (k = 1) of the deviation";
        return Err(FileError::content(
            header.cell(line, columns[3]),
            format!("the uncertainty {u_um} is not above zero"),
            remedy,
        ));
    }
    Ok(DiagonalReading { diagonal, distance_m: number(1)? / 1e3, deviation_m: number(2)? / 1e6, u_m: u_um / 1e6 })
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
            ("NPP,0,0", "line 2"),
            ("NPP,0,0,1\nNPP,0,1,1", "line 3, column distance_mm"),
            ("", "no row"),
            (
                "NPP,0,0,0.1\nNPP,100,-0.025,0.1",
                "line 1, column deviation_um: the largest of all deviations is 2.50e-2 um",
            ),
        ] {
            let problem = read(&format!("{header}{row}")).unwrap_err();
            assert!(problem.contains(expected), "{problem}");
        }
        assert!(read("diagonal,distance_mm,deviation_um\n").unwrap_err().contains("u_um"));
        // A wrong unit in a name is not taken for the right one.
        assert!(read("diagonal,distance_m,deviation_um,u_um\n").unwrap_err().contains("distance_mm"));
    }
}
