//! Stations of which the beginning or the end was rejected: all lines up to one, or from one on.
//!
//! Place in the flow: at the end of [`crate::diagnose()`], of the weights of its fit. A stand that somebody bumped, or a zero that was lost, by
//! many times the noise leaves lines that no model of the rest explains; the robust fit gives them no weight, so that the search never
//! sees them. One line is an outlying run. Several, up to the end, say what happened.

use abbe_measurement::campaign::Campaign;

/// Lines from which on they say something.
const FEWEST: usize = 2;

/// Lines of a station on one side of an instant, all of them rejected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct CutOff {
    station: String,
    /// First and last of the lines rejected.
    lines: (String, String),
    /// How many they are, of all of that station.
    count: (usize, usize),
    is_end: bool,
}

impl CutOff {
    /// Of a campaign whose rejected lines are known.
    pub(crate) fn all(campaign: &Campaign, rejected: &[String]) -> Vec<CutOff> {
        (0..campaign.stations.len()).filter_map(|station| CutOff::of(campaign, rejected, station)).collect()
    }

    fn of(campaign: &Campaign, rejected: &[String], station: usize) -> Option<CutOff> {
        let mut lines: Vec<u32> = Vec::new();
        for reading in campaign.readings.iter().filter(|reading| reading.station as usize == station) {
            if !lines.contains(&reading.line) {
                lines.push(reading.line);
            }
        }
        let name = |line: &u32| &campaign.lines[*line as usize];
        let is_off: Vec<bool> = lines.iter().map(|line| rejected.contains(name(line))).collect();
        let count = is_off.iter().filter(|is_off| **is_off).count();
        let is_end = is_off.iter().rev().take(count).all(|is_off| *is_off);
        let is_beginning = is_off.iter().take(count).all(|is_off| *is_off);
        if count < FEWEST || count == lines.len() || !(is_end || is_beginning) {
            return None;
        }
        let own = if is_end { &lines[lines.len() - count..] } else { &lines[..count] };
        Some(CutOff {
            station: campaign.stations[station].clone(),
            lines: (name(own.first()?).clone(), name(own.last()?).clone()),
            count: (count, lines.len()),
            is_end,
        })
    }

    /// What happened, and what to do, for readers.
    pub(crate) fn words(&self) -> String {
        let (first, last) = &self.lines;
        format!(
            "The {} {} of {} lines of station {} ({first} to {last}) were rejected as a whole: its stand was moved, its zero was lost, or the zero of \
             an axis changed. Give these lines a station name of their own, and identify again: then they count.",
            if self.is_end { "last" } else { "first" },
            self.count.0,
            self.count.1,
            self.station,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_measurement::campaign::RangeReading;

    fn said(rejected: &[&str]) -> Vec<String> {
        let reading = |k: u32| RangeReading {
            station: k / 12,
            line: k / 3,
            time_s: f64::from(k),
            reading_m: [0.0; 3],
            offset_m: [0.0; 3],
            length_m: 1.0,
        };
        let campaign = Campaign {
            stations: vec!["S1".to_owned(), "S2".to_owned()],
            lines: (0..8).map(|k| format!("L{k}")).collect(),
            readings: (0..24).map(reading).collect(),
            ..Campaign::default()
        };
        let rejected: Vec<String> = rejected.iter().map(|line| (*line).to_owned()).collect();
        CutOff::all(&campaign, &rejected).iter().map(CutOff::words).collect()
    }

    #[test]
    fn several_lines_up_to_the_end_say_that_something_moved_and_others_do_not() {
        let words = said(&["L2", "L3"]);
        assert!(words.len() == 1 && words[0].contains("last 2 of 4 lines of station S1 (L2 to L3)"), "{words:?}");
        let words = said(&["L4", "L5", "L6"]);
        assert!(words.len() == 1 && words[0].contains("first 3 of 4 lines of station S2 (L4 to L6)"), "{words:?}");
        assert_eq!(said(&["L3"]), Vec::<String>::new(), "one line is an outlying run");
        assert_eq!(said(&["L1", "L2"]), Vec::<String>::new(), "neither up to the end nor from the beginning");
        assert_eq!(
            said(&["L0", "L1", "L2", "L3"]),
            Vec::<String>::new(),
            "nothing of that station is left to hold them against"
        );
    }
}
