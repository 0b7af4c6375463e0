//! Points with scale readings from any CSV, for correction, and the same rows with the corrected coordinates.
//!
//! Place in the flow: points file → [`PointsReader`] → `abbe_geometry::correct` → [`PointsWriter`]. Needed are
//! `x_mm y_mm z_mm` and the offset columns (or the machine's declared offset, ram frame); every other column is
//! handed through as it is and can serve as covariate by its name. What comes out is written as what went in: the same
//! delimiter, decimal mark and line ends (`crate::dialect`). Memory is one row here; rows may be turned into text on several
//! threads ([`RowsText`]).

use crate::columns::{ACTUAL, Header, Known, OFFSET, Offset, READING, TIME};
use crate::csv_source::CsvSource;
use crate::decimals::Mark;
use crate::dialect::Dialect;
use crate::error::{FileError, Place};
use crate::fixed::push_fixed;
use abbe_geometry::Axis;
use abbe_geometry::correct::{Correction, Status};
use abbe_geometry::effects::{CovariateSource, CovariateValue, Lag, Travel, of_lagged};
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
    /// How decimals are marked, as far as this row and those before it have shown.
    mark: Mark,
    /// Indicated axis positions (m).
    pub reading_m: [f64; 3],
    /// Tip or reflector relative to the ram reference point (m, ram frame).
    pub offset_m: [f64; 3],
    /// Where the tip really was (m, frame of the reference); only verification files have it.
    pub actual_m: Option<[f64; 3]>,
    /// Values of the derived covariates that the reader follows, in its order.
    derived: Vec<Option<f64>>,
}

impl PointRow {
    /// All cells, as they stand in the file.
    pub fn cells(&self) -> impl Iterator<Item = &[u8]> {
        self.cells.iter()
    }

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
    actual: Option<[Option<usize>; 3]>,
    followed: Vec<Followed>,
}

/// A derived covariate, made row by row.
struct Followed {
    name: String,
    from: Made,
}

