//! The path of a plan in the forms that people and machines read: points and stations as CSV, G-code, I++ DME commands.
//!
//! Place in the flow: a plan in SI → here → files in mm, s, mm/s. The points are in the columns of a campaign
//! without `length_mm`, so that no fit takes them for measured. [`read_path`] brings them back for the simulator.

use crate::campaign_csv::KNOWN;
use crate::columns::LENGTH;
use crate::dialect::Dialect;
use crate::error::{FileError, Place};
use crate::points_csv::unwritten;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::planned::{Line, Motion, Station};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// Digits of a coordinate (mm): tenths of a micrometre, what a control takes.
const DIGITS: usize = 4;
/// How far a point may be from its even place (m): rounding of both.
const EVEN_M: f64 = 1e-6;
/// Columns of the stations' file.
const STATION: [&str; 4] = ["station", "x_mm", "y_mm", "z_mm"];

/// Stations of a plan, and its lines in order.
type Planned<'a> = (&'a [Station], &'a [Line]);

/// The nominal points in the columns of a campaign, without lengths.
///
/// # Errors
/// A text that CSV cannot hold.
pub fn path_csv(nominal: &Campaign) -> Result<Vec<u8>, FileError> {
    let file = "path.csv";
    let mut writer = Dialect::default().writer(Vec::new());
    let known = KNOWN.iter().map(|known| known.name).filter(|name| *name != LENGTH.name);
    let covariates = nominal.covariates.iter().map(|covariate| covariate.name.as_str());
    writer.write_record(known.chain(covariates)).map_err(|error| unwritten(file, error))?;
    for (row, reading) in nominal.readings.iter().enumerate() {
        let mut cells = vec![
            nominal.stations[reading.station as usize].clone(),
            nominal.lines[reading.line as usize].clone(),
            format!("{:.3}", reading.time_s),
        ];
        cells.extend(reading.reading_m.iter().chain(&reading.offset_m).map(|v| format!("{:.DIGITS$}", v * 1e3)));
        cells.extend(nominal.covariates.iter().map(|c| c.values[row].map_or(String::new(), |v| format!("{v:.6}"))));
        writer.write_record(cells).map_err(|error| unwritten(file, error))?;
    }
    writer.into_inner().map_err(|error| unwritten(file, error.into_error().into()))
}

/// Where the tracer stands.
///
/// # Errors
/// A text that CSV cannot hold.
pub fn stations_csv(stations: &[Station]) -> Result<Vec<u8>, FileError> {
    let file = "stations.csv";
    let mut writer = Dialect::default().writer(Vec::new());
    writer.write_record(STATION).map_err(|error| unwritten(file, error))?;
    for station in stations {
        let [x, y, z] = station.position_m.map(|v| format!("{:.DIGITS$}", v * 1e3));
        writer.write_record([&station.name, &x, &y, &z]).map_err(|error| unwritten(file, error))?;
    }
    writer.into_inner().map_err(|error| unwritten(file, error.into_error().into()))
}

/// A program in the common words of RS-274 controls: absolute, millimetres, a dwell at each point, a stop where somebody has
/// to move the tracer or the reflector.
pub fn gcode(planned: Planned, motion: &Motion, machine: &str) -> String {
    let mut text = format!("(planned campaign of {}, scale readings in mm)\nG21 G90 G94\n", plain(machine));
    let fastest_mm_min = motion.feeds_m_s.iter().fold(0.0_f64, |most, feed| most.max(*feed)) * 6e4;
    each_line(planned, |step| {
        // Writing to a string cannot fail.
        let _ = match step {
            Step::Stop(words) => writeln!(text, "(MSG, {})\nM0", plain(&words)),
            Step::Line(name) => writeln!(text, "(line {})", plain(name)),
            Step::Go(at_m) => {
                writeln!(text, "G1 {} F{fastest_mm_min:.0}", axes(at_m, " ", |axis, mm| format!("{axis}{mm}")))
            }
            Step::Measure(at_m, feed_m_s) => {
                let at = axes(at_m, " ", |axis, mm| format!("{axis}{mm}"));
                writeln!(text, "G1 {at} F{:.0}\nG4 P{:.3}", feed_m_s * 6e4, motion.dwell_s)
            }
        };
    });
    text.push_str("M2\n");
    text
}

/// Commands of I++ DME for the machine's server: a GoTo a point. What a person has to do stands in a comment of its own, which a
/// client shows and does not send.
pub fn dme(planned: Planned, motion: &Motion) -> String {
    let mut text = String::new();
    each_line(planned, |step| {
        let go = |at_m| format!("GoTo({})", axes(at_m, ", ", |axis, mm| format!("{axis}({mm})")));
        // Writing to a string cannot fail.
        let _ = match step {
            Step::Stop(words) => writeln!(text, "# {}", plain(&words)),
            Step::Line(name) => writeln!(text, "# line {}, stand {:.3} s at each point", plain(name), motion.dwell_s),
            Step::Go(at_m) | Step::Measure(at_m, _) => writeln!(text, "{}", go(at_m)),
        };
    });
    text
}

