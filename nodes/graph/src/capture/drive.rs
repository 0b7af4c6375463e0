//! Driving the machine through the open points of a plan: where to go next, when, and when not without asking.
//!
//! Place in the flow: [`super::run`] asks what to order and tells what became of it; a [`Mover`](crate::driver::Mover) moves. Off unless the
//! capture file has a table `[drive]`. Pure: time comes in. Before each set-up, after each refusal and after each loss of the
//! connection somebody has to say that it may move. A set-up is left when all of its points are captured. Readings of the scales, m.

use super::config::{CaptureConfig, ConfigError, DriveConfig};
use super::planned::{Planned, distance_m};
use super::step::{Capturer, LATE_S, mm};
use crate::driver::{Order, Outcome, SessionNumber};
use abbe_geometry::machine::Machine;
use std::collections::VecDeque;

/// Passes over the points of a set-up before somebody is asked.
const PASSES: u32 = 2;
/// Time that a machine may tremble after a move (s), where the file says nothing of it.
const TREMBLES_S: f64 = 2.0;

/// What is done.
#[derive(Debug, Clone, PartialEq)]
enum State {
    /// Somebody has to say that it may move.
    Asking,
    /// The machine is looked at.
    Readying,
    /// On the way to a point, over the places that are left.
    Moving { to: usize, legs: VecDeque<[f64; 3]> },
    /// At a point, until its reading is there or is not waited for any more (s).
    Standing { point: usize, until_s: f64 },
    /// All points are captured.
    Over,
}

/// What follows.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Step {
    /// To be ordered.
    Order(Order),
    /// To be said.
    Say(String),
    /// It cannot go on.
    Stop(String),
}

/// Drives through a plan.
pub(super) struct Driving {
    config: DriveConfig,
    wait_s: f64,
    stroke_m: [(f64, f64); 3],
    state: State,
    session: SessionNumber,
    set_up: usize,
    /// Points of this pass that are still to be gone to.
    ahead: VecDeque<usize>,
    passes: u32,
    /// Where the machine is known to stand (m), and at which point.
    at: Option<([f64; 3], Option<usize>)>,
}

impl DriveConfig {
    /// Whether plan and machine allow what is asked for.
    ///
    /// # Errors
    /// The key that is wrong, and what to do.
    pub fn check(&self, planned: &Planned, machine: &Machine) -> Result<(), ConfigError> {
        let Some(over_mm) = self.over_z_mm else { return Ok(()) };
        let highest_mm = (0..planned.len()).map(|point| planned.reading_m(point)[2] * 1e3).fold(f64::MIN, f64::max);
        let top_mm = machine.stroke_m[2].1 * 1e3;
        match (highest_mm..=top_mm + 1e-3).contains(&over_mm) {
            true => Ok(()),
            false => Err(ConfigError {
                key: "drive.over_z_mm".to_owned(),
                problem: format!(
                    "must be between {highest_mm:.3}, the highest point of the plan, and {top_mm:.3}, the end of the stroke"
                ),
            }),
        }
    }

    fn speed_m_s(&self) -> f64 {
        self.speed_mm_s / 1e3
    }

    /// Places on the way to a point; the last is the point.
    fn legs(&self, planned: &Planned, at: Option<([f64; 3], Option<usize>)>, to: usize) -> VecDeque<[f64; 3]> {
        let target_m = planned.reading_m(to);
        let follows = |from: usize| planned.points_line(from) == planned.points_line(to) && from.abs_diff(to) == 1;
        match (self.over_z_mm.map(|mm| mm / 1e3), at) {
            (Some(over_m), Some((from_m, from))) if !from.is_some_and(follows) => {
                let above = |at_m: [f64; 3]| [at_m[0], at_m[1], over_m];
                [above(from_m), above(target_m), target_m].into()
            }
            _ => [target_m].into(),
        }
    }
}

impl Driving {
    pub(super) fn new(config: &CaptureConfig, drive: &DriveConfig, machine: &Machine) -> Driving {
        let usual_s = 2.0 * config.standstill.longest_s + LATE_S + TREMBLES_S;
        Driving {
            config: *drive,
            wait_s: drive.wait_s.unwrap_or(usual_s),
            stroke_m: machine.stroke_m,
            state: State::Asking,
            session: 0,
            set_up: 0,
            ahead: VecDeque::new(),
            passes: 0,
            at: None,
        }
    }

