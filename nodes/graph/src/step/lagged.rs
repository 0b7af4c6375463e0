//! Covariates that lag behind others, and sides that follow over a travel, made in the stream of scale readings.
//!
//! Place in the flow: in the scale node, before a reading is published, so that it is recorded with what it was corrected with and
//! replay finds the same. [`Lag`] and [`Travel`] make them; what the reading says itself stays. A lagged covariate is as
//! old as what it follows, and is there once the stream has told for three time constants how that went; a side over a travel is as
//! new as the reading, once the axis has gone three times that far.

use abbe_geometry::effects::{Lag, Lagged, Travel, of_lagged};
use abbe_msgs::{CovariateError, ScaleReading};

/// Instants closer than this are one (s): a stamp less an age comes out with a rounding.
const SAME_INSTANT_S: f64 = 1e-3;

/// Lagged covariates of a stream of scale readings.
#[derive(Debug, Clone, Default)]
pub struct DerivedLags {
    followed: Vec<Followed>,
    sides: Vec<(String, Travel)>,
    /// Instant of the first reading: differences from it are exact enough as numbers of seconds.
    first_ns: Option<i64>,
}

#[derive(Debug, Clone)]
struct Followed {
    name: String,
    logged: String,
    lag: Lag,
    last: Option<(f64, Lagged)>,
}

impl DerivedLags {
    /// Of these names, of a stream that has not begun; a name that is none of a derived covariate is left out.
    pub fn new<'a>(names: impl IntoIterator<Item = &'a String> + Clone) -> DerivedLags {
        let side = |name: &String| Some((name.clone(), Travel::of(name)?));
        let sides = names.clone().into_iter().filter_map(side).collect();
        let followed = |name: &String| {
            let (logged, lag_s) = of_lagged(name)?;
            Some(Followed { name: name.clone(), logged, lag: Lag::new(f64::from(lag_s)), last: None })
        };
        DerivedLags { followed: names.into_iter().filter_map(followed).collect(), sides, first_ns: None }
    }

    /// Nobody saw how the machine moved before the next reading: sides over a travel begin anew.
    pub fn forget_motion(&mut self) {
        self.sides.iter_mut().for_each(|(_, travel)| travel.forget());
    }

    /// Adds to the next reading of the stream what can be told; gives what had no room.
    pub fn fill(&mut self, reading: &mut ScaleReading) -> Vec<CovariateError> {
        let at_ns = reading.stamp.to_nanos();
        let since_s = (at_ns - *self.first_ns.get_or_insert(at_ns)) as f64 * 1e-9;
        let covariates = &mut reading.covariates;
        let mut refused = Vec::new();
        for followed in &mut self.followed {
            let Some(logged) = covariates.get(&followed.logged) else { continue };
            let age_s = logged.age_s;
            let value = logged.value;
            let Some(lagged) = followed.follow(since_s - age_s, value) else { continue };
            if lagged.is_settled && covariates.get(&followed.name).is_none() {
                refused.extend(covariates.push(&followed.name, lagged.value, age_s).err());
            }
        }
        for (name, travel) in &mut self.sides {
            // A stream is read all the way; its logged side turns later, once the axis has surely turned.
            let Some(now) = travel.push(reading.reading_m, None) else { continue };
            if now.is_settled && covariates.get(name).is_none() {
                refused.extend(covariates.push(name, now.side, 0.0).err());
            }
        }
        refused
    }
}

impl Followed {
    /// The lagged value at that instant. A value that is not a number tells nothing; one of the same instant, nothing new.
    fn follow(&mut self, time_s: f64, value: f64) -> Option<Lagged> {
        if !(time_s.is_finite() && value.is_finite()) {
            return None;
        }
        match self.last {
            Some((last_s, lagged)) if (time_s - last_s).abs() < SAME_INSTANT_S => Some(lagged),
            _ => {
                let lagged = self.lag.push(time_s, value);
                self.last = Some((time_s, lagged));
                Some(lagged)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_msgs::Stamp;

    const NAME: &str = "temp_air_lag_60s_c";

    fn reading(ms: i64, value: f64, age_s: f64) -> ScaleReading {
        let stamp = Stamp::from_nanos(1_700_000_000_000_000_000 + ms * 1_000_000).unwrap();
        let mut reading = ScaleReading { stamp, ..ScaleReading::default() };
        reading.covariates.push("temp_air_c", value, age_s).unwrap();
        reading
    }

    fn filled(lags: &mut DerivedLags, mut reading: ScaleReading) -> Option<(f64, f64)> {
        assert_eq!(lags.fill(&mut reading), []);
        reading.covariates.get(NAME).map(|entry| (entry.value, entry.age_s))
    }

    #[test]
    fn it_is_there_after_three_time_constants_and_as_old_as_what_it_follows() {
        let mut lags = DerivedLags::new([&NAME.to_owned()]);
        // A sensor that speaks every 10 s, readings every second.
        let sensor = |s: i64| 20.0 + 0.001 * (10 * (s / 10)) as f64;
        let mut last = None;
        for s in 0..1000 {
            let age_s = (s % 10) as f64;
            last = filled(&mut lags, reading(1000 * s, sensor(s), age_s));
            assert_eq!(last.is_some(), s >= 180, "after {s} s");
        }
        let (value, age_s) = last.unwrap();
        // A ramp is followed as far behind as the time constant is long.
        assert!((value - (20.0 + 0.001 * (990.0 - 60.0))).abs() < 1e-6, "{value}");
        assert_eq!(age_s, 9.0);
    }

    #[test]
    fn a_side_over_a_travel_is_there_once_the_axis_has_gone_three_times_as_far() {
        let name = "dir_z_over_10000um".to_owned();
        let mut lags = DerivedLags::new([&name]);
        let mut at = |z_m: f64| {
            let mut reading = ScaleReading { reading_m: [0.0, 0.0, z_m], ..ScaleReading::default() };
            assert_eq!(lags.fill(&mut reading), []);
            reading.covariates.get(&name).map(|entry| (entry.value, entry.age_s))
        };
        assert_eq!((at(0.0), at(0.029)), (None, None));
        let (side, age_s) = at(0.5).unwrap();
        assert!((side - 1.0).abs() < 1e-12 && age_s == 0.0);
        assert!((at(0.49).unwrap().0 - (2.0 * (-1.0_f64).exp() - 1.0)).abs() < 1e-12);
        assert_eq!(at(f64::NAN), None);
    }

    #[test]
    fn what_the_reading_says_itself_stays_and_a_silent_sensor_begins_anew() {
        let mut lags = DerivedLags::new([&NAME.to_owned()]);
        for s in 0..300 {
            filled(&mut lags, reading(1000 * s, 20.0, 0.0));
        }
        let mut own = reading(300_000, 20.0, 0.0);
        own.covariates.push(NAME, 25.0, 0.0).unwrap();
        assert_eq!(filled(&mut lags, own), Some((25.0, 0.0)));
        assert!(filled(&mut lags, reading(301_000, 20.0, 0.0)).is_some());
        assert_eq!(filled(&mut lags, reading(602_000, 20.0, 0.0)), None, "nobody knows what was in between");
        assert_eq!(filled(&mut lags, ScaleReading::default()), None);
    }
}
