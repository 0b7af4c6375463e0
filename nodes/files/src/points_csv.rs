//! Points with scale readings from any CSV, for correction, and the same rows with the corrected coordinates.
//!
//! Place in the flow: points file → [`PointsReader`] → `abbe_geometry::correct` → [`PointsWriter`]. Needed are
//! `x_mm y_mm z_mm` and the offset columns (or the machine's declared offset, ram frame); every other column is
//! handed through as it is and can serve as covariate by its name. Memory is one row.

use crate::columns::{ACTUAL, Known, OFFSET, Offset, READING, parse_number};
use crate::csv_source::CsvSource;
use crate::error::{FileError, Place};
use abbe_geometry::correct::{Correction, Status};
use abbe_geometry::effects::{CovariateSource, CovariateValue};
use csv::{ByteRecord, Writer};
use std::io::{Read, Write};

const KNOWN: [Known; 9] =
    [READING[0], READING[1], READING[2], OFFSET[0], OFFSET[1], OFFSET[2], ACTUAL[0], ACTUAL[1], ACTUAL[2]];
/// Columns that correction adds.
pub const ADDED_COLUMNS: [&str; 7] =
    ["corrected_x_mm", "corrected_y_mm", "corrected_z_mm", "u_x_um", "u_y_um", "u_z_um", "status"];
/// Coverage factor of the `u` columns.
const COVERAGE: f64 = 2.0;
const NUMBER_REMEDY: &str = "write a number with a decimal point, or remove the row";

/// One row: the cells as they are, and what they say of the machine.
#[derive(Debug, Clone, Default)]
pub struct PointRow {
    cells: ByteRecord,
    line: u64,
    /// Indicated axis positions (m).
    pub reading_m: [f64; 3],
    /// Tip or reflector relative to the ram reference point (m, ram frame).
    pub offset_m: [f64; 3],
    /// Where the tip really was (m, frame of the reference); only verification files have it.
    pub actual_m: Option<[f64; 3]>,
}

impl PointRow {
    /// Line in the file.
    pub fn line(&self) -> u64 {
        self.line
    }
}

/// Reads points row by row.
pub struct PointsReader<R: Read> {
    source: CsvSource<R>,
    reading: [usize; 3],
    offset: Offset,
    actual: Option<[usize; 3]>,
}

impl<R: Read> PointsReader<R> {
    /// Points to be corrected; `file` is the name in messages, `default_offset_m` serves a file without offset
    /// columns. A file that already holds one of [`ADDED_COLUMNS`] is refused.
    pub fn new(input: R, file: &str, default_offset_m: Option<[f64; 3]>) -> Result<PointsReader<R>, FileError> {
        let reader = PointsReader::open(input, file, default_offset_m)?;
        let header = reader.source.header();
        for name in ADDED_COLUMNS {
            if header.find(name).is_some() {
                let remedy = "give the file as it was before correction, or rename the column";
                let problem = "the file already holds a column that correction adds";
                return Err(FileError::content(header.place().column(name), problem, remedy));
            }
        }
        Ok(reader)
    }

    /// Points with `actual_x_mm actual_y_mm actual_z_mm`, to hold a corrected machine against.
    pub fn verification(
        input: R,
        file: &str,
        default_offset_m: Option<[f64; 3]>,
    ) -> Result<PointsReader<R>, FileError> {
        let mut reader = PointsReader::open(input, file, default_offset_m)?;
        let require = |k: usize| reader.source.header().require(ACTUAL[k], &KNOWN);
        reader.actual = Some([require(0)?, require(1)?, require(2)?]);
        Ok(reader)
    }

    fn open(input: R, file: &str, default_offset_m: Option<[f64; 3]>) -> Result<PointsReader<R>, FileError> {
        let source = CsvSource::new(input, file)?;
        let header = source.header();
        let require = |k: usize| header.require(READING[k], &KNOWN);
        let reading = [require(0)?, require(1)?, require(2)?];
        let offset = header.offset(default_offset_m, &KNOWN)?;
        Ok(PointsReader { source, reading, offset, actual: None })
    }

    /// Column names as in the file.
    pub fn columns(&self) -> &[String] {
        self.source.header().names()
    }

    /// Reads the next row into `row`; false at the end of the file.
    pub fn read(&mut self, row: &mut PointRow) -> Result<bool, FileError> {
        let Some(line) = self.source.next(&mut row.cells)? else { return Ok(false) };
        row.line = line;
        row.reading_m = self.metres(&row.cells, line, self.reading)?;
        row.offset_m = match self.offset {
            Offset::Columns(columns) => self.metres(&row.cells, line, columns)?,
            Offset::Constant(offset_m) => offset_m,
        };
        row.actual_m = self.actual.map(|columns| self.metres(&row.cells, line, columns)).transpose()?;
        Ok(true)
    }

