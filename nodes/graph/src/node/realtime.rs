//! Real time of a node on the path of a sample: begun while the node starts, entered by its loop, told on `/diagnostics`.
//!
//! Place in the flow: in the loops of the scale, the geometric and the residual node. What a loop needs is open, and its threads
//! and its gateway run, before it steps in: they are not to get its priority.

use super::{NodeContext, NodeError, NodeSummary};
use crate::launch::{Launch, NodeName};
use abbe_msgs::standard::DiagnosticStatus;
use abbe_runtime::realtime::{self, InRealtime};
use std::thread;
use std::time::{Duration, Instant};

/// Component on `/diagnostics`.
const COMPONENT: &str = "realtime";
/// How often it is told.
const REPORT_EVERY: Duration = Duration::from_secs(1);
/// How long a rest makes a WARN.
const WARN_FOR: Duration = Duration::from_secs(10);

/// Locks the memory of this process and makes sure of its priority, where the launch file asks for that; before anything is open.
pub(super) fn begin(launch: &Launch, node: NodeName) -> Result<(), NodeError> {
    let Some(realtime) = launch.realtime_of(node) else { return Ok(()) };
    let words = realtime.to_string();
    realtime.begin()?;
    tracing::info!("realtime: {words}");
    Ok(())
}

/// The loop of a node while it carries samples.
pub(super) struct OnPath(Option<InRealtime>);

impl OnPath {
    /// To be called when everything is open; the thread that calls it is the loop's.
    pub(super) fn enter(context: &NodeContext) -> Result<OnPath, NodeError> {
        report(context)?;
        Ok(OnPath(realtime::step_in()?))
    }

    /// Lets others have the core where this node takes more than its share; with every sample.
    pub(super) fn breathe(&mut self) {
        if let Some(inside) = &mut self.0 {
            inside.breathe();
        }
    }

    /// Its figures for the summary.
    pub(super) fn figures(&self, summary: &mut NodeSummary) {
        if let Some(realtime) = realtime::begun() {
            summary.figures.insert("realtime_priority".to_owned(), f64::from(realtime.priority));
            summary.figures.insert("realtime_rests".to_owned(), realtime::rests() as f64);
        }
    }
}

/// Tells it from a thread of its own, until the node stops.
fn report(context: &NodeContext) -> Result<(), NodeError> {
    let (Some(realtime), Some(node)) = (realtime::begun(), &context.ros) else { return Ok(()) };
    let (health, shutdown) = (node.diagnostics(&context.machine.machine.name), context.shutdown.clone());
    let telling = move || {
        let mut told = Told::default();
        while !shutdown.sleep_beside(REPORT_EVERY) {
            let rests = realtime::rests();
            let (level, message) = told.of(&realtime.to_string(), rests, Instant::now());
            let cores = if realtime.cores.is_empty() { "all".to_owned() } else { format!("{:?}", realtime.cores) };
            let figures = [("priority", realtime.priority.to_string()), ("cores", cores), ("rests", rests.to_string())];
            health.report(COMPONENT, level, &message, figures);
        }
    };
    thread::Builder::new().name("realtime".into()).spawn(telling).map_err(NodeError::Thread)?;
    Ok(())
}

/// Rests so far, and when there was one last.
#[derive(Default)]
struct Told {
    rests: u64,
    at: Option<Instant>,
}

impl Told {
    fn of(&mut self, words: &str, rests: u64, now: Instant) -> (u8, String) {
        if std::mem::replace(&mut self.rests, rests) < rests {
            self.at = Some(now);
        }
        if self.at.is_some_and(|at| now.duration_since(at) < WARN_FOR) {
            let why = "it takes more than its share of the cores and rests between samples; slow down the source, or give it cores";
            return (DiagnosticStatus::WARN, format!("{words}; {why}"));
        }
        (DiagnosticStatus::OK, words.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rest_is_warned_of_for_a_while() {
        let (mut told, start) = (Told::default(), Instant::now());
        let mut level = |rests, s| told.of("fifo 50, locked, all cores", rests, start + Duration::from_secs(s)).0;
        let (ok, warn) = (DiagnosticStatus::OK, DiagnosticStatus::WARN);
        assert_eq!([level(0, 0), level(2, 1), level(2, 5), level(2, 12)], [ok, warn, warn, ok]);
    }
}
