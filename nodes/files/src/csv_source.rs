//! A CSV file as a stream of rows with their line numbers, hashed while it is read.
//!
//! Place in the flow: below the readers of campaigns and points; the one place that knows how tables are written. Columns
//! stand between commas, semicolons or tabs, told by the line of the column names or by a line `sep=` above it
//! ([`crate::dialect`]); what marks decimals is told by the numbers ([`crate::decimals`]); files packed by gzip or Zstandard are
//! unpacked on the way ([`crate::csv_bytes`]). Quoted fields, a byte order mark, CRLF line ends, blank lines and lines that
//! start with `#` are accepted. What might be understood otherwise is told ([`crate::notice`]). Memory is one row.

use crate::columns::Header;
use crate::csv_bytes::TableBytes;
use crate::dialect::{Dialect, Preamble};
use crate::error::{FileError, Place};
use crate::notice::tell_once;
use csv::{ByteRecord, Reader, ReaderBuilder};
use std::fs::File;
use std::io::Read;
use std::path::Path;

const BUFFER_BYTES: usize = 1 << 16;

/// Rows of one file.
pub(crate) struct CsvSource<R: Read> {
    reader: Reader<TableBytes<R>>,
    header: Header,
    /// What was read with the column names, for a look at the first rows.
    ahead: Vec<u8>,
}

impl<R: Read> CsvSource<R> {
    /// Reads and checks the header; `file` is the name in messages.
    pub(crate) fn new(input: R, file: &str) -> Result<CsvSource<R>, FileError> {
        let source = CsvSource::quiet(input, file)?;
        if let Some(words) = source.header.dialect().words() {
            tell_once(format!("{file}: {words}"));
        }
        if source.header.unnamed() > 0 {
            let empty = if source.header.unnamed() == 1 { "a column" } else { "columns" };
            tell_once(format!("{file}: {empty} without a name at the end of each line, left out"));
        }
        Ok(source)
    }

    /// The same without a word about how the file is written.
    fn quiet(input: R, file: &str) -> Result<CsvSource<R>, FileError> {
        let mut bytes = TableBytes::new(input, file)?;
        let (mut head, preamble) = read_preamble(&mut bytes, file)?;
        let mut dialect = bytes.dialect();
        preamble.complete(&head, file, &mut dialect)?;
        if let Some((start, end)) = preamble.separator_line {
            head.drain(start..end);
        }
        let ahead = head.clone();
        bytes.put_back(head);
        bytes.begin_row();
        let mut reader = reader(dialect).from_reader(bytes);
        let mut record = ByteRecord::new();
        let header = match next_line(&mut reader, &mut record, file)? {
            Some(line) => Header::new(&record, file, line, dialect)?,
            None => {
                let remedy = "give a header line with the column names and one row for each reading";
                return Err(FileError::content(Place::file(file), "the file is empty", remedy));
            }
        };
        Ok(CsvSource { reader, header, ahead })
    }

    pub(crate) fn header(&self) -> &Header {
        &self.header
    }

    /// Looks at the numbers of these columns in the rows that came with the column names, for what marks their decimals: a row
    /// of whole numbers does not tell.
    pub(crate) fn look_ahead(&mut self, columns: &[usize]) {
        let ahead = std::mem::take(&mut self.ahead);
        let complete = ahead.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
        let mut rows = reader(self.header.dialect()).from_reader(&ahead[..complete]);
        let mut record = ByteRecord::new();
        let mut is_header = true;
        while let Ok(true) = rows.read_byte_record(&mut record) {
            if !is_header && (self.header.len()..=self.header.len() + self.header.unnamed()).contains(&record.len()) {
                let line = line_of(&record, rows.position());
                for column in columns {
                    let _ = self.header.optional_number(&record, *column, line); // read again, and judged, in its row
                }
            }
            is_header = false;
        }
    }

