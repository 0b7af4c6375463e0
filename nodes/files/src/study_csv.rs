//! Data without a tracer from CSV: sphere centres of a five-axis machine, positioning runs, residual vectors.
//!
//! Place in the flow: file → here → rows in SI → study. Columns, units in the name:
//! - sphere centres: `a_deg c_deg d_mm x_mm y_mm z_mm`, optional `u_um` and, for the head of a report, temperatures (`temp_…_c`);
//! - positioning runs: `axis target_mm direction cycle` and `measured_mm` or `deviation_um`, optional `time_s`; measured is the position
//!   actually reached, the deviation that less the target; direction is `+` or `-`, also `+1 -1 up down`;
//! - residual vectors: `x_ y_ z_` in mm, um or m, `res_x_ res_y_ res_z_` and optionally `u_x_ u_y_ u_z_` likewise,
//!   optional `time_s` and `block`; of a plate `pose`, `point` and `u_plate_um`. Where a plane will do, one of the three
//!   positions and one of the three residuals may be missing; for a diagnosis two of these, as of a dial gauge that reads along Z.
//!
//! Any further column of the latter two holds numbers and is a covariate; an empty cell there was not logged.

use crate::columns::{Header, Known, READING, TIME};
use crate::csv_source::CsvSource;
use crate::error::{FileError, Place};
use crate::names::nearest;
use crate::notice::tell_once;
use crate::plausible::{refuse_millimetres, tell_of_metres};
use crate::predicted_csv;
use crate::table_facts::is_temperature;
use crate::tips::refuse_several_tips;
use abbe_geometry::Axis;
use abbe_measurement::positioning::{Approach, Run};
use abbe_measurement::probe_pose::SphereCentre;
use abbe_measurement::residual_vector::ResidualVector;
use csv::ByteRecord;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

const NUMBER_REMEDY: &str = "write a number with a decimal point, or remove the row";
const COVARIATE_REMEDY: &str = "a further column must hold numbers to be a covariate: write a number, leave the cell \
                                empty where nothing was logged, or remove the column";
const A: Known = Known::new("a_deg", "a", "degrees");
const C: Known = Known::new("c_deg", "c", "degrees");
const DISTANCE: Known = Known::new("d_mm", "d", "millimetres");
const U: Known = Known::new("u_um", "u", "micrometres");
const CENTRES: [Known; 7] = [A, C, DISTANCE, READING[0], READING[1], READING[2], U];
const AXIS: Known = Known::new("axis", "axis", "text");
/// How far an axis may stand from its target (mm): ten times a poor machine tool of several metres.
const LARGEST_MM: f64 = 10.0;
const TARGET: Known = Known::new("target_mm", "target", "millimetres");
const DIRECTION: Known = Known::new("direction", "direction", "+ or -");
const CYCLE: Known = Known::new("cycle", "cycle", "whole number");
const MEASURED: Known = Known::new("measured_mm", "measured", "millimetres");
const DEVIATION: Known = Known::new("deviation_um", "deviation", "micrometres");
const RUNS: [Known; 7] = [AXIS, TARGET, DIRECTION, CYCLE, MEASURED, DEVIATION, TIME];
const BLOCK: Known = Known::new("block", "block", "text");
const POSE: Known = Known::new("pose", "pose", "text");
const POINT: Known = Known::new("point", "point", "text");
const U_PLATE: Known = Known::new("u_plate_um", "u_plate", "micrometres");

/// Columns in which Abbe says what a vector is worth that it computed: none is measured, so that none is a covariate.
const OF_ABBE: [&str; 3] = ["status", predicted_csv::STATUS, predicted_csv::EXTRAPOLATED];

/// Rows of a study and the hash of the file they came from.
#[derive(Debug, Clone, PartialEq)]
pub struct StudyFile<T> {
    /// In the order of the file.
    pub rows: Vec<T>,
    /// Line of each row, as an editor counts them.
    pub lines: Vec<u64>,
    /// SHA-256 of the bytes of the file.
    pub sha256: [u8; 32],
}

