//! When each reading of a source is due, and which present instant it has.
//!
//! Place in the flow: in the loop of the scale and the tracer node.

use super::{NodeContext, NodeError};
use crate::launch::{Pace, Source, Stamps};
use crate::present::Present;
use abbe_msgs::Stamp;
use abbe_runtime::ros::Clock;
use abbe_runtime::{Shutdown, agree};
use std::time::{Duration, Instant};

/// How often it is looked what time it is on `/clock`.
const LOOK_EVERY: Duration = Duration::from_millis(2);
/// A source that was held up makes up for it at most so many times faster than its pace: those who take its readings have room
/// for some seconds of them, and a host that stood still for ten would otherwise lose what it plays.
const CATCH_UP: u32 = 4;
/// Readings that are late by less than this are no more than the jitter of the host; they go at once.
const JITTER: Duration = Duration::from_millis(100);
/// Simulated time that goes by between two looks where it does not run but leap (ns).
const LEAP_NS: i128 = 1_000_000_000;
/// Longest that a reading which was leapt over waits for its turn.
const LONGEST_TURN: Duration = Duration::from_millis(10);
/// An agreement older than this is of another launch (ns).
const OLDEST_NS: i64 = 3_600_000_000_000;

/// When each sample is due.
pub(super) struct Schedule {
    pace: Pace,
    start: Instant,
    started_s: f64,
    first: Stamp,
    clock: Clock,
    present: Option<Present>,
    catching_up: CatchingUp,
    leaps: Leaps,
}

/// Whether what this source plays gets present stamps.
fn stamps_now(context: &NodeContext, source: &Source) -> bool {
    context.launch.stamps == Stamps::Now && !source.driver.is_live()
}

/// Whether this source gives a reading when it is due by `/clock`.
pub(super) fn goes_by_clock(context: &NodeContext, source: &Source) -> bool {
    stamps_now(context, source) && context.clock().is_simulated()
}

/// Spreads readings that are overdue.
#[derive(Default)]
struct CatchingUp {
    /// When the last one was due, since the start.
    due: Duration,
    /// Until when the next ones wait, since the start.
    held_until: Duration,
}

impl CatchingUp {
    /// When a reading that is due then may go, as it is `now`; all since the start.
    fn when(&mut self, due: Duration, now: Duration) -> Duration {
        let gap = due.saturating_sub(self.due);
        self.due = due;
        self.held_until = self.held_until.max(now.saturating_sub(JITTER)).saturating_add(gap / CATCH_UP);
        due.max(self.held_until)
    }
}

/// What `/clock` leaps over: forwards, where whoever publishes it skips, and back, where it begins anew.
#[derive(Default)]
struct Leaps {
    /// What it showed last (ns).
    seen_ns: Option<i128>,
    /// When the last reading was due (ns).
    due_ns: i128,
    /// Readings that are due before this were leapt over (ns).
    leapt_to_ns: i128,
}

impl Leaps {
    /// Follows what it shows.
    fn note(&mut self, now_ns: i128) {
        let since_ns = now_ns - self.seen_ns.replace(now_ns).unwrap_or(now_ns);
        if since_ns >= LEAP_NS {
            self.leapt_to_ns = now_ns;
        }
        if since_ns <= -LEAP_NS {
            let back_s = -since_ns as f64 * 1e-9;
            tracing::warn!(
                "/clock went back by {back_s} s; what is played waits until it is where it was. To begin anew, start the launch again"
            );
        }
    }

    /// How long a reading that is due then waits for its turn among all that were leapt over.
    fn turn(&mut self, due_ns: i128) -> Duration {
        let gap_ns = due_ns - std::mem::replace(&mut self.due_ns, due_ns);
        let was_leapt_over = due_ns < self.leapt_to_ns;
        let gap = Duration::from_nanos(u64::try_from(gap_ns).unwrap_or_default()) / CATCH_UP;
        if was_leapt_over { gap.min(LONGEST_TURN) } else { Duration::ZERO }
    }
}

