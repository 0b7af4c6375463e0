//! What any measured table says of itself: its hash, and the lowest and highest temperature that was logged in it.
//!
//! Place in the flow: data → here → head and end of a report. Columns of temperatures are named `temp_…_c` and hold degrees
//! Celsius; a cell without a number is a missing one. Memory is one row.

use crate::csv_source::{CsvSource, header_names};
use crate::error::FileError;
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
        let file = path.display().to_string();
        let mut source = CsvSource::new(File::open(path).map_err(FileError::io(&file, "open the file"))?, &file)?;
        let names = source.header().names();
        let columns: Vec<usize> = (0..names.len()).filter(|column| is_temperature(&names[*column])).collect();
        source.look_ahead(&columns);
        let (mut range, mut record) = (None, ByteRecord::new());
        while let Some(line) = source.next(&mut record)? {
            let values = columns.iter().filter_map(|column| source.header().optional_number(&record, *column, line));
            range = values.filter(|value| value.is_finite()).fold(range, |range: Option<[f64; 2]>, value| {
                Some(range.map_or([value; 2], |[low, high]| [low.min(value), high.max(value)]))
            });
        }
        Ok(TableFacts { sha256: source.sha256(), temperature_c: range })
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
        assert_eq!(of("x_mm,temp_a_c\n1,\n"), None);
        assert_eq!(of("x_mm,temperature\n1,20\n"), None);
    }
}