/// What it is made from.
enum Made {
    /// The columns of the time and of the logged quantity.
    Columns([usize; 2], Lag),
    /// The readings, and the column of the logged side.
    Readings(Travel, Option<usize>),
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
        reader.actual = Some([Some(require(0)?), Some(require(1)?), Some(require(2)?)]);
        Ok(reader)
    }

    /// The same of a volume or a plate, of which one of the three may not have been measured: [`PointsReader::lacks`] names it,
    /// and a row holds 0 there.
    pub fn of_plates(input: R, file: &str, default_offset_m: Option<[f64; 3]>) -> Result<PointsReader<R>, FileError> {
        let mut reader = PointsReader::open(input, file, default_offset_m)?;
        let header = reader.source.header();
        let optional = |k: usize| header.optional(ACTUAL[k], &KNOWN);
        let actual = [optional(0)?, optional(1)?, optional(2)?];
        let missing: Vec<usize> = (0..3).filter(|k| actual[*k].is_none()).collect();
        if let [first, _, ..] = missing[..] {
            header.require(ACTUAL[first], &KNOWN)?;
        }
        reader.actual = Some(actual);
        Ok(reader)
    }

    /// The actual coordinate that the file does not have.
    pub fn lacks(&self) -> Option<Axis> {
        let actual = self.actual?;
        Axis::ALL.into_iter().find(|axis| actual[axis.index()].is_none())
    }

    /// A cell as text, `None` where the file has no such column.
    ///
    /// # Errors
    /// A cell that is empty or no text.
    pub fn text(&self, row: &PointRow, column: &str) -> Result<Option<String>, FileError> {
        let Some(index) = self.source.header().find(column) else { return Ok(None) };
        let cell = row.cells.get(index).unwrap_or_default().trim_ascii();
        let text = std::str::from_utf8(cell).ok().filter(|text| !text.is_empty());
        let missing = || {
            let place = self.source.header().cell(row.line, index);
            FileError::content(place, "the name is empty or not UTF-8", "write a name in every row")
        };
        text.map(|text| Some(text.to_owned())).ok_or_else(missing)
    }

    fn open(input: R, file: &str, default_offset_m: Option<[f64; 3]>) -> Result<PointsReader<R>, FileError> {
        let mut source = CsvSource::new(input, file)?;
        let header = source.header();
        let require = |k: usize| header.require(READING[k], &KNOWN);
        let reading = [require(0)?, require(1)?, require(2)?];
        let offset = header.offset(default_offset_m, &KNOWN)?;
        match offset {
            Offset::Columns(columns) => source.look_ahead(&[reading, columns].concat()),
            Offset::Constant(_) => source.look_ahead(&reading),
        }
        Ok(PointsReader { source, reading, offset, actual: None, followed: Vec::new() })
    }

    /// Also makes, of these covariates, those that lag behind a column of the file, from `time_s` and the rows as they come, and sides
    /// that follow over a travel, from their readings. A row has none until the rows before it tell for three time constants, or three
    /// times that travel, how it came.
    pub fn following(mut self, names: impl IntoIterator<Item = String>) -> PointsReader<R> {
        let header = self.source.header();
        let followed = |name: String| {
            if header.find(&name).is_some() {
                return None;
            }
            if let Some(travel) = Travel::of(&name) {
                let side = header.find(travel.logged_side());
                return Some(Followed { name, from: Made::Readings(travel, side) });
            }
            let (logged, lag_s) = of_lagged(&name)?;
            let columns = [header.find(TIME.name)?, header.find(&logged)?];
            Some(Followed { name, from: Made::Columns(columns, Lag::new(f64::from(lag_s))) })
        };
        self.followed = names.into_iter().filter_map(followed).collect();
        self
    }

    /// Column names as in the file.
    pub fn columns(&self) -> &[String] {
        self.source.header().names()
    }

    /// Refuses a number that has two readings, which no row read so far tells apart. At the end of the file [`PointsReader::read`]
    /// does; whoever hands out rows before must ask at each.
    pub fn refuse_open_numbers(&self) -> Result<(), FileError> {
        self.source.header().refuse_open_numbers()
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
        let actual = |columns: [Option<usize>; 3]| {
            let one = |column: Option<usize>| column.map_or(Ok(0.0), |column| self.metre(&row.cells, line, column));
            Ok::<_, FileError>([one(columns[0])?, one(columns[1])?, one(columns[2])?])
        };
        row.actual_m = self.actual.map(actual).transpose()?;
        let header = self.source.header();
        row.derived.clear();
        for followed in &mut self.followed {
            row.derived.push(match &mut followed.from {
                Made::Columns(columns, lag) => {
                    let [time, input] = *columns;
                    // How long ago something was does not depend on when seconds began to count.
                    let time_s = header.number(&row.cells, time, line, NUMBER_REMEDY).ok();
                    let input = header.optional_number(&row.cells, input, line);
                    let lagged = time_s.zip(input).map(|(time_s, input)| lag.push(time_s, input));
                    lagged.filter(|lagged| lagged.is_settled).map(|lagged| lagged.value)
                }
                Made::Readings(travel, side) => {
                    let logged = side.and_then(|column| header.optional_number(&row.cells, column, line));
                    let travelled = travel.push(row.reading_m, logged);
                    travelled.filter(|travelled| travelled.is_settled).map(|travelled| travelled.side)
                }
            });
        }
        row.mark = header.mark();
        Ok(true)
    }

    /// The further columns of a row as covariates. A cell that holds no finite number is a missing covariate: the
    /// correction then says so where an effect needs it.
    pub fn covariates<'a>(&'a self, row: &'a PointRow) -> RowCovariates<'a> {
        RowCovariates { header: self.source.header(), row, followed: &self.followed }
    }

    /// Where a covariate is found in every row.
    pub fn place_of(&self, covariate: &str) -> CovariatePlace {
        place_of(self.source.header(), &self.followed, covariate)
    }

    /// The covariate of a row that is found there; missing where the cell holds no finite number.
    pub fn covariate_at(&self, row: &PointRow, place: CovariatePlace) -> CovariateValue {
        value_at(self.source.header(), row, place)
    }

    /// SHA-256 of the bytes read so far: of the whole file once [`PointsReader::read`] has returned false.
    pub fn sha256(self) -> [u8; 32] {
        self.source.sha256()
    }

    fn metres(&self, cells: &ByteRecord, line: u64, columns: [usize; 3]) -> Result<[f64; 3], FileError> {
        let metre = |column| self.metre(cells, line, column);
        Ok([metre(columns[0])?, metre(columns[1])?, metre(columns[2])?])
    }

    fn metre(&self, cells: &ByteRecord, line: u64, column: usize) -> Result<f64, FileError> {
        Ok(self.source.header().number(cells, column, line, NUMBER_REMEDY)? / 1e3)
    }
}