    /// Looks at what is open, and asks; to be called once at the beginning.
    pub(super) fn begin(&mut self, capturer: &Capturer) -> Vec<Step> {
        self.next_set_up(capturer)
    }

    /// Whether it waits for somebody.
    pub(super) fn is_asking(&self) -> bool {
        self.state == State::Asking
    }

    /// Whether an order is out whose outcome is not known.
    pub(super) fn is_under_way(&self) -> bool {
        matches!(self.state, State::Readying | State::Moving { .. })
    }

    /// What was to be ordered is not ordered any more.
    pub(super) fn halt(&mut self) {
        self.state = State::Asking;
    }

    /// The set-up that it drives.
    pub(super) fn set_up(&self) -> usize {
        self.set_up
    }

    /// Somebody says that it may move.
    pub(super) fn confirm(&mut self) -> Vec<Step> {
        if !self.is_asking() {
            return vec![Step::Say("nothing was asked; the machine is driven already".to_owned())];
        }
        self.state = State::Readying;
        vec![Step::Order(Order::Ready { speed_m_s: self.config.speed_m_s(), stroke_m: self.stroke_m })]
    }

    /// What became of an order.
    pub(super) fn outcome(&mut self, outcome: Outcome, capturer: &Capturer, now_s: f64) -> Vec<Step> {
        match (outcome, std::mem::replace(&mut self.state, State::Asking)) {
            (Outcome::Ready(session, at_m), State::Readying) => {
                (self.session, self.at) = (session, Some((at_m, None)));
                self.go_on(capturer)
            }
            (Outcome::Arrived, State::Moving { to, mut legs }) => {
                if let Some(at_m) = legs.pop_front() {
                    self.at = Some((at_m, legs.is_empty().then_some(to)));
                }
                match legs.front().copied() {
                    Some(next_m) => {
                        self.state = State::Moving { to, legs };
                        vec![self.order(next_m, to, capturer)]
                    }
                    None => {
                        self.state = State::Standing { point: to, until_s: now_s + self.wait_s };
                        Vec::new()
                    }
                }
            }
            (Outcome::Refused(why), State::Moving { to, .. }) => {
                self.ahead.push_front(to);
                self.ask(capturer, &format!("the machine was not moved: {why}"))
            }
            (Outcome::Refused(why), _) => self.ask(capturer, &format!("the machine is not moved: {why}")),
            (Outcome::Lost(why), State::Moving { to, .. }) => {
                self.ahead.push_front(to);
                self.ask(capturer, &format!("{why}; see where the machine stands, and that it stands"))
            }
            (Outcome::Lost(why), _) => self.ask(capturer, &why),
            (Outcome::Stopped(why), _) => vec![Step::Stop(why)],
            (other, state) => {
                self.state = state;
                vec![Step::Stop(format!("the driver answers what was not ordered ({other:?})"))]
            }
        }
    }

    /// Looks whether the point at which it stands is captured.
    pub(super) fn look(&mut self, capturer: &Capturer, now_s: f64) -> Vec<Step> {
        let State::Standing { point, until_s } = self.state else { return Vec::new() };
        if capturer.is_done(point) {
            return self.go_on(capturer);
        }
        if now_s < until_s {
            return Vec::new();
        }
        let words = format!("no reading at {} within {:.1} s", capturer.planned().words(point), self.wait_s);
        let mut steps = vec![Step::Say(words)];
        steps.extend(self.go_on(capturer));
        steps
    }

    /// To the next open point, or what comes after the last.
    fn go_on(&mut self, capturer: &Capturer) -> Vec<Step> {
        loop {
            match self.ahead.pop_front() {
                Some(point) if capturer.is_done(point) => {}
                Some(point) => {
                    let legs = self.config.legs(capturer.planned(), self.at, point);
                    let first_m = legs[0];
                    self.state = State::Moving { to: point, legs };
                    return vec![self.order(first_m, point, capturer)];
                }
                None => break,
            }
        }
        let open = self.open(capturer);
        if open.is_empty() {
            return self.next_set_up(capturer);
        }
        self.passes += 1;
        if self.passes < PASSES {
            self.ahead = open.into();
            let mut steps =
                vec![Step::Say(format!("{} points gave no reading; they are driven again", self.ahead.len()))];
            steps.extend(self.go_on(capturer));
            return steps;
        }
        self.passes = 0;
        let words = format!("{} points of this set-up give no reading; see why", open.len());
        self.ahead = open.into();
        self.ask(capturer, &words)
    }

