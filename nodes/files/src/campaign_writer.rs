//! Tracer campaigns to CSV, in the columns that the reader wants.
//!
//! Place in the flow: [`Campaign`] in SI → here → file in mm (0.1 nm) and s (1 ns) → `abbe identify`, `abbe diagnose`.
//! A covariate is a column of its name; an empty cell says that nothing was logged.

use crate::atomic::AtomicFile;
use crate::campaign_csv::KNOWN;
use crate::dialect::Dialect;
use crate::error::{FileError, Place};
use crate::points_csv::unwritten;
use abbe_measurement::campaign::Campaign;
use csv::Writer;
use std::io::Write;
use std::path::Path;

/// Writes a campaign file, whole or not at all.
pub fn write_campaign(path: &Path, campaign: &Campaign) -> Result<(), FileError> {
    let file = path.display().to_string();
    let mut output = AtomicFile::create(path)?;
    write_rows(&mut output, &file, campaign)?;
    output.commit()
}

fn write_rows(output: impl Write, file: &str, campaign: &Campaign) -> Result<(), FileError> {
    let mut writer = Dialect::default().writer(output);
    let header = KNOWN.iter().map(|known| known.name);
    if let Some(taken) = campaign.covariates.iter().find(|c| KNOWN.iter().any(|known| known.name == c.name)) {
        let problem = "a covariate has the name of a column of its own meaning";
        return Err(FileError::content(Place::file(file).column(&taken.name), problem, "rename the covariate"));
    }
    let names = campaign.covariates.iter().map(|covariate| covariate.name.as_str());
    writer.write_record(header.chain(names)).map_err(|error| unwritten(file, error))?;
    for row in 0..campaign.readings.len() {
        write_row(&mut writer, campaign, row).map_err(|error| unwritten(file, error))?;
    }
    writer.flush().map_err(FileError::io(file, "write"))
}

fn write_row(writer: &mut Writer<impl Write>, campaign: &Campaign, row: usize) -> csv::Result<()> {
    let reading = &campaign.readings[row];
    writer.write_field(&campaign.stations[reading.station as usize])?;
    writer.write_field(&campaign.lines[reading.line as usize])?;
    writer.write_field(format!("{:.9}", reading.time_s))?;
    for metres in reading.reading_m.iter().chain(&reading.offset_m).chain([&reading.length_m]) {
        writer.write_field(format!("{:.7}", metres * 1e3))?;
    }
    for covariate in &campaign.covariates {
        writer.write_field(covariate.values[row].map_or(String::new(), |value| value.to_string()))?;
    }
    writer.write_record(None::<&[u8]>)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read_campaign;
    use abbe_measurement::campaign::{Covariate, RangeReading};

    fn campaign() -> Campaign {
        let reading = |station, line, time_s, x_m: f64| RangeReading {
            station,
            line,
            time_s,
            reading_m: [x_m, -0.25, 0.125],
            offset_m: [0.0, 0.0, -0.1 * f64::from(line)],
            length_m: 1.5 - x_m,
        };
        Campaign {
            // One that reads like a comment, too.
            stations: vec!["S1, by the door".to_owned(), "#2".to_owned()],
            lines: vec!["a".to_owned(), "b \"twice\"".to_owned(), "c".to_owned()],
            readings: vec![reading(0, 0, 0.0, 0.1), reading(0, 1, 0.001, 0.2), reading(1, 2, 3.5, 0.3)],
            covariates: vec![Covariate {
                name: "temp_scale_x_c".to_owned(),
                values: vec![Some(20.125), None, Some(-3.0)],
            }],
        }
    }

    #[test]
    fn what_is_written_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("campaign.csv");
        write_campaign(&path, &campaign()).unwrap();
        assert_eq!(crate::read_campaign_file(&path, None).unwrap().campaign, campaign());
    }

    #[test]
    fn the_shortest_steps_that_are_recorded_survive() {
        let mut fine = campaign();
        fine.readings[1].time_s = 1e-9;
        fine.readings[1].length_m += 2e-10;
        let mut bytes = Vec::new();
        write_rows(&mut bytes, "fine.csv", &fine).unwrap();
        let read = read_campaign(bytes.as_slice(), "fine.csv", None).unwrap().campaign;
        assert_eq!(read.readings[1].time_s, 1e-9);
        assert!((read.readings[1].length_m - fine.readings[1].length_m).abs() < 0.5e-10);
    }

    #[test]
    fn a_covariate_cannot_pass_for_a_column() {
        let mut wrong = campaign();
        wrong.covariates[0].name = "time_s".to_owned();
        let error = write_rows(Vec::new(), "campaign.csv", &wrong).unwrap_err().to_string();
        assert!(error.contains("time_s") && error.contains("rename"), "{error}");
    }
}
