//! Tracer campaigns from CSV: one row a static reading, any further numeric column a covariate.
//!
//! Place in the flow: campaign file → here → [`Campaign`] in SI → identification. Columns: `station`, `line`
//! (optional; then each station is one line), `time_s`, `x_mm y_mm z_mm`, `offset_x_mm offset_y_mm offset_z_mm`
//! (optional where the machine declares an offset), `length_mm`. Reading is one pass; memory is the campaign.

use crate::columns::{Header, Known, LENGTH, LINE, OFFSET, Offset, READING, STATION, TIME};
use crate::csv_source::CsvSource;
use crate::error::{FileError, Place};
use crate::notice::tell_once;
use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};
use csv::ByteRecord;
use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Columns of every campaign, in the order in which they are written.
pub(crate) const KNOWN: [Known; 10] =
    [STATION, LINE, TIME, READING[0], READING[1], READING[2], OFFSET[0], OFFSET[1], OFFSET[2], LENGTH];
const NUMBER_REMEDY: &str = "write a number with a decimal point, or remove the row";
const COVARIATE_REMEDY: &str = "a further column must hold numbers to be a covariate: write a number, leave the cell \
                                empty where nothing was logged, or remove the column";

/// A campaign and the hash of the file it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct CampaignFile {
    /// The readings.
    pub campaign: Campaign,
    /// SHA-256 of the bytes of the file.
    pub sha256: [u8; 32],
}

/// Reads a campaign file; `default_offset_m` (ram frame) is used where it has no offset columns.
pub fn read_campaign_file(path: &Path, default_offset_m: Option<[f64; 3]>) -> Result<CampaignFile, FileError> {
    let file = path.display().to_string();
    let input = File::open(path).map_err(FileError::io(&file, "open the campaign"))?;
    read_campaign(input, &file, default_offset_m)
}

/// Reads a campaign from anything; `file` is its name in messages.
pub fn read_campaign(
    input: impl Read,
    file: &str,
    default_offset_m: Option<[f64; 3]>,
) -> Result<CampaignFile, FileError> {
    let mut source = CsvSource::new(input, file)?;
    let columns = Columns::new(source.header(), default_offset_m)?;
    let mut builder = Builder::new(source.header(), columns);
    let mut record = ByteRecord::new();
    while let Some(line) = source.next(&mut record)? {
        builder.add(source.header(), &record, line)?;
    }
    if builder.campaign.readings.is_empty() {
        let remedy = "give one row for each reading";
        return Err(FileError::content(source.header().place(), "the file holds a header but no reading", remedy));
    }
    if let Some(words) = builder.clock_words() {
        tell_once(format!("{file}: {words}"));
    }
    Ok(CampaignFile { campaign: builder.campaign, sha256: source.sha256() })
}

/// Where each quantity stands in a row.
struct Columns {
    station: usize,
    line: Option<usize>,
    time: usize,
    reading: [usize; 3],
    offset: Offset,
    length: usize,
    covariates: Vec<usize>,
}

impl Columns {
    fn new(header: &Header, default_offset_m: Option<[f64; 3]>) -> Result<Columns, FileError> {
        let require = |column| header.require(column, &KNOWN);
        let is_covariate = |k: &usize| KNOWN.iter().all(|known| known.name != header.names()[*k]);
        let columns = Columns {
            station: require(STATION)?,
            line: header.optional(LINE, &KNOWN)?,
            time: require(TIME)?,
            reading: [require(READING[0])?, require(READING[1])?, require(READING[2])?],
            offset: header.offset(default_offset_m, &KNOWN)?,
            length: require(LENGTH)?,
            covariates: (0..header.len()).filter(is_covariate).collect(),
        };
        header.check_covariates(&KNOWN)?;
        Ok(columns)
    }
}

/// What is remembered of a line of the campaign to hold later rows against.
struct LineSeen {
    station: u32,
    offset_m: [f64; 3],
    row: u64,
}

/// First and latest reading of a station: time (s) and row.
struct Span {
    first: (f64, u64),
    latest: (f64, u64),
}

/// A campaign as it grows.
struct Builder {
    campaign: Campaign,
    columns: Columns,
    stations: Names,
    lines: Names,
    /// First and latest instant of each station, each with its row.
    spans: Vec<Span>,
    seen: Vec<LineSeen>,
}

impl Builder {
    fn new(header: &Header, columns: Columns) -> Builder {
        let covariate = |k: &usize| Covariate { name: header.names()[*k].clone(), values: Vec::new() };
        let covariates = columns.covariates.iter().map(covariate).collect();
        Builder {
            campaign: Campaign { covariates, ..Campaign::default() },
            columns,
            stations: Names::default(),
            lines: Names::default(),
            spans: Vec::new(),
            seen: Vec::new(),
        }
    }

