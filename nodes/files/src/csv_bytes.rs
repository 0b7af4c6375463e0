//! The bytes of a table: hashed as they lie in the file, unpacked, checked to be UTF-8 text, line ends in one form.
//!
//! Place in the flow: between a file, or the standard input, and [`crate::csv_source::CsvSource`]. Compression is told by the
//! first bytes (gzip, Zstandard), so that it also works without a name. Memory is a buffer, and a row may not be longer than
//! [`MOST_OF_A_ROW`]: what unpacks to endless blanks ends there.

use crate::dialect::Dialect;
use crate::error::{FileError, Place};
use flate2::bufread::MultiGzDecoder;
use sha2::{Digest, Sha256};
use std::fmt;
use std::io::{BufReader, ErrorKind, Read};

/// Bytes that a row may take, with the comments above it.
const MOST_OF_A_ROW: u64 = 1 << 22;
/// Bytes by which packed files, and files that are no text, are told.
const SIGNATURE: usize = 8;
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// First bytes of files that are no table, and what to do with them.
const STRANGERS: [(&[u8], &str, &str); 7] = [
    (b"PK\x03\x04", "an Excel workbook or a ZIP archive", "save the sheet as CSV UTF-8, or unpack it"),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook", "save the sheet as CSV UTF-8"),
    (b"\xff\xfe", "text in UTF-16", "save it as CSV UTF-8"),
    (b"\xfe\xff", "text in UTF-16", "save it as CSV UTF-8"),
    (b"\xfd7zXZ", "packed by xz", "unpack it, or pack it by gzip or zstd"),
    (b"BZh", "packed by bzip2", "unpack it, or pack it by gzip or zstd"),
    (b"\x89MCAP", "a bag", "name it so that it ends in .mcap"),
];

/// Text of a table, line ends LF, also after the last line.
pub(crate) struct TableBytes<R: Read> {
    unpacked: Unpacked<R>,
    dialect: Dialect,
    /// What is read again before anything else.
    ready: Vec<u8>,
    taken: usize,
    /// A CR was read, and what follows it is not known yet.
    after_return: bool,
    /// Line ends were seen, so that `dialect.crlf` holds.
    knows_line_end: bool,
    ends_with_newline: bool,
    of_this_row: u64,
    /// Lines so far that begin with `#`, those inside quotes too.
    comments: u64,
    /// The last line had no end, and was given one.
    lacks_end: bool,
    /// The last byte that is no line end, of a line that is no comment.
    last: u8,
    at_line_start: bool,
    in_comment: bool,
}

