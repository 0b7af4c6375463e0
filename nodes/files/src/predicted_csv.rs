//! Any points as CSV, and the same rows with the residual predicted there.
//!
//! Place in the flow: `abbe predict`: points file → [`PlainPoints`] → residual field → [`PredictedWriter`]. Needed are
//! `x_mm y_mm z_mm` of points in the machine frame, or whatever the model has for inputs; every other column is handed through. Added are `res_x_um res_y_um
//! res_z_um` (actual − corrected), `u_x_um u_y_um u_z_um` (k = 1) and `res_extrapolated` (1 outside
//! what the field was made from), and `res_status` where the model has inputs beside the position: what comes out can be read back as
//! residual vectors. Memory is one row.

use crate::columns::{Header, READING};
use crate::csv_source::CsvSource;
use crate::decimals::Mark;
use crate::error::FileError;
use crate::points_csv::{OneMark, finished, started, status_word, unwritten};
use abbe_geometry::correct::Added;
use abbe_geometry::effects::{CovariateSource, CovariateValue};
use abbe_geometry::residual_field::ResidualPrediction;
use csv::{ByteRecord, Writer};
use std::io::{Read, Write};

const ADDED: [&str; 7] = ["res_x_um", "res_y_um", "res_z_um", "u_x_um", "u_y_um", "u_z_um", EXTRAPOLATED];
/// The column beside them where the model has inputs beside the position: why a row has no residual.
pub(crate) const STATUS: &str = "res_status";
/// Whether the point is outside what the field was made from.
pub(crate) const EXTRAPOLATED: &str = "res_extrapolated";
/// Columns that say that `x_mm` is a scale reading rather than a point.
const READINGS_ONLY: [&str; 2] = ["offset_x_mm", "corrected_x_mm"];
const NUMBER_REMEDY: &str = "write a number with a decimal point, or remove the row";

/// Reads points row by row.
pub struct PlainPoints<R: Read> {
    source: CsvSource<R>,
    /// Columns of the position, where the model has it.
    columns: Option<[usize; 3]>,
    has_status: bool,
    cells: ByteRecord,
    line: u64,
}

impl<R: Read> PlainPoints<R> {
    /// Points of a file, for a model that has the position or not, and these further inputs; `file` is its name in messages.
    ///
    /// # Errors
    /// Columns that are missing or already there, or that say that these are scale readings.
    pub fn new(input: R, file: &str, has_position: bool, further: &[String]) -> Result<PlainPoints<R>, FileError> {
        let mut source = CsvSource::new(input, file)?;
        let header = source.header();
        let require = |k: usize| header.require(READING[k], &READING);
        let columns = match has_position {
            true => Some([require(0)?, require(1)?, require(2)?]),
            false => None,
        };
        if let Some(name) = further.iter().find(|name| header.find(name).is_none()) {
            let problem = "the column is missing, and the residual model has it for an input";
            let remedy = "add the column, or train a model without it";
            return Err(FileError::content(header.place().column(name), problem, remedy));
        }
        let has_status = !further.is_empty();
        if let Some(name) = READINGS_ONLY.iter().filter(|_| columns.is_some()).find(|name| header.find(name).is_some())
        {
            let problem = "beside this column, x_mm is a scale reading and no point of the machine frame";
            let remedy = "correct the readings with abbe correct --residual, or give points without this column";
            return Err(FileError::content(header.place().column(name), problem, remedy));
        }
        let added = ADDED.iter().chain(has_status.then_some(&STATUS));
        if let Some(name) = added.into_iter().find(|name| header.find(name).is_some()) {
            let problem = "the file already holds a column that prediction adds";
            return Err(FileError::content(header.place().column(name), problem, "remove or rename the column"));
        }
        let inputs = further.iter().filter_map(|name| header.find(name));
        let read: Vec<usize> = columns.iter().flatten().copied().chain(inputs).collect();
        source.look_ahead(&read);
        Ok(PlainPoints { source, columns, has_status, cells: ByteRecord::new(), line: 0 })
    }