    /// Reads the next row and returns its line, `None` at the end of the file.
    pub(crate) fn next(&mut self, record: &mut ByteRecord) -> Result<Option<u64>, FileError> {
        self.reader.get_mut().begin_row();
        let line = next_line(&mut self.reader, record, self.header.file())?;
        let Some(line) = line else {
            self.header.refuse_open_numbers()?;
            return Ok(None);
        };
        self.leave_out_unnamed(record, line)?;
        if record.len() != self.header.len() {
            let (cells, names, between) = (record.len(), self.header.len(), self.header.between());
            let problem = format!("the row has {cells} cells between {between}, but the header has {names}");
            let mut remedy =
                "complete the row, quote text that holds such a mark, or measure again if the file was cut off"
                    .to_owned();
            if cells > names && self.header.dialect().delimiter == b',' {
                remedy += "; where decimals have commas, separate the columns by semicolons";
            }
            return Err(FileError::content(Place::file(self.header.file()).line(line), problem, remedy));
        }
        Ok(Some(line))
    }

    /// Takes away the cells behind the last column that has a name; what holds something belongs somewhere.
    fn leave_out_unnamed(&self, record: &mut ByteRecord, line: u64) -> Result<(), FileError> {
        let (named, all) = (self.header.len(), self.header.len() + self.header.unnamed());
        if record.len() <= named || record.len() > all {
            return Ok(());
        }
        if let Some(k) = (named..record.len()).find(|k| !record[*k].trim_ascii().is_empty()) {
            let place = Place::file(self.header.file()).line(line).column(&format!("number {}", k + 1));
            return Err(FileError::content(place, "the column has no name and holds something", "name or remove it"));
        }
        record.truncate(named);
        Ok(())
    }

    /// SHA-256 of all bytes read so far: of the whole file once [`CsvSource::next`] has returned `None`.
    pub(crate) fn sha256(self) -> [u8; 32] {
        self.reader.into_inner().sha256()
    }
}

/// Column names of a CSV file, to tell what kind it is; `None` for what cannot be read as a table.
pub fn header_names(path: &Path) -> Option<Vec<String>> {
    let file = path.display().to_string();
    let source = CsvSource::quiet(File::open(path).ok()?, &file).ok()?;
    Some(source.header.names().to_vec())
}

fn reader(dialect: Dialect) -> ReaderBuilder {
    let mut builder = ReaderBuilder::new();
    builder.has_headers(false).flexible(true).comment(Some(b'#')).buffer_capacity(BUFFER_BYTES);
    builder.delimiter(dialect.delimiter);
    builder
}

/// Reads until the line of the column names is complete.
fn read_preamble<R: Read>(bytes: &mut TableBytes<R>, file: &str) -> Result<(Vec<u8>, Preamble), FileError> {
    let mut head = Vec::new();
    loop {
        let before = head.len();
        head.resize(before + BUFFER_BYTES, 0);
        let count = bytes.read(&mut head[before..]).map_err(|error| bytes.told(error, file, 1))?;
        head.truncate(before + count);
        if let Some(preamble) = Preamble::read(&head, count == 0, file)? {
            return Ok((head, preamble));
        }
    }
}

fn next_line<R: Read>(
    reader: &mut Reader<TableBytes<R>>,
    record: &mut ByteRecord,
    file: &str,
) -> Result<Option<u64>, FileError> {
    match reader.read_byte_record(record) {
        Ok(true) => Ok(Some(line_of(record, reader.position()))),
        Ok(false) => Ok(None),
        Err(error) => {
            let line = reader.position().line();
            Err(match error.into_kind() {
                csv::ErrorKind::Io(source) => reader.get_ref().told(source, file, line),
                other => FileError::content(
                    Place::file(file).line(line),
                    format!("the text is not CSV ({other:?})"),
                    "write comma separated values",
                ),
            })
        }
    }
}

/// The line in which a record begins; the position is that of the line after it. Before the record, comments and blank lines
/// are not yet skipped. Line ends inside quotes count.
fn line_of(record: &ByteRecord, after: &csv::Position) -> u64 {
    let inside = record.as_slice().iter().filter(|byte| **byte == b'\n').count() as u64;
    after.line().saturating_sub(1 + inside).max(1)
}