impl<R: Read> TableBytes<R> {
    /// Looks at the first bytes; `file` is the name in messages.
    pub(crate) fn new(input: R, file: &str) -> Result<TableBytes<R>, FileError> {
        let mut raw = Raw { input, hash: Sha256::new(), head: Vec::new(), taken: 0 };
        raw.head = first_bytes(&mut raw).map_err(FileError::io(file, "read the file"))?;
        refuse_strangers(&raw.head, file)?;
        let buffered = |raw| BufReader::with_capacity(1 << 16, raw);
        let mut dialect = Dialect::default();
        let unpacked = if raw.head.starts_with(b"\x1f\x8b") {
            dialect.compression = Some("gzip");
            Unpacked::Gzip(Box::new(MultiGzDecoder::new(buffered(raw))))
        } else if raw.head.starts_with(b"\x28\xb5\x2f\xfd") {
            dialect.compression = Some("Zstandard");
            let decoder = zstd::Decoder::with_buffer(buffered(raw)).map_err(FileError::io(file, "unpack the file"))?;
            Unpacked::Zstandard(Box::new(decoder))
        } else {
            Unpacked::Plain(raw)
        };
        let mut bytes = TableBytes {
            unpacked,
            dialect,
            ready: Vec::new(),
            taken: 0,
            after_return: false,
            knows_line_end: false,
            ends_with_newline: true,
            of_this_row: 0,
            comments: 0,
            lacks_end: false,
            last: b'\n',
            at_line_start: true,
            in_comment: false,
        };
        let head = first_bytes(&mut bytes.unpacked).map_err(|error| bytes.told(error, file, 1))?;
        refuse_strangers(&head, file)?;
        bytes.dialect.byte_order_mark = head.starts_with(BYTE_ORDER_MARK);
        let text = head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&head).to_vec();
        bytes.translate(&text);
        Ok(bytes)
    }

    /// What is known of the dialect.
    pub(crate) fn dialect(&self) -> Dialect {
        self.dialect
    }

    /// Puts text back, to be read again.
    pub(crate) fn put_back(&mut self, text: Vec<u8>) {
        let rest = self.ready.split_off(self.taken);
        self.ready = [text, rest].concat();
        self.taken = 0;
        (self.comments, self.ends_with_newline) = (0, true);
        (self.at_line_start, self.in_comment) = (true, false);
    }

    /// Lines so far that begin with `#`, with those that a cell in quotes holds.
    pub(crate) fn comments(&self) -> u64 {
        self.comments
    }

    /// Whether the last line had no end.
    pub(crate) fn lacks_end(&self) -> bool {
        self.lacks_end
    }

    /// The last byte of the text that is no line end, at the end of the file.
    pub(crate) fn last(&self) -> u8 {
        self.last
    }

    /// A row begins: what it may take is counted from here.
    pub(crate) fn begin_row(&mut self) {
        self.of_this_row = 0;
    }

    /// SHA-256 of the bytes of the file read so far.
    pub(crate) fn sha256(self) -> [u8; 32] {
        self.unpacked.into_raw().hash.finalize().into()
    }

    /// What went wrong, at a line of the file.
    pub(crate) fn told(&self, error: std::io::Error, file: &str, line: u64) -> FileError {
        let place = || Place::file(file).line(line);
        if error.get_ref().is_some_and(|inner| inner.is::<RowTooLong>()) {
            return FileError::content(
                place(),
                error.to_string(),
                "close the quotes, and end each row with a line end",
            );
        }
        match self.dialect.compression {
            // What the system refuses has a number; all else is what the unpacking met.
            Some(packed) if error.raw_os_error().is_none() && error.kind() != ErrorKind::Interrupted => {
                let problem = format!("the {packed} data are damaged or cut off ({error})");
                FileError::content(place(), problem, "copy or pack the file again")
            }
            _ => FileError::io(file, "read the file")(error),
        }
    }

    /// Makes text ready to be read, with LF for CR LF and for CR alone.
    fn translate(&mut self, text: &[u8]) {
        self.ready.drain(..self.taken);
        self.taken = 0;
        for byte in text {
            let after_return = std::mem::take(&mut self.after_return);
            match byte {
                b'\n' => self.line_end(after_return),
                b'\r' if after_return => {
                    self.line_end(false);
                    self.after_return = true;
                }
                b'\r' => self.after_return = true,
                _ => {
                    if after_return {
                        self.line_end(false);
                    }
                    self.ready.push(*byte);
                }
            }
        }
    }

    /// Notes what this text tells of the whole.
    fn note(&mut self, text: &[u8]) {
        let Some((first, last)) = text.first().zip(text.last()) else { return };
        let within = text.windows(2).filter(|pair| *pair == b"\n#").count();
        self.comments += (within + usize::from(self.ends_with_newline && *first == b'#')) as u64;
        // A comment below the rows is none of them.
        for line in text.split_inclusive(|byte| *byte == b'\n') {
            self.in_comment = if self.at_line_start { line[0] == b'#' } else { self.in_comment };
            self.at_line_start = line.ends_with(b"\n");
            if !self.in_comment {
                self.last = line.iter().rev().copied().find(|byte| *byte != b'\n').unwrap_or(self.last);
            }
        }
        self.ends_with_newline = *last == b'\n';
    }

    fn line_end(&mut self, is_crlf: bool) {
        self.ready.push(b'\n');
        if !self.knows_line_end {
            (self.knows_line_end, self.dialect.crlf) = (true, is_crlf);
        }
    }

    /// More text, at least a byte of it; nothing at the end.
    fn more(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        loop {
            let ready = self.ready.get(self.taken..).unwrap_or_default();
            if !ready.is_empty() {
                let count = ready.len().min(buffer.len());
                buffer[..count].copy_from_slice(&ready[..count]);
                self.taken += count;
                return Ok(count);
            }
            let count = self.unpacked.read(buffer)?;
            match count {
                0 if self.after_return => {
                    self.after_return = false;
                    self.translate(b"\n");
                }
                0 => return Ok(0),
                _ if !self.after_return && self.knows_line_end && !buffer[..count].contains(&b'\r') => {
                    return Ok(count);
                }
                _ => {
                    let text = buffer[..count].to_vec();
                    self.translate(&text);
                }
            }
        }
    }
}

impl<R: Read> Read for TableBytes<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        let mut count = self.more(buffer)?;
        if count == 0 && !self.ends_with_newline {
            buffer[0] = b'\n';
            (count, self.lacks_end) = (1, true);
        }
        self.note(&buffer[..count]);
        self.of_this_row += count as u64;
        if self.of_this_row > MOST_OF_A_ROW {
            return Err(std::io::Error::other(RowTooLong));
        }
        Ok(count)
    }
}

/// A row without an end.
#[derive(Debug)]
struct RowTooLong;

impl fmt::Display for RowTooLong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the row is longer than {} MiB", MOST_OF_A_ROW >> 20)
    }
}

impl std::error::Error for RowTooLong {}

/// Up to [`SIGNATURE`] bytes, fewer only at the end.
fn first_bytes(input: &mut impl Read) -> std::io::Result<Vec<u8>> {
    let (mut head, mut bytes) = (Vec::new(), [0; SIGNATURE]);
    while head.len() < SIGNATURE {
        let count = input.read(&mut bytes[head.len()..])?;
        if count == 0 {
            break;
        }
        head.extend_from_slice(&bytes[head.len()..head.len() + count]);
    }
    Ok(head)
}