    /// The next point (m); `None` at the end of the file. Where the model has no position, it means nothing.
    ///
    /// # Errors
    /// A row that is not whole, a cell that holds no number.
    pub fn next_point_m(&mut self) -> Result<Option<[f64; 3]>, FileError> {
        let Some(line) = self.source.next(&mut self.cells)? else { return Ok(None) };
        self.line = line;
        let header = self.source.header();
        let metres = |column: usize| Ok::<_, FileError>(header.number(&self.cells, column, line, NUMBER_REMEDY)? / 1e3);
        match self.columns {
            Some([x, y, z]) => Ok(Some([metres(x)?, metres(y)?, metres(z)?])),
            None => Ok(Some([0.0; 3])),
        }
    }

    /// Further columns of the last row as covariates. A cell that holds no finite number is a missing one.
    pub fn covariates(&self) -> PlainCovariates<'_> {
        PlainCovariates { header: self.source.header(), cells: &self.cells, line: self.line }
    }

    /// Line of the last row.
    pub fn line(&self) -> u64 {
        self.line
    }

    fn mark(&self) -> Mark {
        self.source.header().mark()
    }
}

/// Covariates of one row.
pub struct PlainCovariates<'a> {
    header: &'a Header,
    cells: &'a ByteRecord,
    line: u64,
}

impl CovariateSource for PlainCovariates<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        let value =
            self.header.find(name).and_then(|column| self.header.optional_number(self.cells, column, self.line));
        value.map_or(CovariateValue::Missing, CovariateValue::Fresh)
    }
}

/// Writes rows with the residual predicted at their point.
pub struct PredictedWriter<W: Write> {
    writer: Writer<W>,
    file: String,
    marks: OneMark,
}

impl<W: Write> PredictedWriter<W> {
    /// Writes the header: the columns of the input and those added.
    ///
    /// # Errors
    /// What the system says.
    pub fn new<R: Read>(output: W, file: &str, input: &PlainPoints<R>) -> Result<PredictedWriter<W>, FileError> {
        let header = input.source.header();
        let added: Vec<&str> = ADDED.into_iter().chain(input.has_status.then_some(STATUS)).collect();
        let writer = started(output, file, header, &added)?;
        let marks = OneMark { mark: None, input: header.file().to_owned() };
        Ok(PredictedWriter { writer, file: file.to_owned(), marks })
    }

    /// Writes the last row read with its prediction.
    ///
    /// # Errors
    /// What the system says.
    pub fn write<R: Read>(&mut self, row: &PlainPoints<R>, added: &Added) -> Result<(), FileError> {
        let mark = row.mark();
        self.marks.check(mark, row.line)?;
        self.write_cells(row, mark, added).map_err(|error| unwritten(&self.file, error))
    }

    fn write_cells<R: Read>(&mut self, row: &PlainPoints<R>, mark: Mark, added: &Added) -> csv::Result<()> {
        for cell in &row.cells {
            self.writer.write_field(cell)?;
        }
        let prediction = match added {
            Added::Residual(prediction) => Some(prediction),
            Added::LeftOut(_) => None,
        };
        let u_m = prediction.map(|prediction| prediction.covariance_m2.diagonal().map(f64::sqrt));
        // Where the model has no number, neither has the file.
        let known = prediction.zip(u_m).filter(|(_, u_m)| u_m.iter().all(|u_m| u_m.is_finite()));
        for k in 0..6 {
            let value_m = known.map(|(prediction, u_m)| if k < 3 { prediction.residual_m[k] } else { u_m[k - 3] });
            let mut text = value_m.map_or(String::new(), |value_m| format!("{:.4}", value_m * 1e6));
            self.writer.write_field(mark.of(&mut text))?;
        }
        self.writer.write_field(match prediction {
            Some(ResidualPrediction { inside: true, .. }) => "0",
            Some(_) => "1",
            None => "",
        })?;
        if row.has_status {
            self.writer.write_field(status_word(added.status()))?;
        }
        self.writer.write_record(None::<&[u8]>)
    }

    /// Flushes and hands the output back, to be committed.
    ///
    /// # Errors
    /// What the system says.
    pub fn finish(self) -> Result<W, FileError> {
        finished(self.writer, &self.file)
    }
}
