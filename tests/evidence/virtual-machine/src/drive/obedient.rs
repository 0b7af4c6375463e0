//! The machine of a campaign that moves where it is told, instead of along its plan.
//!
//! Place in the flow: a capture that drives the machine is rehearsed against it. At a point of the set-up it shows what the campaign has
//! there; elsewhere the length is the geometric distance with what was shown last. Tracer and reflector are moved to the next set-up
//! by nobody: it is there when all points of this one were stood at, and the machine has stood idle since. Machine frame, SI.

use super::{Drive, LENGTH_M, Pace, SCALES_M, Seen, distance_m, gone_m, lasts_s};
use crate::random::normal;
use std::ops::Range;

/// So near it stands at a point (m).
const AT_M: f64 = 1e-4;

/// A machine that obeys.
#[derive(Debug)]
pub struct Obedient {
    drive: Drive,
    pace: Pace,
    set_ups: Vec<Range<usize>>,
    set_up: usize,
    is_visited: Vec<bool>,
    from_m: [f64; 3],
    to_m: [f64; 3],
    begun_s: f64,
    speed_m_s: f64,
    /// What the machine makes of the distance, shown last (m).
    shown_m: f64,
}

impl Obedient {
    /// Stands where the campaign begins; `None` where there is nothing to be measured.
    pub fn new(drive: Drive, pace: Pace) -> Option<Obedient> {
        let first = drive.stays.first()?;
        let begins: Vec<usize> = (0..drive.len()).filter(|k| *k == 0 || drive.stays[*k].is_changed).collect();
        let ends = begins.iter().skip(1).copied().chain([drive.len()]);
        let (from_m, is_visited) = (first.from_m, vec![false; drive.len()]);
        Some(Obedient {
            set_ups: begins.iter().copied().zip(ends).map(|(from, to)| from..to).collect(),
            set_up: 0,
            is_visited,
            from_m,
            to_m: from_m,
            begun_s: f64::NEG_INFINITY,
            speed_m_s: 1.0,
            shown_m: 0.0,
            drive,
            pace,
        })
    }

    /// The campaign.
    pub fn drive(&self) -> &Drive {
        &self.drive
    }

    /// Moves to a reading (m) from this time (s) on.
    pub fn go(&mut self, time_s: f64, to_m: [f64; 3], speed_m_s: f64) {
        let from_m = self.place_m(time_s);
        let speed_m_s = (speed_m_s * self.pace.faster).max(super::SLOWEST_M_S);
        (self.from_m, self.to_m, self.begun_s, self.speed_m_s) = (from_m, to_m, time_s, speed_m_s);
    }

    /// Stops where it is.
    pub fn stop(&mut self, time_s: f64) {
        let at_m = self.place_m(time_s);
        (self.from_m, self.to_m, self.begun_s) = (at_m, at_m, time_s);
    }

    /// Whether it stands at the end of its way.
    pub fn has_arrived(&self, time_s: f64) -> bool {
        time_s >= self.arrives_s()
    }

    fn acceleration_m_s2(&self) -> f64 {
        // A point that the machine begins at has a way without acceleration.
        self.drive.stays.iter().map(|stay| stay.acceleration_m_s2).fold(super::SLOWEST_M_S, f64::max)
    }

    fn arrives_s(&self) -> f64 {
        let way_m = distance_m(&self.from_m, &self.to_m);
        match way_m > 0.0 {
            true => self.begun_s + lasts_s(way_m, self.speed_m_s, self.acceleration_m_s2()),
            false => self.begun_s,
        }
    }

    fn place_m(&self, time_s: f64) -> [f64; 3] {
        let way_m = distance_m(&self.from_m, &self.to_m);
        if way_m == 0.0 || self.has_arrived(time_s) {
            return self.to_m;
        }
        let share = gone_m(time_s - self.begun_s, way_m, self.speed_m_s, self.acceleration_m_s2()) / way_m;
        std::array::from_fn(|d| self.from_m[d] + share * (self.to_m[d] - self.from_m[d]))
    }