/// Reads sphere centres of a five-axis machine.
pub fn read_sphere_centres_file(path: &Path) -> Result<StudyFile<SphereCentre>, FileError> {
    let (input, file) = open(path)?;
    read_sphere_centres(input, &file)
}

/// Reads positioning runs.
pub fn read_runs_file(path: &Path) -> Result<StudyFile<Run>, FileError> {
    let (input, file) = open(path)?;
    read_runs(input, &file)
}

/// Reads residual vectors of a volume.
pub fn read_residual_vectors_file(path: &Path) -> Result<StudyFile<ResidualVector>, FileError> {
    let (input, file) = open(path)?;
    read_residual_vectors(input, &file)
}

/// Reads residual vectors that other quantities may stand for than positions; also says whether positions are there. Where they are
/// not, those of a row mean nothing. Rows of several tips are for the caller to refuse ([`refuse_several_tips`]): their offset may be
/// one of those quantities.
pub fn read_input_vectors_file(path: &Path) -> Result<(StudyFile<ResidualVector>, bool), FileError> {
    let (input, file) = open(path)?;
    let source = CsvSource::new(input, &file)?;
    let has_position = lengths(source.header(), "", 0)?.is_some();
    Ok((vectors(source, if has_position { Lack::Nothing } else { Lack::Positions })?, has_position))
}

/// Reads residual vectors of a volume or a plane: one axis may have no positions, and one no residuals.
pub fn read_plane_vectors_file(path: &Path) -> Result<StudyFile<ResidualVector>, FileError> {
    let (input, file) = open(path)?;
    read_plane_vectors(input, &file)
}

pub(crate) fn open(path: &Path) -> Result<(File, String), FileError> {
    let file = path.display().to_string();
    let input = File::open(path).map_err(FileError::io(&file, "open the data"))?;
    Ok((input, file))
}

/// The same for a diagnosis: two components may be missing.
pub fn read_component_vectors_file(path: &Path) -> Result<StudyFile<ResidualVector>, FileError> {
    let (input, file) = open(path)?;
    read_component_vectors(input, &file)
}

/// Reads sphere centres from anything; `file` is its name in messages.
pub fn read_sphere_centres(input: impl Read, file: &str) -> Result<StudyFile<SphereCentre>, FileError> {
    let source = CsvSource::new(input, file)?;
    let header = source.header();
    let require = |column| header.require(column, &CENTRES);
    let [a, c, distance] = [require(A)?, require(C)?, require(DISTANCE)?];
    let centre = [require(READING[0])?, require(READING[1])?, require(READING[2])?];
    let u = header.optional(U, &CENTRES)?;
    let is_stranger = |name: &str| !is_temperature(name) && CENTRES.iter().all(|known| known.name != name);
    if let Some(stranger) = header.names().iter().find(|name| is_stranger(name)) {
        let problem = "the column is not known here";
        return Err(FileError::content(header.place().column(stranger), problem, "remove it, or correct its name"));
    }
    rows(source, |row| {
        Ok(SphereCentre {
            a_rad: row.number(a)?.to_radians(),
            c_rad: row.number(c)?.to_radians(),
            distance_m: row.number(distance)? / 1e3,
            centre_m: row.three(centre, 1e3)?,
            u_m: u.map(|column| row.positive(column, 1e6)).transpose()?,
        })
    })
}

