//! Instants that stand in the column `time_s` as date and time of day (ISO 8601), as seconds since the first of a file.
//!
//! Place in the flow: the numbers of a table ([`crate::columns::Header::number`]) come by here where the column is that of the time, so that
//! all tables are read alike. Time zones are taken into account where they are written; without one, the clock of the wall counts on evenly.

use chrono::{NaiveDate, NaiveDateTime, NaiveTime, TimeDelta};

/// An instant of the calendar.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Instant {
    /// In UTC where the zone is known.
    at: NaiveDateTime,
    has_zone: bool,
}

impl Instant {
    /// `2021-06-13T05:00:02`, also with a blank for the T, a fraction of the second, without seconds, and with `Z` or `+02:00` behind it;
    /// `None` for anything else.
    pub(crate) fn read(cell: &[u8]) -> Option<Instant> {
        let text = std::str::from_utf8(cell.trim_ascii()).ok()?;
        let (day, time) = (text.get(..10)?, text.get(10..)?);
        let (time, ahead) = zone(time.strip_prefix(['T', 't', ' '])?)?;
        let at = date(day)?.and_time(time_of_day(time)?);
        Some(Instant { at: at.checked_sub_signed(ahead.unwrap_or_default())?, has_zone: ahead.is_some() })
    }

    /// Seconds from another instant to this one; `None` where one of them names its zone and the other does not.
    pub(crate) fn since(self, other: Instant) -> Option<f64> {
        let apart = self.at.signed_duration_since(other.at);
        (self.has_zone == other.has_zone).then(|| apart.num_seconds() as f64 + f64::from(apart.subsec_nanos()) / 1e9)
    }
}

/// What the column of the time holds, as far as its cells have shown, and the line that showed it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Clock {
    Unknown,
    Seconds(u64),
    Since(Instant, u64),
}

fn digits(text: &str, count: usize) -> Option<u32> {
    (text.len() == count && text.bytes().all(|byte| byte.is_ascii_digit())).then(|| text.parse().ok()).flatten()
}

/// A day of the calendar, all figures written: `2021-06-13`.
pub(crate) fn date(text: &str) -> Option<NaiveDate> {
    let mut fields = text.split('-');
    let (year, month, day) = (digits(fields.next()?, 4)?, digits(fields.next()?, 2)?, digits(fields.next()?, 2)?);
    if fields.next().is_some() {
        return None;
    }
    NaiveDate::from_ymd_opt(year as i32, month, day)
}

fn time_of_day(text: &str) -> Option<NaiveTime> {
    let mut fields = text.split(':');
    let (hour, minute) = (digits(fields.next()?, 2)?, digits(fields.next()?, 2)?);
    let (second, nanosecond) = match fields.next() {
        None => (0, 0),
        Some(text) => match text.split_once(['.', ',']) {
            None => (digits(text, 2)?, 0),
            // What is finer than a nanosecond is no more than a figure.
            Some((whole, part)) => {
                let is_figure = !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
                is_figure.then_some(())?;
                (digits(whole, 2)?, digits(format!("{part:0<9}").get(..9)?, 9)?)
            }
        },
    };
    if fields.next().is_some() {
        return None;
    }
    NaiveTime::from_hms_nano_opt(hour, minute, second, nanosecond)
}

/// A time of day without its zone, and how far that is ahead of UTC, where it is named.
fn zone(time: &str) -> Option<(&str, Option<TimeDelta>)> {
    if let Some(time) = time.strip_suffix(['Z', 'z']) {
        return Some((time.trim_end(), Some(TimeDelta::zero())));
    }
    let Some(at) = time.rfind(['+', '-']) else { return Some((time, None)) };
    let sign = if time.as_bytes().get(at) == Some(&b'-') { -1 } else { 1 };
    let (hours, minutes) = time.get(at + 1..)?.split_at_checked(2)?;
    let minutes = if minutes.is_empty() { "00" } else { minutes.strip_prefix(':').unwrap_or(minutes) };
    let (hours, minutes) = (digits(hours, 2)?, digits(minutes, 2)?);
    let ahead = TimeDelta::minutes(sign * i64::from(60 * hours + minutes));
    (hours < 24 && minutes < 60).then_some((time.get(..at)?.trim_end(), Some(ahead)))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test

    use super::*;
    use proptest::prelude::*;

    fn since(text: &str, from: &str) -> Option<f64> {
        Instant::read(text.as_bytes()).unwrap().since(Instant::read(from.as_bytes()).unwrap())
    }

    #[test]
    fn instants_are_apart_by_the_seconds_between_them() {
        let from = "2021-06-13T05:00:02";
        assert_eq!(since("2021-06-13T05:00:02", from), Some(0.0));
        assert_eq!(since("2021-06-13 05:01:02.25", from), Some(60.25));
        assert_eq!(since("2021-06-13T05:00:01,5", from), Some(-0.5));
        assert_eq!(since("2021-06-14T05:00", from), Some(86_398.0));
        assert_eq!(since("2021-06-13 05:01:02.2500000000000000000001", from), Some(60.25));
        // 2020 has a leap day, 2100 has none.
        assert_eq!(since("2020-03-01T00:00:00", "2020-02-28T00:00:00"), Some(2.0 * 86_400.0));
        assert_eq!(since("2100-03-01T00:00:00", "2100-02-28T00:00:00"), Some(86_400.0));
        assert_eq!(since("2000-01-01T00:00:00Z", "1970-01-01T00:00:00Z"), Some(946_684_800.0));
    }

    #[test]
    fn zones_count_where_they_are_named_and_not_half() {
        let noon = "2021-06-13T12:00:00Z";
        for same in
            ["2021-06-13T14:00:00+02:00", "2021-06-13T14:00:00+0200", "2021-06-13T09:00:00 -03", "2021-06-13 12:00z"]
        {
            assert_eq!(since(same, noon), Some(0.0), "{same}");
        }
        assert_eq!(since("2021-06-13T12:00:00", noon), None);
    }

    #[test]
    fn what_is_no_instant_is_none() {
        for text in [
            "",
            "12",
            "2021-06-13",
            "13.06.2021 05:00:02",
            "2021-02-29T00:00:00",
            "2021-13-01T00:00:00",
            "2021-06-13T24:00:00",
            "2021-06-13T05:60:00",
            "2021-06-13T05:00:60",
            "2021-06-13T05:00:0x",
            "2021-06-13T5:00:00",
            "2021-06-13T05:00:00+2",
            "2021-06-13T05:00:00+99:99",
            "2021-06-13T05:00:00+2:000",
            "2021-06-13T05:00:00-0:200",
            "2021-06-13T05:00:00+02:",
            "2021-06-13T05:00:00.",
            "2021-06-13T05",
            "2021-06-13X05:00:00",
            "2021-06-13T05:00:00:00",
            "ä021-06-13T05:00:00",
        ] {
            assert_eq!(Instant::read(text.as_bytes()), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_an_instant_or_none(cell: Vec<u8>) {
            let _ = Instant::read(&cell);
        }

        #[test]
        fn any_text_of_its_letters_is_an_instant_or_none(text in "[0-9T:+ .,Z-]{0,40}") {
            let _ = Instant::read(text.as_bytes());
        }
    }
}
