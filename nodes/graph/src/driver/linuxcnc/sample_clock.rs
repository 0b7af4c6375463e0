//! When a sample was taken, from its number and the instants at which samples arrive.
//!
//! Place in the flow: below [`super::Linuxcnc`]. Samples are a servo period apart and arrive later than they were taken, sometimes
//! much later, never earlier: the least delay of the last [`WINDOW_S`] ties numbers to the clock of this host. Samples that the buffer
//! had no room for have no number, so that all after them would be dated too early; that needs a reader that was held up for longer
//! than the buffer is deep. Hence a sample that comes very late makes the tie anew, and until it holds no sample has an instant. A
//! servo thread that stood still for some milliseconds leaves out periods without a number, too: what comes later than is agreed has
//! no instant, until the least delay is that of after. Seconds since 1970; pure.

use std::collections::VecDeque;

/// Over so long the least delay is looked for (s): what the servo clock goes wrong by meanwhile is microseconds.
const WINDOW_S: f64 = 0.5;
/// A sample that comes later than this (s) may come after lost ones; buffers must be deeper.
const LOST_S: f64 = 0.25;
/// The least delay must not have fallen for so long (s): what waited in buffers has been read then.
const SETTLED_S: f64 = 1.0;
/// A fall of the least delay below this (s) is the scatter of a loaded host.
const FALL_S: f64 = 0.002;

/// What is known of a sample's instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Dated {
    /// When it was taken (s).
    At(f64),
    /// Numbers are not tied to the clock yet.
    NotYet,
    /// It came so much later (s) than the others that its number may not tell its instant.
    Late(f64),
    /// They were, and are not any more: it came so much too late (s), or numbers were left out.
    Lost(Option<f64>),
}

/// Ties numbers to instants.
#[derive(Debug, Clone)]
pub(super) struct SampleClock {
    period_s: f64,
    late_s: f64,
    last: Option<i64>,
    /// Arrival, and arrival less the time that the number stands for; the latter ascends.
    least: VecDeque<(f64, f64)>,
    fell_s: f64,
    is_settled: bool,
}

impl SampleClock {
    /// Samples this far apart (s); what comes later than `late_s` has no instant.
    pub(super) fn new(period_s: f64, late_s: f64) -> SampleClock {
        SampleClock {
            period_s,
            late_s,
            last: None,
            least: VecDeque::new(),
            fell_s: f64::NEG_INFINITY,
            is_settled: false,
        }
    }

    /// Numbers begin anew.
    pub(super) fn forget(&mut self) {
        *self = SampleClock::new(self.period_s, self.late_s);
    }

    /// The instant of the sample of this number, which arrived then.
    pub(super) fn date(&mut self, number: i64, arrived_s: f64) -> Dated {
        let was_settled = self.is_settled;
        if self.last.is_some_and(|last| last.checked_add(1) != Some(number)) {
            self.forget();
            self.tie(number, arrived_s);
            return if was_settled { Dated::Lost(None) } else { Dated::NotYet };
        }
        // By the delays before it: after a long pause nothing else would be left to hold it against.
        let before_s = self.least.front().map(|(_, least_s)| arrived_s - least_s - number as f64 * self.period_s);
        if let Some(late_s) = before_s.filter(|late_s| was_settled && *late_s > LOST_S) {
            self.forget();
            self.tie(number, arrived_s);
            return Dated::Lost(Some(late_s));
        }
        let zero_s = self.tie(number, arrived_s);
        match (self.is_settled, before_s.filter(|late_s| *late_s > self.late_s)) {
            (false, _) => Dated::NotYet,
            (true, Some(late_s)) => Dated::Late(late_s),
            (true, None) => Dated::At(zero_s + number as f64 * self.period_s),
        }
    }