/// Reads positioning runs from anything; `file` is its name in messages.
pub fn read_runs(input: impl Read, file: &str) -> Result<StudyFile<Run>, FileError> {
    let source = CsvSource::new(input, file)?;
    let header = source.header();
    let require = |column| header.require(column, &RUNS);
    let [axis, target, direction] = [require(AXIS)?, require(TARGET)?, require(DIRECTION)?];
    let (cycle, reached) = (require(CYCLE)?, Reached::new(header)?);
    let time = header.optional(TIME, &RUNS)?;
    let covariates = strangers(header, |name| RUNS.iter().any(|known| known.name == name));
    header.check_covariates(&RUNS)?;
    let header_place = header.place();
    let read = rows(source, |row| {
        let target_mm = row.number(target)?;
        let measured_mm = reached.measured_mm(row, target_mm)?;
        Ok(Run {
            axis: row.text(axis)?,
            target_m: target_mm / 1e3,
            approach: row.approach(direction)?,
            cycle: row.whole(cycle)?,
            measured_m: measured_mm / 1e3,
            time_s: row.optional(time)?,
            covariates: row.covariates(&covariates)?,
        })
    })?;
    let largest_m = read.rows.iter().map(|run| run.error_m().abs()).fold(0.0, f64::max);
    match reached {
        Reached::Deviation(_) => {
            let otherwise = ", else write measured_mm in their place";
            refuse_millimetres(largest_m, header_place.column(DEVIATION.name), otherwise)?;
        }
        Reached::Measured(_) => {
            let farthest_m = read.rows.iter().map(|run| run.target_m.abs()).fold(0.0, f64::max);
            tell_of_metres(file, farthest_m, largest_m);
        }
    }
    Ok(read)
}

/// The column that says where an axis came to stand.
#[derive(Debug, Clone, Copy)]
enum Reached {
    /// The position itself (mm).
    Measured(usize),
    /// That less the target (µm).
    Deviation(usize),
}

impl Reached {
    fn new(header: &Header) -> Result<Reached, FileError> {
        let deviation = header.find(DEVIATION.name);
        match (header.find(MEASURED.name), deviation) {
            (None, Some(column)) => Ok(Reached::Deviation(column)),
            (Some(_), Some(_)) => {
                let problem = "the column says what measured_mm says, and one of them is enough";
                Err(FileError::content(header.place().column(DEVIATION.name), problem, "remove one of the two"))
            }
            (_, None) => header.require(MEASURED, &RUNS).map(Reached::Measured),
        }
    }

    fn measured_mm(self, row: &Row, target_mm: f64) -> Result<f64, FileError> {
        let (column, deviation_mm, remedy) = match self {
            Reached::Measured(column) => (
                column,
                row.number(column)? - target_mm,
                "check the units of target_mm and measured_mm, and that measured_mm holds positions, not errors",
            ),
            Reached::Deviation(column) => (
                column,
                row.number(column)? / 1e3,
                "check that deviation_um holds errors in micrometres, not positions",
            ),
        };
        if deviation_mm.abs() > LARGEST_MM {
            let problem = format!("{deviation_mm:.3} mm off its target is another unit or another column");
            return Err(FileError::content(row.place(column), problem, remedy));
        }
        match self {
            Reached::Measured(column) => row.number(column),
            Reached::Deviation(_) => Ok(target_mm + deviation_mm),
        }
    }
}

/// Reads residual vectors of a volume from anything; `file` is its name in messages.
pub fn read_residual_vectors(input: impl Read, file: &str) -> Result<StudyFile<ResidualVector>, FileError> {
    of_one_tip(file, vectors(CsvSource::new(input, file)?, Lack::Nothing)?)
}

/// Reads residual vectors of a volume or a plane from anything; `file` is its name in messages.
pub fn read_plane_vectors(input: impl Read, file: &str) -> Result<StudyFile<ResidualVector>, FileError> {
    of_one_tip(file, vectors(CsvSource::new(input, file)?, Lack::OneAxis)?)
}

/// The same of which two components may be missing.
pub fn read_component_vectors(input: impl Read, file: &str) -> Result<StudyFile<ResidualVector>, FileError> {
    of_one_tip(file, vectors(CsvSource::new(input, file)?, Lack::TwoComponents)?)
}

fn of_one_tip(file: &str, table: StudyFile<ResidualVector>) -> Result<StudyFile<ResidualVector>, FileError> {
    refuse_several_tips(file, (&table.rows, &table.lines), |_| false)?;
    Ok(table)
}