    fn add(&mut self, header: &Header, record: &ByteRecord, row: u64) -> Result<(), FileError> {
        let number = |column| header.number(record, column, row, NUMBER_REMEDY);
        let metres = |columns: [usize; 3]| -> Result<[f64; 3], FileError> {
            Ok([number(columns[0])? / 1e3, number(columns[1])? / 1e3, number(columns[2])? / 1e3])
        };
        let time_s = number(self.columns.time)?;
        let reading_m = metres(self.columns.reading)?;
        let length_m = number(self.columns.length)? / 1e3;
        let offset_m = match self.columns.offset {
            Offset::Columns(columns) => metres(columns)?,
            Offset::Constant(offset_m) => offset_m,
        };
        let station = self.stations.index(header, record, self.columns.station, row, &mut self.campaign.stations)?;
        let line_column = self.columns.line.unwrap_or(self.columns.station);
        let line = self.lines.index(header, record, line_column, row, &mut self.campaign.lines)?;
        self.check_time(header, station, time_s, row)?;
        self.check_line(header, station, line, offset_m, row)?;
        for (k, covariate) in self.columns.covariates.iter().zip(&mut self.campaign.covariates) {
            let is_empty = record.get(*k).unwrap_or_default().trim_ascii().is_empty();
            let value = if is_empty { None } else { Some(header.number(record, *k, row, COVARIATE_REMEDY)?) };
            covariate.values.push(value);
        }
        self.campaign.readings.push(RangeReading { station, line, time_s, reading_m, offset_m, length_m });
        Ok(())
    }

    fn check_time(&mut self, header: &Header, station: u32, time_s: f64, row: u64) -> Result<(), FileError> {
        let Some(span) = self.spans.get_mut(station as usize) else {
            self.spans.push(Span { first: (time_s, row), latest: (time_s, row) });
            return Ok(());
        };
        let (latest_s, before) = span.latest;
        if time_s > latest_s {
            span.latest = (time_s, row);
            return Ok(());
        }
        let name = &self.campaign.stations[station as usize];
        let (how, remedy) = if time_s == latest_s {
            ("is the same as", "remove the duplicate row, or write the time with more digits")
        } else {
            ("is earlier than", "sort the rows of each station by time")
        };
        let problem = format!("the time {time_s} s {how} {latest_s} s of station {name} in line {before}");
        Err(FileError::content(header.cell(row, self.columns.time), problem, remedy))
    }

    /// What is odd about the times of the stations, in words: nothing that cannot be right.
    fn clock_words(&self) -> Option<String> {
        let name = |k: usize| &self.campaign.stations[k];
        let rows = |k: usize| format!("{} (lines {} to {})", name(k), self.spans[k].first.1, self.spans[k].latest.1);
        // In the order of the file; times of stations that read at once go through each other.
        let pairs = || (1..self.spans.len()).map(|k| (k - 1, k));
        let begins_before_the_end = |of: &(usize, usize)| self.spans[of.1].first.0 < self.spans[of.0].latest.0;
        let (before, after) = pairs().find(begins_before_the_end)?;
        if self.have_one_clock() {
            return Some(format!(
                "time_s runs backwards from station {} to station {}, and no two stations have times in common: their rows stand in another \
                 order than they were measured in. The times are taken as they stand; if it is the names that were exchanged, correct them",
                rows(before),
                rows(after)
            ));
        }
        let is_after = |of: (usize, usize)| self.spans[of.1].first.1 > self.spans[of.0].latest.1;
        pairs().all(is_after).then(|| {
            format!(
                "time_s begins anew at {} s with station {}, after {} s of station {}: either both were read at once, or the clock was set \
                 anew. In that case what goes with the time since the campaign began, such as a warming up, is sought as if both had begun at \
                 once, and one clock for all stations tells more",
                self.spans[after].first.0,
                rows(after),
                self.spans[before].latest.0,
                rows(before)
            )
        })
    }

    /// Whether no two stations have times in common, so that all were read by one clock.
    fn have_one_clock(&self) -> bool {
        let mut spans: Vec<(f64, f64)> = self.spans.iter().map(|span| (span.first.0, span.latest.0)).collect();
        spans.sort_by(|a, b| a.0.total_cmp(&b.0));
        spans.windows(2).all(|pair| pair[0].1 < pair[1].0)
    }

    fn check_line(
        &mut self,
        header: &Header,
        station: u32,
        line: u32,
        offset_m: [f64; 3],
        row: u64,
    ) -> Result<(), FileError> {
        let Some(seen) = self.seen.get(line as usize) else {
            self.seen.push(LineSeen { station, offset_m, row });
            return Ok(());
        };
        let name = &self.campaign.lines[line as usize];
        if seen.station != station {
            let [owner, other] = [seen.station, station].map(|k| &self.campaign.stations[k as usize]);
            let problem = format!("line {name} belongs to station {owner} since line {}, not to {other}", seen.row);
            let remedy = format!("give each station's lines names of their own, such as {other}-{name}");
            let column = self.columns.line.unwrap_or(self.columns.station);
            return Err(FileError::content(header.cell(row, column), problem, remedy));
        }
        match (0..3).find(|k| seen.offset_m[*k] != offset_m[*k]) {
            None => Ok(()),
            Some(k) => Err(self.offset_changed(header, seen, k, offset_m[k], row)),
        }
    }