impl Schedule {
    /// Begins with this reading; `None` where the node is told to stop before it knows the time.
    pub(super) fn begin(
        context: &NodeContext,
        source: &Source,
        first: Stamp,
        sequence: u64,
    ) -> Result<Option<Schedule>, NodeError> {
        let (pace, clock) = (source.pace, context.clock());
        let mut schedule = Schedule {
            pace,
            start: Instant::now(),
            started_s: monotonic_s(),
            first,
            clock,
            present: None,
            catching_up: CatchingUp::default(),
            leaps: Leaps::default(),
        };
        if !stamps_now(context, source) {
            return Ok(Some(schedule));
        }
        let Some(at_ns) = schedule.now_ns(&context.shutdown)? else { return Ok(None) };
        let is_simulated = schedule.clock.is_simulated();
        let own = Present { at_ns, recorded_ns: first.to_nanos(), sequence, pace, is_simulated };
        let present = agreed(context, own)?;
        if let Some(problem) = present.problem(pace, is_simulated) {
            return Err(NodeError::Present(problem));
        }
        let ago_ns = at_ns - present.at_ns;
        if !(-OLDEST_NS..=OLDEST_NS).contains(&ago_ns) {
            let problem =
                "the sources of this run agreed about the time an hour ago and more; start the whole launch again";
            return Err(NodeError::Present(problem.to_owned()));
        }
        let ago = Duration::from_nanos(ago_ns.max(0).unsigned_abs());
        schedule.start = schedule.start.checked_sub(ago).unwrap_or(schedule.start);
        schedule.started_s -= ago.as_secs_f64();
        schedule.present = Some(present);
        Ok(Some(schedule))
    }

    /// What is due first was due then, in seconds of the host's monotonic clock.
    pub(super) fn started_s(&self) -> f64 {
        self.started_s
    }

    /// The present stamp of a reading, where it gets one.
    pub(super) fn present_stamp(&self, recorded: Stamp, sequence: u64) -> Result<Option<Stamp>, NodeError> {
        Ok(self.present.as_ref().map(|present| present.stamp(recorded, sequence)).transpose()?)
    }

    /// Sleeps until sample `number` is due; true when told to stop.
    pub(super) fn wait_for(&mut self, number: u64, recorded: Stamp, now: Option<Stamp>, shutdown: &Shutdown) -> bool {
        if let (Some(now), true) = (now, self.clock.is_simulated()) {
            return self.wait_on_clock(now, shutdown);
        }
        let due_s = match (&self.present, now, self.pace) {
            (Some(present), Some(now), _) => (now.to_nanos() - present.at_ns) as f64 * 1e-9,
            (_, _, Pace::RateHz(rate)) => number as f64 / rate,
            (_, _, Pace::AsTheyCome) => 0.0,
            (_, _, Pace::TimeFactor(factor)) => (recorded.to_nanos() - self.first.to_nanos()) as f64 * 1e-9 / factor,
        };
        let due = Duration::try_from_secs_f64(due_s.max(0.0)).unwrap_or(Duration::MAX);
        let elapsed = self.start.elapsed();
        let remaining = self.catching_up.when(due, elapsed).saturating_sub(elapsed);
        if remaining.is_zero() { shutdown.requested() } else { shutdown.sleep(remaining) }
    }

    /// The same by `/clock`, which may stand, or go at another pace than the host's.
    fn wait_on_clock(&mut self, due: Stamp, shutdown: &Shutdown) -> bool {
        let due_ns = i128::from(due.to_nanos());
        loop {
            let now_ns = self.clock.now_ns();
            now_ns.into_iter().for_each(|now_ns| self.leaps.note(now_ns));
            if now_ns.is_some_and(|now_ns| now_ns >= due_ns) {
                break;
            }
            if shutdown.sleep(LOOK_EVERY) {
                return true;
            }
        }
        let turn = self.leaps.turn(due_ns);
        if turn.is_zero() { shutdown.requested() } else { shutdown.sleep(turn) }
    }