    /// What is seen at this time (s).
    pub fn at(&mut self, time_s: f64) -> Seen {
        let idle_s = (time_s - self.arrives_s()).max(0.0);
        let all_seen = self.set_ups[self.set_up].clone().all(|point| self.is_visited[point]);
        if all_seen && idle_s.is_finite() && idle_s >= self.pace.dwell_s + self.pace.change_s {
            self.set_ups[self.set_up].clone().for_each(|point| self.is_visited[point] = false);
            self.set_up = (self.set_up + 1) % self.set_ups.len();
            self.begun_s = time_s;
        }
        let at_m = self.place_m(time_s);
        let own = self.set_ups[self.set_up].clone();
        let here =
            own.clone().filter(|point| distance_m(&self.drive.stays[*point].reading.reading.reading_m, &at_m) < AT_M);
        let standing = here.clone().next().filter(|_| self.has_arrived(time_s));
        if let Some(point) = standing {
            if idle_s >= self.pace.dwell_s {
                here.collect::<Vec<_>>().into_iter().for_each(|point| self.is_visited[point] = true);
            }
            let reading = self.drive.stays[point].reading.reading;
            self.shown_m = reading.length_m - self.range_m(&reading.reading_m);
        }
        let is_away = all_seen && idle_s >= self.pace.dwell_s + 0.5 * self.pace.change_s && idle_s.is_finite();
        let reading = self.drive.stays[own.start].reading.reading;
        let length_m = self.range_m(&at_m) + self.shown_m + LENGTH_M * normal(&mut self.drive.lengths);
        Seen {
            reading_m: at_m.map(|m| m + SCALES_M * normal(&mut self.drive.scales)),
            length_m: (!is_away).then_some(length_m),
            station: reading.station as usize,
            offset_m: reading.offset_m,
            standing,
        }
    }

    /// From the station of this set-up to the reflector (m).
    fn range_m(&self, at_m: &[f64; 3]) -> f64 {
        let reading = self.drive.stays[self.set_ups[self.set_up].start].reading.reading;
        let tip_m: [f64; 3] = std::array::from_fn(|d| at_m[d] + reading.offset_m[d]);
        distance_m(&tip_m, &self.drive.stations_m[reading.station as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{PACE, config};
    use super::*;
    use crate::simulate_campaign;

    #[test]
    fn it_moves_where_it_is_told_shows_the_campaign_there_and_stops_in_the_middle() {
        let config = config();
        let campaign = simulate_campaign(&config).unwrap().campaign;
        let mut machine = Obedient::new(Drive::new(&config, PACE).unwrap(), PACE).unwrap();
        let mut now_s = 100.0;
        for reading in campaign.readings.iter().take(5) {
            machine.go(now_s, reading.reading_m, 0.05);
            while !machine.has_arrived(now_s) {
                now_s += 0.01;
                assert_eq!(machine.at(now_s).offset_m, reading.offset_m);
            }
            let mean_m = (0..400).map(|_| machine.at(now_s).length_m.unwrap()).sum::<f64>() / 400.0;
            assert!((mean_m - reading.length_m).abs() < 1e-8, "{mean_m} {}", reading.length_m);
            assert!(distance_m(&machine.at(now_s).reading_m, &reading.reading_m) < 1e-7);
        }
        let from_m = machine.at(now_s).reading_m;
        machine.go(now_s, [0.7, 0.5, 0.5], 0.05);
        machine.stop(now_s + 1.0);
        let stood_m = machine.at(now_s + 9.0).reading_m;
        let gone_m = distance_m(&from_m, &stood_m);
        assert!(gone_m > 0.01 && gone_m < 0.051 && machine.has_arrived(now_s + 1.0), "{gone_m}");
    }

    #[test]
    fn the_next_set_up_is_there_when_all_points_were_stood_at_and_nobody_moves_it() {
        let mut machine = Obedient::new(Drive::new(&config(), PACE).unwrap(), PACE).unwrap();
        let first = machine.at(0.0);
        let points: Vec<[f64; 3]> =
            machine.set_ups[0].clone().map(|point| machine.drive.stays[point].reading.reading.reading_m).collect();
        let mut now_s = 10.0;
        for to_m in points {
            machine.go(now_s, to_m, 1.0);
            now_s += 30.0;
            let seen = machine.at(now_s);
            assert_eq!((seen.station, seen.offset_m), (first.station, first.offset_m));
        }
        now_s += PACE.dwell_s + PACE.change_s;
        let seen = machine.at(now_s);
        assert_ne!((seen.station, seen.offset_m), (first.station, first.offset_m));
    }
}
