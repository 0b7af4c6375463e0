//! How a table is written: what separates columns, what marks decimals, line ends, byte order mark, compression.
//!
//! Place in the flow: found by [`crate::csv_source::CsvSource`] from the lines up to the column names, and taken up by the
//! writers that hand a table through, so that it comes out as it went in. Excel writes semicolons where decimals have commas,
//! and reads a first line `sep=;`. A comment `# decimal=,` above the column names settles what no number shows.

use crate::decimals::Mark;
use crate::error::{FileError, Place};
use std::borrow::Cow;

/// What may separate columns, with its name.
const DELIMITERS: [(u8, &str); 4] = [(b',', "commas"), (b';', "semicolons"), (b'\t', "tabs"), (b'|', "bars")];
/// Those that are looked for; a bar must be named by a line `sep=|`.
const DETECTED: usize = 3;

/// How a table is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Dialect {
    pub(crate) delimiter: u8,
    /// Lines end with CR LF.
    pub(crate) crlf: bool,
    /// It begins with the byte order mark of UTF-8.
    pub(crate) byte_order_mark: bool,
    /// A line `sep=` says the delimiter.
    pub(crate) separator_line: bool,
    /// A comment says the mark of decimals, in this line.
    pub(crate) declared: Option<(Mark, u64)>,
    /// Name of the compression.
    pub(crate) compression: Option<&'static str>,
}

impl Default for Dialect {
    fn default() -> Dialect {
        Dialect {
            delimiter: b',',
            crlf: false,
            byte_order_mark: false,
            separator_line: false,
            declared: None,
            compression: None,
        }
    }
}

impl Dialect {
    /// What is not plain about it, in words; `None` for commas and points. Line ends change no number, and alone need no word.
    pub(crate) fn words(&self) -> Option<String> {
        let mut words = Vec::new();
        words.extend(self.compression.map(str::to_owned));
        words.extend(self.byte_order_mark.then(|| "byte order mark".to_owned()));
        if self.delimiter != b',' || self.separator_line {
            words.push(format!("columns between {}", name(self.delimiter)));
        }
        words.extend(self.declared.map(|(mark, _)| format!("decimals marked by {:?}", mark.sign())));
        let needs_words = !words.is_empty();
        words.extend(self.crlf.then(|| "lines end with CR LF".to_owned()));
        needs_words.then(|| words.join(", "))
    }

    /// What stands above the column names of a table of this dialect.
    pub(crate) fn head(&self) -> String {
        let end = if self.crlf { "\r\n" } else { "\n" };
        let mut head = String::new();
        if self.byte_order_mark {
            head.push('\u{feff}');
        }
        if self.separator_line {
            head += &format!("sep={}{end}", char::from(self.delimiter));
        }
        if let Some((mark, _)) = self.declared {
            head += &format!("# decimal={}{end}", mark.sign());
        }
        head
    }

    /// A writer of this dialect.
    pub(crate) fn writer<W: std::io::Write>(&self, output: W) -> csv::Writer<W> {
        let terminator = if self.crlf { csv::Terminator::CRLF } else { csv::Terminator::Any(b'\n') };
        csv::WriterBuilder::new()
            .delimiter(self.delimiter)
            .terminator(terminator)
            .comment(Some(b'#')) // a first cell that begins with it would be read as a comment
            .from_writer(output)
    }
}

/// A cell between commas as it is to be written: in quotes where its text would be read otherwise.
pub fn cell_text(text: &str) -> Cow<'_, str> {
    let is_special = |c: char| [',', '"', '\n', '\r'].contains(&c);
    match text.starts_with('#') || text.contains(is_special) {
        true => Cow::Owned(format!("\"{}\"", text.replace('"', "\"\""))),
        false => Cow::Borrowed(text),
    }
}

/// The lines of a text up to the column names, as they are looked at.
#[derive(Debug, Default)]
pub(crate) struct Preamble {
    /// Bytes of the line `sep=`, which is no row, by where it begins and ends.
    pub(crate) separator_line: Option<(usize, usize)>,
    delimiter: Option<u8>,
    declared: Option<(Mark, u64)>,
    /// Where the line of the column names begins and ends, and its number.
    header: Option<(usize, usize, u64)>,
}

