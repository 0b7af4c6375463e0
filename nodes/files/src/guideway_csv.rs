//! Targets on the table of a linear axis from CSV: readings of a laser tracker, or points of any instrument.
//!
//! Place in the flow: file → here → points in SI → `abbe_measurement::guideway`. Columns, units in the name:
//! - `position_mm`, the indicated position of the axis, and `target`, its name;
//! - either readings in the tracker's frame: `range_mm` (or `range_m`), `azimuth_deg` and `elevation_deg` (or both in `rad`),
//!   azimuth about z from x, elevation above the x-y plane;
//! - or points: `x_mm y_mm z_mm`, optional `u_um`, the standard uncertainty of each coordinate.
//!
//! Temperatures (`temp_…_c`) may stand beside them, for the head of a report. Other columns are refused.

use crate::columns::{Header, Known, READING};
use crate::csv_source::CsvSource;
use crate::error::FileError;
use crate::study_csv::{Row, StudyFile, open, rows};
use crate::table_facts::is_temperature;
use abbe_measurement::tracker::{TrackerError, TrackerReading};
use std::io::Read;
use std::path::Path;

const POSITION: Known = Known::new("position_mm", "position", "millimetres");
const TARGET: Known = Known::new("target", "target", "text");
const RANGE: Known = Known::new("range_mm", "range", "millimetres");
const RANGE_M: &str = "range_m";
const AZIMUTH: Known = Known::new("azimuth_deg", "azimuth", "degrees");
const AZIMUTH_RAD: &str = "azimuth_rad";
const ELEVATION: Known = Known::new("elevation_deg", "elevation", "degrees");
const ELEVATION_RAD: &str = "elevation_rad";
const U: Known = Known::new("u_um", "u", "micrometres");
const READINGS: [Known; 5] = [POSITION, TARGET, RANGE, AZIMUTH, ELEVATION];
const POINTS: [Known; 6] = [POSITION, TARGET, READING[0], READING[1], READING[2], U];

/// Where a target was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SeenTarget {
    /// By a tracker, in its own frame.
    Reading(TrackerReading),
    /// As a point (m), with the standard uncertainty of each coordinate (m, k = 1) where the file has it.
    Point {
        /// Coordinates (m).
        point_m: [f64; 3],
        /// Standard uncertainty of each (m).
        u_m: Option<f64>,
    },
}

/// A target at a position.
#[derive(Debug, Clone, PartialEq)]
pub struct GuidewayRow {
    /// Indicated position of the axis (m).
    pub position_m: f64,
    /// Name of the target.
    pub target: String,
    /// Where it was seen.
    pub seen: SeenTarget,
}

/// Reads the targets of a guideway.
pub fn read_guideway_file(path: &Path) -> Result<StudyFile<GuidewayRow>, FileError> {
    let (input, file) = open(path)?;
    read_guideway(input, &file)
}

/// Reads the targets of a guideway from anything; `file` is its name in messages.
pub fn read_guideway(input: impl Read, file: &str) -> Result<StudyFile<GuidewayRow>, FileError> {
    let source = CsvSource::new(input, file)?;
    let header = source.header();
    let columns = Columns::new(header)?;
    let known = match columns {
        Columns::Readings { .. } => READINGS.as_slice(),
        Columns::Points { .. } => POINTS.as_slice(),
    };
    let (position, target) = (header.require(POSITION, known)?, header.require(TARGET, known)?);
    let is_known = |name: &str| {
        let other_unit =
            matches!(columns, Columns::Readings { .. }) && [RANGE_M, AZIMUTH_RAD, ELEVATION_RAD].contains(&name);
        other_unit || is_temperature(name) || known.iter().any(|k| k.name == name)
    };
    if let Some(stranger) = header.names().iter().find(|name| !is_known(name)) {
        let problem = "the column is not known here";
        return Err(FileError::content(header.place().column(stranger), problem, "remove it, or correct its name"));
    }
    rows(source, |row| {
        let position_m = row.number(position)? / 1e3;
        Ok(GuidewayRow { position_m, target: row.text(target)?, seen: columns.read(row)? })
    })
}

/// A column and what makes its numbers SI.
#[derive(Debug, Clone, Copy)]
struct Scaled {
    column: usize,
    to_si: fn(f64) -> f64,
}

impl Scaled {
    /// The column in the unit of this name, or in the other one that may stand instead.
    fn new(
        header: &Header,
        known: Known,
        to_si: fn(f64) -> f64,
        other: (&str, fn(f64) -> f64),
    ) -> Result<Scaled, FileError> {
        match (header.find(known.name), header.find(other.0)) {
            (Some(_), Some(_)) => {
                let problem = format!("{} stands beside it", known.name);
                Err(FileError::content(header.place().column(other.0), problem, "remove one of the two"))
            }
            (None, Some(column)) => Ok(Scaled { column, to_si: other.1 }),
            _ => Ok(Scaled { column: header.require(known, &READINGS)?, to_si }),
        }
    }

    fn read(self, row: &Row) -> Result<f64, FileError> {
        Ok((self.to_si)(row.number(self.column)?))
    }
}

enum Columns {
    Readings { range: Scaled, azimuth: Scaled, elevation: Scaled },
    Points { point: [usize; 3], u: Option<usize> },
}