/// What residual vectors may lack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lack {
    Nothing,
    /// Positions along one axis, and one component.
    OneAxis,
    /// Positions along one axis, and two components.
    TwoComponents,
    /// All positions.
    Positions,
}

fn vectors<R: Read>(source: CsvSource<R>, lack: Lack) -> Result<StudyFile<ResidualVector>, FileError> {
    let (header, may_lack) = (source.header(), matches!(lack, Lack::OneAxis | Lack::TwoComponents));
    let components = match lack {
        Lack::TwoComponents => 2,
        Lack::OneAxis => 1,
        Lack::Nothing | Lack::Positions => 0,
    };
    let position = match lengths(header, "", usize::from(may_lack))? {
        None if lack == Lack::Positions => Lengths { columns: [None; 3], per_m: 1.0 },
        found => found.ok_or_else(|| no_lengths(header, ""))?,
    };
    let residual = lengths(header, "res_", components)?.ok_or_else(|| no_lengths(header, "res_"))?;
    // What was not measured needs no uncertainty.
    let u = lengths(header, "u_", residual.lacking().count())?;
    let known = [TIME, BLOCK];
    let (time, block) = (header.optional(TIME, &known)?, header.optional(BLOCK, &known)?);
    let [pose, point, u_plate] = [POSE, POINT, U_PLATE].map(|own| header.find(own.name));
    let mut used: Vec<usize> = position.columns.iter().chain(&residual.columns).flatten().copied().collect();
    used.extend(u.iter().flat_map(|own| own.columns).flatten());
    used.extend([time, block, pose, point, u_plate].into_iter().flatten());
    let said: Vec<&str> = OF_ABBE.into_iter().filter(|name| header.find(name).is_some()).collect();
    if !said.is_empty() {
        tell_once(format!("{}: {} left out, as what Abbe says of its own rows", header.file(), said.join(", ")));
    }
    used.extend(said.iter().filter_map(|name| header.find(name)));
    let covariates = strangers(header, |name| header.find(name).is_some_and(|column| used.contains(&column)));
    header.check_covariates(&[TIME, U_PLATE])?;
    if u.is_none() {
        refuse_misspelt(header, &covariates, &["u_x_um", "u_y_um", "u_z_um"])?;
    }
    for (own, prefix) in [(position, ""), (residual, "res_")] {
        for axis in own.lacking().filter(|_| may_lack) {
            let names = LENGTHS.map(|(unit, _)| format!("{prefix}{}_{unit}", axis.lower()));
            refuse_misspelt(header, &covariates, &names.each_ref().map(String::as_str))?;
        }
    }
    if let Some(of_u) = u.and_then(|u| u.lacking().find(|axis| residual.columns[axis.index()].is_some())) {
        let problem = format!("uncertainties have no {}, and residuals have", of_u.lower());
        return Err(FileError::content(
            header.place(),
            problem,
            "give the uncertainty of every residual that is given",
        ));
    }
    rows(source, |row| {
        Ok(ResidualVector {
            position_m: row.lengths(position)?,
            residual_m: row.lengths(residual)?,
            u_m: u.map(|own| row.uncertainties(own, residual)).transpose()?,
            time_s: row.optional(time)?,
            block: block.map(|column| row.text(column)).transpose()?,
            covariates: row.covariates(&covariates)?,
            pose: pose.map(|column| row.text(column)).transpose()?,
            point: point.map(|column| row.text(column)).transpose()?,
            u_plate_m: u_plate.map(|column| row.positive(column, 1e6)).transpose()?,
            position_lacks: position.columns.map(|column| may_lack && column.is_none()),
            residual_lacks: residual.columns.map(|column| column.is_none()),
        })
    })
}

/// Suffixes of lengths and how many of the unit make a metre.
const LENGTHS: [(&str, f64); 3] = [("mm", 1e3), ("um", 1e6), ("m", 1.0)];

/// Columns of x, y and z in one unit, some of which may be missing.
#[derive(Debug, Clone, Copy)]
struct Lengths {
    columns: [Option<usize>; 3],
    per_m: f64,
}

