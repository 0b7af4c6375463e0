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
/// Longest that a reading adds to the wait of those behind it, by `/clock`: a hundred readings a second flood nobody.
const LONGEST_TURN: Duration = Duration::from_millis(10);
/// Over how long it is measured, at least, how fast `/clock` goes.
const MEASURED_OVER: Duration = Duration::from_millis(500);
/// Simulated time by which `/clock` goes back from where it is said (ns).
const BACK_NS: i128 = 1_000_000_000;
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
    /// Present instant (ns) before which readings are passed over: the node was closed then, and the other source went on.
    goes_on_from_ns: Option<i64>,
    catching_up: CatchingUp,
    simulated: Simulated,
}

/// Whether what this source plays gets present stamps.
fn stamps_now(context: &NodeContext, source: &Source) -> bool {
    context.launch.stamps() == Stamps::Now && !source.driver.is_live()
}

/// Whether this source gives a reading when it is due by `/clock`.
pub(super) fn goes_by_clock(context: &NodeContext, source: &Source) -> bool {
    stamps_now(context, source) && context.clock().is_simulated()
}

/// Spreads readings that are overdue. All instants are of the host's clock, since the start.
#[derive(Default)]
struct CatchingUp {
    /// When the last one was due.
    due: Duration,
    /// Until when the next ones wait.
    held_until: Duration,
}

impl CatchingUp {
    /// When a reading that is due then may go, as it is `now`.
    fn when(&mut self, due: Duration, now: Duration) -> Duration {
        let gap = due.saturating_sub(self.due);
        self.due = due;
        due.max(self.turn(gap, now))
    }

    /// When a reading may go that is due already, and was due so long after the one before it.
    fn turn(&mut self, gap: Duration, now: Duration) -> Duration {
        self.held_until = self.held_until.max(now.saturating_sub(JITTER)).saturating_add(gap / CATCH_UP);
        self.held_until
    }
}

/// `/clock`, and what is due by it: how fast it goes, when it is set back, and how readings that it leapt over are spread.
struct Simulated {
    /// When the last reading was due (ns).
    due_ns: Option<i128>,
    /// What it showed last (ns).
    seen_ns: Option<i128>,
    /// What it showed when measuring began (ns), and when that was by the host's clock, since the start.
    since: Option<(i128, Duration)>,
    /// How many times as fast as the host's clock it went, the last three times.
    paces: [f64; 3],
}

impl Simulated {
    fn new() -> Simulated {
        Simulated { due_ns: None, seen_ns: None, since: None, paces: [1.0; 3] }
    }

    /// When a reading that is due by it then may go, as it shows `now_ns` and the host's clock `now`; none before it is due.
    fn when(&mut self, due_ns: i128, now_ns: i128, now: Duration, catching_up: &mut CatchingUp) -> Option<Duration> {
        self.note(now_ns, now);
        (now_ns >= due_ns).then(|| {
            let gap_ns = due_ns - self.due_ns.replace(due_ns).unwrap_or(due_ns);
            catching_up.turn(self.of_host(gap_ns).min(LONGEST_TURN * CATCH_UP), now)
        })
    }

    /// Follows what it shows.
    fn note(&mut self, now_ns: i128, now: Duration) {
        let step_ns = now_ns - self.seen_ns.replace(now_ns).unwrap_or(now_ns);
        if step_ns <= -BACK_NS {
            let back_s = -step_ns as f64 * 1e-9;
            tracing::warn!(
                "/clock went back by {back_s} s; what is played waits until it is where it was. To begin anew, start the launch again"
            );
        }
        let (since_ns, since) = *self.since.get_or_insert((now_ns, now));
        let elapsed = now.saturating_sub(since);
        if step_ns < 0 {
            self.since = Some((now_ns, now));
        } else if step_ns > 0 && elapsed >= MEASURED_OVER {
            self.paces.rotate_left(1);
            self.paces[2] = (now_ns - since_ns) as f64 * 1e-9 / elapsed.as_secs_f64();
            self.since = Some((now_ns, now));
        }
    }

