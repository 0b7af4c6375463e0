//! A recording in the present: which recorded instant is which present one.
//!
//! Place in the flow: the scale and the tracer node stamp by it what they play, where the launch file says `stamps = "now"`.
//! Both go by one agreement, so that readings of one instant stay readings of one instant. What goes out has the present
//! stamp, and so does what is recorded of it; the recorded instant stays in scale readings as the covariate `time_s`.
//!
//! t = t₀ + (r − r₀)/factor by recorded distances, t = t₀ + (n − n₀)/rate by count; to the nanosecond.

use crate::launch::Pace;
use abbe_geometry::effects::TIME;
use abbe_msgs::{CovariateError, MessageError, ScaleReading, Stamp};
use serde::{Deserialize, Serialize};

/// What the sources of a run agree about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Present {
    /// Present instant (ns) of the reading below.
    pub(crate) at_ns: i64,
    /// Recorded instant (ns) of the first reading of the source that was there first.
    pub(crate) recorded_ns: i64,
    /// Its sequence.
    pub(crate) sequence: u64,
    /// How fast all of them play.
    pub(crate) pace: Pace,
    /// Whether `at_ns` is of `/clock`.
    pub(crate) is_simulated: bool,
}

impl Present {
    /// The present stamp of a reading.
    pub(crate) fn stamp(&self, recorded: Stamp, sequence: u64) -> Result<Stamp, MessageError> {
        let since_ns = match self.pace {
            // Exact, where nothing is to be divided.
            Pace::TimeFactor(1.0) | Pace::AsTheyCome => recorded.to_nanos() - self.recorded_ns,
            Pace::TimeFactor(factor) => ((recorded.to_nanos() - self.recorded_ns) as f64 / factor).round() as i64,
            Pace::RateHz(rate) => {
                let count = i128::from(sequence) - i128::from(self.sequence);
                (count as f64 * 1e9 / rate).round() as i64
            }
        };
        Stamp::from_nanos(self.at_ns.saturating_add(since_ns))
    }

    /// What keeps two sources from playing by this agreement; `None` where nothing does.
    pub(crate) fn problem(&self, pace: Pace, is_simulated: bool) -> Option<String> {
        if self.pace != pace {
            let paces = format!("this source plays at {pace}, the one before it at {}", self.pace);
            return Some(format!("{paces}; give scale and tracer the same pace, or say stamps = \"recorded\""));
        }
        (self.is_simulated != is_simulated)
            .then(|| "scale and tracer go by different clocks; give both use_sim_time, or neither".to_owned())
    }
}

/// Keeps the instant of the recording with a reading, in seconds on its clock.
pub(crate) fn keep_recorded(reading: &mut ScaleReading) -> Result<(), CovariateError> {
    match reading.covariates.get(TIME) {
        Some(_) => Ok(()),
        None => reading.covariates.push(TIME, reading.stamp.to_seconds(), 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_NS: i64 = 1_700_000_000_000_000_000;

    fn at(pace: Pace) -> Present {
        Present { at_ns: NOW_NS, recorded_ns: 5_000_000_000, sequence: 3, pace, is_simulated: false }
    }

    #[test]
    fn one_instant_stays_one_and_distances_go_as_the_pace_says() {
        let recorded = Stamp::from_nanos(7_000_000_001).unwrap();
        let since_ns = |pace| at(pace).stamp(recorded, 13).unwrap().to_nanos() - NOW_NS;
        assert_eq!(since_ns(Pace::TimeFactor(1.0)), 2_000_000_001);
        assert_eq!(since_ns(Pace::TimeFactor(2.0)), 1_000_000_001);
        assert_eq!(since_ns(Pace::RateHz(100.0)), 100_000_000);
        // What another source has from before the first reading of this one.
        let before = at(Pace::TimeFactor(1.0)).stamp(Stamp::from_nanos(4_999_999_999).unwrap(), 0).unwrap();
        assert_eq!(before.to_nanos(), NOW_NS - 1);
        assert!(at(Pace::RateHz(1e-6)).stamp(recorded, u64::MAX).is_err(), "no stamp is that far away");
    }

    #[test]
    fn sources_that_do_not_agree_are_told_what_to_do() {
        let agreed = at(Pace::RateHz(100.0));
        assert_eq!(agreed.problem(Pace::RateHz(100.0), false), None);
        assert!(agreed.problem(Pace::RateHz(50.0), false).unwrap().contains("the same pace"));
        assert!(agreed.problem(Pace::RateHz(100.0), true).unwrap().contains("use_sim_time"));
    }

    #[test]
    fn the_recorded_instant_stays_with_the_reading_and_what_it_says_itself_is_left() {
        let mut reading = ScaleReading { stamp: Stamp::from_nanos(2_500_000_000).unwrap(), ..ScaleReading::default() };
        keep_recorded(&mut reading).unwrap();
        assert_eq!(reading.covariates.get(TIME).unwrap().value, 2.5);
        reading.stamp = Stamp::from_nanos(9_000_000_000).unwrap();
        keep_recorded(&mut reading).unwrap();
        assert_eq!(reading.covariates.get(TIME).unwrap().value, 2.5);
    }
}