impl Lengths {
    fn lacks(self) -> Option<Axis> {
        self.lacking().next()
    }

    fn lacking(self) -> impl Iterator<Item = Axis> {
        Axis::ALL.into_iter().filter(move |axis| self.columns[axis.index()].is_none())
    }
}

/// Columns of x, y and z with this prefix, all in one unit, of which so many may be missing; `None` where none of them is there.
fn lengths(header: &Header, prefix: &str, may_lack: usize) -> Result<Option<Lengths>, FileError> {
    let find = |axis: &str, unit: &str| header.find(&format!("{prefix}{axis}_{unit}"));
    let mut there = Vec::new();
    for (unit, per_m) in LENGTHS {
        let columns = ["x", "y", "z"].map(|axis| find(axis, unit));
        match columns.iter().flatten().count() {
            0 => {}
            count => there.push((Lengths { columns, per_m }, unit, count)),
        }
    }
    if there.len() > 1
        && let Some((whole, ..)) = there.iter().find(|(.., count)| *count == 3)
        && let Some((other, ..)) = there.iter().find(|(other, ..)| other.per_m != whole.per_m)
    {
        let name = |of: &Lengths| of.columns.iter().flatten().next().map_or("?", |first| &header.names()[*first]);
        return Err(header.said_twice(name(other), name(whole)));
    }
    let Some((own, unit, count)) = there.last().copied() else { return Ok(None) };
    if count + may_lack >= 3 && there.len() == 1 {
        return Ok(Some(own));
    }
    let axis = own.lacks().map_or("x", Axis::lower);
    let name = format!("{prefix}{axis}_{unit}");
    let remedy = format!("add the column {name}, and write all three in one unit");
    Err(FileError::content(header.place().column(&name), "the column is missing", remedy))
}

fn no_lengths(header: &Header, prefix: &str) -> FileError {
    let name = format!("{prefix}x_mm");
    let remedy =
        format!("add the columns {prefix}x_mm, {prefix}y_mm and {prefix}z_mm (or all three ending in _um or _m)");
    FileError::content(header.place().column(&name), "the column is missing", remedy)
}

/// Columns that nobody has asked for, with their names.
fn strangers(header: &Header, is_known: impl Fn(&str) -> bool) -> Vec<(usize, String)> {
    header.names().iter().enumerate().filter(|(_, name)| !is_known(name)).map(|(k, name)| (k, name.clone())).collect()
}

/// Refuses columns that stand where others are missing, and are named nearly like them: they would pass for covariates.
fn refuse_misspelt(header: &Header, strangers: &[(usize, String)], wanted: &[&str]) -> Result<(), FileError> {
    for name in wanted.iter().copied() {
        if let Some(misspelt) = nearest(name, strangers.iter().map(|(_, stranger)| stranger.as_str())) {
            let problem = format!("the column {name} is missing; did you mean it by {misspelt}?");
            let remedy = format!("rename the column {misspelt} to {name}, or to a name that is not so like it");
            return Err(FileError::content(header.place().column(misspelt), problem, remedy));
        }
    }
    Ok(())
}

/// All rows of a file, at least one.
pub(crate) fn rows<R: Read, T>(
    mut source: CsvSource<R>,
    mut read: impl FnMut(&Row) -> Result<T, FileError>,
) -> Result<StudyFile<T>, FileError> {
    let (mut rows, mut lines) = (Vec::new(), Vec::new());
    let mut record = ByteRecord::new();
    while let Some(line) = source.next(&mut record)? {
        lines.push(line);
        rows.push(read(&Row { header: source.header(), record: &record, line })?);
    }
    if rows.is_empty() {
        let remedy = "give one row for each measurement";
        return Err(FileError::content(source.header().place(), "the file holds a header but no row", remedy));
    }
    Ok(StudyFile { rows, lines, sha256: source.sha256() })
}

/// One row with its place.
pub(crate) struct Row<'a> {
    header: &'a Header,
    record: &'a ByteRecord,
    line: u64,
}

