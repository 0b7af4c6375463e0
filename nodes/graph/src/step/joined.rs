//! Covariates of other boxes joined to scale readings, each with its age at the instant of latching.
//!
//! Place in the flow: in the scale node, before a reading is published. Sensors say their values in their own rhythm; a reading
//! gets the newest one from not after its stamp, however late the reading itself comes. Values in the unit of their name,
//! ages in s. What the reading's own driver says stays. A name that two sensors say is left out, since nobody knows which of them
//! is meant. Where the clock of the readings is set back, the age of what was said before is unknown: a sensor is missing until
//! it speaks again. One reading that is back may be late, and goes without sensors; the next one tells. Pure: no clock is read.

use super::geometric::CLOCK_TOLERANCE_S;
use abbe_msgs::{CovariateError, ScaleReading, Stamp};
use std::collections::{BTreeMap, VecDeque};

/// Values of one name that are kept: readings come at most so many sensor values late.
const KEPT: usize = 256;

/// What the sensors have said lately.
#[derive(Debug, Clone, Default)]
pub struct SensorMemory {
    values: BTreeMap<String, Said>,
    /// Stamp of the reading that was joined last.
    joined: Option<Stamp>,
    /// Stamp of the reading before that, where the last one went back.
    went_back: Option<Stamp>,
}

/// What was said under one name.
#[derive(Debug, Clone, Default)]
struct Said {
    /// Number of the sensor.
    by: usize,
    /// Another sensor has said it as well.
    is_contested: bool,
    kept: VecDeque<(Stamp, f64)>,
    /// The sensor's own clock was set back since the last reading: it knows the new time already.
    began_anew: bool,
}

impl SensorMemory {
    /// Takes what a sensor, told from the others by a number, says of an instant.
    pub fn note(&mut self, sensor: usize, stamp: Stamp, values: &[(String, f64)]) {
        for (name, value) in values {
            let said = match self.values.get_mut(name) {
                Some(said) => said,
                None => self.values.entry(name.clone()).or_insert(Said { by: sensor, ..Said::default() }),
            };
            said.is_contested |= said.by != sensor;
            // A clock that was set back begins anew.
            if said.kept.back().is_some_and(|(last, _)| stamp < *last) {
                said.kept.clear();
                said.began_anew = true;
            }
            if said.kept.len() == KEPT {
                said.kept.pop_front();
            }
            said.kept.push_back((stamp, *value));
        }
    }

    /// Takes that a sensor has no value under this name: what it said before holds no longer.
    pub fn forget(&mut self, name: &str) {
        if let Some(said) = self.values.get_mut(name) {
            said.kept.clear();
        }
    }

