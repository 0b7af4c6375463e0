//! Rows of trials on disk: appended as they come, read back to resume and to summarise.
//!
//! Place in the flow: workers hand records to [`Store::append`]; a run that was stopped finds what it has in
//! [`read`]. A half-written last row is left out and its trial run again.

use abbe_trials::Record;
use abbe_trials::record::COLUMNS;
use anyhow::{Context, Result};
use std::fs::{File, OpenOptions};
use std::path::Path;

/// Appends rows, each on disk before the next.
pub(crate) struct Store {
    writer: csv::Writer<File>,
}

impl Store {
    /// Opens a file for more rows; rewrites it with `kept` first, so that a torn row does not stay.
    pub(crate) fn open(path: &Path, kept: &[(Record, f64)]) -> Result<Store> {
        let mut whole = csv::Writer::from_path(path).with_context(|| format!("{}", path.display()))?;
        whole.write_record(COLUMNS)?;
        for (record, wall_s) in kept {
            whole.write_record(record.to_row(*wall_s))?;
        }
        whole.flush()?;
        drop(whole);
        let file = OpenOptions::new().append(true).open(path).with_context(|| format!("{}", path.display()))?;
        Ok(Store { writer: csv::WriterBuilder::new().has_headers(false).from_writer(file) })
    }

    /// Adds one row.
    pub(crate) fn append(&mut self, record: &Record, wall_s: f64) -> Result<()> {
        self.writer.write_record(record.to_row(wall_s))?;
        self.writer.flush()?;
        Ok(())
    }
}

/// Records of a file with their times, none where there is no file.
pub(crate) fn read(path: &Path) -> Result<Vec<(Record, f64)>> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let mut reader =
        csv::ReaderBuilder::new().flexible(true).from_path(path).with_context(|| format!("{}", path.display()))?;
    let mut records = Vec::new();
    for row in reader.records() {
        let row = row.with_context(|| format!("{}", path.display()))?;
        let fields: Vec<&str> = row.iter().collect();
        let wall_s = fields.last().and_then(|text| text.parse().ok());
        match (Record::from_row(&fields), wall_s) {
            (Some(record), Some(wall_s)) => records.push((record, wall_s)),
            _ => eprintln!("{}: a row that is not whole is left out and run again", path.display()),
        }
    }
    Ok(records)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn what_was_written_is_read_and_a_torn_row_is_not() {
        let folder = std::env::temp_dir().join(format!("abbe-trials-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("trials.csv");
        let record = Record {
            scenario: "nothing".to_owned(),
            family: "clean".to_owned(),
            seed: 3,
            level: None,
            outcome: Err("not run, a test".to_owned()),
        };
        Store::open(&path, &[]).unwrap().append(&record, 1.5).unwrap();
        OpenOptions::new().append(true).open(&path).unwrap().write_all(b"nothing,clean,4").unwrap();
        assert_eq!(read(&path).unwrap(), [(record.clone(), 1.5)]);
        Store::open(&path, &read(&path).unwrap()).unwrap().append(&record, 2.0).unwrap();
        assert_eq!(read(&path).unwrap().len(), 2);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
