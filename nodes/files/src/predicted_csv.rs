//! Any points as CSV, and the same rows with the residual predicted there.
//!
//! Place in the flow: `abbe predict`: points file → [`PlainPoints`] → residual field → [`PredictedWriter`]. Needed are
//! `x_mm y_mm z_mm` of points in the machine frame; every other column is handed through. Added are `res_x_um res_y_um
//! res_z_um` (actual − corrected), `u_x_um u_y_um u_z_um` (k = 1) and `res_extrapolated` (1 outside
//! what the field was made from): what comes out can be read back as
//! residual vectors. Memory is one row.

use crate::columns::READING;
use crate::csv_source::CsvSource;
use crate::decimals::Mark;
use crate::error::FileError;
use crate::points_csv::{OneMark, finished, started, unwritten};
use abbe_geometry::residual_field::ResidualPrediction;
use csv::{ByteRecord, Writer};
use std::io::{Read, Write};

const ADDED: [&str; 7] = ["res_x_um", "res_y_um", "res_z_um", "u_x_um", "u_y_um", "u_z_um", "res_extrapolated"];
/// Columns that say that `x_mm` is a scale reading rather than a point.
const READINGS_ONLY: [&str; 2] = ["offset_x_mm", "corrected_x_mm"];
const NUMBER_REMEDY: &str = "write a number with a decimal point, or remove the row";

/// Reads points row by row.
pub struct PlainPoints<R: Read> {
    source: CsvSource<R>,
    columns: [usize; 3],
    cells: ByteRecord,
    line: u64,
}

impl<R: Read> PlainPoints<R> {
    /// Points of a file; `file` is its name in messages.
    ///
    /// # Errors
    /// Columns that are missing or already there, or that say that these are scale readings.
    pub fn new(input: R, file: &str) -> Result<PlainPoints<R>, FileError> {
        let mut source = CsvSource::new(input, file)?;
        let header = source.header();
        let require = |k: usize| header.require(READING[k], &READING);
        let columns = [require(0)?, require(1)?, require(2)?];
        if let Some(name) = READINGS_ONLY.iter().find(|name| header.find(name).is_some()) {
            let problem = "beside this column, x_mm is a scale reading and no point of the machine frame";
            let remedy = "correct the readings with abbe correct --residual, or give points without this column";
            return Err(FileError::content(header.place().column(name), problem, remedy));
        }
        if let Some(name) = ADDED.iter().find(|name| header.find(name).is_some()) {
            let problem = "the file already holds a column that prediction adds";
            return Err(FileError::content(header.place().column(name), problem, "remove or rename the column"));
        }
        source.look_ahead(&columns);
        Ok(PlainPoints { source, columns, cells: ByteRecord::new(), line: 0 })
    }

    /// The next point (m); `None` at the end of the file.
    ///
    /// # Errors
    /// A row that is not whole, a cell that holds no number.
    pub fn next_point_m(&mut self) -> Result<Option<[f64; 3]>, FileError> {
        let Some(line) = self.source.next(&mut self.cells)? else { return Ok(None) };
        self.line = line;
        let header = self.source.header();
        let metres = |k: usize| Ok(header.number(&self.cells, self.columns[k], line, NUMBER_REMEDY)? / 1e3);
        Ok(Some([metres(0)?, metres(1)?, metres(2)?]))
    }

    /// Line of the last row.
    pub fn line(&self) -> u64 {
        self.line
    }

    fn mark(&self) -> Mark {
        self.source.header().mark()
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
        let writer = started(output, file, header, &ADDED)?;
        let marks = OneMark { mark: None, input: header.file().to_owned() };
        Ok(PredictedWriter { writer, file: file.to_owned(), marks })
    }

    /// Writes the last row read with its prediction.
    ///
    /// # Errors
    /// What the system says.
    pub fn write<R: Read>(&mut self, row: &PlainPoints<R>, prediction: &ResidualPrediction) -> Result<(), FileError> {
        let mark = row.mark();
        self.marks.check(mark, row.line)?;
        self.write_cells(&row.cells, mark, prediction).map_err(|error| unwritten(&self.file, error))
    }

    fn write_cells(&mut self, cells: &ByteRecord, mark: Mark, prediction: &ResidualPrediction) -> csv::Result<()> {
        for cell in cells {
            self.writer.write_field(cell)?;
        }
        let u_m = prediction.covariance_m2.diagonal().map(f64::sqrt);
        // Where the model has no number, neither has the file.
        let is_known = u_m.iter().all(|u_m| u_m.is_finite());
        for value_m in prediction.residual_m.iter().chain(&u_m) {
            let mut text = if is_known { format!("{:.4}", value_m * 1e6) } else { String::new() };
            self.writer.write_field(mark.of(&mut text))?;
        }
        self.writer.write_field(if prediction.inside { "0" } else { "1" })?;
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