impl Preamble {
    /// Looks at a text (line ends LF); `is_whole` where no more comes. `None` where the column names are not complete yet.
    pub(crate) fn read(text: &[u8], is_whole: bool, file: &str) -> Result<Option<Preamble>, FileError> {
        let mut found = Preamble::default();
        let (mut start, mut number) = (0, 1);
        while start < text.len() {
            let Some(length) = line_length(&text[start..], is_whole) else { return Ok(None) };
            let line = &text[start..start + length];
            let place = || Place::file(file).line(number);
            if let Some(delimiter) = separator(line).filter(|_| found.delimiter.is_none()) {
                found.delimiter = Some(known(delimiter, place())?);
                found.separator_line = Some((start, start + length));
            } else if let Some(comment) = line.strip_prefix(b"#") {
                found.declared = declared(comment, place())?.map(|mark| (mark, number)).or(found.declared);
            } else if !line.is_empty() {
                found.header = Some((start, start + length, number));
                return Ok(Some(found));
            }
            number += 1 + text[start..start + length].iter().filter(|byte| **byte == b'\n').count() as u64;
            start += length + 1;
        }
        Ok(is_whole.then_some(found))
    }

    /// Lines above the column names that begin with `#`; `text` is what was read.
    pub(crate) fn comments(&self, text: &[u8]) -> u64 {
        let above = self.header.map_or(text, |(start, ..)| &text[..start]);
        above.split(|byte| *byte == b'\n').filter(|line| line.starts_with(b"#")).count() as u64
    }

    /// What it says of the dialect; `text` is what was read.
    pub(crate) fn complete(&self, text: &[u8], file: &str, dialect: &mut Dialect) -> Result<(), FileError> {
        dialect.separator_line = self.separator_line.is_some();
        dialect.declared = self.declared;
        dialect.delimiter = match (self.delimiter, self.header) {
            (Some(delimiter), _) => delimiter,
            (None, Some((start, end, number))) => detected(&text[start..end], Place::file(file).line(number))?,
            (None, None) => b',',
        };
        Ok(())
    }
}

/// Length of the first line without its end; line ends inside quotes are part of it. `None` where it is not complete.
fn line_length(text: &[u8], is_whole: bool) -> Option<usize> {
    let is_comment = text.first() == Some(&b'#');
    let mut is_quoted = false;
    for (k, byte) in text.iter().enumerate() {
        match byte {
            b'"' if !is_comment => is_quoted = !is_quoted,
            b'\n' if !is_quoted => return Some(k),
            _ => {}
        }
    }
    is_whole.then_some(text.len())
}

/// What a line `sep=` names; Excel fills such a line up with delimiters when it saves, and may quote it.
pub(crate) fn separator(line: &[u8]) -> Option<u8> {
    let line = line.trim_ascii();
    let line = line.strip_prefix(b"\"").unwrap_or(line);
    let (word, rest) = line.split_at_checked(4)?;
    if !word.eq_ignore_ascii_case(b"sep=") {
        return None;
    }
    // A tab at the end of the line was trimmed off with the blanks.
    let (delimiter, rest) = rest.split_first().unwrap_or((&b'\t', &[]));
    rest.iter().all(|byte| *byte == b'"' || byte == delimiter).then_some(*delimiter)
}

fn known(delimiter: u8, place: Place) -> Result<u8, FileError> {
    if DELIMITERS.iter().any(|(known, _)| *known == delimiter) {
        return Ok(delimiter);
    }
    let problem = format!("{:?} cannot separate columns", char::from(delimiter));
    Err(FileError::content(place, problem, "separate them by commas, semicolons, tabs or bars (sep=|)"))
}

/// What a comment `decimal=` says.
fn declared(comment: &[u8], place: Place) -> Result<Option<Mark>, FileError> {
    let comment = comment.trim_ascii();
    let Some((word, rest)) = comment.split_at_checked(8) else { return Ok(None) };
    if !word.eq_ignore_ascii_case(b"decimal=") {
        return Ok(None);
    }
    match rest.trim_ascii_start().first() {
        Some(b',') => Ok(Some(Mark::Comma)),
        Some(b'.') => Ok(Some(Mark::Point)),
        _ => {
            let problem = "this comment says no mark of decimals";
            Err(FileError::content(place, problem, "write # decimal=, or # decimal=."))
        }
    }
}

/// The delimiter that a line of column names has.
fn detected(line: &[u8], place: Place) -> Result<u8, FileError> {
    let candidates = &DELIMITERS[..DETECTED];
    let present: Vec<u8> = candidates.iter().map(|(d, _)| *d).filter(|d| cells(line, *d) > 1).collect();
    let [first, rest @ ..] = present.as_slice() else { return Ok(b',') };
    if rest.is_empty() {
        return Ok(*first);
    }
    // A name may hold the mark that separates the columns of another dialect. The delimiter is what leaves most names whole.
    let whole = |delimiter: u8| whole_names(line, delimiter, &present);
    let most = present.iter().map(|d| whole(*d)).max().unwrap_or_default();
    match present.iter().filter(|d| whole(**d) == most).collect::<Vec<_>>().as_slice() {
        [one] => Ok(**one),
        several => {
            let named: Vec<&str> = several.iter().map(|d| name(**d)).collect();
            let problem = format!("both {} may separate these columns", named.join(" and "));
            let remedy = "say which by a first line sep=, or sep=; or quote the names that hold such a mark";
            Err(FileError::content(place, problem, remedy))
        }
    }
}