    /// The time now, waiting for `/clock` where that is the one to go by; `None` when told to stop.
    fn now_ns(&self, shutdown: &Shutdown) -> Result<Option<i64>, NodeError> {
        loop {
            if let Some(now_ns) = self.clock.now_ns() {
                return i64::try_from(now_ns)
                    .map(Some)
                    .map_err(|_| NodeError::Present("the clock is beyond what a stamp can hold; set it".to_owned()));
            }
            if !self.clock.is_simulated() {
                return Err(NodeError::Present("the system clock is before 1970; set it".to_owned()));
            }
            if shutdown.sleep(LOOK_EVERY) {
                return Ok(None);
            }
        }
    }
}

/// What the first source of this launch said; a source without a run has nobody to agree with.
fn agreed(context: &NodeContext, own: Present) -> Result<Present, NodeError> {
    let Some(run) = &context.whole_run else { return Ok(own) };
    let wrong = |error: String| NodeError::Present(format!("scale and tracer cannot agree about the time: {error}"));
    let word = serde_json::to_string(&own).map_err(|error| wrong(error.to_string()))?;
    // A later launch of the same name is another; one by hand has no launcher.
    let subject = format!("played.{}", context.launcher_pid.unwrap_or_default());
    let said = agree(run, &subject, &word).map_err(|error| wrong(error.to_string()))?;
    serde_json::from_str(&said).map_err(|error| wrong(error.to_string()))
}

/// Seconds of the host's monotonic clock, the same for all processes; for figures, never for data.
pub fn monotonic_s() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// When each of `count` readings goes, one due each ms, on a host that stands still from the first instant until the second.
    fn gone(count: u32, (stands, until): (Duration, Duration)) -> Vec<Duration> {
        let (mut catching_up, mut now) = (CatchingUp::default(), Duration::ZERO);
        (0..count)
            .map(|number| {
                now = now.max(catching_up.when(MS * number, now));
                if now >= stands && now < until {
                    now = until;
                }
                now
            })
            .collect()
    }

    #[test]
    fn a_host_that_stood_still_gives_its_readings_at_four_times_the_pace_until_it_is_on_time() {
        let gone = gone(20_000, (MS * 1000, MS * 11_000));
        let within = |from: Duration, to: Duration| gone.iter().filter(|at| (from..to).contains(at)).count();
        assert_eq!(gone[999], MS * 999);
        // Of the 10,000 that are overdue only those of a moment go together.
        assert!((400..=410).contains(&within(MS * 11_000, MS * 11_001)), "{}", within(MS * 11_000, MS * 11_001));
        assert!((4000..=4410).contains(&within(MS * 11_000, MS * 12_000)), "{}", within(MS * 11_000, MS * 12_000));
        assert_eq!(gone[19_000], MS * 19_000, "it is on time again");
    }

    #[test]
    fn readings_that_are_late_by_jitter_go_at_once() {
        let gone = gone(1000, (MS * 100, MS * 150));
        assert_eq!(gone[101..=150], [MS * 150; 50]);
        assert_eq!(gone[151], MS * 151);
    }

    #[test]
    fn readings_that_the_clock_leaps_over_come_in_turn_and_those_of_a_fast_clock_at_once() {
        let (mut leaps, s) = (Leaps::default(), |seconds: i128| seconds * 1_000_000_000);
        leaps.note(s(100));
        assert_eq!(leaps.turn(s(100)), Duration::ZERO);
        // Twenty times as fast as the host's, told 50 times a second.
        leaps.note(s(100) + 400_000_000);
        assert_eq!(leaps.turn(s(100) + 1_000_000), Duration::ZERO);
        leaps.note(s(160));
        assert_eq!(leaps.turn(s(100) + 2_000_000), MS / CATCH_UP, "a leap of a minute");
        assert_eq!(leaps.turn(s(150)), LONGEST_TURN, "a recording with a gap");
        assert_eq!(leaps.turn(s(160)), Duration::ZERO, "on time again");
        leaps.note(s(90));
        assert_eq!(leaps.turn(s(160) + 1), Duration::ZERO, "once it is there again");
    }

    #[test]
    fn a_pace_that_the_host_cannot_keep_is_not_held_back() {
        let (mut catching_up, pace) = (CatchingUp::default(), Duration::from_nanos(100));
        for number in 1..1_000_000_u32 {
            let now = Duration::from_micros(2) * number;
            assert!(catching_up.when(pace * number, now) <= now);
        }
    }
}
