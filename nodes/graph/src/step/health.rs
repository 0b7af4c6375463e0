//! Verdict over the last range residuals: does the model in use still describe the machine?
//!
//! Place in the flow: filled by the monitor's step with residuals (m) and their standard uncertainties (m); read by the
//! monitor node for `/diagnostics` and to know which readings a diagnosis is about.

use abbe_msgs::{Sha256, Stamp};
use std::collections::VecDeque;

/// Residuals from which a verdict is given, where the window is not shorter.
const LEAST: usize = 30;

/// Verdict over the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HealthState {
    /// Too few residuals to say.
    Unknown,
    /// Residuals are as large as their uncertainties say.
    Consistent,
    /// The mean square is larger than chance allows (99.9 %): the model lacks something, or something changed.
    Degraded,
}

/// Residuals of one model since it was last consistent for a whole window.
///
/// They belong to the state that the model does not describe. The readings in which the window filled up with the new
/// state are left out, which keeps those of the old state out as well. A short return to consistency counts as the
/// same state: many effects show in parts of the volume only; but where the squares have exceeded the window's limit from
/// some residual on, for a whole window or longer, the state begins there. A model that is new in use is in this state
/// until it has shown otherwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unsound {
    /// Stamp of the first.
    pub since: Stamp,
    /// Verdict over all of them. A window of a sound model is degraded once in a while, all of them together are not.
    pub state: HealthState,
}

/// Figures behind the verdict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    /// The verdict.
    pub state: HealthState,
    /// The model in use: that of the latest corrected sample. All residuals in the window are its own.
    pub model_sha256: Sha256,
    /// Residuals in the window.
    pub residuals: usize,
    /// Mean of (residual/u)² over the window; `None` while it is empty.
    pub mean_square: Option<f64>,
    /// Rms residual over the window (m); `None` while it is empty.
    pub rms_m: Option<f64>,
    /// Residuals since it was last consistent for a whole window; `None` while it is.
    pub unsound: Option<Unsound>,
    /// Single residuals out of bounds since the start.
    pub out_of_bounds: u64,
    /// Tracer readings that nothing could be predicted for.
    pub unpredicted: u64,
}

/// Verdict on `count` residuals with that mean square of residual/u, where `least` are enough for one.
fn verdict(count: usize, mean_square: f64, least: usize) -> HealthState {
    match count >= least {
        false => HealthState::Unknown,
        true if mean_square > mean_square_limit(count) => HealthState::Degraded,
        true => HealthState::Consistent,
    }
}

/// Mean square of so many residuals that a sound model exceeds once in a thousand times.
fn mean_square_limit(count: usize) -> f64 {
    // χ²/n has variance 2/n: 3.3 deviations above 1.
    1.0 + 3.3 * (2.0 / count.max(1) as f64).sqrt()
}

/// Residuals from one on.
#[derive(Clone, Copy)]
struct Tally {
    since: Stamp,
    count: usize,
    squares: f64,
}

impl Tally {
    fn new(since: Stamp) -> Tally {
        Tally { since, count: 0, squares: 0.0 }
    }

    /// Adds a square. A clock that was set back makes the readings from then on the earlier ones: `since` goes with it,
    /// or they would count as from before the state.
    fn add(&mut self, stamp: Stamp, square: f64) {
        self.since = self.since.min(stamp);
        self.count += 1;
        self.squares += square;
    }

    fn unsound(&self, least: usize) -> Unsound {
        Unsound { since: self.since, state: verdict(self.count, self.squares / self.count as f64, least) }
    }
}

/// The sums behind [`Unsound`]: of all, and of those since the squares began to exceed the window's limit.
///
/// The second one is Page's cumulative sum. A window of a sound model is degraded once in a while, and an effect may set
/// in before the model was consistent for a whole window again; without it the readings between would dilute the effect.
struct Spell {
    all: Tally,
    recent: Tally,
}

/// The last residuals of one model.
pub(super) struct Window {
    length: usize,
    /// Residual and its standard uncertainty (m).
    residuals: VecDeque<(f64, f64)>,
    /// Residuals in a row that left the verdict at consistent.
    consistent: usize,
    spell: Option<Spell>,
}

impl Window {
    pub(super) fn new(length: usize) -> Window {
        Window { length, residuals: VecDeque::new(), consistent: 0, spell: None }
    }

    /// Adds a residual and its standard uncertainty (m).
    pub(super) fn push(&mut self, stamp: Stamp, residual_m: f64, u_m: f64) {
        self.residuals.push_back((residual_m, u_m));
        if self.residuals.len() > self.length {
            self.residuals.pop_front();
        }
        self.consistent = if self.state() == HealthState::Consistent { self.consistent + 1 } else { 0 };
        if self.consistent == 0 {
            self.spell.get_or_insert(Spell { all: Tally::new(stamp), recent: Tally::new(stamp) });
        } else if self.consistent >= self.length {
            self.spell = None;
        }
        if let Some(spell) = &mut self.spell {
            let (square, limit) = ((residual_m / u_m).powi(2), mean_square_limit(self.length));
            let recent = &spell.recent;
            if recent.squares <= recent.count as f64 * limit {
                spell.recent = Tally::new(stamp);
            }
            spell.all.add(stamp, square);
            spell.recent.add(stamp, square);
        }
    }

