//! What live drivers read from, on `/diagnostics`: connected, silent or lost, and why.
//!
//! Place in the flow: a thread beside the loop of a source node, which waits for its driver. One component a driver.

use super::{NodeContext, NodeError};
use crate::link::{Link, LinkState, LinkStatus};
use abbe_msgs::standard::DiagnosticStatus;
use std::thread;
use std::time::{Duration, Instant};

/// How often a link is told.
const REPORT_EVERY: Duration = Duration::from_secs(1);
/// How long a link is warned of after something came that was no reading.
const WARN_FOR: Duration = Duration::from_secs(10);

/// Tells how these links stand, by component, until the node stops.
pub(super) fn report(context: &NodeContext, links: Vec<(String, Link)>) -> Result<(), NodeError> {
    let Some(node) = context.ros.as_ref().filter(|_| !links.is_empty()) else { return Ok(()) };
    let (health, shutdown) = (node.diagnostics(&context.machine.machine.name), context.shutdown.clone());
    let telling = move || {
        let mut seen: Vec<(u64, Option<Instant>)> = vec![(0, None); links.len()];
        while !shutdown.sleep_beside(REPORT_EVERY) {
            for ((component, link), (refused, at)) in links.iter().zip(&mut seen) {
                let status = link.status();
                if status.refused > *refused {
                    (*refused, *at) = (status.refused, Some(Instant::now()));
                }
                let (level, message) = told(&status, at.is_some_and(|at| at.elapsed() < WARN_FOR));
                let figures = [
                    ("losses", status.losses.to_string()),
                    ("refused", status.refused.to_string()),
                    ("last refused", status.last_refusal),
                ];
                health.report(component, level, &message, figures);
            }
        }
    };
    thread::Builder::new().name("links".into()).spawn(telling).map_err(NodeError::Thread)?;
    Ok(())
}

fn told(status: &LinkStatus, was_refused_of_late: bool) -> (u8, String) {
    match &status.state {
        LinkState::Waiting => (DiagnosticStatus::WARN, "nothing has been reached yet".to_owned()),
        LinkState::Connected(whom) if was_refused_of_late => {
            let (refused, last) = (status.refused, &status.last_refusal);
            (
                DiagnosticStatus::WARN,
                format!("connected with {whom}; {refused} so far were no reading, the last: {last}"),
            )
        }
        LinkState::Connected(whom) => (DiagnosticStatus::OK, format!("connected with {whom}")),
        LinkState::Silent(words) => (DiagnosticStatus::STALE, words.clone()),
        LinkState::Lost(words) => (DiagnosticStatus::ERROR, words.clone()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_on_which_nonsense_comes_is_not_well() {
        let link = Link::default();
        link.stands(LinkState::Connected("box".to_owned()));
        assert_eq!(told(&link.status(), false), (DiagnosticStatus::OK, "connected with box".to_owned()));
        link.refused("line 7: no number".to_owned());
        let (level, words) = told(&link.status(), true);
        assert_eq!(level, DiagnosticStatus::WARN);
        assert!(words.contains("1 so far were no reading, the last: line 7: no number"), "{words}");
        link.stands(LinkState::Lost("cut".to_owned()));
        assert_eq!(told(&link.status(), true), (DiagnosticStatus::ERROR, "cut".to_owned()));
    }
}
