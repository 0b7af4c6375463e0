//! Error vectors at points to CSV, and bare points from it.
//!
//! Place in the flow: `abbe points` and `abbe interpolate` write what `abbe interpolate`, `abbe diagnose --residuals` and
//! whatever else takes residual vectors reads ([`crate::read_residual_vectors`]). Points in mm in the machine frame, errors
//! (actual − indicated) and standard uncertainties (k = 1) in µm. Of a plane, positions along one axis and one component may be
//! missing: they are then missing in what is written, too. Vectors of several tips say with which offset each was measured (mm, ram
//! frame).

use crate::atomic::AtomicFile;
use crate::columns::{OFFSET, READING};
use crate::csv_source::CsvSource;
use crate::error::FileError;
use crate::export::commented;
use crate::points_csv::unwritten;
use crate::tips::Tips;
use abbe_geometry::Axis;
use csv::{ByteRecord, Writer};
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

const NUMBER_REMEDY: &str = "write a number with a decimal point, or remove the row";
const ERRORS: [&str; 3] = ["res_x_um", "res_y_um", "res_z_um"];
const UNCERTAINTIES: [&str; 3] = ["u_x_um", "u_y_um", "u_z_um"];

/// An error vector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorVector {
    /// Where (m, machine frame).
    pub position_m: [f64; 3],
    /// Tip or reflector from the ram reference point (m, ram frame), where vectors of several are written.
    pub offset_m: Option<[f64; 3]>,
    /// Actual − indicated (m); `None` where there is no answer.
    pub error_m: Option<[f64; 3]>,
    /// Standard uncertainty of each component (m, k = 1), where it is known.
    pub u_m: Option<[f64; 3]>,
    /// A word about it, where there is one to say: written to a column `status`.
    pub status: Option<&'static str>,
}

/// What a file of a plane lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lacks {
    /// Axis without positions.
    pub position: Option<Axis>,
    /// Component that was not measured.
    pub error: Option<Axis>,
}

/// Points, and the axis that they have no positions along.
#[derive(Debug, Clone, PartialEq)]
pub struct Positions {
    /// Where (m, machine frame); 0 along an axis that is missing, and it means nothing.
    pub rows: Vec<[f64; 3]>,
    /// That axis.
    pub lacks: Option<Axis>,
    /// Offsets of the tips of the points (m, ram frame), each once; none where the file has no columns of offsets.
    pub tips_m: Vec<[f64; 3]>,
}

/// Writes error vectors, whole or not at all, below these lines of comment. Columns for offsets, uncertainties and status are there
/// if any vector has them; an empty cell is a missing value.
pub fn write_error_vectors(path: &Path, vectors: &[ErrorVector], notes: &[String]) -> Result<(), FileError> {
    write_whole(path, vectors, Lacks::default(), notes)
}

/// The same without the columns that a file of a plane lacks.
pub fn write_plane_errors(path: &Path, vectors: &[ErrorVector], lacks: Lacks) -> Result<(), FileError> {
    write_whole(path, vectors, lacks, &[])
}

fn write_whole(path: &Path, vectors: &[ErrorVector], lacks: Lacks, notes: &[String]) -> Result<(), FileError> {
    let file = path.display().to_string();
    let mut output = AtomicFile::create(path)?;
    output.write_all(commented(notes, "#").as_bytes()).map_err(FileError::io(&file, "write"))?;
    write_rows(&mut output, &file, vectors, lacks)?;
    output.commit()
}

