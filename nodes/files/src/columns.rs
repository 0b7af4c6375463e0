//! Column names of a CSV header, and the numbers below them.
//!
//! Place in the flow: the readers of campaigns and points look up their columns here, so that a missing,
//! misspelt or wrongly scaled column is refused in the same words everywhere, and so is a number that could be another.

use crate::decimals::{Contradiction, Decimals, Mark, NoNumber, Number, Seen, number};
use crate::dialect::{self, Dialect};
use crate::error::{FileError, Place};
use crate::instants::{Clock, Instant};
use crate::names::{is_like_offset, is_like_temperature, nearest};
use crate::notice::tell_once;
use crate::units::millimetres_from_m;
use csv::ByteRecord;
use std::borrow::Cow;
use std::cell::{Cell, RefCell};

/// A column that a reader knows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Known {
    /// Name with the unit as suffix.
    pub(crate) name: &'static str,
    /// Name before the unit suffix; the same as the name for columns without a unit.
    stem: &'static str,
    /// The unit in words.
    unit: &'static str,
}

impl Known {
    /// A column by its name, the name before the unit suffix, and the unit in words.
    pub(crate) const fn new(name: &'static str, stem: &'static str, unit: &'static str) -> Known {
        Known { name, stem, unit }
    }
}

const fn millimetres(name: &'static str, stem: &'static str) -> Known {
    Known { name, stem, unit: "millimetres" }
}

pub(crate) const STATION: Known = Known { name: "station", stem: "station", unit: "text" };
pub(crate) const LINE: Known = Known { name: "line", stem: "line", unit: "text" };
pub(crate) const TIME: Known = Known { name: "time_s", stem: "time", unit: "seconds" };
pub(crate) const LENGTH: Known = millimetres("length_mm", "length");
pub(crate) const READING: [Known; 3] = [millimetres("x_mm", "x"), millimetres("y_mm", "y"), millimetres("z_mm", "z")];
pub(crate) const OFFSET: [Known; 3] = [
    millimetres("offset_x_mm", "offset_x"),
    millimetres("offset_y_mm", "offset_y"),
    millimetres("offset_z_mm", "offset_z"),
];
pub(crate) const ACTUAL: [Known; 3] = [
    millimetres("actual_x_mm", "actual_x"),
    millimetres("actual_y_mm", "actual_y"),
    millimetres("actual_z_mm", "actual_z"),
];

/// Signs that texts write for a minus: minus sign, hyphens, figure dash, dashes, small and wide hyphen.
const OTHER_MINUS: [char; 9] =
    ['\u{2212}', '\u{2010}', '\u{2011}', '\u{2012}', '\u{2013}', '\u{2014}', '\u{fe63}', '\u{ff0d}', '\u{2015}'];

const TIME_REMEDY: &str = "write all times of a file in seconds (between two instants of a spreadsheet, (A3-A$2)*86400), or all as date and \
                           time of day, such as 2021-06-13T05:00:02";

/// Unit suffixes that people write; a known column with one of these is in another unit than wanted.
const UNITS: [&str; 17] =
    ["nm", "um", "µm", "μm", "mm", "cm", "dm", "m", "in", "inch", "ns", "us", "µs", "ms", "s", "min", "h"];

/// Names of the columns, and where they stand.
#[derive(Debug, Clone)]
pub(crate) struct Header {
    names: Vec<String>,
    file: String,
    line: u64,
    dialect: Dialect,
    /// Cells without a name behind the last column, as a mark at the end of each line leaves them.
    unnamed: usize,
    /// What the numbers read so far tell of their marks.
    decimals: RefCell<Decimals>,
    /// How columns mark decimals that nobody reads: for what is written while no number that is read has shown it.
    aside: Cell<Option<Mark>>,
    /// Column of the time, and what it holds.
    time: Option<usize>,
    clock: Cell<Clock>,
}

