//! Days of a measurement: as text (ISO 8601), from stamps, and from the comment `# measured=` above a table's column names.
//!
//! Place in the flow: data → here → [`crate::Identity`] of a report. Days are UTC; a stamp that counts from the start of a device
//! or of a simulation is no day, so stamps from before 2000 give none.

use crate::csv_bytes::TableBytes;
use crate::error::{FileError, Place};
use std::fmt;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

const SECONDS_OF_A_DAY: i64 = 86_400;
/// Days from 1970-01-01 to 2000-01-01.
const YEAR_2000: i64 = 10_957;
/// What a comment above the column names begins with.
const COMMENT: &str = "measured=";
/// Comments stand within this much of a table (bytes).
const HEAD_BYTES: u64 = 1 << 16;
const REMEDY: &str = "write 2026-03-05, or 2026-03-05/2026-03-07 for first and last";

/// A day of the calendar.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Day {
    year: i64,
    month: i64,
    day: i64,
}

impl Day {
    /// The day of a stamp in nanoseconds since 1970-01-01, UTC; `None` for a clock that does not know the day.
    pub fn of_stamp_ns(stamp_ns: i64) -> Option<Day> {
        let days = stamp_ns.div_euclid(1_000_000_000 * SECONDS_OF_A_DAY);
        (days >= YEAR_2000).then(|| Day::of_days(days))
    }

    /// Days since 1970-01-01 to the calendar: years begin in March, so that the leap day is the last of its year.
    fn of_days(days: i64) -> Day {
        let from_0000_03_01 = days + 719_468;
        let era = from_0000_03_01.div_euclid(146_097);
        let of_era = from_0000_03_01.rem_euclid(146_097);
        let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
        let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
        let from_march = (5 * of_year + 2) / 153;
        let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
        let year = year_of_era + era * 400 + i64::from(month <= 2);
        Day { year, month, day: of_year - (153 * from_march + 2) / 5 + 1 }
    }

    fn parse(text: &str) -> Option<Day> {
        let fields: Vec<&str> = text.split('-').collect();
        let [year, month, day] = fields.as_slice() else { return None };
        let number = |text: &str, digits: usize| {
            (text.len() == digits && text.bytes().all(|b| b.is_ascii_digit())).then(|| text.parse().ok()).flatten()
        };
        let (year, month, day): (i64, i64, i64) = (number(year, 4)?, number(month, 2)?, number(day, 2)?);
        let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
        let longest = match month {
            4 | 6 | 9 | 11 => 30,
            2 => 28 + i64::from(leap),
            _ => 31,
        };
        ((1..=12).contains(&month) && (1..=longest).contains(&day)).then_some(Day { year, month, day })
    }
}

impl fmt::Display for Day {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04}-{:02}-{:02}", self.year, self.month, self.day)
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
        let days = Days { first: Day::parse(first)?, last: Day::parse(last)? };
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
            let line = line.trim();
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
        let error = of("# measured=5 March\nx_mm\n1\n").unwrap_err();
        assert!(error.contains("line 1") && error.contains("5 March"), "{error}");
    }
}