    /// So much of its time, as it is of the host's where it is the faster one. The middle of three measurements counts: one in
    /// which it leapt, or stood, says nothing of how it goes.
    fn of_host(&self, gap_ns: i128) -> Duration {
        let mut paces = self.paces;
        paces.sort_by(f64::total_cmp);
        let gap_s = gap_ns.max(0) as f64 * 1e-9 / paces[1].max(1.0);
        Duration::try_from_secs_f64(gap_s).unwrap_or(Duration::MAX)
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
            goes_on_from_ns: None,
            catching_up: CatchingUp::default(),
            simulated: Simulated::new(),
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
        let goes_on = context.is_configured_again() && is_of_two(context);
        schedule.goes_on_from_ns = goes_on.then_some(at_ns);
        if !goes_on && !(-OLDEST_NS..=OLDEST_NS).contains(&ago_ns) {
            let problem =
                "the sources of this run agreed about the time an hour ago and more; start the whole launch again";
            return Err(NodeError::Present(problem.to_owned()));
        }
        let ago = Duration::from_nanos(ago_ns.max(0).unsigned_abs());
        schedule.start = schedule.start.checked_sub(ago).unwrap_or(schedule.start);
        schedule.started_s -= ago.as_secs_f64();
        if goes_on {
            // What is passed over is not waited for.
            schedule.catching_up.due = ago;
        }
        schedule.present = Some(present);
        Ok(Some(schedule))
    }

    /// What is due first was due then, in seconds of the host's monotonic clock.
    pub(super) fn started_s(&self) -> f64 {
        self.started_s
    }

    /// Whether a reading was due while the node was closed, and the other source of its recording went on.
    pub(super) fn has_passed(&self, now: Option<Stamp>) -> bool {
        now.zip(self.goes_on_from_ns).is_some_and(|(now, from_ns)| now.to_nanos() < from_ns)
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
        sleep(self.catching_up.when(due, elapsed), elapsed, shutdown)
    }

