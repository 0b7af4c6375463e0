//! How often a node publishes, on `/diagnostics`, in the words of `diagnostic_updater`.
//!
//! Place in the flow: counted where a sample is sent, told once a second from a thread of its own, so that a source that waits
//! for its driver is told of all the same. Tools that know `FrequencyStatus` find its keys.

use super::{NodeContext, NodeError};
use crate::launch::{NodeName, Pace};
use abbe_msgs::standard::DiagnosticStatus;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

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
    let mut rate = Rate::new(wanted_hz(context), Instant::now());
    let counted = Arc::clone(&sent);
    let telling = move || {
        while !shutdown.sleep_beside(REPORT_EVERY) {
            let (level, message, figures) = rate.look(counted.load(Ordering::Relaxed), Instant::now());
            health.report(COMPONENT, level, message, figures);
        }
    };
    thread::Builder::new().name("frequency".into()).spawn(telling).map_err(NodeError::Thread)?;
    Ok(sent)
}

/// The rate that the launch file asks for; none where samples come when they come.
fn wanted_hz(context: &NodeContext) -> Option<f64> {
    let source = match context.name {
        NodeName::Scale => context.launch.scale.as_ref(),
        NodeName::Tracer => context.launch.tracer.as_ref(),
        _ => None,
    };
    match source?.pace {
        Pace::RateHz(rate_hz) => Some(rate_hz),
        Pace::TimeFactor(_) | Pace::AsTheyCome => None,
    }
}

type Figures = [(&'static str, String); 6];

/// Counts of the last looks.
struct Rate {
    wanted_hz: Option<f64>,
    looks: VecDeque<(Instant, u64)>,
}

impl Rate {
    fn new(wanted_hz: Option<f64>, now: Instant) -> Rate {
        Rate { wanted_hz, looks: VecDeque::from([(now, 0)]) }
    }

    fn look(&mut self, sent: u64, now: Instant) -> (u8, &'static str, Figures) {
        let (since, before) = self.looks.front().copied().unwrap_or((now, 0));
        self.looks.push_back((now, sent));
        if self.looks.len() > WINDOW {
            self.looks.pop_front();
        }
        let (events, window_s) = (sent - before, now.duration_since(since).as_secs_f64());
        let actual_hz = if window_s > 0.0 { events as f64 / window_s } else { 0.0 };
        let (least_hz, most_hz) =
            self.wanted_hz.map_or((0.0, f64::INFINITY), |hz| (hz * (1.0 - TOLERANCE), hz * (1.0 + TOLERANCE)));
        let (level, message) = match (events, actual_hz) {
            (0, _) => (DiagnosticStatus::STALE, "No events recorded."),
            (_, hz) if hz < least_hz => (DiagnosticStatus::WARN, "Frequency too low."),
            (_, hz) if hz > most_hz => (DiagnosticStatus::WARN, "Frequency too high."),
            _ => (DiagnosticStatus::OK, "Desired frequency met"),
        };
        let figures = [
            ("Events in window", events.to_string()),
            ("Events since startup", sent.to_string()),
            ("Duration of window (s)", format!("{window_s:.3}")),
            ("Actual frequency (Hz)", format!("{actual_hz:.3}")),
            ("Minimum acceptable frequency (Hz)", format!("{least_hz:.3}")),
            ("Maximum acceptable frequency (Hz)", format!("{most_hz:.3}")),
        ];
        (level, message, figures)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_judged_against_what_is_asked_for_and_over_the_window_alone() {
        let start = Instant::now();
        let at = |seconds: u64| start + Duration::from_secs(seconds);
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
}
