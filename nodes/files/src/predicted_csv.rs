//! Any points as CSV, and the same rows with the residual predicted there.
//!
//! Place in the flow: `abbe predict`: points file → [`PlainPoints`] → residual field → [`PredictedWriter`]. Needed are
//! `x_mm y_mm z_mm` of points in the machine frame; every other column is handed through. Added are `res_x_um res_y_um
//! res_z_um` (actual − corrected), `u_x_um u_y_um u_z_um` (k = 1) and `res_extrapolated` (1 outside
//! what the field was made from): what comes out can be read back as
//! residual vectors. Memory is one row.

use crate::columns::READING;
use crate::csv_source::CsvSource;
use crate::error::FileError;
use crate::points_csv::unwritten;
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
}

impl<R: Read> PlainPoints<R> {
    /// Points of a file; `file` is its name in messages.
    ///
    /// # Errors
    /// Columns that are missing or already there, or that say that these are scale readings.
    pub fn new(input: R, file: &str) -> Result<PlainPoints<R>, FileError> {
        let source = CsvSource::new(input, file)?;
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
        Ok(PlainPoints { source, columns, cells: ByteRecord::new() })
    }

    /// Column names as in the file.
    pub fn columns(&self) -> &[String] {
        self.source.header().names()
    }

    /// The next point (m); `None` at the end of the file.
    ///
    /// # Errors
    /// A row that is not whole, a cell that holds no number.
    pub fn next_point_m(&mut self) -> Result<Option<[f64; 3]>, FileError> {
        let Some(line) = self.source.next(&mut self.cells)? else { return Ok(None) };
        let header = self.source.header();
        let metres = |k: usize| Ok(header.number(&self.cells, self.columns[k], line, NUMBER_REMEDY)? / 1e3);
        Ok(Some([metres(0)?, metres(1)?, metres(2)?]))
    }

    /// The cells of the last row as they are.
    fn cells(&self) -> &ByteRecord {
        &self.cells
    }
}

/// Writes rows with the residual predicted at their point.
pub struct PredictedWriter<W: Write> {
    writer: Writer<W>,
    file: String,
}

impl<W: Write> PredictedWriter<W> {
    /// Writes the header: the columns of the input and those added.
    ///
    /// # Errors
    /// What the system says.
    pub fn new(output: W, file: &str, columns: &[String]) -> Result<PredictedWriter<W>, FileError> {
        let mut writer = Writer::from_writer(output);
        let header = columns.iter().map(String::as_str).chain(ADDED);
        writer.write_record(header).map_err(|error| unwritten(file, error))?;
        Ok(PredictedWriter { writer, file: file.to_owned() })
    }

    /// Writes the last row read with its prediction.
    ///
    /// # Errors
    /// What the system says.
    pub fn write<R: Read>(&mut self, row: &PlainPoints<R>, prediction: &ResidualPrediction) -> Result<(), FileError> {
        self.write_cells(row.cells(), prediction).map_err(|error| unwritten(&self.file, error))
    }

    fn write_cells(&mut self, cells: &ByteRecord, prediction: &ResidualPrediction) -> csv::Result<()> {
        for cell in cells {
            self.writer.write_field(cell)?;
        }
        let u_m = prediction.covariance_m2.diagonal().map(f64::sqrt);
        // Where the model has no number, neither has the file.
        let is_known = u_m.iter().all(|u_m| u_m.is_finite());
        for value_m in prediction.residual_m.iter().chain(&u_m) {
            self.writer.write_field(if is_known { format!("{:.4}", value_m * 1e6) } else { String::new() })?;
        }
        self.writer.write_field(if prediction.inside { "0" } else { "1" })?;
        self.writer.write_record(None::<&[u8]>)
    }

    /// Flushes and hands the output back, to be committed.
    ///
    /// # Errors
    /// What the system says.
    pub fn finish(self) -> Result<W, FileError> {
        let file = self.file;
        self.writer.into_inner().map_err(|error| {
            let source = std::io::Error::new(error.error().kind(), error.error().to_string());
            FileError::io(&file, "write")(source)
        })
    }
}
