//! Sensors of a server: the last values of each, and since when and until when they hold.
//!
//! Place in the flow: each message of a session passes through; a reading asks what held at its instant. By source timestamps a
//! value is as old as its timestamp says. Where values hold until there is another, each message of the server that says nothing
//! else makes it as young as that message. A value of bad status is missing from then on, and so is everything when a session is lost.

use crate::units::Unit;
use abbe_msgs::Covariates;
use abbe_opcua::client::NodeValue;
use std::collections::{BTreeMap, VecDeque};

/// Values of one name that are kept: readings come at most so many later.
const KEPT: usize = 64;
/// Values from this much after a reading are of the same instant (ns).
const SAME_NS: i64 = 1_000_000;

/// A value in the unit of its name, from when to when.
#[derive(Debug, Clone, PartialEq)]
struct Held {
    from_ns: i64,
    to_ns: i64,
    value: f64,
}

/// What is known of one sensor.
#[derive(Debug, Default)]
struct Known {
    held: VecDeque<Held>,
    /// Why its last value is none.
    problem: Option<String>,
    /// The newest instant that was given as news.
    given_ns: Option<i64>,
}

/// The sensors of a session.
#[derive(Debug)]
pub(super) struct Sensors {
    holds: bool,
    known: BTreeMap<String, Known>,
    /// Names that have become missing and were not yet told of.
    gone: Vec<String>,
}

impl Sensors {
    /// None has said anything; whether values hold until there is another.
    pub(super) fn new(holds: bool) -> Sensors {
        Sensors { holds, known: BTreeMap::new(), gone: Vec::new() }
    }

    /// The session is lost: what was said holds no longer.
    pub(super) fn forget(&mut self) {
        for (name, known) in &mut self.known {
            // What is as it was is news to whoever has forgotten it.
            *known = Known::default();
            self.gone.push(name.clone());
        }
    }

    /// Takes a value; gives why it is none, where that is new.
    pub(super) fn take(&mut self, name: &str, unit: &Unit, told: &NodeValue, arrived_ns: i64) -> Option<String> {
        let known = self.known.entry(unit.name.clone()).or_default();
        match &told.value {
            Err(problem) => {
                // A server that is asked says it with every answer.
                if known.problem.is_none() || !known.held.is_empty() {
                    self.gone.push(unit.name.clone());
                }
                known.held.clear();
                known.given_ns = None;
                let is_new = known.problem.as_ref() != Some(problem);
                known.problem = Some(problem.clone());
                is_new.then(|| format!("covariate {name} is missing: {problem}"))
            }
            Ok(value) => {
                known.problem = None;
                let from_ns = told.source_ns.unwrap_or(arrived_ns);
                // A clock that was set back begins anew.
                if known.held.back().is_some_and(|last| from_ns < last.from_ns) {
                    known.held.clear();
                }
                if known.held.back().is_none_or(|last| from_ns > last.from_ns) {
                    if known.held.len() == KEPT {
                        known.held.pop_front();
                    }
                    known.held.push_back(Held { from_ns, to_ns: from_ns, value: unit.convert(*value) });
                }
                None
            }
        }
    }

    /// A message of the server's time says that all else is as it was.
    pub(super) fn confirm(&mut self, server_ns: i64) {
        if self.holds {
            for last in self.known.values_mut().filter_map(|known| known.held.back_mut()) {
                last.to_ns = last.to_ns.max(server_ns);
            }
        }
    }

    /// What held at an instant, with the age of it.
    pub(super) fn at(&self, at_ns: i64) -> Result<Covariates, String> {
        let mut covariates = Covariates::new();
        for (name, known) in &self.known {
            let Some(held) = known.held.iter().rev().find(|held| held.from_ns <= at_ns + SAME_NS) else { continue };
            let age_s = (at_ns - held.to_ns.min(at_ns)) as f64 / 1e9;
            covariates.push(name, held.value, age_s).map_err(|error| error.to_string())?;
        }
        Ok(covariates)
    }

    /// Names that have become missing since this was asked last.
    pub(super) fn gone(&mut self) -> Vec<String> {
        std::mem::take(&mut self.gone)
    }

