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
    seen: Seen,
}

/// What the rows so far tell of how the file is written.
#[derive(Debug, Default)]
struct Seen {
    /// Lines that begin with `#` above the column names.
    comments_above: u64,
    /// Line after the latest row.
    next_line: u64,
    /// Lines between rows that are no rows: blank, or beginning with `#`.
    skipped: u64,
    /// A cell in quotes holds line ends, and that was told.
    has_line_ends: bool,
    /// The latest row, where its last cell ends with a line end: inside quotes, that is.
    open: Option<u64>,
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
        let comments_above = preamble.comments(&head);
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
        let seen = Seen { comments_above, next_line: reader.position().line(), ..Seen::default() };
        Ok(CsvSource { reader, header, ahead, seen })
    }

    pub(crate) fn header(&self) -> &Header {
        &self.header
    }

    /// Looks at the numbers of these columns in the rows that came with the column names, for what marks their decimals: a row
    /// of whole numbers does not tell.
    pub(crate) fn look_ahead(&mut self, columns: &[usize]) {
        let ahead = std::mem::take(&mut self.ahead);
        let complete = ahead.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
        self.each_ahead(&ahead[..complete], |header, record, line| {
            for column in columns {
                let _ = header.optional_number(record, *column, line); // read again, and judged, in its row
            }
        });
        // What is written beside columns that nobody reads is written like them; between commas, a comma in a cell may be a list.
        if self.header.dialect().delimiter != b',' {
            self.each_ahead(&ahead[..complete], |header, record, _| {
                record.iter().for_each(|cell| header.look_aside(cell))
            });
        }
    }

    /// The rows of this text, which begins with the column names.
    fn each_ahead(&self, text: &[u8], mut look: impl FnMut(&Header, &ByteRecord, u64)) {
        let mut rows = reader(self.header.dialect()).from_reader(text);
        let mut record = ByteRecord::new();
        let mut is_header = true;
        while let Ok(true) = rows.read_byte_record(&mut record) {
            if !is_header && (self.header.len()..=self.header.len() + self.header.unnamed()).contains(&record.len()) {
                look(&self.header, &record, line_of(&record, rows.position()));
            }
            is_header = false;
        }
    }

    /// Reads the next row and returns its line, `None` at the end of the file.
    pub(crate) fn next(&mut self, record: &mut ByteRecord) -> Result<Option<u64>, FileError> {
        self.reader.get_mut().begin_row();
        let line = next_line(&mut self.reader, record, self.header.file())?;
        let Some(line) = line else {
            self.refuse_open_quotes()?;
            self.header.refuse_open_numbers()?;
            self.tell_of_the_end();
            return Ok(None);
        };
        self.note(record, line);
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

    /// Notes what a row tells of how the file is written.
    fn note(&mut self, record: &ByteRecord, line: u64) {
        self.seen.skipped += line.saturating_sub(self.seen.next_line);
        self.seen.next_line = self.reader.position().line();
        self.seen.open = record.iter().next_back().filter(|cell| cell.ends_with(b"\n")).map(|_| line);
        // A last cell that ends so may be open to the end of the file, which is refused there.
        if !self.seen.has_line_ends && self.seen.open.is_none() && record.as_slice().contains(&b'\n') {
            self.seen.has_line_ends = true;
            let file = self.header.file();
            tell_once(format!("{file}, line {line}: a cell in quotes goes on over the end of the line"));
        }
    }

    /// Refuses a file that ends inside quotes, which swallowed all rows after them.
    fn refuse_open_quotes(&self) -> Result<(), FileError> {
        let Some(line) = self.seen.open.filter(|_| self.reader.get_ref().last() != b'"') else { return Ok(()) };
        let problem = "the quotes of the last cell are never closed, and the lines after it are taken for its text";
        // The row has no end of its own, so that it was counted from a line too early.
        Err(FileError::content(Place::file(self.header.file()).line(line + 1), problem, "close or remove the quotes"))
    }

    /// Tells of rows that are none, and of a last row that may be cut off.
    fn tell_of_the_end(&self) {
        let (file, bytes) = (self.header.file(), self.reader.get_ref());
        let skipped = self.seen.skipped + self.reader.position().line().saturating_sub(self.seen.next_line);
        // What begins with # inside quotes is no line of its own.
        match bytes.comments().saturating_sub(self.seen.comments_above).min(skipped) {
            0 => {}
            1 => tell_once(format!("{file}: a line below the column names begins with # and is left out")),
            several => {
                tell_once(format!("{file}: {several} lines below the column names begin with # and are left out"))
            }
        }
        if bytes.lacks_end() {
            let last = self.seen.next_line.saturating_sub(1);
            tell_once(format!(
                "{file}, line {last}: the last line has no end; if the file was cut off, so may its last number be"
            ));
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The rows of a text, and what was told of it.
    fn read(text: &str, file: &str) -> (Result<usize, String>, Vec<String>) {
        let mut source = match CsvSource::new(text.as_bytes(), file) {
            Ok(source) => source,
            Err(error) => return (Err(error.to_string()), Vec::new()),
        };
        let (mut rows, mut record) = (0, ByteRecord::new());
        let outcome = loop {
            match source.next(&mut record) {
                Ok(Some(_)) => rows += 1,
                Ok(None) => break Ok(rows),
                Err(error) => break Err(error.to_string()),
            }
        };
        (outcome, crate::notice::told_of(file))
    }

    #[test]
    fn regress_rows_behind_a_comment_mark_are_told() {
        let (rows, told) = read("# above\nline,x_mm\nX,1\n#3,2\n\nX,3\n# end\n", "comments.csv");
        assert_eq!(rows, Ok(2));
        assert_eq!(told, ["comments.csv: 2 lines below the column names begin with # and are left out"]);
        assert_eq!(read("# above\n\n# again\nline,x_mm\n\nX,1\n\"#3\",2\n", "none.csv"), (Ok(2), Vec::new()));
    }

    #[test]
    fn regress_a_last_line_without_an_end_is_told() {
        let (rows, told) = read("x_mm\n300\n35", "cut.csv");
        assert!(
            rows == Ok(2) && told.len() == 1 && told[0].contains("cut.csv, line 3: the last line has no end"),
            "{told:?}"
        );
        assert_eq!(read("x_mm\r\n300\r\n35\r", "whole.csv"), (Ok(2), Vec::new()));
    }

    #[test]
    fn regress_quotes_that_are_never_closed_swallow_no_rows() {
        for text in
            ["x_mm,note\n1,\"bad\n2,ok\n3,ok\n", "x_mm,note\n1,\"bad\n2,ok\n3,ok\n\n", "x_mm,note\n1,\"bad\n2,ok"]
        {
            let told = read(text, "open.csv").0.unwrap_err();
            assert!(told.contains("open.csv, line 2: the quotes of the last cell are never closed"), "{told}");
        }
        let (rows, told) = read("x_mm,note\n1,\"two\nlines\"\n2,ok\n3,\"at the end\n\"\n", "closed.csv");
        assert_eq!(rows, Ok(3));
        assert_eq!(told, ["closed.csv, line 2: a cell in quotes goes on over the end of the line"]);
        let (rows, _) = read("x_mm,note\n1,\"two\n\"\n# end\n", "commented.csv");
        assert_eq!(rows, Ok(1), "a comment below closed quotes opens none");
    }

    /// What stands above the column names was looked for in a text that was shorter by the line of the separator.
    #[test]
    fn regress_a_short_table_with_a_line_of_its_separator_is_read() {
        assert_eq!(read("sep=;\nx_mm\n1\n", "short.csv").0, Ok(1));
    }

    #[test]
    fn regress_line_breaks_in_column_names_become_blanks() {
        let source = CsvSource::new("\"Scale\n Y (C)\",x_mm\n1,2\n".as_bytes(), "t.csv").unwrap();
        assert_eq!(source.header().names(), ["Scale Y (C)", "x_mm"]);
        let told = read("\"a\u{1b}[1m\",x_mm\n1,2\n", "escape.csv").0.unwrap_err();
        assert!(told.contains("line 1, column number 1") && told.contains("control character"), "{told}");
    }
}