impl Header {
    pub(crate) fn new(record: &ByteRecord, file: &str, line: u64, dialect: Dialect) -> Result<Header, FileError> {
        let decimals = dialect.declared.map_or(Decimals::Unknown, |(mark, line)| Decimals::Declared(mark, line));
        let (names, decimals) = (Vec::with_capacity(record.len()), RefCell::new(decimals));
        let named = record.iter().rposition(|cell| !cell.trim_ascii().is_empty()).map_or(0, |last| last + 1);
        // A line of nothing but marks names no column.
        let unnamed = if named == 0 { 0 } else { record.len() - named };
        let clock = Cell::new(Clock::Unknown);
        let (file, aside) = (file.to_owned(), Cell::new(None));
        let mut header = Header { names, file, line, dialect, unnamed, decimals, aside, time: None, clock };
        header.refuse_numbers(record)?;
        for (k, cell) in record.iter().take(record.len() - unnamed).enumerate() {
            let place = || header.place().column(&format!("number {}", k + 1));
            let Ok(name) = std::str::from_utf8(cell) else {
                return Err(FileError::content(place(), "the name is not UTF-8", "save the file as UTF-8"));
            };
            let name = one_line(name).map_err(|sign| {
                let problem = format!("the name holds the control character {sign:?}");
                FileError::content(place(), problem, "write the name without it")
            })?;
            let name = name.trim();
            if name.is_empty() {
                return Err(FileError::content(place(), "the column has no name", "name or remove it"));
            }
            if header.find(name).is_some() {
                let place = header.place().column(name);
                return Err(FileError::content(place, "the column stands twice", "remove or rename one of the two"));
            }
            header.names.push(name.to_owned());
        }
        header.time = header.find(TIME.name);
        Ok(header)
    }

    pub(crate) fn names(&self) -> &[String] {
        &self.names
    }

    pub(crate) fn len(&self) -> usize {
        self.names.len()
    }

    /// Cells without a name behind the last column: they hold nothing in any row.
    pub(crate) fn unnamed(&self) -> usize {
        self.unnamed
    }

    pub(crate) fn file(&self) -> &str {
        &self.file
    }

    /// The header line.
    pub(crate) fn place(&self) -> Place {
        Place::file(&self.file).line(self.line)
    }