impl Columns {
    fn new(header: &Header) -> Result<Columns, FileError> {
        let has = |stem: &str| header.names().iter().any(|name| name.starts_with(stem));
        if has("range") || has("azimuth") || has("elevation") {
            let metres: fn(f64) -> f64 = |metres| metres;
            return Ok(Columns::Readings {
                range: Scaled::new(header, RANGE, |mm| mm / 1e3, (RANGE_M, metres))?,
                azimuth: Scaled::new(header, AZIMUTH, f64::to_radians, (AZIMUTH_RAD, metres))?,
                elevation: Scaled::new(header, ELEVATION, f64::to_radians, (ELEVATION_RAD, metres))?,
            });
        }
        let require = |k: usize| header.require(READING[k], &POINTS);
        Ok(Columns::Points { point: [require(0)?, require(1)?, require(2)?], u: header.optional(U, &POINTS)? })
    }

    fn read(&self, row: &Row) -> Result<SeenTarget, FileError> {
        match self {
            Columns::Points { point, u } => Ok(SeenTarget::Point {
                point_m: row.three(*point, 1e3)?,
                u_m: u.map(|column| row.positive(column, 1e6)).transpose()?,
            }),
            Columns::Readings { range, azimuth, elevation } => {
                let reading = TrackerReading {
                    range_m: range.read(row)?,
                    azimuth_rad: azimuth.read(row)?,
                    elevation_rad: elevation.read(row)?,
                };
                reading.check().map_err(|problem| {
                    let column = match problem {
                        TrackerError::Azimuth(_) => azimuth.column,
                        TrackerError::Elevation(_) => elevation.column,
                        _ => range.column,
                    };
                    FileError::content(row.place(column), problem.to_string(), "correct the reading or remove the row")
                })?;
                Ok(SeenTarget::Reading(reading))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    fn read(text: &str) -> Result<StudyFile<GuidewayRow>, FileError> {
        read_guideway(text.as_bytes(), "g.csv")
    }

    #[track_caller]
    fn refused(text: &str, says: &[&str]) {
        let message = read(text).unwrap_err().to_string();
        says.iter().for_each(|part| assert!(message.contains(part), "{message:?} does not say {part:?}"));
    }

    #[test]
    fn readings_are_read_in_si_whatever_their_unit() {
        let degrees = read("target,position_mm,range_mm,azimuth_deg,elevation_deg\nP,250,2000,90,-45\n").unwrap();
        let radians = read(&format!(
            "target,position_mm,range_m,azimuth_rad,elevation_rad\n# a comment\nP,250,2,{FRAC_PI_2},{}\n",
            -FRAC_PI_2 / 2.0
        ))
        .unwrap();
        assert_eq!(degrees.rows, radians.rows);
        assert_ne!(degrees.sha256, radians.sha256);
        let expected = TrackerReading { range_m: 2.0, azimuth_rad: FRAC_PI_2, elevation_rad: -FRAC_PI_2 / 2.0 };
        let row = GuidewayRow { position_m: 0.25, target: "P".to_owned(), seen: SeenTarget::Reading(expected) };
        assert_eq!(degrees.rows, [row]);
    }

    #[test]
    fn points_are_read_with_their_uncertainty() {
        let file = read("position_mm,target,x_mm,y_mm,z_mm,u_um\n0,P,1,2,3,5\n").unwrap();
        assert_eq!(file.rows[0].seen, SeenTarget::Point { point_m: [1e-3, 2e-3, 3e-3], u_m: Some(5e-6) });
        let file = read("position_mm,target,x_mm,y_mm,z_mm\n0,P,1,2,3\n").unwrap();
        assert_eq!(file.rows[0].seen, SeenTarget::Point { point_m: [1e-3, 2e-3, 3e-3], u_m: None });
    }

    #[test]
    fn what_is_wrong_is_named_with_line_and_column() {
        let head = "position_mm,target,range_mm,azimuth_deg,elevation_deg\n";
        refused("", &["g.csv", "empty"]);
        refused(head, &["no row"]);
        refused(&format!("{head}0,P,2000,30,95\n"), &["g.csv, line 2, column elevation_deg", "beyond straight"]);
        refused(&format!("{head}0,P,2000,400,9\n"), &["line 2, column azimuth_deg", "full turn"]);
        refused(&format!("{head}0,P,0,30,9\n"), &["line 2, column range_mm", "above zero"]);
        refused(&format!("{head}0,P,2000,NaN,9\n"), &["line 2, column azimuth_deg", "finite"]);
        refused(&format!("{head}0,,2000,30,9\n"), &["line 2, column target", "empty"]);
        refused(&format!("{head}0,P,2000,30\n"), &["line 2", "4 cells"]);
        refused("position_mm,target,range_mm,range_m,azimuth_deg,elevation_deg\n", &["column range_m", "beside it"]);
        refused("position_mm,target,range_mm,azimuth_deg\n", &["column elevation_deg", "missing"]);
        refused("position_m,target,x_mm,y_mm,z_mm\n", &["column position_m", "millimetres"]);
        refused("position_mm,target,x_mm,y_mm,z_um\n", &["column z_um", "millimetres"]);
        refused("position_mm,target,x_mm,y_mm\n", &["column z_mm", "missing"]);
        refused("position_mm,target,x_mm,y_mm,z_mm,note\n", &["column note", "not known"]);
        refused("position_mm,target,x_mm,y_mm,z_mm,u_um\n0,P,1,2,3,-1\n", &["line 2, column u_um", "above zero"]);
    }
}
