//! Side of approach, feed and acceleration as covariates, where the controller tells none.
//!
//! Place in the flow: in the scale node, before a reading is published, so that what is recorded for a campaign and what is
//! corrected live carry the same. [`abbe_measurement::motion`] derives them; what the reading says itself stays.

use abbe_measurement::motion::{Motion, MotionSettings};
use abbe_msgs::{CovariateError, ScaleReading};

const SIDES: [&str; 3] = ["dir_x", "dir_y", "dir_z"];
const SPEED: &str = "speed_mm_s";
const ACCELERATIONS: [&str; 3] = ["acc_x_mm_s2", "acc_y_mm_s2", "acc_z_mm_s2"];

/// The motion of a stream of scale readings.
#[derive(Debug, Clone)]
pub struct DerivedMotion {
    motion: Motion,
    /// Instant of the first reading: differences from it are exact enough as numbers of seconds.
    first_ns: Option<i64>,
}

impl DerivedMotion {
    /// Of a stream that has not begun.
    pub fn new(settings: MotionSettings) -> DerivedMotion {
        DerivedMotion { motion: Motion::new(settings), first_ns: None }
    }

    /// Nobody saw how the machine moved before the next reading.
    pub fn forget(&mut self) {
        self.motion.forget();
    }

    /// Adds to the next reading of the stream what it lacks; gives what had no room.
    pub fn fill(&mut self, reading: &mut ScaleReading) -> Vec<CovariateError> {
        if !reading.reading_m.iter().all(|value| value.is_finite()) {
            return Vec::new();
        }
        let at_ns = reading.stamp.to_nanos();
        let since_s = (at_ns - *self.first_ns.get_or_insert(at_ns)) as f64 * 1e-9;
        let moved = self.motion.push(since_s, reading.reading_m);
        let sides = SIDES.into_iter().zip(moved.direction);
        let speed = std::iter::once((SPEED, moved.speed_m_s.map(|speed_m_s| speed_m_s * 1e3)));
        let accelerations = moved.acceleration_m_s2.map_or([None; 3], |a| a.map(|m_s2| Some(m_s2 * 1e3)));
        let known = sides.chain(speed).chain(ACCELERATIONS.into_iter().zip(accelerations));
        let lacking = known.filter_map(|(name, value)| Some((name, value?)));
        let covariates = &mut reading.covariates;
        lacking
            .filter_map(|(name, value)| match covariates.get(name) {
                Some(_) => None,
                None => covariates.push(name, value, 0.0).err(),
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_msgs::Stamp;

    #[test]
    fn what_the_controller_tells_stays_and_the_rest_is_derived() {
        let mut motion = DerivedMotion::new(MotionSettings { reversal_m: 5e-6, window_s: 0.05 });
        let mut last = ScaleReading::default();
        for k in 0..300_i64 {
            let stamp = Stamp::from_nanos(1_700_000_000_000_000_000 + k * 1_000_000).unwrap();
            let reading_m = [k as f64 * 1e-4, 0.0, 0.0];
            last = ScaleReading { stamp, reading_m, ..ScaleReading::default() };
            last.covariates.push("dir_x", -1.0, 0.0).unwrap();
            assert_eq!(motion.fill(&mut last), []);
        }
        let value = |name: &str| last.covariates.get(name).map(|entry| entry.value);
        assert_eq!((value("dir_x"), value("dir_y")), (Some(-1.0), None));
        assert!((value("speed_mm_s").unwrap() - 100.0).abs() < 1e-6);
        assert!(value("acc_x_mm_s2").unwrap().abs() < 1e-3);
    }
}
