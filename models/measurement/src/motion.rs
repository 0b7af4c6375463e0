//! What the scales themselves tell of the motion: side of approach, feed and acceleration.
//!
//! Place in the flow: where a controller logs none of them, they are derived from the stream of scale readings, live and
//! for a campaign alike. An axis keeps its side of approach until it travels back by more than `reversal_m`: what stands
//! still leans on the side that it came from. Feed and acceleration need a dense stream; single latched points tell the
//! side alone. Readings in m, times in s.

use std::collections::VecDeque;

/// Share of the greatest feed of a move from which it has not begun to end.
const CRUISING: f64 = 0.9;

/// What counts as motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionSettings {
    /// Travel back from which an axis has turned (m): above the noise of the scales and the tremble of a standing axis.
    pub reversal_m: f64,
    /// Time over which a feed is taken (s). A longer pause between readings leaves it unknown.
    pub window_s: f64,
}

/// What is known of the motion at one reading; what is not known is `None`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Moved {
    /// Side of approach of each axis: +1 or −1.
    pub direction: [Option<f64>; 3],
    /// Feed now, or the greatest one of the last move where the machine stands (m/s).
    pub speed_m_s: Option<f64>,
    /// Acceleration now, or the one with which the last move ended where the machine stands (m/s², by axis).
    pub acceleration_m_s2: Option<[f64; 3]>,
}

/// The motion so far.
#[derive(Debug, Clone)]
pub struct Motion {
    settings: MotionSettings,
    sides: [Side; 3],
    /// Readings of the last two windows, the oldest one at their beginning.
    recent: VecDeque<(f64, [f64; 3])>,
    last: Option<Move>,
}

/// The side an axis leans on, and how far it came.
#[derive(Debug, Clone, Copy, Default)]
struct Side {
    sign: Option<f64>,
    /// Lowest and highest reading since the sign is known, or at all (m).
    low_m: f64,
    high_m: f64,
}

/// A move, under way or over.
#[derive(Debug, Clone, Copy)]
struct Move {
    is_over: bool,
    greatest_m_s: f64,
    ending_m_s2: [f64; 3],
}

impl Motion {
    /// Nothing seen yet.
    pub fn new(settings: MotionSettings) -> Motion {
        Motion { settings, sides: [Side::default(); 3], recent: VecDeque::new(), last: None }
    }

    /// Begins anew: nobody read how the machine moved before the next reading.
    pub fn forget(&mut self) {
        *self = Motion::new(self.settings);
    }

    /// Takes the next reading; gives what is known of the motion at it.
    pub fn push(&mut self, time_s: f64, reading_m: [f64; 3]) -> Moved {
        let is_first = self.recent.is_empty();
        for (side, at_m) in self.sides.iter_mut().zip(reading_m) {
            side.push(at_m, self.settings.reversal_m, is_first);
        }
        let direction = self.sides.map(|side| side.sign);
        // A pause hides a move, and a clock that goes back tells no feed.
        let follows = |last: &(f64, [f64; 3])| time_s > last.0 && time_s - last.0 <= self.settings.window_s;
        if !self.recent.back().is_none_or(follows) {
            self.recent.clear();
            self.last = None;
        }
        self.recent.push_back((time_s, reading_m));
        let beginning_s = time_s - 2.0 * self.settings.window_s;
        while self.recent.get(1).is_some_and(|second| second.0 <= beginning_s) {
            self.recent.pop_front();
        }
        let Some((velocity_m_s, acceleration_m_s2)) = self.now() else {
            return Moved { direction, ..Moved::default() };
        };
        let speed_m_s = velocity_m_s.iter().map(|v| v * v).sum::<f64>().sqrt();
        let is_moving = speed_m_s * self.settings.window_s > self.settings.reversal_m;
        let (speed_m_s, acceleration_m_s2) = match (is_moving, &mut self.last) {
            (true, last) => {
                Move::go_on(last, speed_m_s, acceleration_m_s2);
                (Some(speed_m_s), Some(acceleration_m_s2))
            }
            (false, Some(last)) => {
                last.is_over = true;
                (Some(last.greatest_m_s), Some(last.ending_m_s2))
            }
            (false, None) => (None, None),
        };
        Moved { direction, speed_m_s, acceleration_m_s2 }
    }