fn write_rows(output: impl Write, file: &str, vectors: &[ErrorVector], lacks: Lacks) -> Result<(), FileError> {
    let has = |lacks: Option<Axis>| move |k: &usize| lacks != Some(Axis::ALL[*k]);
    let places: Vec<usize> = (0..3).filter(has(lacks.position)).collect();
    let components: Vec<usize> = (0..3).filter(has(lacks.error)).collect();
    let with_offset = vectors.iter().any(|v| v.offset_m.is_some());
    let with_u = vectors.iter().any(|v| v.u_m.is_some());
    let with_status = vectors.iter().any(|v| v.status.is_some());
    let mut writer = Writer::from_writer(output);
    let mut header: Vec<&str> = places.iter().map(|k| READING[*k].name).collect();
    header.extend(OFFSET.iter().map(|own| own.name).filter(|_| with_offset));
    header.extend(components.iter().map(|k| ERRORS[*k]));
    header.extend(components.iter().map(|k| UNCERTAINTIES[*k]).filter(|_| with_u));
    header.extend(["status"].iter().filter(|_| with_status));
    writer.write_record(header).map_err(|error| unwritten(file, error))?;
    for vector in vectors {
        let mut cells: Vec<String> = places.iter().map(|k| format!("{:.7}", vector.position_m[*k] * 1e3)).collect();
        let offset = (0..3).filter(|_| with_offset);
        cells.extend(offset.map(|k| vector.offset_m.map_or_else(String::new, |m| format!("{:.7}", m[k] * 1e3))));
        let three = |values: Option<[f64; 3]>| -> Vec<String> {
            let cell = |k: &usize| values.map_or_else(String::new, |metres| format!("{:.6}", metres[*k] * 1e6));
            components.iter().map(cell).collect()
        };
        cells.extend(three(vector.error_m));
        if with_u {
            cells.extend(three(vector.u_m));
        }
        if with_status {
            cells.push(vector.status.unwrap_or_default().to_owned());
        }
        writer.write_record(cells).map_err(|error| unwritten(file, error))?;
    }
    writer.flush().map_err(FileError::io(file, "write"))
}

/// Reads points from `x_mm`, `y_mm`, `z_mm` (machine frame) into metres; other columns are left alone.
pub fn read_positions_file(path: &Path) -> Result<Vec<[f64; 3]>, FileError> {
    let file = path.display().to_string();
    let input = File::open(path).map_err(FileError::io(&file, "open the points"))?;
    read_positions(input, &file)
}

/// Reads points of a volume or a plane: one of the three columns may be missing.
pub fn read_plane_positions_file(path: &Path) -> Result<Positions, FileError> {
    let file = path.display().to_string();
    let input = File::open(path).map_err(FileError::io(&file, "open the points"))?;
    let mut columns = [None; 3];
    let source = CsvSource::new(input, &file)?;
    for (column, known) in columns.iter_mut().zip(READING) {
        *column = source.header().optional(known, &READING)?;
    }
    let lacks: Vec<Axis> = Axis::ALL.into_iter().filter(|axis| columns[axis.index()].is_none()).collect();
    if let [_, second, ..] = lacks[..] {
        source.header().require(READING[second.index()], &READING)?;
    }
    let (rows, tips_m) = positions(source, columns)?;
    Ok(Positions { rows, lacks: lacks.first().copied(), tips_m })
}

/// Reads points from anything; `file` is its name in messages.
pub fn read_positions(input: impl Read, file: &str) -> Result<Vec<[f64; 3]>, FileError> {
    let mut columns = [None; 3];
    let source = CsvSource::new(input, file)?;
    for (column, known) in columns.iter_mut().zip(READING) {
        *column = Some(source.header().require(known, &READING)?);
    }
    Ok(positions(source, columns)?.0)
}

/// Positions of all rows, and the offsets that they have (m).
type Placed = (Vec<[f64; 3]>, Vec<[f64; 3]>);

