//! Whether a machine stands still, told from the stream of its scales alone.
//!
//! Place in the flow: capturing a campaign averages over a standstill, so it has to know when one begins and ends. A machine
//! stands still where its scales stay within a span, and where the straight line through them has no more slope than a creep
//! that is allowed, both for long enough. Vibration beyond the span, a slow creep and a ring that dies away are no standstill.
//! A pause of the stream, or a clock that goes back, ends one. Readings in m, times in s.

use std::collections::VecDeque;

/// What counts as a standstill.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandstillSettings {
    /// Span of each axis at most (m): above the noise of the scales and the tremble of a standing axis.
    pub span_m: f64,
    /// Way along the straight line through the readings of an axis at most (m).
    pub creep_m: f64,
    /// Shortest standstill (s).
    pub shortest_s: f64,
    /// Time of it that is kept (s); a machine may stand for hours.
    pub longest_s: f64,
    /// Longest pause between two readings (s).
    pub pause_s: f64,
}

/// A reading of the scales.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scaled {
    /// When (s).
    pub time_s: f64,
    /// Indicated axis positions (m).
    pub reading_m: [f64; 3],
}

/// The machine stood still from the first to the last of these readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Rest {
    /// At least two, in the order of time.
    pub scales: Vec<Scaled>,
}

impl Rest {
    /// First and last instant (s).
    pub fn ends_s(&self) -> (f64, f64) {
        let at = |scaled: Option<&Scaled>| scaled.map_or(0.0, |scaled| scaled.time_s);
        (at(self.scales.first()), at(self.scales.last()))
    }

    /// The readings between two instants (s).
    pub fn between(&self, from_s: f64, to_s: f64) -> impl Iterator<Item = &Scaled> {
        self.scales.iter().filter(move |scaled| (from_s..=to_s).contains(&scaled.time_s))
    }
}

/// What a reading of the scales brought.
#[derive(Debug, Clone, PartialEq)]
pub enum Change {
    /// The machine moves, or has not stood for long enough yet.
    Moving,
    /// It stands still.
    Standing,
    /// It stood still until just before this reading.
    Left(Rest),
    /// The stamp is that of the reading before, or earlier: the reading is not used.
    NotLater,
}

/// The stream so far.
#[derive(Debug, Clone)]
pub struct Standstill {
    settings: StandstillSettings,
    scales: VecDeque<Scaled>,
    last_s: Option<f64>,
    is_standing: bool,
}

impl Standstill {
    /// Of a stream that has not begun.
    pub fn new(settings: StandstillSettings) -> Standstill {
        Standstill { settings, scales: VecDeque::new(), last_s: None, is_standing: false }
    }

    /// Takes the next reading.
    pub fn push(&mut self, scaled: Scaled) -> Change {
        if self.last_s.is_some_and(|last_s| scaled.time_s <= last_s) || !is_number(&scaled) {
            return Change::NotLater;
        }
        let paused = self.last_s.is_some_and(|last_s| scaled.time_s - last_s > self.settings.pause_s);
        self.last_s = Some(scaled.time_s);
        if paused {
            let rest = self.take();
            self.scales.push_back(scaled);
            return rest.map_or(Change::Moving, Change::Left);
        }
        match self.is_standing {
            true => self.go_on(scaled),
            false => self.settle(scaled),
        }
    }

    /// The standstill so far, where the machine stands.
    pub fn rest(&self) -> Option<Rest> {
        self.is_standing.then(|| Rest { scales: self.scales.iter().copied().collect() })
    }

    /// How long it lasts already (s); nothing where the machine moves.
    pub fn lasts_s(&self) -> Option<f64> {
        self.is_standing.then(|| self.last_s.unwrap_or(0.0) - self.scales.front().map_or(0.0, |first| first.time_s))
    }

    /// Begins anew, as after a clock that was set back.
    pub fn forget(&mut self) {
        *self = Standstill::new(self.settings);
    }

    fn take(&mut self) -> Option<Rest> {
        let rest = self.rest();
        self.scales.clear();
        self.is_standing = false;
        rest
    }

    /// The machine stood: does it still?
    fn go_on(&mut self, scaled: Scaled) -> Change {
        let is_full = self.kept_s() >= self.settings.longest_s;
        self.scales.push_back(scaled);
        let stays = self.is_narrow() && (is_full || self.creep_m() <= self.settings.creep_m);
        if stays {
            if is_full {
                // What is kept is what it is judged by: a creep over hours leaves it.
                self.scales.pop_back();
            }
            return Change::Standing;
        }
        self.scales.pop_back();
        let rest = self.take();
        self.scales.push_back(scaled);
        rest.map_or(Change::Moving, Change::Left)
    }

    /// The machine moved: has it come to rest? What is left of the readings is as old as it may be.
    fn settle(&mut self, scaled: Scaled) -> Change {
        self.scales.push_back(scaled);
        while !self.is_narrow() {
            self.scales.pop_front();
        }
        while self.kept_s() >= self.settings.shortest_s && self.scales.len() > 2 {
            if self.creep_m() <= self.settings.creep_m {
                self.is_standing = true;
                return Change::Standing;
            }
            self.scales.pop_front();
        }
        Change::Moving
    }

    fn kept_s(&self) -> f64 {
        match (self.scales.front(), self.scales.back()) {
            (Some(first), Some(last)) => last.time_s - first.time_s,
            _ => 0.0,
        }
    }

    fn is_narrow(&self) -> bool {
        (0..3).all(|d| {
            let ends = self.scales.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), scaled| {
                (low.min(scaled.reading_m[d]), high.max(scaled.reading_m[d]))
            });
            ends.1 - ends.0 <= self.settings.span_m
        })
    }

    /// The longest way of an axis along the straight line through its readings (m).
    fn creep_m(&self) -> f64 {
        let times: Vec<f64> = self.scales.iter().map(|scaled| scaled.time_s).collect();
        let of = |d: usize| {
            let values: Vec<f64> = self.scales.iter().map(|scaled| scaled.reading_m[d]).collect();
            drift(&times, &values).abs()
        };
        (0..3).map(of).fold(0.0, f64::max)
    }
}

/// The way along the straight line through values at these times (s), from the first time to the last; 0 where there is no line.
pub fn drift(times_s: &[f64], values: &[f64]) -> f64 {
    let count = times_s.len().min(values.len()) as f64;
    let (Some(first_s), Some(last_s), Some(first)) = (times_s.first(), times_s.last(), values.first()) else {
        return 0.0;
    };
    // From the first on: times since 1970 and metres would leave no digits.
    let pairs = || times_s.iter().zip(values).map(|(time_s, value)| (time_s - first_s, value - first));
    let mean_s = pairs().map(|(t, _)| t).sum::<f64>() / count;
    let mean = pairs().map(|(_, v)| v).sum::<f64>() / count;
    let square = pairs().map(|(t, _)| (t - mean_s).powi(2)).sum::<f64>();
    let product = pairs().map(|(t, v)| (t - mean_s) * (v - mean)).sum::<f64>();
    if square > 0.0 { product / square * (last_s - first_s) } else { 0.0 }
}

fn is_number(scaled: &Scaled) -> bool {
    scaled.time_s.is_finite() && scaled.reading_m.iter().all(|value| value.is_finite())
}

#[cfg(test)]
mod tests;