    /// Adds to a reading what the sensors said by its instant; gives what could not be added, and why.
    pub fn join(&mut self, reading: &mut ScaleReading) -> Vec<CovariateError> {
        let at_ns = reading.stamp.to_nanos();
        let age_s = |stamp: Stamp| (at_ns - stamp.to_nanos()) as f64 * 1e-9;
        let is_before = |last: Stamp| age_s(last) < -CLOCK_TOLERANCE_S;
        let last = self.joined.replace(reading.stamp);
        let is_set_back = self.went_back.take().is_some_and(is_before);
        if let Some(last) = last.filter(|last| is_before(*last) && !is_set_back) {
            self.went_back = Some(last);
            return Vec::new();
        }
        let mut refused = Vec::new();
        for (name, said) in &mut self.values {
            if is_set_back && !said.began_anew {
                said.kept.clear();
            }
            said.began_anew = false;
            if said.is_contested {
                refused.push(CovariateError::Duplicate { name: name.clone() });
                continue;
            }
            let newest = said.kept.iter().rev().find(|(stamp, _)| age_s(*stamp) >= -CLOCK_TOLERANCE_S);
            // All of them are from after the reading: the first tells by its age that it cannot be used.
            let Some((stamp, value)) = newest.or(said.kept.front()) else { continue };
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

    fn joined(memory: &mut SensorMemory, ms: i64) -> Option<(f64, f64)> {
        let mut reading = ScaleReading { stamp: at(ms), ..ScaleReading::default() };
        assert_eq!(memory.join(&mut reading), []);
        reading.covariates.get("temp_air_c").map(|entry| (entry.value, (entry.age_s * 1e3).round()))
    }

    #[test]
    fn a_reading_gets_the_newest_value_from_not_after_it() {
        let mut memory = SensorMemory::default();
        assert_eq!(joined(&mut memory, 0), None, "what no sensor has said is missing");
        for (ms, value) in [(0, 20.0), (1000, 20.1), (2000, 20.2)] {
            memory.note(0, at(ms), &[("temp_air_c".to_owned(), value)]);
        }
        assert_eq!(
            joined(&mut memory, 1500),
            Some((20.1, 500.0)),
            "a reading that comes late is not given a later value"
        );
        assert_eq!(joined(&mut memory, 2000), Some((20.2, 0.0)));
        assert_eq!(joined(&mut memory, 60_000), Some((20.2, 58_000.0)), "a sensor that says no more grows old");
        assert_eq!(joined(&mut memory, 59_000), None, "late, or of another time");
        assert_eq!(joined(&mut memory, 61_000), Some((20.2, 59_000.0)), "it was late");
        let mut ahead = SensorMemory::default();
        ahead.note(0, at(0), &[("temp_air_c".to_owned(), 20.0)]);
        assert_eq!(joined(&mut ahead, -5000), Some((20.0, -5000.0)), "an age below zero says that the clocks disagree");
    }

    #[test]
    fn regress_a_sensor_without_a_value_is_missing_until_it_has_one() {
        let mut memory = SensorMemory::default();
        memory.forget("temp_air_c");
        memory.note(0, at(0), &[("temp_air_c".to_owned(), 20.0), ("load_kg".to_owned(), 7.0)]);
        memory.forget("temp_air_c");
        let mut reading = ScaleReading { stamp: at(100), ..ScaleReading::default() };
        assert_eq!(memory.join(&mut reading), []);
        assert_eq!(reading.covariates.iter().map(|entry| entry.value).collect::<Vec<_>>(), [7.0]);
        memory.note(0, at(200), &[("temp_air_c".to_owned(), 21.0)]);
        let mut reading = ScaleReading { stamp: at(300), ..ScaleReading::default() };
        assert_eq!(memory.join(&mut reading), []);
        assert_eq!(reading.covariates.get("temp_air_c").map(|entry| entry.value), Some(21.0));
    }

    #[test]
    fn what_the_reading_has_already_stays_and_is_told() {
        let mut memory = SensorMemory::default();
        memory.note(0, at(0), &[("temp_air_c".to_owned(), 20.0)]);
        let mut reading = ScaleReading { stamp: at(1), ..ScaleReading::default() };
        reading.covariates.push("temp_air_c", 25.0, 0.0).unwrap();
        assert!(matches!(memory.join(&mut reading).as_slice(), [CovariateError::Duplicate { .. }]));
        assert_eq!(reading.covariates.get("temp_air_c").unwrap().value, 25.0);
    }

    #[test]
    fn a_clock_that_was_set_back_begins_anew() {
        let mut memory = SensorMemory::default();
        memory.note(0, at(10_000), &[("temp_air_c".to_owned(), 25.0)]);
        memory.note(0, at(0), &[("temp_air_c".to_owned(), 20.0)]);
        assert_eq!(joined(&mut memory, 20_000), Some((20.0, 20_000.0)));
    }

    /// A sensor that had died was fresh again, with what it said a minute ago, once the clock of the readings was set back.
    #[test]
    fn regress_what_was_said_before_the_readings_went_back_is_missing_until_the_sensor_speaks_again() {
        let mut memory = SensorMemory::default();
        for s in 0..60 {
            memory.note(0, at(1000 * s), &[("temp_air_c".to_owned(), 20.0 + 0.1 * s as f64)]);
        }
        assert_eq!(joined(&mut memory, 75_000).map(|(_, age_ms)| age_ms), Some(16_000.0));
        assert_eq!(joined(&mut memory, 6000), None);
        assert_eq!(joined(&mut memory, 7000), None);
        memory.note(0, at(7500), &[("temp_air_c".to_owned(), 26.0)]);
        assert_eq!(joined(&mut memory, 8000), Some((26.0, 500.0)));
        // The sensor hears of the new time before the readings do.
        memory.note(0, at(1000), &[("temp_air_c".to_owned(), 27.0)]);
        assert_eq!([1500, 1501].map(|ms| joined(&mut memory, ms)), [None, Some((27.0, 501.0))]);
    }

    /// Readings got the temperature of one and of the other box by turns.
    #[test]
    fn regress_a_name_of_two_sensors_is_left_out_and_told() {
        let mut memory = SensorMemory::default();
        memory.note(0, at(0), &[("temp_air_c".to_owned(), 20.0), ("load_kg".to_owned(), 7.0)]);
        memory.note(1, at(10), &[("temp_air_c".to_owned(), 24.0)]);
        let mut reading = ScaleReading { stamp: at(20), ..ScaleReading::default() };
        assert!(
            matches!(memory.join(&mut reading).as_slice(), [CovariateError::Duplicate { name }] if name == "temp_air_c")
        );
        assert!(reading.covariates.get("temp_air_c").is_none());
        assert_eq!(reading.covariates.get("load_kg").map(|entry| entry.value), Some(7.0));
    }
}