enum Step<'a> {
    /// Somebody has something to do.
    Stop(String),
    Line(&'a str),
    /// A place to go through (m).
    Go([f64; 3]),
    /// A place to stand still (m), with the feed (m/s) to it.
    Measure([f64; 3], f64),
}

fn each_line((stations, lines): Planned, mut visit: impl FnMut(Step)) {
    let mut before: Option<(usize, usize)> = None;
    for line in lines {
        let offset = line.offset_m.map(|v| format!("{:.DIGITS$}", v * 1e3)).join(" ");
        if before.is_none_or(|(station, _)| station != line.station) {
            let station = &stations[line.station];
            let at = station.position_m.map(|v| format!("{:.DIGITS$}", v * 1e3)).join(" ");
            visit(Step::Stop(format!(
                "tracer to station {} at {at} mm, reflector at offset {offset} mm",
                station.name
            )));
        } else if before.is_some_and(|(_, holder)| holder != line.holder) {
            visit(Step::Stop(format!("reflector to offset {offset} mm, without losing the beam")));
        }
        visit(Step::Line(&line.name));
        line.via_m.iter().for_each(|at_m| visit(Step::Go(*at_m)));
        line.points_m.iter().for_each(|at_m| visit(Step::Measure(*at_m, line.feed_m_s)));
        before = Some((line.station, line.holder));
    }
}

fn axes(at_m: [f64; 3], between: &str, word: impl Fn(char, String) -> String) -> String {
    let words = ['X', 'Y', 'Z'].into_iter().zip(at_m).map(|(axis, v)| word(axis, format!("{:.DIGITS$}", v * 1e3)));
    words.collect::<Vec<_>>().join(between)
}

/// Text without what ends a comment.
fn plain(text: &str) -> String {
    text.replace(['(', ')', '\n', '\r', ';'], " ")
}

/// A path as it is driven: stations with their lines.
#[derive(Debug, Clone, PartialEq)]
pub struct PathStation {
    /// Name.
    pub name: String,
    /// Centre of the tracer (m, machine frame).
    pub position_m: [f64; 3],
    /// Lines in order.
    pub lines: Vec<PathLine>,
}

/// One line of a path.
#[derive(Debug, Clone, PartialEq)]
pub struct PathLine {
    /// Name.
    pub name: String,
    /// Readings of its points (m).
    pub points_m: Vec<[f64; 3]>,
    /// Reflector (m, ram frame).
    pub offset_m: [f64; 3],
    /// Feed (m/s); `None` where the file has no column `speed_mm_s`.
    pub feed_m_s: Option<f64>,
}

/// Reads `path.csv` and `stations.csv` of a folder.
///
/// # Errors
/// A file, column or number that is missing or wrong, by file, line and column.
pub fn read_path(folder: &Path) -> Result<Vec<PathStation>, FileError> {
    let stations = read_stations(&folder.join("stations.csv"))?;
    let path = folder.join("path.csv");
    let table = Table::read(&path)?;
    let mut all: Vec<PathStation> = Vec::new();
    for row in 0..table.rows.len() {
        let (station, line) = (table.text(row, "station")?, table.text(row, "line")?);
        let Some(position_m) = stations.get(&station) else {
            let problem = format!("station {station} is not in stations.csv");
            return Err(FileError::content(table.place(row, "station"), problem, "add it there, or correct the name"));
        };
        let metres = |names: [&str; 3]| -> Result<[f64; 3], FileError> {
            let mut values = [0.0; 3];
            for (value, name) in values.iter_mut().zip(names) {
                *value = table.number(row, name)? / 1e3;
            }
            Ok(values)
        };
        let at_m = metres(["x_mm", "y_mm", "z_mm"])?;
        let offset_m = metres(["offset_x_mm", "offset_y_mm", "offset_z_mm"])?;
        let feed_m_s = if table.has("speed_mm_s") { Some(table.number(row, "speed_mm_s")? / 1e3) } else { None };
        if all.last().is_none_or(|last| last.name != station) {
            all.push(PathStation { name: station, position_m: *position_m, lines: Vec::new() });
        }
        let Some(own) = all.last_mut() else { continue };
        match own.lines.last_mut().filter(|last| last.name == line) {
            Some(last) if last.offset_m != offset_m => {
                let problem = format!("line {line} has another offset before");
                return Err(FileError::content(
                    table.place(row, "offset_x_mm"),
                    problem,
                    "give each offset its own line",
                ));
            }
            Some(last) => last.points_m.push(at_m),
            None => own.lines.push(PathLine { name: line, points_m: vec![at_m], offset_m, feed_m_s }),
        }
    }
    if let Some(line) = all.iter().flat_map(|station| &station.lines).find(|line| !is_even(&line.points_m)) {
        let problem = format!("the points of line {} are not evenly spaced on a straight line", line.name);
        let remedy = "give each straight, even run of points its own line";
        return Err(FileError::content(Place::file(&table.file).column("line"), problem, remedy));
    }
    if all.is_empty() {
        return Err(FileError::content(Place::file(&path.display().to_string()), "holds no point", "plan again"));
    }
    Ok(all)
}