impl Row<'_> {
    pub(crate) fn number(&self, column: usize) -> Result<f64, FileError> {
        self.header.number(self.record, column, self.line, NUMBER_REMEDY)
    }

    pub(crate) fn place(&self, column: usize) -> Place {
        self.header.cell(self.line, column)
    }

    pub(crate) fn three(&self, columns: [usize; 3], per_m: f64) -> Result<[f64; 3], FileError> {
        Ok([self.number(columns[0])? / per_m, self.number(columns[1])? / per_m, self.number(columns[2])? / per_m])
    }

    /// A standard uncertainty (m).
    pub(crate) fn positive(&self, column: usize, per_m: f64) -> Result<f64, FileError> {
        let value = self.number(column)?;
        if value > 0.0 {
            return Ok(value / per_m);
        }
        let remedy = "write the standard uncertainty (k = 1), or remove the column";
        Err(FileError::content(self.place(column), format!("the uncertainty {value} is not above zero"), remedy))
    }

    /// Lengths (m); 0 stands where the file has no column, and whoever reads asks [`Lengths::lacks`].
    fn lengths(&self, own: Lengths) -> Result<[f64; 3], FileError> {
        let at = |k: usize| own.columns[k].map_or(Ok(0.0), |column| Ok(self.number(column)? / own.per_m));
        Ok([at(0)?, at(1)?, at(2)?])
    }

    /// Standard uncertainties (m); that of a component that nobody measured is one of the others.
    fn uncertainties(&self, own: Lengths, residual: Lengths) -> Result<[f64; 3], FileError> {
        let given = |k: usize| own.columns[k].filter(|_| residual.columns[k].is_some());
        let any = (0..3).find_map(given);
        let at = |k: usize| given(k).or(any).map_or(Ok(1.0), |column| self.positive(column, own.per_m));
        Ok([at(0)?, at(1)?, at(2)?])
    }

    fn is_empty(&self, column: usize) -> bool {
        self.record.get(column).unwrap_or_default().trim_ascii().is_empty()
    }

    pub(crate) fn optional(&self, column: Option<usize>) -> Result<Option<f64>, FileError> {
        column.filter(|column| !self.is_empty(*column)).map(|column| self.number(column)).transpose()
    }

    pub(crate) fn text(&self, column: usize) -> Result<String, FileError> {
        let cell = self.record.get(column).unwrap_or_default().trim_ascii();
        let text = std::str::from_utf8(cell).ok().filter(|text| !text.is_empty());
        text.map(str::to_owned).ok_or_else(|| {
            FileError::content(self.place(column), "the name is empty or not UTF-8", "write a name in every row")
        })
    }

    pub(crate) fn whole(&self, column: usize) -> Result<i64, FileError> {
        let text = self.text(column)?;
        text.parse().map_err(|_| {
            let problem = format!("{text:?} is not a whole number");
            FileError::content(self.place(column), problem, "number the cycles 1, 2, 3 and so on")
        })
    }

    fn approach(&self, column: usize) -> Result<Approach, FileError> {
        let text = self.text(column)?;
        match text.to_lowercase().as_str() {
            "+" | "+1" | "1" | "up" | "positive" => Ok(Approach::Positive),
            "-" | "-1" | "down" | "negative" => Ok(Approach::Negative),
            _ => {
                let problem = format!("{text:?} is no direction of approach");
                Err(FileError::content(
                    self.place(column),
                    problem,
                    "write + towards larger positions, - towards smaller",
                ))
            }
        }
    }

    fn covariates(&self, columns: &[(usize, String)]) -> Result<BTreeMap<String, f64>, FileError> {
        let mut logged = BTreeMap::new();
        for (column, name) in columns.iter().filter(|(column, _)| !self.is_empty(*column)) {
            let value = self.header.number(self.record, *column, self.line, COVARIATE_REMEDY)?;
            logged.insert(name.clone(), value);
        }
        Ok(logged)
    }
}