    fn open(&self, capturer: &Capturer) -> Vec<usize> {
        let points = capturer.planned().set_ups[self.set_up].points.clone();
        points.filter(|point| !capturer.is_done(*point)).collect()
    }

    /// Asks for the next set-up with open points.
    fn next_set_up(&mut self, capturer: &Capturer) -> Vec<Step> {
        let all = capturer.planned().set_ups.len();
        let found = (0..all).find(|set_up| {
            self.set_up = *set_up;
            !self.open(capturer).is_empty()
        });
        if found.is_none() {
            self.state = State::Over;
            return Vec::new();
        }
        (self.ahead, self.passes) = (self.open(capturer).into(), 0);
        let words = format!("set-up {} of {all}: {}", self.set_up + 1, capturer.set_up_words(self.set_up));
        self.ask(capturer, &words)
    }

    fn ask(&mut self, capturer: &Capturer, why: &str) -> Vec<Step> {
        self.state = State::Asking;
        let ahead: Vec<usize> = self.ahead.iter().copied().filter(|point| !capturer.is_done(*point)).collect();
        let first = ahead.first().map_or(String::new(), |point| {
            let over = match self.config.over_z_mm {
                Some(mm) => format!(", up to Z = {mm:.3} mm, across and down"),
                None => ", in a straight line".to_owned(),
            };
            format!(
                "Press Enter, and the machine moves by itself at {} mm/s: from where it stands{over} to {} at X, Y, Z = {} mm, then to {} \
                 more. Nothing here sees what stands in its way",
                self.config.speed_mm_s,
                capturer.planned().words(*point),
                mm(&capturer.planned().reading_m(*point)),
                ahead.len() - 1
            )
        });
        vec![Step::Say(format!("{why}. {first}"))]
    }

    fn order(&self, reading_m: [f64; 3], to: usize, capturer: &Capturer) -> Step {
        let planned = capturer.planned();
        let offset_m = capturer.tells_offset().then(|| planned.line(to).offset_m);
        Step::Order(Order::Go { session: self.session, reading_m, offset_m, within_m: planned.within_m() })
    }
}

/// The moves through all points that are open, in words; nothing is opened and nothing moves.
pub fn preview(capturer: &Capturer, drive: &DriveConfig) -> Vec<String> {
    let planned = capturer.planned();
    let (mut words, mut way_m, mut moves) = (Vec::new(), 0.0, 0);
    let mut bounds_m = [(f64::INFINITY, f64::NEG_INFINITY); 3];
    for (number, set_up) in planned.set_ups.iter().enumerate() {
        let open: Vec<usize> = set_up.points.clone().filter(|point| !capturer.is_done(*point)).collect();
        if open.is_empty() {
            continue;
        }
        let all = planned.set_ups.len();
        words.push(format!("set-up {} of {all}: {}; asks first", number + 1, capturer.set_up_words(number)));
        // Where it stands then is not known: somebody may have moved it.
        let mut at = None;
        for to in open {
            for to_m in drive.legs(planned, at, to) {
                moves += 1;
                way_m += at.map_or(0.0, |(from_m, _)| distance_m(&from_m, &to_m));
                for (bounds_m, m) in bounds_m.iter_mut().zip(to_m) {
                    *bounds_m = (bounds_m.0.min(m), bounds_m.1.max(m));
                }
                let what = if to_m == planned.reading_m(to) { planned.words(to) } else { "on the way".to_owned() };
                let from = match (at, drive.over_z_mm) {
                    (None, Some(mm)) => {
                        format!(", from where the machine stands, up to Z = {mm:.3} mm, across and down")
                    }
                    (None, None) => ", from where the machine stands".to_owned(),
                    (Some(_), _) => String::new(),
                };
                words.push(format!("{moves:6}  X, Y, Z = {} mm  {what}{from}", mm(&to_m)));
                at = Some((to_m, Some(to)));
            }
        }
    }
    if moves == 0 {
        words.push("all points are captured; nothing is left to drive".to_owned());
        return words;
    }
    let [x, y, z] = bounds_m.map(|(low_m, high_m)| format!("{:.3} to {:.3}", low_m * 1e3, high_m * 1e3));
    words.push(format!(
        "{moves} moves, {:.3} m between the points, {:.1} min on the way at {} mm/s; X {x}, Y {y}, Z {z} mm (scales)",
        way_m,
        way_m / drive.speed_m_s() / 60.0,
        drive.speed_mm_s
    ));
    words
}
