//! A CSV file as a stream of rows with their line numbers, hashed while it is read.
//!
//! Place in the flow: below the readers of campaigns and points. Comma separated, quoted fields allowed; a byte
//! order mark, CRLF line ends, blank lines and lines that start with `#` are accepted. Memory is one row.

use crate::columns::Header;
use crate::error::{FileError, Place};
use csv::{ByteRecord, Reader, ReaderBuilder};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

const BUFFER_BYTES: usize = 1 << 16;

/// Rows of one file.
pub(crate) struct CsvSource<R: Read> {
    reader: Reader<Normalised<R>>,
    header: Header,
}

impl<R: Read> CsvSource<R> {
    /// Reads and checks the header; `file` is the name in messages.
    pub(crate) fn new(input: R, file: &str) -> Result<CsvSource<R>, FileError> {
        let mut reader = ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .comment(Some(b'#'))
            .buffer_capacity(BUFFER_BYTES)
            .from_reader(Normalised::new(input));
        let mut record = ByteRecord::new();
        let header = match next_line(&mut reader, &mut record, file)? {
            Some(line) => Header::new(&record, file, line)?,
            None => {
                let remedy = "give a header line with the column names and one row for each reading";
                return Err(FileError::content(Place::file(file), "the file is empty", remedy));
            }
        };
        Ok(CsvSource { reader, header })
    }

    pub(crate) fn header(&self) -> &Header {
        &self.header
    }

    /// Reads the next row and returns its line, `None` at the end of the file.
    pub(crate) fn next(&mut self, record: &mut ByteRecord) -> Result<Option<u64>, FileError> {
        let line = next_line(&mut self.reader, record, self.header.file())?;
        if let Some(line) = line
            && record.len() != self.header.len()
        {
            let problem = format!("the row has {} cells, but the header has {}", record.len(), self.header.len());
            let remedy = "complete the row, quote text that holds a comma, or measure again if the file was cut off";
            return Err(FileError::content(Place::file(self.header.file()).line(line), problem, remedy));
        }
        Ok(line)
    }

    /// SHA-256 of all bytes read so far: of the whole file once [`CsvSource::next`] has returned `None`.
    pub(crate) fn sha256(self) -> [u8; 32] {
        self.reader.into_inner().hash.finalize().into()
    }
}

/// How far into a file its header may stand (bytes).
const HEADER: u64 = 1 << 16;

/// Column names of a CSV file, to tell what kind it is; `None` for what cannot be read as text.
pub fn header_names(path: &Path) -> Option<Vec<String>> {
    let file = File::open(path).ok()?;
    // A file without line ends is not read as a whole to look at it.
    let lines = BufReader::new(file.take(HEADER)).split(b'\n').map_while(Result::ok);
    let texts = lines.map(|line| String::from_utf8_lossy(&line).trim_start_matches('\u{feff}').trim().to_owned());
    let header = texts.into_iter().find(|line| !line.is_empty() && !line.starts_with('#'))?;
    Some(header.split(',').map(|name| name.trim().trim_matches('"').to_owned()).collect())
}

fn next_line<R: Read>(
    reader: &mut Reader<Normalised<R>>,
    record: &mut ByteRecord,
    file: &str,
) -> Result<Option<u64>, FileError> {
    match reader.read_byte_record(record) {
        Ok(true) => {
            // The position is that of the line after the record; before it, comments and blank lines are not yet
            // skipped. Line ends inside quotes count.
            let inside = record.as_slice().iter().filter(|byte| **byte == b'\n').count() as u64;
            Ok(Some(reader.position().line().saturating_sub(1 + inside).max(1)))
        }
        Ok(false) => Ok(None),
        Err(error) => {
            let line = reader.position().line();
            Err(match error.into_kind() {
                csv::ErrorKind::Io(source) => FileError::io(file, "read the file")(source),
                other => FileError::content(
                    Place::file(file).line(line),
                    format!("the text is not CSV ({other:?})"),
                    "write comma separated values",
                ),
            })
        }
    }
}

/// Hashes what passes and brings line ends into one form: LF, also after the last line.
struct Normalised<R: Read> {
    input: R,
    hash: Sha256,
    ends_with_newline: bool,
}

impl<R: Read> Normalised<R> {
    fn new(input: R) -> Normalised<R> {
        Normalised { input, hash: Sha256::new(), ends_with_newline: true }
    }
}

impl<R: Read> Read for Normalised<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            let mut count = self.input.read(buffer)?;
            self.hash.update(&buffer[..count]);
            if count == 0 {
                if self.ends_with_newline {
                    return Ok(0);
                }
                self.ends_with_newline = true;
                buffer[0] = b'\n';
                return Ok(1);
            }
            if buffer[..count].contains(&b'\r') {
                count = without_carriage_returns(&mut buffer[..count]);
            }
            if count > 0 {
                self.ends_with_newline = buffer[count - 1] == b'\n';
                return Ok(count);
            }
        }
    }
}

fn without_carriage_returns(bytes: &mut [u8]) -> usize {
    let mut kept = 0;
    for k in 0..bytes.len() {
        if bytes[k] != b'\r' {
            bytes[kept] = bytes[k];
            kept += 1;
        }
    }
    kept
}