    /// The same by `/clock`, which may stand, leap, or go at another pace than the host's.
    fn wait_on_clock(&mut self, due: Stamp, shutdown: &Shutdown) -> bool {
        let due_ns = i128::from(due.to_nanos());
        loop {
            let (now_ns, elapsed) = (self.clock.now_ns(), self.start.elapsed());
            let when = |now_ns| self.simulated.when(due_ns, now_ns, elapsed, &mut self.catching_up);
            if let Some(at) = now_ns.and_then(when) {
                return sleep(at, elapsed, shutdown);
            }
            if shutdown.sleep(LOOK_EVERY) {
                return true;
            }
        }
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

/// Sleeps until then; true when told to stop.
fn sleep(until: Duration, now: Duration, shutdown: &Shutdown) -> bool {
    let remaining = until.saturating_sub(now);
    if remaining.is_zero() { shutdown.requested() } else { shutdown.sleep(remaining) }
}

/// Whether scale and tracer both play: what they have agreed about holds as long as the launch.
fn is_of_two(context: &NodeContext) -> bool {
    context.launch.played().count() == 2
}

/// What the first source of this launch said. A source without a run has nobody to agree with; one that is alone and is configured again
/// begins anew.
fn agreed(context: &NodeContext, own: Present) -> Result<Present, NodeError> {
    let Some(run) = context.whole_run.as_ref().filter(|_| !context.is_configured_again() || is_of_two(context)) else {
        return Ok(own);
    };
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

    /// When readings go that are due each ms by a clock that shows `clock` (ms) after each ms of the host's; each sleep lasts
    /// `late` too long.
    fn gone_by(clock: impl Fn(u64) -> u64, late: Duration, until: Duration) -> Vec<Duration> {
        let (mut simulated, mut catching_up) = (Simulated::new(), CatchingUp::default());
        let (mut now, mut gone) = (Duration::ZERO, Vec::new());
        while now < until {
            let shows = |now: Duration| i128::from(clock(now.as_millis() as u64)) * 1_000_000;
            match simulated.when(gone.len() as i128 * 1_000_000, shows(now), now, &mut catching_up) {
                Some(at) if at > now => now = at + late,
                Some(_) => {}
                None => {
                    now += LOOK_EVERY + late;
                    continue;
                }
            }
            gone.push(now);
        }
        gone
    }

    /// The most of them that go within a tenth of a second.
    fn densest(gone: &[Duration]) -> usize {
        gone.iter()
            .enumerate()
            .map(|(first, from)| gone[first..].partition_point(|at| *at < *from + MS * 100))
            .max()
            .unwrap()
    }

    #[test]
    fn readings_that_the_clock_leaps_over_come_at_four_times_the_pace_until_they_are_on_time() {
        // It is told a hundred times a second, and leaps by a minute when a second has gone by.
        let clock = |ms: u64| if ms < 1000 { ms / 10 * 10 } else { ms / 10 * 10 + 60_000 };
        for late in [Duration::ZERO, Duration::from_micros(60), MS * 5] {
            let gone = gone_by(clock, late, MS * 30_000);
            assert!(densest(&gone) <= 810, "{late:?}: {} of what takers have room for", densest(&gone));
            // 60 s at three times its pace beyond what the clock goes on by.
            let is_late = |number: usize| gone[number] > MS * (number as u32 - 60_000 + 20);
            assert!(is_late(61_000 + 18_000) && !is_late(61_000 + 21_000), "{late:?}");
        }
    }

    #[test]
    fn a_clock_that_goes_faster_than_the_hosts_or_in_long_steps_is_kept_up_with() {
        // Ten times a second by 2 s, a hundred times a second by 200 ms, once a second by 1 s, once in 5 s by 5 s.
        for (every_ms, step_ms) in [(100, 2000), (10, 200), (1000, 1000), (5000, 5000)] {
            let clock = |ms: u64| ms / every_ms * step_ms;
            let gone = gone_by(clock, Duration::ZERO, MS * 20_000);
            let told_last = MS * (19_999 / every_ms * every_ms) as u32;
            let before = gone.partition_point(|at| *at < told_last) as u64;
            assert_eq!(before, 1 + clock(19_999) - step_ms, "all that was due by {step_ms} ms before has gone");
        }
    }

    #[test]
    fn a_clock_that_leaps_while_it_goes_fast_is_caught_up_with() {
        let clock = |ms: u64| ms / 10 * 200 + if ms < 5000 { 0 } else { 600_000 };
        let gone = gone_by(clock, Duration::ZERO, MS * 30_000);
        assert!(gone.len() as u64 > clock(29_980), "{} of {}", gone.len(), clock(29_980));
        // Four times twenty readings a millisecond, and those of a moment.
        assert!(densest(&gone) <= 16_100, "{}", densest(&gone));
    }

    #[test]
    fn a_clock_that_stood_is_followed_as_soon_as_it_goes_on() {
        let clock = |ms: u64| if ms < 5000 { ms } else { ms.max(60_000) - 55_000 };
        let gone = gone_by(clock, Duration::ZERO, MS * 70_000);
        assert!(gone[5000..].iter().zip(60_000..).all(|(at, due_ms)| *at <= MS * due_ms + LOOK_EVERY));
        assert!(gone.iter().all(|at| *at <= MS * 5002 || *at > MS * 60_000));
    }

    #[test]
    fn readings_far_apart_that_the_clock_leaps_over_come_a_hundred_a_second() {
        let (mut simulated, mut catching_up) = (Simulated::new(), CatchingUp::default());
        let mut when = |due_s: i128, now_s: i128, now| {
            simulated.when(due_s * 1_000_000_000, now_s * 1_000_000_000, now, &mut catching_up)
        };
        assert_eq!(when(0, 0, MS * 1000), Some(MS * 900));
        assert_eq!(when(3600, 0, MS * 1000), None);
        assert_eq!(when(3600, 9000, MS * 2000), Some(MS * 1910));
        assert_eq!(when(7200, 9000, MS * 2000), Some(MS * 1920));
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