/// Whether points (m) lie evenly between the first and the last, as the simulator drives a line.
fn is_even(points_m: &[[f64; 3]]) -> bool {
    let (Some(first), Some(last)) = (points_m.first(), points_m.last()) else { return true };
    let steps = points_m.len().saturating_sub(1).max(1) as f64;
    let off_m = |(k, at_m): (usize, &[f64; 3])| {
        (0..3).map(|d| (at_m[d] - first[d] - (last[d] - first[d]) * k as f64 / steps).abs()).fold(0.0, f64::max)
    };
    points_m.iter().enumerate().map(off_m).all(|off_m| off_m < EVEN_M)
}

fn read_stations(path: &Path) -> Result<BTreeMap<String, [f64; 3]>, FileError> {
    let table = Table::read(path)?;
    let mut stations = BTreeMap::new();
    for row in 0..table.rows.len() {
        let mut position_m = [0.0; 3];
        for (value, name) in position_m.iter_mut().zip(&STATION[1..]) {
            *value = table.number(row, name)? / 1e3;
        }
        let name = table.text(row, "station")?;
        if stations.contains_key(&name) {
            let problem = format!("station {name} stands twice");
            return Err(FileError::content(table.place(row, "station"), problem, "remove or rename one of the two"));
        }
        stations.insert(name, position_m);
    }
    Ok(stations)
}

/// A small table that this program wrote: commas, a header, decimal points.
struct Table {
    file: String,
    names: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    fn read(path: &Path) -> Result<Table, FileError> {
        let file = path.display().to_string();
        let bytes = std::fs::read(path).map_err(FileError::io(&file, "read the path"))?;
        let mut reader = csv::ReaderBuilder::new().from_reader(bytes.as_slice());
        let unread = |error: csv::Error| {
            FileError::content(Place::file(&file), error.to_string(), "write it anew with `abbe plan`")
        };
        let names = reader.headers().map_err(unread)?.iter().map(str::to_owned).collect();
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(unread)?;
            rows.push(record.iter().map(str::to_owned).collect());
        }
        Ok(Table { file, names, rows })
    }

    fn has(&self, name: &str) -> bool {
        self.names.iter().any(|known| known == name)
    }

    fn place(&self, row: usize, name: &str) -> Place {
        Place::file(&self.file).line(row as u64 + 2).column(name)
    }

    fn text(&self, row: usize, name: &str) -> Result<String, FileError> {
        let column = self.names.iter().position(|known| known == name);
        let cell = column.and_then(|column| self.rows[row].get(column));
        cell.cloned().ok_or_else(|| {
            FileError::content(self.place(row, name), "there is no such cell", "write the path anew with `abbe plan`")
        })
    }

    fn number(&self, row: usize, name: &str) -> Result<f64, FileError> {
        let text = self.text(row, name)?;
        text.trim().parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| {
            FileError::content(self.place(row, name), format!("{text:?} is no number"), "write a number such as 12.5")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "station,line,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,speed_mm_s\n";

    fn read(rows: &str) -> Result<Vec<PathStation>, String> {
        let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
        std::fs::write(folder.path().join("stations.csv"), "station,x_mm,y_mm,z_mm\nS1,-200,-300,100\n")
            .and_then(|()| std::fs::write(folder.path().join("path.csv"), format!("{HEAD}{rows}")))
            .map_err(|error| error.to_string())?;
        read_path(folder.path()).map_err(|error| error.to_string())
    }

    #[test]
    fn a_path_is_read_back_and_what_would_be_driven_otherwise_is_refused() {
        let even = "S1,A,1,0,0,0,0,0,-60,50\nS1,A,2,10,0,0,0,0,-60,50\nS1,A,3,20,0,0,0,0,-60,50\n";
        let found = read(even).unwrap();
        assert_eq!(found[0].position_m, [-0.2, -0.3, 0.1]);
        assert_eq!((found[0].lines[0].points_m.len(), found[0].lines[0].feed_m_s), (3, Some(0.05)));
        let said = |rows: &str| read(rows).unwrap_err();
        assert!(said(&even.replace("A,2,10", "A,2,12")).contains("line A are not evenly spaced"));
        assert!(said(&even.replace("0,0,0,0,-60,50\nS1,A,3", "0,0,5,0,-60,50\nS1,A,3")).contains("another offset"));
        assert!(said(&even.replace("S1,A,3", "S2,A,3")).contains("S2 is not in stations.csv"));
        assert!(said(&even.replace("20,0,0", "x,0,0")).contains("\"x\" is no number"));
        assert!(said("").contains("holds no point"));
    }

    #[test]
    fn regress_a_station_that_stands_twice_is_refused_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("stations.csv");
        std::fs::write(&file, "station,x_mm,y_mm,z_mm\nS1,-200,-300,100\nS2,0,0,0\nS1,500,-300,100\n").unwrap();
        let said = read_path(folder.path()).unwrap_err().to_string();
        assert!(["stations.csv", "line 4", "S1 stands twice"].iter().all(|part| said.contains(part)), "{said}");
    }
}