    /// What is newer than was given before, by instant.
    pub(super) fn news(&mut self) -> Vec<(i64, Vec<(String, f64)>)> {
        let mut news: BTreeMap<i64, Vec<(String, f64)>> = BTreeMap::new();
        for (name, known) in &mut self.known {
            let given_ns = known.given_ns;
            for held in known.held.iter().filter(|held| given_ns.is_none_or(|given| held.to_ns > given)) {
                news.entry(held.to_ns).or_default().push((name.clone(), held.value));
                known.given_ns = Some(held.to_ns);
            }
        }
        news.into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    fn value(value: Result<f64, String>, at_s: Option<i64>) -> NodeValue {
        NodeValue { node: 3, value, source_ns: at_s.map(|s| s * S), is_after_loss: false }
    }

    fn take(sensors: &mut Sensors, told: &NodeValue) -> Option<String> {
        sensors.take("temp_air_k", &Unit::of("temp_air_k").unwrap(), told, 100 * S)
    }

    fn at(sensors: &Sensors, at_s: i64) -> Option<(f64, f64)> {
        let all = sensors.at(at_s * S).unwrap();
        all.get("temp_air_c").map(|entry| ((entry.value * 1e6).round() / 1e6, entry.age_s))
    }

    #[test]
    fn ages_are_from_the_source_or_from_the_last_sign_that_nothing_changed() {
        for (holds, age_s) in [(false, 5.0), (true, 2.0)] {
            let mut sensors = Sensors::new(holds);
            assert_eq!(take(&mut sensors, &value(Ok(293.15), Some(10))), None);
            sensors.confirm(13 * S);
            assert_eq!(at(&sensors, 15), Some((20.0, age_s)));
            assert_eq!(at(&sensors, 5), None, "a later value is not given to an earlier reading");
            assert_eq!(take(&mut sensors, &value(Ok(294.15), Some(14))), None);
            assert_eq!(at(&sensors, 13).unwrap().0, 20.0, "a reading that comes late gets what held then");
            assert_eq!(at(&sensors, 14), Some((21.0, 0.0)));
        }
    }

    #[test]
    fn a_bad_value_is_missing_and_told_once_and_so_is_all_of_a_lost_session() {
        let mut sensors = Sensors::new(true);
        take(&mut sensors, &value(Ok(293.15), Some(10)));
        let bad = value(Err("its status is BadSensorFailure".to_owned()), Some(11));
        assert!(take(&mut sensors, &bad).unwrap().contains("BadSensorFailure"));
        assert_eq!((0..100).find_map(|_| take(&mut sensors, &bad)), None);
        assert_eq!(sensors.gone(), ["temp_air_c"], "a server that is asked says it with every answer");
        sensors.confirm(12 * S);
        assert_eq!(at(&sensors, 12), None);
        take(&mut sensors, &value(Ok(293.15), Some(13)));
        assert!(at(&sensors, 13).is_some());
        sensors.forget();
        assert_eq!(at(&sensors, 13), None);
    }

    #[test]
    fn a_value_without_a_timestamp_is_as_old_as_its_arrival_and_news_are_given_once() {
        let mut sensors = Sensors::new(false);
        take(&mut sensors, &value(Ok(293.15), None));
        assert_eq!(at(&sensors, 103), Some((20.0, 3.0)));
        assert_eq!(sensors.news().len(), 1);
        take(&mut sensors, &value(Ok(293.15), Some(100)));
        assert_eq!(sensors.news(), [], "the same instant again");
        assert_eq!(sensors.gone(), [""; 0]);
        // Who was told that it is missing has forgotten it, so that a new session's repetition is news.
        for bad in [None, Some(value(Err("BadSensorFailure".to_owned()), Some(101)))] {
            match bad {
                None => sensors.forget(),
                Some(bad) => assert!(take(&mut sensors, &bad).is_some()),
            }
            assert_eq!((sensors.gone(), sensors.news()), (vec!["temp_air_c".to_owned()], vec![]));
            take(&mut sensors, &value(Ok(293.15), Some(100)));
            assert_eq!((sensors.gone().len(), sensors.news().len()), (0, 1));
        }
    }
}
