//! What any measured table says of itself: its hash, and the lowest and highest temperature that was logged in it.
//!
//! Place in the flow: data → here → head and end of a report. Columns of temperatures are named `temp_…_c` and hold degrees
//! Celsius; a cell without a number is a missing one. One that is no temperature of a measuring room, as of a broken sensor or in degrees
//! Fahrenheit, is left out and told. Memory is one row.

use crate::csv_source::{CsvSource, header_names};
use crate::error::FileError;
use crate::identity::PLAUSIBLE_C;
use crate::notice::tell_once;
use csv::ByteRecord;
use std::fs::File;
use std::path::Path;

/// How columns of temperatures are named: what they begin and end with.
const TEMPERATURE: (&str, &str) = ("temp_", "_c");

/// Hash and temperatures of a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TableFacts {
    /// SHA-256 of the table.
    pub sha256: [u8; 32],
    /// Lowest and highest temperature (°C); `None` where none was logged.
    pub temperature_c: Option<[f64; 2]>,
}

impl TableFacts {
    /// Reads a table to its end.
    ///
    /// # Errors
    /// A file that cannot be read as a table, with the line.
    pub fn read(path: &Path) -> Result<TableFacts, FileError> {
        // Where temperatures alone do not tell what marks decimals, the other columns do.
        facts(path, is_temperature).or_else(|_| facts(path, |_| true))
    }

    /// The temperatures alone: a table without such a column is not read.
    ///
    /// # Errors
    /// As [`TableFacts::read`].
    pub fn temperature_c(path: &Path) -> Result<Option<[f64; 2]>, FileError> {
        let is_logged = header_names(path).is_some_and(|names| names.iter().any(|name| is_temperature(name)));
        if is_logged { Ok(TableFacts::read(path)?.temperature_c) } else { Ok(None) }
    }
}

/// Reads a table to its end; `tells` are the columns whose numbers tell what marks decimals.
fn facts(path: &Path, tells: impl Fn(&str) -> bool) -> Result<TableFacts, FileError> {
    let file = path.display().to_string();
    let mut source = CsvSource::new(File::open(path).map_err(FileError::io(&file, "open the file"))?, &file)?;
    let names = source.header().names();
    let columns = |is_own: &dyn Fn(&str) -> bool| (0..names.len()).filter(|k| is_own(&names[*k])).collect::<Vec<_>>();
    let (telling, columns) = (columns(&tells), columns(&is_temperature));
    source.look_ahead(&telling);
    let (mut range, mut record, mut told): (Option<[f64; 2]>, _, _) = (None, ByteRecord::new(), false);
    while let Some(line) = source.next(&mut record)? {
        for column in &telling {
            let value = source.header().optional_number(&record, *column, line);
            let Some(value) = value.filter(|_| columns.contains(column)) else { continue };
            if PLAUSIBLE_C.contains(&value) {
                range = Some(range.map_or([value; 2], |[low, high]| [low.min(value), high.max(value)]));
            } else if !std::mem::replace(&mut told, true) {
                let place = source.header().cell(line, *column);
                tell_once(format!(
                    "{place}: {value} degrees Celsius are of no measuring room; such values are left out of the head of a report"
                ));
            }
        }
    }
    Ok(TableFacts { sha256: source.sha256(), temperature_c: range })
}

/// Whether a column holds temperatures.
pub fn is_temperature(name: &str) -> bool {
    let (before, after) = TEMPERATURE;
    name.starts_with(before) && name.ends_with(after)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test

    use super::*;
    use crate::envelope::{hex, sha256_hex};

    #[test]
    fn temperatures_are_of_all_sensors_and_what_is_missing_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        let of = |text: &str| {
            std::fs::write(&path, text).unwrap();
            let facts = TableFacts::read(&path).unwrap();
            assert_eq!(hex(&facts.sha256), sha256_hex(text.as_bytes()));
            assert_eq!(TableFacts::temperature_c(&path).unwrap(), facts.temperature_c);
            facts.temperature_c
        };
        assert_eq!(of("x_mm,temp_a_c,temp_b_c\n1,20.5,\n2,21.25,19.75\n3,-,20\n"), Some([19.75, 21.25]));
        assert_eq!(of("x_mm;temp_a_c\n1;20\n2;20,125\n3;21,5\n"), Some([20.0, 21.5]), "decimal commas");
        // The temperatures alone do not tell that they have decimal commas.
        assert_eq!(of("um;temp_a_c\n0,4;20,125\n0,5;20,250\n"), Some([20.125, 20.25]));
        assert_eq!(of("x_mm,temp_a_c\n1,68\n2,-999\n3,20\n"), Some([20.0, 20.0]), "Fahrenheit, and a broken sensor");
        assert_eq!(of("x_mm,temp_a_c\n1,\n"), None);
        assert_eq!(of("x_mm,temperature\n1,20\n"), None);
    }
}