/// Covariates of one row.
#[derive(Clone, Copy)]
pub struct RowCovariates<'a> {
    header: &'a Header,
    row: &'a PointRow,
    followed: &'a [Followed],
}

impl CovariateSource for RowCovariates<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        value_at(self.header, self.row, place_of(self.header, self.followed, name))
    }
}

/// Where a covariate of a table is found, the same in every row.
#[derive(Debug, Clone, Copy)]
pub struct CovariatePlace(Found);

#[derive(Debug, Clone, Copy)]
enum Found {
    Nowhere,
    Column(usize),
    /// Among those that the reader follows.
    Derived(usize),
}

fn place_of(header: &Header, followed: &[Followed], name: &str) -> CovariatePlace {
    let is_known = KNOWN.iter().any(|known| known.name == name);
    CovariatePlace(match (is_known, header.find(name)) {
        (true, _) => Found::Nowhere, // readings, offsets and truth are no covariates
        (false, Some(column)) => Found::Column(column),
        (false, None) => followed.iter().position(|known| known.name == name).map_or(Found::Nowhere, Found::Derived),
    })
}

fn value_at(header: &Header, row: &PointRow, CovariatePlace(found): CovariatePlace) -> CovariateValue {
    let value = match found {
        Found::Nowhere => None,
        Found::Column(column) => header.optional_number(&row.cells, column, row.line),
        Found::Derived(place) => row.derived.get(place).copied().flatten(),
    };
    value.map_or(CovariateValue::Missing, CovariateValue::Fresh)
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

/// How the rows of a table are written; goes to any thread.
#[derive(Debug, Clone, Copy)]
pub struct RowsForm(Dialect);

impl RowsForm {
    /// No row yet.
    pub fn text(self) -> RowsText {
        RowsText { writer: self.0.writer(Vec::new()), number: String::new() }
    }
}

/// Rows with their corrected coordinates, as text of a table.
pub struct RowsText {
    writer: Writer<Vec<u8>>,
    number: String,
}

impl RowsText {
    /// Adds one row: corrected position in mm (0.1 nm), u with k = 2 in µm, both empty where rejected.
    ///
    /// # Errors
    /// None that is known: the text grows in memory.
    pub fn push(&mut self, row: &PointRow, correction: &Correction) -> Result<(), FileError> {
        self.write_cells(row, correction).map_err(|error| unwritten("the table", error))
    }

    fn write_cells(&mut self, row: &PointRow, correction: &Correction) -> csv::Result<()> {
        for cell in &row.cells {
            self.writer.write_field(cell)?;
        }
        let covariance_m2 = correction.covariance_m2;
        for k in 0..6 {
            self.number.clear();
            match covariance_m2 {
                None => {}
                Some(_) if k < 3 => push_fixed(&mut self.number, correction.position_m[k] * 1e3, 7),
                Some(v) => push_fixed(&mut self.number, COVERAGE * v[(k - 3, k - 3)].max(0.0).sqrt() * 1e6, 4),
            }
            self.writer.write_field(row.mark.of(&mut self.number))?;
        }
        self.writer.write_field(status_word(correction.status))?;
        self.writer.write_record(None::<&[u8]>)
    }
}

/// Writes rows with their corrected coordinates, as the table they come from is written.
pub struct PointsWriter<W: Write> {
    output: W,
    file: String,
    form: RowsForm,
    marks: OneMark,
}

impl<W: Write> PointsWriter<W> {
    /// Writes the header: the columns of the input and [`ADDED_COLUMNS`]; `file` is the name of the output.
    pub fn new<R: Read>(output: W, file: &str, input: &PointsReader<R>) -> Result<PointsWriter<W>, FileError> {
        let header = input.source.header();
        let output = finished(started(output, file, header, &ADDED_COLUMNS)?, file)?;
        let marks = OneMark { mark: None, input: header.file().to_owned() };
        Ok(PointsWriter { output, file: file.to_owned(), form: RowsForm(header.dialect()), marks })
    }

    /// How its rows are written.
    pub fn form(&self) -> RowsForm {
        self.form
    }

    /// Writes one row.
    pub fn write(&mut self, row: &PointRow, correction: &Correction) -> Result<(), FileError> {
        let mut text = self.form.text();
        text.push(row, correction)?;
        self.append([row], text)
    }

    /// Writes the text of these rows.
    pub fn append<'r>(
        &mut self,
        rows: impl IntoIterator<Item = &'r PointRow>,
        text: RowsText,
    ) -> Result<(), FileError> {
        rows.into_iter().try_for_each(|row| self.marks.check(row.mark, row.line))?;
        let text = finished(text.writer, &self.file)?;
        self.output.write_all(&text).map_err(FileError::io(&self.file, "write"))
    }

    /// Hands on what was written so far.
    pub fn flush(&mut self) -> std::io::Result<()> {
        self.output.flush()
    }

    /// Flushes and hands the output back, to be committed.
    pub fn finish(mut self) -> Result<W, FileError> {
        self.output.flush().map_err(FileError::io(&self.file, "write"))?;
        Ok(self.output)
    }
}