    /// A cell.
    pub(crate) fn cell(&self, line: u64, column: usize) -> Place {
        Place::file(&self.file).line(line).column(self.names.get(column).map_or("?", String::as_str))
    }

    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }

    /// Index of a column that must be there; `known` are all names this reader understands.
    pub(crate) fn require(&self, wanted: Known, known: &[Known]) -> Result<usize, FileError> {
        self.optional(wanted, known)?.ok_or_else(|| {
            let remedy = format!("add the column {} ({})", wanted.name, wanted.unit);
            FileError::content(self.place().column(wanted.name), "the column is missing", remedy)
        })
    }

    /// Index of a column that may be missing, but not misspelt or in another unit.
    pub(crate) fn optional(&self, wanted: Known, known: &[Known]) -> Result<Option<usize>, FileError> {
        if let Some(index) = self.find(wanted.name) {
            return Ok(Some(index));
        }
        if let Some(other) = self.names.iter().find(|name| is_other_unit(name, wanted)) {
            let problem = format!("the unit is not the one expected: {} in {} is needed", wanted.name, wanted.unit);
            let remedy = format!("convert the values to {} and name the column {}", wanted.unit, wanted.name);
            return Err(FileError::content(self.place().column(other), problem, remedy));
        }
        let strangers = self.names.iter().map(String::as_str).filter(|name| known.iter().all(|k| k.name != *name));
        match nearest(wanted.name, strangers) {
            None => Ok(None),
            Some(misspelt) => {
                let problem = format!("the column {} is missing; did you mean it by {misspelt}?", wanted.name);
                let remedy = format!("rename the column {misspelt} to {}", wanted.name);
                Err(FileError::content(self.place().column(misspelt), problem, remedy))
            }
        }
    }

    /// Refuses what would be a wrong covariate, where whatever is not known becomes one.
    pub(crate) fn check_covariates(&self, known: &[Known]) -> Result<(), FileError> {
        self.refuse_said_twice(known)?;
        self.refuse_unnamed_temperatures(known)
    }

    /// Refuses a column that is one of these in another unit: one quantity would be told to depend on itself.
    fn refuse_said_twice(&self, known: &[Known]) -> Result<(), FileError> {
        let names = || self.names.iter().map(String::as_str).filter(|name| known.iter().all(|k| k.name != *name));
        match known.iter().find_map(|k| Some((names().find(|name| is_other_unit(name, *k))?, k))) {
            Some((other, own)) => Err(self.said_twice(other, own.name)),
            None => Ok(()),
        }
    }

    /// Refuses a column that looks like a temperature and would not count as one: what a temperature does is judged by its unit.
    fn refuse_unnamed_temperatures(&self, known: &[Known]) -> Result<(), FileError> {
        let mut names = self.names.iter().filter(|name| known.iter().all(|k| k.name != **name));
        let Some(other) = names.find(|name| is_like_temperature(name)) else { return Ok(()) };
        let problem = "the column looks like a temperature, and its name does not end in _c (a small letter), as those in degrees Celsius do";
        let remedy = "convert the values to degrees Celsius and name the column temp_air_c, temp_scale_x_c or the like; name what is no \
                      temperature in another way";
        Err(FileError::content(self.place().column(other), problem, remedy))
    }

    /// Two columns hold one quantity in two units.
    pub(crate) fn said_twice(&self, other: &str, own: &str) -> FileError {
        let problem = format!("the column is {own} in another unit, and a quantity stands once");
        let remedy = "keep one unit, or rename the column if it is another quantity";
        FileError::content(self.place().column(other), problem, remedy)
    }

    /// Indices of three columns that stand together or not at all.
    pub(crate) fn all_or_none(&self, wanted: [Known; 3], known: &[Known]) -> Result<Option<[usize; 3]>, FileError> {
        let found =
            [self.optional(wanted[0], known)?, self.optional(wanted[1], known)?, self.optional(wanted[2], known)?];
        match found {
            [Some(x), Some(y), Some(z)] => Ok(Some([x, y, z])),
            [None, None, None] => Ok(None),
            _ => wanted.into_iter().try_for_each(|column| self.require(column, known).map(|_| ())).map(|()| None),
        }
    }

    /// The offset columns, or the offset that the machine declares.
    pub(crate) fn offset(&self, default_m: Option<[f64; 3]>, known: &[Known]) -> Result<Offset, FileError> {
        match (self.all_or_none(OFFSET, known)?, default_m) {
            (Some(columns), _) => Ok(Offset::Columns(columns)),
            (None, Some(offset_m)) => match self.names.iter().find(|name| is_like_offset(name)) {
                None => Ok(Offset::Constant(offset_m)),
                Some(other) => {
                    let [x, y, z] = offset_m.map(millimetres_from_m);
                    let problem = format!(
                        "the column looks like an offset and is not read as one: the machine's own, {x}, {y}, {z} mm, would be taken"
                    );
                    let remedy = "name the columns offset_x_mm, offset_y_mm and offset_z_mm (millimetres), or in a way that holds neither \
                                  offset, tip, stylus nor reflector";
                    Err(FileError::content(self.place().column(other), problem, remedy))
                }
            },
            (None, None) => Err(FileError::content(
                self.place().column(OFFSET[0].name),
                "the offset columns are missing, and the machine declares no default_offset_mm",
                "add offset_x_mm, offset_y_mm and offset_z_mm, or declare default_offset_mm in the machine file",
            )),
        }
    }

    /// A finite number in a cell; `remedy` says what to do where it is none.
    pub(crate) fn number(&self, record: &ByteRecord, column: usize, line: u64, remedy: &str) -> Result<f64, FileError> {
        let cell = record.get(column).unwrap_or_default();
        if self.time == Some(column) {
            return self.time(cell, column, line, remedy);
        }
        let found = number(cell).map_err(|problem| self.no_number(cell, problem, line, column, remedy))?;
        self.take(found, cell, line, column)
    }

    /// Seconds, or those since the first instant where the column holds date and time of day.
    fn time(&self, cell: &[u8], column: usize, line: u64, remedy: &str) -> Result<f64, FileError> {
        let wrong = |problem| FileError::content(self.cell(line, column), problem, TIME_REMEDY);
        match (Instant::read(cell), self.clock.get()) {
            (Some(instant), Clock::Unknown) => {
                self.clock.set(Clock::Since(instant, line));
                tell_once(format!(
                    "{}: date and time of day; counted in seconds from {} on",
                    self.cell(line, column),
                    shown(cell)
                ));
                Ok(0.0)
            }
            (Some(instant), Clock::Since(first, of)) => instant
                .since(first)
                .ok_or_else(|| wrong(format!("{:?} and line {of} do not both name their time zone", shown(cell)))),
            (Some(_), Clock::Seconds(of)) => {
                Err(wrong(format!("{:?} is date and time of day, line {of} holds a number", shown(cell))))
            }
            (None, clock) => {
                let remedy = if cell.trim_ascii().is_empty() { remedy } else { TIME_REMEDY };
                let found = number(cell).map_err(|problem| self.no_number(cell, problem, line, column, remedy))?;
                if let Clock::Since(_, of) = clock {
                    return Err(wrong(format!("{:?} is a number, line {of} holds date and time of day", shown(cell))));
                }
                self.clock.set(Clock::Seconds(line));
                self.take(found, cell, line, column)
            }
        }
    }

    /// A finite number in a cell that need not hold one. Text that would contradict the file's mark of decimals is none, and neither is date and
    /// time of day: when its seconds began is for whoever reads the file.
    pub(crate) fn optional_number(&self, record: &ByteRecord, column: usize, line: u64) -> Option<f64> {
        let cell = record.get(column).unwrap_or_default();
        self.take(number(cell).ok()?, cell, line, column).ok()
    }

    fn take(&self, found: Number, cell: &[u8], line: u64, column: usize) -> Result<f64, FileError> {
        let seen = || Seen { line, column, text: shown(cell) };
        let taken = self.decimals.borrow_mut().take(found, seen);
        let taken = taken.map_err(|contradiction| self.contradicted(contradiction, cell, line, column))?;
        if taken.is_news && self.mark() == Mark::Comma {
            tell_once(format!("{}: decimal commas, as {:?} shows", self.cell(line, column), shown(cell)));
        }
        Ok(taken.value)
    }

    /// How decimals are marked, as far as numbers have shown.
    pub(crate) fn mark(&self) -> Mark {
        match (&*self.decimals.borrow(), self.aside.get()) {
            (Decimals::Unknown, Some(aside)) => aside,
            (known, _) => known.mark(),
        }
    }

    /// Looks at a cell of any column for what marks its decimals; the first that shows it counts.
    pub(crate) fn look_aside(&self, cell: &[u8]) {
        let shown = match number(cell) {
            Ok(Number::Point(_)) => Mark::Point,
            Ok(Number::Comma(_)) => Mark::Comma,
            _ => return,
        };
        self.aside.set(self.aside.get().or(Some(shown)));
    }

    /// How the table is written.
    pub(crate) fn dialect(&self) -> Dialect {
        self.dialect
    }

    /// Refuses a number that has two readings, which nothing read so far tells apart.
    pub(crate) fn refuse_open_numbers(&self) -> Result<(), FileError> {
        let decimals = self.decimals.borrow();
        let Some(open) = decimals.open() else { return Ok(()) };
        let problem = format!("{}, and no number up to here tells which", two_readings(&open.text));
        let remedy = "write the line # decimal=, above the column names where it is a decimal comma, or remove the commas \
                      between thousands";
        Err(FileError::content(self.cell(open.line, open.column), problem, remedy))
    }

    fn no_number(&self, cell: &[u8], problem: NoNumber, line: u64, column: usize, remedy: &str) -> FileError {
        let (text, place) = (shown(cell), self.cell(line, column));
        let problem = match problem {
            NoNumber::Empty => "the cell is empty".to_owned(),
            NoNumber::Text => {
                let minus = text.chars().find(|sign| OTHER_MINUS.contains(sign));
                if let Some(minus) = minus {
                    let problem =
                        format!("{text:?} is not a number: it has the sign {minus}, which only looks like a minus");
                    return FileError::content(
                        place,
                        problem,
                        "write the minus of the keyboard, -, in its place everywhere in the file",
                    );
                }
                format!("{text:?} is not a number")
            }
            NoNumber::NotFinite => format!("{text:?} is not a finite number"),
            NoNumber::TooLarge => format!("{text:?} is larger than anything measured"),
            NoNumber::Thousands => {
                let problem = format!("{text:?} has marks between thousands");
                return FileError::content(place, problem, "write numbers without them");
            }
        };
        FileError::content(place, problem, remedy)
    }

    fn contradicted(&self, contradiction: Contradiction, cell: &[u8], line: u64, column: usize) -> FileError {
        let (text, place) = (shown(cell), self.cell(line, column));
        let at = |seen: &Seen| format!("{:?} in line {}", seen.text, seen.line);
        let remove = "remove the commas between thousands";
        match contradiction {
            Contradiction::Mixed(seen) => {
                let problem = format!("{text:?} marks decimals in another way than {}", at(&seen));
                FileError::content(place, problem, "write all numbers of a file in one way")
            }
            Contradiction::CommaBetweenThousands(seen) => {
                let problem = format!("{text:?} has a comma between thousands, as {} has a decimal point", at(&seen));
                FileError::content(place, problem, remove)
            }
            Contradiction::OpenWasThousands(seen) => {
                let problem = format!("{}, and {text:?} in line {line} has a decimal point", two_readings(&seen.text));
                let remedy = format!("{remove}, or write all numbers of a file in one way");
                FileError::content(self.cell(seen.line, seen.column), problem, remedy)
            }
            Contradiction::Declared(mark, says) => {
                let problem = format!("{text:?} is no number here: line {says} says decimal={}", mark.sign());
                FileError::content(place, problem, "correct that line, or write all numbers of a file in one way")
            }
        }
    }

    /// Refuses numbers where column names are to stand.
    fn refuse_numbers(&self, record: &ByteRecord) -> Result<(), FileError> {
        let numbers = record.iter().filter(|cell| number(cell).is_ok()).count();
        if numbers == 0 || 2 * numbers < record.len() {
            return Ok(());
        }
        let problem = format!("the first row holds numbers and no column names (between {})", self.between());
        let remedy = "begin the file with the column names; tail -f leaves them out, tail -n +1 -f does not";
        Err(FileError::content(self.place(), problem, remedy))
    }

    /// What separates the columns, in a word.
    pub(crate) fn between(&self) -> &'static str {
        dialect::name(self.dialect.delimiter)
    }
}