    /// The further columns of a row as covariates. A cell that holds no finite number is a missing covariate: the
    /// correction then says so where an effect needs it.
    pub fn covariates<'a>(&'a self, row: &'a PointRow) -> RowCovariates<'a> {
        RowCovariates { names: self.columns(), cells: &row.cells }
    }

    /// SHA-256 of the bytes read so far: of the whole file once [`PointsReader::read`] has returned false.
    pub fn sha256(self) -> [u8; 32] {
        self.source.sha256()
    }

    fn metres(&self, cells: &ByteRecord, line: u64, columns: [usize; 3]) -> Result<[f64; 3], FileError> {
        let metres = |column| Ok(self.source.header().number(cells, column, line, NUMBER_REMEDY)? / 1e3);
        Ok([metres(columns[0])?, metres(columns[1])?, metres(columns[2])?])
    }
}

/// Covariates of one row.
#[derive(Clone, Copy)]
pub struct RowCovariates<'a> {
    names: &'a [String],
    cells: &'a ByteRecord,
}

impl CovariateSource for RowCovariates<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        if KNOWN.iter().any(|known| known.name == name) {
            return CovariateValue::Missing; // readings, offsets and truth are no covariates
        }
        let column = self.names.iter().position(|known| known == name);
        let value = column.and_then(|k| self.cells.get(k)).and_then(|cell| parse_number(cell).ok());
        value.map_or(CovariateValue::Missing, CovariateValue::Fresh)
    }
}

/// Word for a status in the column `status`.
pub const fn status_word(status: Status) -> &'static str {
    match status {
        Status::InVolume => "in_volume",
        Status::Extrapolated => "extrapolated",
        Status::CovariateMissing => "covariate_missing",
        Status::Stale => "stale",
        Status::Rejected => "rejected",
    }
}

/// Writes rows with their corrected coordinates.
pub struct PointsWriter<W: Write> {
    writer: Writer<W>,
    file: String,
    text: String,
}

impl<W: Write> PointsWriter<W> {
    /// Writes the header: the columns of the input and [`ADDED_COLUMNS`].
    pub fn new(output: W, file: &str, columns: &[String]) -> Result<PointsWriter<W>, FileError> {
        let mut writer = Writer::from_writer(output);
        let header = columns.iter().map(String::as_str).chain(ADDED_COLUMNS);
        writer.write_record(header).map_err(|error| unwritten(file, error))?;
        Ok(PointsWriter { writer, file: file.to_owned(), text: String::new() })
    }

    /// Writes one row: corrected position in mm (0.1 nm), u with k = 2 in µm, both empty where rejected.
    pub fn write(&mut self, row: &PointRow, correction: &Correction) -> Result<(), FileError> {
        self.write_cells(row, correction).map_err(|error| unwritten(&self.file, error))
    }

    fn write_cells(&mut self, row: &PointRow, correction: &Correction) -> csv::Result<()> {
        use std::fmt::Write as _;
        for cell in &row.cells {
            self.writer.write_field(cell)?;
        }
        let covariance_m2 = correction.covariance_m2;
        for k in 0..6 {
            self.text.clear();
            // Writing to a String cannot fail; an empty cell would be all that came of it.
            let _ = match covariance_m2 {
                None => Ok(()),
                Some(_) if k < 3 => write!(self.text, "{:.7}", correction.position_m[k] * 1e3),
                Some(v) => write!(self.text, "{:.4}", COVERAGE * v[(k - 3, k - 3)].max(0.0).sqrt() * 1e6),
            };
            self.writer.write_field(&self.text)?;
        }
        self.writer.write_field(status_word(correction.status))?;
        self.writer.write_record(None::<&[u8]>)
    }

    /// Flushes and hands the output back, to be committed.
    pub fn finish(self) -> Result<W, FileError> {
        let file = self.file;
        self.writer.into_inner().map_err(|error| {
            let source = std::io::Error::new(error.error().kind(), error.error().to_string());
            FileError::io(&file, "write")(source)
        })
    }
}

pub(crate) fn unwritten(file: &str, error: csv::Error) -> FileError {
    match error.into_kind() {
        csv::ErrorKind::Io(source) => FileError::io(file, "write")(source),
        other => FileError::content(Place::file(file), format!("a row cannot be written ({other:?})"), "check the row"),
    }
}