    /// Takes a sample into account; the instant of number 0 (s).
    fn tie(&mut self, number: i64, arrived_s: f64) -> f64 {
        self.last = Some(number);
        let own_s = arrived_s - number as f64 * self.period_s;
        if self.least.front().is_none_or(|(_, least_s)| own_s < least_s - FALL_S) {
            self.fell_s = arrived_s;
        }
        while self.least.back().is_some_and(|(_, least_s)| *least_s >= own_s) {
            self.least.pop_back();
        }
        self.least.push_back((arrived_s, own_s));
        while self.least.front().is_some_and(|(at_s, _)| arrived_s - at_s > WINDOW_S) {
            self.least.pop_front();
        }
        self.is_settled |= arrived_s - self.fell_s >= SETTLED_S;
        self.least.front().map_or(own_s, |(_, least_s)| *least_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 0.001;
    /// When number 0 was taken.
    const ZERO_S: f64 = 1000.0;

    /// Dates samples that were taken at `taken_s` and arrive `delay_s` later; the greatest error (s), and how many had an instant.
    fn errors(clock: &mut SampleClock, samples: impl Iterator<Item = (i64, f64, f64)>) -> (f64, usize) {
        let (mut worst_s, mut dated) = (0.0_f64, 0);
        for (number, taken_s, delay_s) in samples {
            if let Dated::At(at_s) = clock.date(number, taken_s + delay_s) {
                worst_s = worst_s.max((at_s - taken_s).abs());
                dated += 1;
            }
        }
        (worst_s, dated)
    }

    /// As a program gives them that empties its buffer every 20 ms.
    fn in_bursts(number: i64) -> f64 {
        0.0003 + 0.001 * ((19 - number.rem_euclid(20)) as f64)
    }

    #[test]
    fn samples_in_bursts_are_dated_by_their_number_once_old_ones_are_read() {
        let mut clock = SampleClock::new(PERIOD_S, 0.03);
        // 4 s of old samples come at once, and are read within 0.4 s.
        let old = (0..4000).map(|k| (k, ZERO_S + 0.001 * k as f64, 4.0 - 0.0009 * k as f64));
        assert_eq!(errors(&mut clock, old).1, 0, "what comes out of a buffer does not say when it was taken");
        let (worst_s, dated) = errors(&mut clock, (4000..14_000).map(|k| (k, ZERO_S + 0.001 * k as f64, in_bursts(k))));
        assert!(worst_s < 0.0005 && dated > 7000, "{worst_s} {dated}");
    }

    /// What LinuxCNC 2.9 does: 6 s held up with a buffer of 4 s leave out 2 s, and the numbers go on.
    #[test]
    fn after_samples_without_a_number_none_has_a_wrong_instant() {
        let mut clock = SampleClock::new(PERIOD_S, 0.03);
        assert!(errors(&mut clock, (0..5000).map(|k| (k, ZERO_S + 0.001 * k as f64, in_bursts(k)))).1 > 3000);
        let held_up = (5000..9000).map(|k| (k, ZERO_S + 0.001 * k as f64, 11.0 - 0.001 * k as f64));
        assert!(errors(&mut clock, held_up).0 < 0.001);
        let after = (9000..15_000).map(|k| (k, ZERO_S + 2.0 + 0.001 * k as f64, in_bursts(k)));
        let (worst_s, dated) = errors(&mut clock, after);
        assert!(worst_s < 0.0005 && dated > 4000, "{worst_s} {dated}");
    }

    #[test]
    fn a_servo_thread_that_stood_still_gives_no_wrong_instants() {
        let mut clock = SampleClock::new(PERIOD_S, 0.03);
        let stood_s = |k: i64| if k < 5000 { 0.0 } else { 0.043 };
        let samples = (0..10_000).map(|k| (k, ZERO_S + 0.001 * k as f64 + stood_s(k), in_bursts(k)));
        let (worst_s, dated) = errors(&mut clock, samples);
        assert!(worst_s < 0.0005 && dated > 8000, "{worst_s} {dated}");
    }

    #[test]
    fn a_number_beyond_all_others_is_a_jump_and_no_end() {
        let mut clock = SampleClock::new(PERIOD_S, 0.03);
        for (number, at_s) in [(i64::MAX, ZERO_S), (i64::MIN, ZERO_S), (i64::MAX, ZERO_S + 0.001), (5, ZERO_S)] {
            assert_eq!(clock.date(number, at_s), Dated::NotYet);
        }
    }

    #[test]
    fn numbers_that_jump_or_begin_anew_and_a_slow_servo_clock_are_followed() {
        let mut clock = SampleClock::new(PERIOD_S, 0.03);
        // 100 periods in a million longer.
        let slow = (0..20_000).map(|k| (k, ZERO_S + 0.001_000_1 * k as f64, in_bursts(k)));
        assert!(errors(&mut clock, slow).0 < 0.001);
        assert_eq!(clock.date(0, ZERO_S + 21.0), Dated::Lost(None));
        assert_eq!(clock.date(1, ZERO_S + 21.001), Dated::NotYet);
        let again = (2..4000).map(|k| (k, ZERO_S + 21.0 + 0.001 * k as f64, in_bursts(k)));
        let (worst_s, dated) = errors(&mut clock, again);
        assert!(worst_s < 0.0005 && dated > 2000, "{worst_s} {dated}");
    }
}