fn positions<R: Read>(mut source: CsvSource<R>, columns: [Option<usize>; 3]) -> Result<Placed, FileError> {
    let (mut positions, mut record, mut tips) = (Vec::new(), ByteRecord::new(), Tips::default());
    let offset = OFFSET.map(|own| source.header().find(own.name));
    if offset.iter().any(Option::is_some) && offset.iter().any(Option::is_none) {
        return Err(FileError::content(
            source.header().place(),
            "an offset of the tip has three columns, and some of them are missing",
            "give offset_x_mm, offset_y_mm and offset_z_mm, or none of them",
        ));
    }
    while let Some(line) = source.next(&mut record)? {
        let mut position = [0.0; 3];
        for (value, column) in position.iter_mut().zip(columns).filter_map(|(value, column)| Some((value, column?))) {
            *value = source.header().number(&record, column, line, NUMBER_REMEDY)? / 1e3;
        }
        positions.push(position);
        if let [Some(x), Some(y), Some(z)] = offset {
            let mm = |column| source.header().number(&record, column, line, NUMBER_REMEDY);
            tips.push([mm(x)?, mm(y)?, mm(z)?]);
        }
    }
    if positions.is_empty() {
        return Err(FileError::content(
            source.header().place(),
            "the file holds a header but no point",
            "give one row a point",
        ));
    }
    Ok((positions, tips.into_m()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read_residual_vectors;

    fn vector(k: f64) -> ErrorVector {
        ErrorVector {
            position_m: [0.1 * k, -0.25, 0.125],
            offset_m: None,
            error_m: Some([1e-6 * k, -2.5e-6, 0.0]),
            u_m: Some([0.2e-6, 0.3e-6, 0.4e-6]),
            status: None,
        }
    }

    #[test]
    fn what_is_written_reads_back_as_residual_vectors() {
        let mut bytes = Vec::new();
        write_rows(&mut bytes, "points.csv", &[vector(1.0), vector(2.0)], Lacks::default()).unwrap();
        let read = read_residual_vectors(bytes.as_slice(), "points.csv").unwrap().rows;
        for (row, k) in read.iter().zip([1.0, 2.0]) {
            let same = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
            assert!(same(row.position_m, vector(k).position_m));
            assert!(same(row.residual_m, vector(k).error_m.unwrap()));
            assert!(same(row.u_m.unwrap(), vector(k).u_m.unwrap()));
        }
        let positions = read_positions(bytes.as_slice(), "points.csv").unwrap();
        assert_eq!(positions.len(), 2);
        assert!((positions[1][0] - 0.2).abs() < 1e-12);
    }

    #[test]
    fn what_is_missing_is_an_empty_cell_and_no_zero() {
        let mut bytes = Vec::new();
        let silent = ErrorVector { error_m: None, u_m: None, status: Some("no_answer"), ..vector(1.0) };
        write_rows(&mut bytes, "points.csv", &[silent], Lacks::default()).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        assert_eq!(text.lines().nth(1).unwrap(), "100.0000000,-250.0000000,125.0000000,,,,no_answer");
    }

    #[test]
    fn vectors_of_several_tips_say_of_which_and_are_no_field_of_one() {
        let tip = |k: f64, offset_m: [f64; 3]| ErrorVector { offset_m: Some(offset_m), ..vector(k) };
        let (a, b) = ([0.0, 0.0, -0.06], [0.12, 0.0, -0.06]);
        let written = |vectors: &[ErrorVector]| {
            let mut bytes = Vec::new();
            write_rows(&mut bytes, "v.csv", vectors, Lacks::default()).unwrap();
            String::from_utf8(bytes).unwrap()
        };
        let both = written(&[tip(1.0, a), tip(1.0, b), tip(2.0, a)]);
        assert!(both.starts_with("x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,res_x_um"), "{both}");
        assert!(both.contains("125.0000000,120.0000000,0.0000000,-60.0000000,"), "{both}");
        let refused = read_residual_vectors(both.as_bytes(), "v.csv").unwrap_err().to_string();
        for says in ["v.csv, line 3, column offset_x_mm", "of 2 tips", "0 0 -60, 120 0 -60 mm", "--offset-mm"] {
            assert!(refused.contains(says), "{refused}");
        }
        // Of one tip it does not matter, nor does a hundredth of a millimetre.
        let near = [a[0] + 1e-5, a[1], a[2]];
        assert!(read_residual_vectors(written(&[tip(1.0, a), tip(2.0, near)]).as_bytes(), "v.csv").is_ok());
    }

    #[test]
    fn points_that_are_none_are_refused_with_their_line() {
        let refused = |text: &str| read_positions(text.as_bytes(), "p.csv").unwrap_err().to_string();
        assert!(refused("x_mm,y_mm,z_mm\n1,2,nan\n").contains("p.csv, line 2, column z_mm"));
        assert!(refused("x_mm,y_mm\n1,2\n").contains("z_mm"));
        assert!(refused("x_m,y_mm,z_mm\n1,2,3\n").contains("millimetres"));
        assert!(refused("x_mm,y_mm,z_mm\n").contains("no point"));
    }
}
