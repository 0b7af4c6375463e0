//! Instants that stand in the column `time_s` as date and time of day (ISO 8601), as seconds since the first of a file.
//!
//! Place in the flow: the numbers of a table ([`crate::columns::Header::number`]) come by here where the column is that of the time, so that
//! all tables are read alike. Time zones are taken into account where they are written; without one, the clock of the wall counts on evenly.

const SECONDS_OF_A_DAY: i64 = 86_400;

/// An instant of the calendar.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Instant {
    /// Since 1970-01-01, in UTC where the zone is known.
    seconds: i64,
    nanoseconds: i64,
    has_zone: bool,
}

impl Instant {
    /// `2021-06-13T05:00:02`, also with a blank for the T, a fraction of the second, without seconds, and with `Z` or `+02:00` behind it;
    /// `None` for anything else.
    pub(crate) fn read(cell: &[u8]) -> Option<Instant> {
        let text = std::str::from_utf8(cell.trim_ascii()).ok()?;
        let (date, time) = (text.get(..10)?, text.get(10..)?);
        let time = time.strip_prefix(['T', 't', ' '])?;
        let (time, zone_s) = zone(time)?;
        let (seconds, nanoseconds) = time_of_day(time)?;
        let seconds = days(date)? * SECONDS_OF_A_DAY + seconds - zone_s.unwrap_or(0);
        Some(Instant { seconds, nanoseconds, has_zone: zone_s.is_some() })
    }

    /// Seconds from another instant to this one; `None` where one of them names its zone and the other does not.
    pub(crate) fn since(self, other: Instant) -> Option<f64> {
        let whole = (self.seconds - other.seconds) as f64;
        (self.has_zone == other.has_zone).then(|| whole + (self.nanoseconds - other.nanoseconds) as f64 / 1e9)
    }
}

/// What the column of the time holds, as far as its cells have shown, and the line that showed it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Clock {
    Unknown,
    Seconds(u64),
    Since(Instant, u64),
}

fn digits(text: &str, count: usize) -> Option<i64> {
    (text.len() == count && text.bytes().all(|byte| byte.is_ascii_digit())).then(|| text.parse().ok()).flatten()
}

/// Days since 1970-01-01 of a date; years begin in March, so that the leap day is the last of its year.
fn days(date: &str) -> Option<i64> {
    let mut fields = date.split('-');
    let (year, month, day) = (digits(fields.next()?, 4)?, digits(fields.next()?, 2)?, digits(fields.next()?, 2)?);
    let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let longest = match month {
        4 | 6 | 9 | 11 => 30,
        2 => 28 + i64::from(is_leap),
        1..=12 => 31,
        _ => return None,
    };
    if fields.next().is_some() || !(1..=longest).contains(&day) {
        return None;
    }
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    Some(
        365 * year + year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400) + (153 * month + 2) / 5 + day
            - 719_469,
    )
}

/// Seconds and nanoseconds of a time of day.
fn time_of_day(time: &str) -> Option<(i64, i64)> {
    let mut fields = time.split(':');
    let (hour, minute) = (digits(fields.next()?, 2)?, digits(fields.next()?, 2)?);
    let (second, nanoseconds) = match fields.next() {
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
    let is_time = hour < 24 && minute < 60 && second < 60 && fields.next().is_none();
    is_time.then_some((3600 * hour + 60 * minute + second, nanoseconds))
}

/// A time of day without its zone, and how far that is ahead of UTC (s), where it is named.
fn zone(time: &str) -> Option<(&str, Option<i64>)> {
    if let Some(time) = time.strip_suffix(['Z', 'z']) {
        return Some((time.trim_end(), Some(0)));
    }
    let Some(at) = time.rfind(['+', '-']) else { return Some((time, None)) };
    let sign = if time.as_bytes().get(at) == Some(&b'-') { -1 } else { 1 };
    let (hours, minutes) = time.get(at + 1..)?.split_at_checked(2)?;
    let minutes = if minutes.is_empty() { "00" } else { minutes.strip_prefix(':').unwrap_or(minutes) };
    let (hours, minutes) = (digits(hours, 2)?, digits(minutes, 2)?);
    (hours < 24 && minutes < 60).then_some(())?;
    Some((time.get(..at)?.trim_end(), Some(sign * (3600 * hours + 60 * minutes))))
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