    pub(super) fn len(&self) -> usize {
        self.residuals.len()
    }

    pub(super) fn unsound(&self) -> Option<Unsound> {
        let Spell { all, recent } = self.spell.as_ref()?;
        // A whole window above its limit is no chance cluster.
        let recent = recent.unsound(self.length.max(LEAST));
        Some(if recent.state == HealthState::Degraded { recent } else { all.unsound(self.least()) })
    }

    /// Residuals from which a verdict is given.
    fn least(&self) -> usize {
        self.length.min(LEAST)
    }

    pub(super) fn state(&self) -> HealthState {
        self.mean_square().map_or(HealthState::Unknown, |mean_square| verdict(self.len(), mean_square, self.least()))
    }

    pub(super) fn mean_square(&self) -> Option<f64> {
        self.mean(|(residual_m, u_m)| (residual_m / u_m).powi(2))
    }

    pub(super) fn rms_m(&self) -> Option<f64> {
        self.mean(|(residual_m, _)| residual_m * residual_m).map(f64::sqrt)
    }

    fn mean(&self, of: impl Fn(&(f64, f64)) -> f64) -> Option<f64> {
        let count = self.residuals.len();
        (count > 0).then(|| self.residuals.iter().map(of).sum::<f64>() / count as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pushes residuals of one second each, all of this many standard uncertainties.
    fn push(window: &mut Window, seconds: std::ops::Range<i32>, deviations: f64) {
        seconds.for_each(|s| window.push(Stamp::new(s, 0).unwrap(), deviations * 1e-6, 1e-6));
    }

    fn since_s(window: &Window) -> Option<f64> {
        window.unsound().map(|unsound| unsound.since.to_seconds())
    }

    #[test]
    fn a_state_begins_where_a_model_that_held_stops_holding() {
        let mut window = Window::new(50);
        push(&mut window, 0..100, 0.9);
        assert_eq!((window.state(), window.unsound()), (HealthState::Consistent, None));
        push(&mut window, 100..160, 5.0);
        let since = since_s(&window).unwrap();
        assert!((100.0..110.0).contains(&since), "{since}");
        assert_eq!((window.state(), window.unsound().unwrap().state), (HealthState::Degraded, HealthState::Degraded));
    }

    #[test]
    fn a_model_that_never_held_is_unsound_from_its_first_residual() {
        let mut window = Window::new(50);
        push(&mut window, 7..80, 5.0);
        assert_eq!(since_s(&window), Some(7.0));
    }

    #[test]
    fn a_short_return_to_consistency_is_the_same_state_and_a_long_one_is_not() {
        let mut window = Window::new(50);
        push(&mut window, 0..100, 0.9);
        push(&mut window, 100..160, 5.0);
        let since = since_s(&window);
        push(&mut window, 160..215, 0.9);
        assert_eq!((window.state(), since_s(&window)), (HealthState::Consistent, since));
        push(&mut window, 215..270, 0.9);
        assert_eq!(window.unsound(), None);
    }

    #[test]
    fn a_state_that_sets_in_soon_after_a_degraded_window_begins_where_it_sets_in() {
        let mut window = Window::new(50);
        push(&mut window, 0..100, 0.9);
        push(&mut window, 100..104, 4.5);
        push(&mut window, 104..180, 0.9);
        assert!(since_s(&window).unwrap() < 104.0);
        push(&mut window, 180..240, 3.0);
        assert_eq!((since_s(&window), window.unsound().unwrap().state), (Some(180.0), HealthState::Degraded));
    }

    #[test]
    fn regress_a_clock_set_back_in_a_state_does_not_leave_its_readings_out() {
        let mut window = Window::new(50);
        push(&mut window, 10_000..10_060, 5.0);
        push(&mut window, 6_400..6_500, 5.0);
        assert_eq!(since_s(&window), Some(6_400.0));
    }

    #[test]
    fn a_window_that_is_degraded_by_chance_does_not_make_the_whole_state_so() {
        let mut window = Window::new(50);
        // Mean square 1.0 over ninety residuals, but 1.7 over a window of 50 that holds all four large ones.
        for start in (0..1800).step_by(90) {
            push(&mut window, start..start + 4, 4.5);
            push(&mut window, start + 4..start + 90, 0.3);
        }
        push(&mut window, 1800..1804, 4.5);
        let unsound = window.unsound().unwrap();
        assert_eq!((window.state(), unsound.state), (HealthState::Degraded, HealthState::Consistent));
    }
}
