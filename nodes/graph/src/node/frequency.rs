//! How often a node publishes, on `/diagnostics`, in the words of `diagnostic_updater`.
//!
//! Place in the flow: counted where a sample is sent, told once a second from a thread of its own, so that a source that waits
//! for its driver is told of all the same. Tools that know `FrequencyStatus` find its keys. A source that goes by `/clock` is judged
//! by it: where simulated time goes slowly, so do its readings.

use super::schedule::{goes_by_clock, monotonic_s};
use super::{NodeContext, NodeError};
use crate::launch::{NodeName, Pace, Source};
use abbe_msgs::standard::DiagnosticStatus;
use abbe_runtime::ros::Clock;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

/// Component, as `diagnostic_updater` calls it.
const COMPONENT: &str = "Frequency Status";
/// How often it is told.
const REPORT_EVERY: Duration = Duration::from_secs(1);
/// Reports that a window goes back.
const WINDOW: usize = 5;
/// Share of the rate that is asked for by which a rate may differ.
const TOLERANCE: f64 = 0.1;

/// Counts what is sent from now on and tells how often, until the node stops.
pub(super) fn watch(context: &NodeContext) -> Result<Arc<AtomicU64>, NodeError> {
    let sent = Arc::new(AtomicU64::new(0));
    let Some(node) = &context.ros else { return Ok(sent) };
    let (health, shutdown) = (node.diagnostics(&context.machine.machine.name), context.shutdown.clone());
    let source = source(context);
    let clock = source.filter(|source| goes_by_clock(context, source)).map(|_| context.clock());
    let now_s = move || clock.as_ref().map_or_else(|| Some(monotonic_s()), simulated_s);
    let mut rate = Rate::new(source.and_then(wanted_hz), now_s());
    let counted = Arc::clone(&sent);
    let telling = move || {
        while !shutdown.sleep_beside(REPORT_EVERY) {
            let (level, message, figures) = rate.look(counted.load(Ordering::Relaxed), now_s());
            health.report(COMPONENT, level, message, figures);
        }
    };
    thread::Builder::new().name("frequency".into()).spawn(telling).map_err(NodeError::Thread)?;
    Ok(sent)
}

/// What the launch file says of this node's readings; none of a node that has no driver.
fn source(context: &NodeContext) -> Option<&Source> {
    match context.name {
        NodeName::Scale => context.launch.scale.as_ref(),
        NodeName::Tracer => context.launch.tracer.as_ref(),
        _ => None,
    }
}

/// The rate that the launch file asks for; none where samples come when they come.
fn wanted_hz(source: &Source) -> Option<f64> {
    match source.pace {
        Pace::RateHz(rate_hz) => Some(rate_hz),
        Pace::TimeFactor(_) | Pace::AsTheyCome => None,
    }
}

/// What `/clock` shows (s); none where nothing has come on it yet.
fn simulated_s(clock: &Clock) -> Option<f64> {
    clock.now_ns().map(|now_ns| now_ns as f64 * 1e-9)
}