/// Writes the head of a table that hands another through: what stands above its column names, the names, and those added.
pub(crate) fn started<W: Write>(
    mut output: W,
    file: &str,
    input: &Header,
    added: &[&str],
) -> Result<Writer<W>, FileError> {
    let dialect = input.dialect();
    output.write_all(dialect.head().as_bytes()).map_err(FileError::io(file, "write"))?;
    let mut writer = dialect.writer(output);
    let names = input.names().iter().map(String::as_str).chain(added.iter().copied());
    writer.write_record(names).map_err(|error| unwritten(file, error))?;
    Ok(writer)
}

/// Flushes and hands the output back.
pub(crate) fn finished<W: Write>(writer: Writer<W>, file: &str) -> Result<W, FileError> {
    writer.into_inner().map_err(|error| {
        let source = std::io::Error::new(error.error().kind(), error.error().to_string());
        FileError::io(file, "write")(source)
    })
}

/// The mark of decimals in which rows are written: that of the first, and no other.
pub(crate) struct OneMark {
    pub(crate) mark: Option<Mark>,
    /// Name of the table that is handed through.
    pub(crate) input: String,
}

impl OneMark {
    /// Refuses a row whose mark is known only now, after rows of whole numbers were written with points.
    pub(crate) fn check(&mut self, mark: Mark, line: u64) -> Result<(), FileError> {
        if *self.mark.get_or_insert(mark) == mark {
            return Ok(());
        }
        let (problem, remedy) = match mark {
            Mark::Comma => (
                "decimal commas begin here, after rows of whole numbers that were written out with decimal points",
                "write the line # decimal=, above the column names",
            ),
            Mark::Point => (
                "decimal points begin here, after rows that were written out with the decimal commas of another column",
                "write all numbers of a file in one way",
            ),
        };
        Err(FileError::content(Place::file(&self.input).line(line), problem, remedy))
    }
}

pub(crate) fn unwritten(file: &str, error: csv::Error) -> FileError {
    match error.into_kind() {
        csv::ErrorKind::Io(source) => FileError::io(file, "write")(source),
        other => FileError::content(Place::file(file), format!("a row cannot be written ({other:?})"), "check the row"),
    }
}