/// A name with blanks for the line breaks that spreadsheets allow in it: it is to stand in comments and messages of one line. No other
/// control character means anything in a name.
fn one_line(name: &str) -> Result<Cow<'_, str>, char> {
    match name.trim().chars().find(|sign| sign.is_control()) {
        None => Ok(Cow::Borrowed(name)),
        Some(_) => match name.chars().find(|sign| sign.is_control() && !sign.is_whitespace()) {
            Some(sign) => Err(sign),
            None => Ok(Cow::Owned(name.split_whitespace().collect::<Vec<_>>().join(" "))),
        },
    }
}

/// A cell as messages show it.
fn shown(cell: &[u8]) -> String {
    String::from_utf8_lossy(cell.trim_ascii()).chars().take(40).collect()
}

fn two_readings(text: &str) -> String {
    let (point, whole) = (text.replace(',', "."), text.replace(',', ""));
    format!("{text:?} is {point} with a decimal comma and {whole} with a comma between thousands")
}

/// Where a row's offset comes from.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Offset {
    /// Three columns of the file.
    Columns([usize; 3]),
    /// The machine's own (m, ram frame).
    Constant([f64; 3]),
}

fn is_other_unit(name: &str, wanted: Known) -> bool {
    if wanted.name == wanted.stem {
        return false;
    }
    let name = name.to_lowercase();
    let bare = name == wanted.stem;
    let suffix = name.strip_prefix(wanted.stem).and_then(|rest| rest.strip_prefix('_'));
    bare || (name != wanted.name && suffix.is_some_and(|unit| UNITS.contains(&unit)))
}