/// Cells outside quotes.
fn split(line: &[u8], delimiter: u8) -> Vec<Vec<u8>> {
    let (mut cells, mut is_quoted) = (vec![Vec::new()], false);
    for byte in line {
        is_quoted ^= *byte == b'"';
        match cells.last_mut() {
            Some(cell) if is_quoted || *byte != delimiter => {
                // What is quoted belongs to the name, whatever it is.
                cell.push(if is_quoted { b'"' } else { *byte });
            }
            _ => cells.push(Vec::new()),
        }
    }
    cells
}

fn cells(line: &[u8], delimiter: u8) -> usize {
    split(line, delimiter).len()
}

fn whole_names(line: &[u8], delimiter: u8, marks: &[u8]) -> usize {
    let is_whole = |cell: &&Vec<u8>| !cell.trim_ascii().is_empty() && !cell.iter().any(|byte| marks.contains(byte));
    split(line, delimiter).iter().filter(is_whole).count()
}

pub(crate) fn name(delimiter: u8) -> &'static str {
    DELIMITERS.iter().find(|(known, _)| *known == delimiter).map_or("other marks", |(_, name)| *name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dialect(text: &str) -> Result<Dialect, String> {
        let said = |error: FileError| error.to_string();
        let preamble = Preamble::read(text.as_bytes(), true, "t.csv").map_err(said)?.unwrap();
        let mut dialect = Dialect::default();
        preamble.complete(text.as_bytes(), "t.csv", &mut dialect).map_err(said)?;
        Ok(dialect)
    }

    #[test]
    fn the_delimiter_is_what_separates_the_column_names() {
        for (text, delimiter) in [
            ("x_mm,y_mm\n", b','),
            ("x_mm;y_mm\n", b';'),
            ("\n# a, comment; here\nx_mm\ty_mm\n", b'\t'),
            ("x_mm\n", b','),
            ("", b','),
            ("x_mm;y_mm;\"note, or so\"\n", b';'),
            ("x_mm;y_mm;note, or so\n", b';'),
            ("sep=;\na,b;c\n", b';'),
            ("SEP=,\na,b;c\n", b','),
            ("\"sep=;\";;;\nx_mm;y_mm\n", b';'),
            ("sep=\t\nx_mm\ty_mm\n", b'\t'),
            ("sep=|\nx_mm|y_mm\n", b'|'),
        ] {
            assert_eq!(dialect(text).map(|d| char::from(d.delimiter)), Ok(char::from(delimiter)), "{text:?}");
        }
        let both = dialect("# c\na,b;c\n").unwrap_err();
        assert!(both.starts_with("t.csv, line 2: both commas and semicolons") && both.contains("sep="), "{both}");
        assert!(dialect("sep=x\nax b\n").unwrap_err().contains("'x' cannot separate"));
    }

    #[test]
    fn cells_that_would_read_otherwise_are_quoted() {
        for (text, written) in
            [("S1", "S1"), ("#2", "\"#2\""), ("hall, door", "\"hall, door\""), ("a \"b\"", "\"a \"\"b\"\"\"")]
        {
            assert_eq!(cell_text(text), written);
        }
    }

    #[test]
    fn a_comment_says_the_mark_of_decimals() {
        assert_eq!(dialect("# decimal=,;;;\nx_mm;y_mm\n").unwrap().declared, Some((Mark::Comma, 1)));
        assert_eq!(dialect("\n#Decimal= .\nx_mm;y_mm\n").unwrap().declared, Some((Mark::Point, 2)));
        assert_eq!(dialect("# decimals are fine\nx_mm\n").unwrap().declared, None);
        assert!(dialect("# decimal=comma\nx_mm\n").unwrap_err().contains("line 1"));
    }

    #[test]
    fn column_names_that_are_not_complete_are_waited_for() {
        for text in ["", "# a\n", "sep=;\n", "x_mm,y_m", "x_mm,\"two\nlines"] {
            assert!(Preamble::read(text.as_bytes(), false, "t.csv").unwrap().is_none(), "{text:?}");
        }
        let quoted = "x_mm,\"two\nlines\"\n1";
        let read = Preamble::read(quoted.as_bytes(), false, "t.csv").unwrap().unwrap();
        assert_eq!(read.header, Some((0, quoted.len() - 2, 1)));
    }
}
