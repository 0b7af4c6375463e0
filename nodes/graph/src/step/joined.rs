//! Covariates of other boxes joined to scale readings, each with its age at the instant of latching.
//!
//! Place in the flow: in the scale node, before a reading is published. Sensors say their values in their own rhythm; a reading
//! gets the newest one from not after its stamp, however late the reading itself comes. Values in the unit of their name,
//! ages in s. What the reading's own driver says stays; a value from two sources is counted. Pure: no clock is read.

use super::geometric::CLOCK_TOLERANCE_S;
use abbe_msgs::{CovariateError, ScaleReading, Stamp};
use std::collections::{BTreeMap, VecDeque};

/// Values of one name that are kept: readings come at most so many sensor values late.
const KEPT: usize = 256;

/// What the sensors have said lately.
#[derive(Debug, Clone, Default)]
pub struct SensorMemory {
    values: BTreeMap<String, VecDeque<(Stamp, f64)>>,
}

impl SensorMemory {
    /// Takes what a sensor says of an instant.
    pub fn note(&mut self, stamp: Stamp, values: &[(String, f64)]) {
        for (name, value) in values {
            let kept = match self.values.get_mut(name) {
                Some(kept) => kept,
                None => self.values.entry(name.clone()).or_default(),
            };
            // A clock that was set back begins anew.
            if kept.back().is_some_and(|(last, _)| stamp < *last) {
                kept.clear();
            }
            if kept.len() == KEPT {
                kept.pop_front();
            }
            kept.push_back((stamp, *value));
        }
    }

    /// Takes that a sensor has no value under this name: what it said before holds no longer.
    pub fn forget(&mut self, name: &str) {
        if let Some(kept) = self.values.get_mut(name) {
            kept.clear();
        }
    }

    /// Adds to a reading what the sensors said by its instant; gives what could not be added, and why.
    pub fn join(&self, reading: &mut ScaleReading) -> Vec<CovariateError> {
        let at_ns = reading.stamp.to_nanos();
        let age_s = |stamp: Stamp| (at_ns - stamp.to_nanos()) as f64 * 1e-9;
        let mut refused = Vec::new();
        for (name, kept) in &self.values {
            let newest = kept.iter().rev().find(|(stamp, _)| age_s(*stamp) >= -CLOCK_TOLERANCE_S);
            // All of them are from after the reading: the first tells by its age that it cannot be used.
            let Some((stamp, value)) = newest.or(kept.front()) else { continue };
            refused.extend(reading.covariates.push(name, *value, age_s(*stamp)).err());
        }
        refused
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: i64) -> Stamp {
        Stamp::from_nanos(1_700_000_000_000_000_000 + ms * 1_000_000).unwrap()
    }

    fn joined(memory: &SensorMemory, ms: i64) -> Option<(f64, f64)> {
        let mut reading = ScaleReading { stamp: at(ms), ..ScaleReading::default() };
        assert_eq!(memory.join(&mut reading), []);
        reading.covariates.get("temp_air_c").map(|entry| (entry.value, (entry.age_s * 1e3).round()))
    }

    #[test]
    fn a_reading_gets_the_newest_value_from_not_after_it() {
        let mut memory = SensorMemory::default();
        assert_eq!(joined(&memory, 0), None, "what no sensor has said is missing");
        for (ms, value) in [(0, 20.0), (1000, 20.1), (2000, 20.2)] {
            memory.note(at(ms), &[("temp_air_c".to_owned(), value)]);
        }
        assert_eq!(joined(&memory, 1500), Some((20.1, 500.0)), "a reading that comes late is not given a later value");
        assert_eq!(joined(&memory, 2000), Some((20.2, 0.0)));
        assert_eq!(joined(&memory, 60_000), Some((20.2, 58_000.0)), "a sensor that says no more grows old");
        assert_eq!(joined(&memory, -5000), Some((20.0, -5000.0)), "an age below zero says that the clocks disagree");
    }

    #[test]
    fn regress_a_sensor_without_a_value_is_missing_until_it_has_one() {
        let mut memory = SensorMemory::default();
        memory.forget("temp_air_c");
        memory.note(at(0), &[("temp_air_c".to_owned(), 20.0), ("load_kg".to_owned(), 7.0)]);
        memory.forget("temp_air_c");
        let mut reading = ScaleReading { stamp: at(100), ..ScaleReading::default() };
        assert_eq!(memory.join(&mut reading), []);
        assert_eq!(reading.covariates.iter().map(|entry| entry.value).collect::<Vec<_>>(), [7.0]);
        memory.note(at(200), &[("temp_air_c".to_owned(), 21.0)]);
        let mut reading = ScaleReading { stamp: at(300), ..ScaleReading::default() };
        assert_eq!(memory.join(&mut reading), []);
        assert_eq!(reading.covariates.get("temp_air_c").map(|entry| entry.value), Some(21.0));
    }

    #[test]
    fn what_the_reading_has_already_stays_and_is_told() {
        let mut memory = SensorMemory::default();
        memory.note(at(0), &[("temp_air_c".to_owned(), 20.0)]);
        let mut reading = ScaleReading { stamp: at(1), ..ScaleReading::default() };
        reading.covariates.push("temp_air_c", 25.0, 0.0).unwrap();
        assert!(matches!(memory.join(&mut reading).as_slice(), [CovariateError::Duplicate { .. }]));
        assert_eq!(reading.covariates.get("temp_air_c").unwrap().value, 25.0);
    }

    #[test]
    fn a_clock_that_was_set_back_begins_anew() {
        let mut memory = SensorMemory::default();
        memory.note(at(10_000), &[("temp_air_c".to_owned(), 25.0)]);
        memory.note(at(0), &[("temp_air_c".to_owned(), 20.0)]);
        assert_eq!(joined(&memory, 20_000), Some((20.0, 20_000.0)));
    }
}