    /// Velocity over the last window and acceleration since the one before; `None` until both are there.
    fn now(&self) -> Option<([f64; 3], [f64; 3])> {
        let (newest, oldest) = (self.recent.back()?, self.recent.front()?);
        let window_s = self.settings.window_s;
        if newest.0 - oldest.0 < 2.0 * window_s {
            return None;
        }
        let middle = self.recent.iter().rev().find(|reading| newest.0 - reading.0 >= window_s)?;
        if middle.0 <= oldest.0 {
            return None;
        }
        let over = |a: &(f64, [f64; 3]), b: &(f64, [f64; 3])| -> [f64; 3] {
            std::array::from_fn(|d| (b.1[d] - a.1[d]) / (b.0 - a.0))
        };
        let (before, now) = (over(oldest, middle), over(middle, newest));
        let between_s = 0.5 * (newest.0 - oldest.0);
        Some((now, std::array::from_fn(|d| (now[d] - before[d]) / between_s)))
    }
}

impl Side {
    fn push(&mut self, at_m: f64, reversal_m: f64, is_first: bool) {
        if is_first && self.sign.is_none() {
            (self.low_m, self.high_m) = (at_m, at_m);
        }
        (self.low_m, self.high_m) = (self.low_m.min(at_m), self.high_m.max(at_m));
        let turned = match self.sign {
            Some(sign) if sign > 0.0 => (self.high_m - at_m > reversal_m).then_some(-1.0),
            Some(_) => (at_m - self.low_m > reversal_m).then_some(1.0),
            None if at_m - self.low_m > reversal_m => Some(1.0),
            None => (self.high_m - at_m > reversal_m).then_some(-1.0),
        };
        if turned.is_some() {
            *self = Side { sign: turned, low_m: at_m, high_m: at_m };
        }
    }
}