    fn offset_changed(&self, header: &Header, seen: &LineSeen, k: usize, now_m: f64, row: u64) -> FileError {
        let before_m = seen.offset_m[k];
        let how = if before_m == -now_m { "changes its sign" } else { "changes" };
        let run = match self.columns.line {
            Some(_) => format!("line {}", self.campaign.lines[self.seen_index(seen)]),
            None => format!("station {}, which counts as one line", self.campaign.stations[seen.station as usize]),
        };
        let problem = format!(
            "the offset {how} within {run}: {} mm since line {}, here {} mm",
            before_m * 1e3,
            seen.row,
            now_m * 1e3
        );
        let remedy = "correct it, or name the readings with another offset as a line of their own in the column line";
        FileError::content(Place::file(header.file()).line(row).column(OFFSET[k].name), problem, remedy)
    }

    fn seen_index(&self, seen: &LineSeen) -> usize {
        self.seen.iter().position(|other| other.row == seen.row).unwrap_or_default()
    }
}

/// Indices of names in the order of their first row; the name of the row before is the usual hit.
#[derive(Default)]
struct Names {
    indices: HashMap<Vec<u8>, u32>,
    last: Option<(Vec<u8>, u32)>,
}

impl Names {
    fn index(
        &mut self,
        header: &Header,
        record: &ByteRecord,
        column: usize,
        row: u64,
        names: &mut Vec<String>,
    ) -> Result<u32, FileError> {
        let cell = record.get(column).unwrap_or_default().trim_ascii();
        if let Some((name, index)) = &self.last
            && name == cell
        {
            return Ok(*index);
        }
        let index = match self.indices.get(cell) {
            Some(index) => *index,
            None => {
                let text = std::str::from_utf8(cell).ok().filter(|text| !text.is_empty()).ok_or_else(|| {
                    let problem = "the name is empty or not UTF-8";
                    FileError::content(header.cell(row, column), problem, "write a name in every row")
                })?;
                let index = names.len() as u32;
                names.push(text.to_owned());
                self.indices.insert(cell.to_vec(), index);
                index
            }
        };
        self.last = Some((cell.to_vec(), index));
        Ok(index)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test

    use super::*;

    /// What is said of the times of readings of these stations.
    fn words(readings: &[(&str, f64)]) -> Option<String> {
        let row = |(station, time_s): &(&str, f64)| format!("{station},{time_s},1,2,3,0,0,0,4\n");
        let names: Vec<&str> = KNOWN.iter().map(|known| known.name).filter(|name| *name != LINE.name).collect();
        let text = names.join(",") + "\n" + &readings.iter().map(row).collect::<String>();
        let mut source = CsvSource::new(text.as_bytes(), "c.csv").unwrap();
        let columns = Columns::new(source.header(), None).unwrap();
        let (mut builder, mut record) = (Builder::new(source.header(), columns), ByteRecord::new());
        while let Some(line) = source.next(&mut record).unwrap() {
            builder.add(source.header(), &record, line).unwrap();
        }
        builder.clock_words()
    }

    #[test]
    fn stations_in_another_order_than_their_times_are_told_with_their_rows() {
        let told = words(&[("S1", 0.0), ("S1", 9.0), ("S3", 30.0), ("S3", 39.0), ("S2", 10.0), ("S2", 19.0)]).unwrap();
        for part in ["backwards from station S3 (lines 4 to 5) to station S2 (lines 6 to 7)", "exchanged"] {
            assert!(told.contains(part), "{told}");
        }
    }

    #[test]
    fn a_clock_that_begins_anew_is_told_and_one_that_goes_on_or_serves_two_at_once_is_not() {
        let told = words(&[("S1", 0.0), ("S1", 9.0), ("S2", 0.5), ("S2", 19.0)]).unwrap();
        assert!(
            told.contains("begins anew at 0.5 s with station S2 (lines 4 to 5), after 9 s of station S1"),
            "{told}"
        );
        assert_eq!(words(&[("S1", 0.0), ("S1", 9.0), ("S2", 10.0), ("S2", 19.0)]), None);
        assert_eq!(words(&[("S1", 0.0), ("S2", 0.5), ("S1", 9.0), ("S2", 19.0)]), None);
        assert_eq!(words(&[("S1", 0.0), ("S1", 9.0)]), None);
    }
}