type Figures = [(&'static str, String); 6];

/// Counts of the last looks.
struct Rate {
    wanted_hz: Option<f64>,
    /// Seconds of the clock, and what had been sent until then.
    looks: VecDeque<(f64, u64)>,
}

impl Rate {
    /// From this instant on, or from the first that is known.
    fn new(wanted_hz: Option<f64>, now_s: Option<f64>) -> Rate {
        Rate { wanted_hz, looks: now_s.map(|now_s| (now_s, 0)).into_iter().collect() }
    }

    /// What has been sent by now; no time is known where nothing has come on `/clock`.
    fn look(&mut self, sent: u64, now_s: Option<f64>) -> (u8, &'static str, Figures) {
        let (events, window_s) = now_s.map_or((0, 0.0), |now_s| self.window(sent, now_s));
        let actual_hz = (window_s > 0.0).then(|| events as f64 / window_s);
        let (least_hz, most_hz) =
            self.wanted_hz.map_or((0.0, f64::INFINITY), |hz| (hz * (1.0 - TOLERANCE), hz * (1.0 + TOLERANCE)));
        let (level, message) = match (events, actual_hz) {
            (0, _) => (DiagnosticStatus::STALE, "No events recorded."),
            (_, None) => (DiagnosticStatus::STALE, "No time has gone by on the clock."),
            (_, Some(hz)) if hz < least_hz => (DiagnosticStatus::WARN, "Frequency too low."),
            (_, Some(hz)) if hz > most_hz => (DiagnosticStatus::WARN, "Frequency too high."),
            _ => (DiagnosticStatus::OK, "Desired frequency met"),
        };
        let figures = [
            ("Events in window", events.to_string()),
            ("Events since startup", sent.to_string()),
            ("Duration of window (s)", format!("{window_s:.3}")),
            ("Actual frequency (Hz)", format!("{:.3}", actual_hz.unwrap_or_default())),
            ("Minimum acceptable frequency (Hz)", format!("{least_hz:.3}")),
            ("Maximum acceptable frequency (Hz)", format!("{most_hz:.3}")),
        ];
        (level, message, figures)
    }

    /// What was sent within the window that ends now, and how long that is (s).
    fn window(&mut self, sent: u64, now_s: f64) -> (u64, f64) {
        // A clock that was set back begins a window anew.
        if self.looks.back().is_some_and(|(last_s, _)| now_s < *last_s) {
            self.looks.clear();
        }
        let (since_s, before) = self.looks.front().copied().unwrap_or((now_s, sent));
        self.looks.push_back((now_s, sent));
        if self.looks.len() > WINDOW {
            self.looks.pop_front();
        }
        (sent - before, now_s - since_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_judged_against_what_is_asked_for_and_over_the_window_alone() {
        let (start, at) = (Some(0.0), |seconds: u32| Some(f64::from(seconds)));
        let mut rate = Rate::new(Some(100.0), start);
        let levels: Vec<u8> = [100, 200, 260, 300].into_iter().zip(1..).map(|(n, s)| rate.look(n, at(s)).0).collect();
        assert_eq!(
            levels,
            [DiagnosticStatus::OK, DiagnosticStatus::OK, DiagnosticStatus::WARN, DiagnosticStatus::WARN]
        );
        let (level, message, figures) = rate.look(1300, at(5));
        assert_eq!((level, message), (DiagnosticStatus::WARN, "Frequency too high."));
        assert_eq!((figures[0].1.as_str(), figures[3].1.as_str()), ("1300", "260.000"));
        // Nothing is asked of what comes when it comes, but that it comes.
        let mut free = Rate::new(None, start);
        assert_eq!(free.look(1, at(1)).0, DiagnosticStatus::OK);
        let last = (2..8).map(|second| free.look(1, at(second)).0).last();
        assert_eq!(last, Some(DiagnosticStatus::STALE));
    }

    #[test]
    fn a_clock_that_is_slow_stands_or_is_set_back_is_the_one_that_counts() {
        let mut rate = Rate::new(Some(100.0), None);
        assert_eq!(rate.look(0, None).0, DiagnosticStatus::STALE, "no time has come yet");
        // It begins late, and goes ten times slower than the looks come.
        let levels: Vec<u8> =
            (0..3).map(|n: u32| rate.look(u64::from(10 * n), Some(7.0 + 0.1 * f64::from(n))).0).collect();
        assert_eq!(levels, [DiagnosticStatus::STALE, DiagnosticStatus::OK, DiagnosticStatus::OK]);
        let (level, message, _) = (0..5).map(|_| rate.look(20, Some(7.2))).last().unwrap();
        assert_eq!((level, message), (DiagnosticStatus::STALE, "No events recorded."));
        assert_eq!(rate.look(21, Some(7.2)).1, "No time has gone by on the clock.");
        assert_eq!(rate.look(22, Some(2.0)).0, DiagnosticStatus::STALE, "the window begins anew");
        assert_eq!(rate.look(122, Some(3.0)).0, DiagnosticStatus::OK);
    }
}