impl Move {
    fn go_on(last: &mut Option<Move>, speed_m_s: f64, acceleration_m_s2: [f64; 3]) {
        let new = Move { is_over: false, greatest_m_s: 0.0, ending_m_s2: [0.0; 3] };
        let current = match last {
            Some(current) if !current.is_over => current,
            _ => last.insert(new),
        };
        current.greatest_m_s = current.greatest_m_s.max(speed_m_s);
        let size = |a: [f64; 3]| a.iter().map(|v| v * v).sum::<f64>();
        let is_cruising = speed_m_s >= CRUISING * current.greatest_m_s;
        if is_cruising || size(acceleration_m_s2) > size(current.ending_m_s2) {
            current.ending_m_s2 = acceleration_m_s2;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: MotionSettings = MotionSettings { reversal_m: 5e-6, window_s: 0.05 };
    const FEED_M_S: f64 = 0.1;
    const RAMP_M_S2: f64 = 0.5;

    /// Position of a move of 0.1 m that begins at 0 s, with trapezoidal feed (m).
    fn trapezoid(time_s: f64) -> f64 {
        let ramp_s = FEED_M_S / RAMP_M_S2;
        let whole_s = 0.1 / FEED_M_S + ramp_s;
        let started = |t: f64| 0.5 * RAMP_M_S2 * t * t;
        match time_s {
            t if t <= 0.0 => 0.0,
            t if t < ramp_s => started(t),
            t if t < whole_s - ramp_s => started(ramp_s) + FEED_M_S * (t - ramp_s),
            t if t < whole_s => 0.1 - started(whole_s - t),
            _ => 0.1,
        }
    }

    /// Noise of 0.1 um without a generator: what a scale's last digits do.
    fn noise(k: usize) -> f64 {
        1e-7 * ((k as f64 * 12.9898).sin() * 43758.5453).fract()
    }

    #[test]
    fn a_move_in_a_dense_stream_tells_side_feed_and_acceleration() {
        let mut motion = Motion::new(SETTINGS);
        let mut at = |from_ms: usize, to_ms: usize, sign: f64| {
            let mut moved = Moved::default();
            for k in from_ms..to_ms {
                let x_m = sign * trapezoid((k - from_ms) as f64 * 1e-3 - 0.2) + noise(k);
                let y_m = -0.5 * sign * trapezoid((k - from_ms) as f64 * 1e-3 - 0.2) + noise(k + 7);
                moved = motion.push(k as f64 * 1e-3, [x_m, y_m, noise(k + 3)]);
            }
            moved
        };
        let standing = at(0, 150, 1.0);
        assert_eq!(standing, Moved::default(), "an axis that has not moved has no side");
        let over = at(150, 2000, 1.0);
        assert_eq!(over.direction, [Some(1.0), Some(-1.0), None]);
        let feed_m_s = FEED_M_S * 1.25f64.sqrt();
        assert!((over.speed_m_s.unwrap() / feed_m_s - 1.0).abs() < 0.01, "{over:?}");
        let ending = over.acceleration_m_s2.unwrap();
        assert!((ending[0] / -RAMP_M_S2 - 1.0).abs() < 0.05 && (ending[1] / (0.5 * RAMP_M_S2) - 1.0).abs() < 0.05);
        // Back to where it came from: both axes turn, and the side is that of the way back.
        let mut back = Moved::default();
        for k in 2000..4000 {
            let share = 0.1 - trapezoid((k - 2000) as f64 * 1e-3 - 0.2);
            back = motion.push(k as f64 * 1e-3, [share + noise(k), -0.5 * share + noise(k + 7), noise(k + 3)]);
        }
        assert_eq!(back.direction, [Some(-1.0), Some(1.0), None]);
    }

    #[test]
    fn points_latched_one_by_one_tell_the_side_and_nothing_that_they_cannot() {
        let mut motion = Motion::new(SETTINGS);
        let sides: Vec<_> = [0.0, 0.1, 0.2, 0.2, 0.1]
            .iter()
            .enumerate()
            .map(|(k, x_m)| motion.push(3.0 * k as f64, [*x_m, 0.0, 0.0]))
            .collect();
        let x: Vec<_> = sides.iter().map(|moved| moved.direction[0]).collect();
        assert_eq!(x, [None, Some(1.0), Some(1.0), Some(1.0), Some(-1.0)]);
        assert!(sides.iter().all(|moved| moved.speed_m_s.is_none() && moved.acceleration_m_s2.is_none()));
    }

    /// While a link was down the axis went on and came back: it had kept the side of before.
    #[test]
    fn regress_a_way_that_nobody_read_leaves_the_side_unknown() {
        let mut motion = Motion::new(SETTINGS);
        motion.push(0.0, [0.0; 3]);
        assert_eq!(motion.push(1.0, [0.11, 0.0, 0.0]).direction[0], Some(1.0));
        motion.forget();
        assert_eq!(motion.push(9.0, [0.2, 0.0, 0.0]).direction[0], None);
        assert_eq!(motion.push(10.0, [0.19, 0.0, 0.0]).direction[0], Some(-1.0));
    }

    #[test]
    fn a_clock_that_goes_back_leaves_the_feed_unknown() {
        let mut motion = Motion::new(SETTINGS);
        for k in 0..300 {
            motion.push(k as f64 * 1e-3, [k as f64 * 1e-4, 0.0, 0.0]);
        }
        let moved = motion.push(0.0, [0.03, 0.0, 0.0]);
        assert_eq!((moved.direction[0], moved.speed_m_s), (Some(1.0), None));
    }
}