fn refuse_strangers(head: &[u8], file: &str) -> Result<(), FileError> {
    let known = STRANGERS.iter().find(|(signature, ..)| head.starts_with(signature));
    let refused = |what: &str, remedy: &str| {
        Err(FileError::content(Place::file(file), format!("this is no CSV but {what}"), remedy))
    };
    match known {
        Some((_, what, remedy)) => refused(what, remedy),
        // Letters of UTF-16 without a byte order mark.
        None if matches!(head, [0, a, 0, b, ..] | [a, 0, b, 0, ..] if *a != 0 && *b != 0) => {
            refused("text in UTF-16", "save it as CSV UTF-8")
        }
        None => Ok(()),
    }
}

/// Bytes as they lie in the file.
struct Raw<R: Read> {
    input: R,
    hash: Sha256,
    /// What was read to look at it, to be read again.
    head: Vec<u8>,
    taken: usize,
}

impl<R: Read> Read for Raw<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let again = &self.head[self.taken..];
        if !again.is_empty() {
            let count = again.len().min(buffer.len());
            buffer[..count].copy_from_slice(&again[..count]);
            self.taken += count;
            return Ok(count);
        }
        loop {
            match self.input.read(buffer) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
                Ok(count) => {
                    self.hash.update(&buffer[..count]);
                    return Ok(count);
                }
            }
        }
    }
}

/// What is in the file, unpacked. Both packers bound what they need by the format: 32 KiB and, in Zstandard, 128 MiB.
enum Unpacked<R: Read> {
    Plain(Raw<R>),
    Gzip(Box<MultiGzDecoder<BufReader<Raw<R>>>>),
    Zstandard(Box<zstd::Decoder<'static, BufReader<Raw<R>>>>),
}

impl<R: Read> Unpacked<R> {
    fn into_raw(self) -> Raw<R> {
        match self {
            Unpacked::Plain(raw) => raw,
            Unpacked::Gzip(decoder) => decoder.into_inner().into_inner(),
            Unpacked::Zstandard(decoder) => decoder.finish().into_inner(),
        }
    }
}

impl<R: Read> Read for Unpacked<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        match self {
            Unpacked::Plain(raw) => raw.read(buffer),
            Unpacked::Gzip(decoder) => decoder.read(buffer),
            Unpacked::Zstandard(decoder) => decoder.read(buffer),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gives one byte at a time, as the slowest pipe does.
    struct Dripping<'a>(&'a [u8]);

    impl Read for Dripping<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            let count = buffer.len().min(1);
            (&mut self.0).take(count as u64).read(buffer)
        }
    }

    fn text(bytes: &[u8]) -> (String, Dialect) {
        let mut table = TableBytes::new(bytes, "t.csv").unwrap();
        let mut whole = String::new();
        table.read_to_string(&mut whole).unwrap();
        let mut dripped = String::new();
        TableBytes::new(Dripping(bytes), "t.csv").unwrap().read_to_string(&mut dripped).unwrap();
        assert_eq!(whole, dripped, "it depends on how much comes at a time");
        (whole, table.dialect())
    }

    #[test]
    fn line_ends_of_any_system_become_one() {
        for ends in ["a\nb\n", "a\r\nb\r\n", "a\rb\r", "a\r\nb", "a\rb", "a\nb", "\u{feff}a\r\nb\n"] {
            assert_eq!(text(ends.as_bytes()).0, "a\nb\n", "{ends:?}");
        }
        assert_eq!(text(b"a\r\r\n\nb\r").0, "a\n\n\nb\n");
        assert_eq!([b"a\r\nb\n".as_slice(), b"a\nb\r\n", b"a\rb"].map(|t| text(t).1.crlf), [true, false, false]);
        assert_eq!(["", "\n", "\u{feff}"].map(|t| text(t.as_bytes()).0), ["", "\n", ""]);
    }

    #[test]
    fn what_is_no_text_is_named() {
        for (bytes, says) in [
            (b"PK\x03\x04....".as_slice(), "Excel workbook"),
            (b"\xff\xfex\0_\0", "UTF-16"),
            (b"\0x\0_\0m\0m", "UTF-16"),
            (b"x\0_\0m\0m\0", "UTF-16"),
            (b"\x89MCAP0\r\n", "a bag"),
        ] {
            let Err(error) = TableBytes::new(bytes, "t.csv") else { panic!("{bytes:?} was taken") };
            assert!(error.to_string().contains(says), "{error}");
        }
    }

    #[test]
    fn a_row_without_end_is_refused_before_it_fills_the_memory() {
        let endless = std::io::repeat(b'7');
        let error = std::io::copy(&mut TableBytes::new(endless, "t.csv").unwrap(), &mut std::io::sink()).unwrap_err();
        assert!(error.get_ref().unwrap().is::<RowTooLong>(), "{error}");
    }
}
