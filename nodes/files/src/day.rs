//! Days of a measurement: as text (ISO 8601), from stamps, and from the comment `# measured=` above a table's column names.
//!
//! Place in the flow: data → here → [`crate::Identity`] of a report. Days are UTC; a stamp that counts from the start of a device
//! or of a simulation is no day, so stamps from before 2000 give none.

use crate::csv_bytes::TableBytes;
use crate::error::{FileError, Place};
use crate::instants::date;
use chrono::{DateTime, Datelike, NaiveDate};
use std::fmt;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// A clock that tells an earlier year does not know the day.
const FIRST_YEAR: i32 = 2000;
/// What a comment above the column names begins with.
const COMMENT: &str = "measured=";
/// Comments stand within this much of a table (bytes).
const HEAD_BYTES: u64 = 1 << 16;
const REMEDY: &str = "write 2026-03-05, or 2026-03-05/2026-03-07 for first and last";

/// A day of the calendar.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Day(NaiveDate);

impl Day {
    /// The day of a stamp in nanoseconds since 1970-01-01, UTC; `None` for a clock that does not know the day.
    pub fn of_stamp_ns(stamp_ns: i64) -> Option<Day> {
        let day = DateTime::from_timestamp_nanos(stamp_ns).date_naive();
        (day.year() >= FIRST_YEAR).then_some(Day(day))
    }
}

impl fmt::Display for Day {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// First and last day of a measurement; often the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Days {
    /// The first day.
    pub first: Day,
    /// The last day.
    pub last: Day,
}

impl Days {
    /// `2026-03-05`, or `2026-03-05/2026-03-07`.
    pub fn parse(text: &str) -> Option<Days> {
        let (first, last) = text.split_once('/').unwrap_or((text, text));
        let days = Days { first: Day(date(first)?), last: Day(date(last)?) };
        (days.first <= days.last).then_some(days)
    }

    /// The days of stamps; `None` where there is none, or one of a clock that does not know the day.
    pub fn of_stamps_ns(stamps_ns: impl Iterator<Item = i64> + Clone) -> Option<Days> {
        let (first, last) = (stamps_ns.clone().min()?, stamps_ns.max()?);
        Some(Days { first: Day::of_stamp_ns(first)?, last: Day::of_stamp_ns(last)? })
    }

    /// What a table says above its column names: `# measured=2026-03-05`. `None` where it says nothing.
    ///
    /// # Errors
    /// A file that cannot be read, and a day that is none, with its line.
    pub fn of_table(path: &Path) -> Result<Option<Days>, FileError> {
        let file = path.display().to_string();
        let input = File::open(path).map_err(FileError::io(&file, "open the file"))?;
        let head = BufReader::new(TableBytes::new(input, &file)?.take(HEAD_BYTES));
        for (number, line) in (1..).zip(head.split(b'\n')) {
            let line = line.map_err(FileError::io(&file, "read the file"))?;
            let line = String::from_utf8_lossy(&line);
            // Excel fills comments up with delimiters when it saves.
            let line = line.trim().trim_end_matches([',', ';', '\t']);
            let Some(comment) = line.strip_prefix('#') else {
                if line.is_empty() || line.starts_with("sep=") {
                    continue;
                }
                break;
            };
            if let Some(text) = comment.trim().strip_prefix(COMMENT) {
                let place = || Place::file(&file).line(number);
                let wrong = || FileError::content(place(), format!("{text:?} is no day"), REMEDY);
                return Days::parse(text.trim()).map(Some).ok_or_else(wrong);
            }
        }
        Ok(None)
    }
}

impl fmt::Display for Days {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.first == self.last {
            true => self.first.fmt(f),
            false => write!(f, "{}/{}", self.first, self.last),
        }
    }
}

impl std::str::FromStr for Days {
    type Err = String;

    fn from_str(text: &str) -> Result<Days, String> {
        Days::parse(text).ok_or_else(|| format!("no such day; {REMEDY}"))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test

    use super::*;

    #[test]
    fn stamps_become_days_of_the_calendar() {
        // Unix seconds of known days: 2000-02-29, 2026-03-01 and the last second of 2024.
        for (second, day) in [(951_782_400, "2000-02-29"), (1_772_323_200, "2026-03-01"), (1_735_689_599, "2024-12-31")]
        {
            assert_eq!(Day::of_stamp_ns(second * 1_000_000_000).unwrap().to_string(), day);
        }
        assert_eq!(Day::of_stamp_ns(12_000_000_000), None, "a clock that began at zero knows no day");
        let far = [1_772_323_200_000_000_000, 1_772_409_700_000_000_000];
        assert_eq!(Days::of_stamps_ns(far.into_iter()).unwrap().to_string(), "2026-03-01/2026-03-02");
    }

    #[test]
    fn what_is_no_day_is_refused() {
        for text in ["2026-02-29", "2026-13-01", "26-01-01", "2026-01-01T10", "2026-01-02/2026-01-01", "", "2026-1-1"] {
            assert_eq!(Days::parse(text), None, "{text}");
        }
        assert_eq!(Days::parse("2024-02-29/2024-03-01").unwrap().to_string(), "2024-02-29/2024-03-01");
    }

    #[test]
    fn a_table_may_say_its_day_above_the_column_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        let of = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Days::of_table(&path).map(|days| days.map(|days| days.to_string())).map_err(|error| error.to_string())
        };
        assert_eq!(of("sep=;\n# any\n# measured=2026-03-05\nx_mm;y_mm\n1;2\n"), Ok(Some("2026-03-05".to_owned())));
        assert_eq!(of("x_mm,y_mm\n# measured=2026-03-05\n1,2\n"), Ok(None), "below the names it is a row's comment");
        assert_eq!(
            of("# measured=2026-03-05;;;\nx_mm;y_mm\n1;2\n"),
            Ok(Some("2026-03-05".to_owned())),
            "as Excel saves it"
        );
        let error = of("# measured=5 March\nx_mm\n1\n").unwrap_err();
        assert!(error.contains("line 1") && error.contains("5 March"), "{error}");
    }
}
