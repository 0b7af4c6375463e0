//! What live drivers read from, on `/diagnostics`: connected, silent or lost, and why.
//!
//! Place in the flow: a thread beside the loop of a source node, which waits for its driver. One component a driver.

use super::{NodeContext, NodeError};
use crate::link::{Link, LinkState, LinkStatus};
use abbe_msgs::standard::DiagnosticStatus;
use std::thread;
use std::time::Duration;

/// How often a link is told.
const REPORT_EVERY: Duration = Duration::from_secs(1);

/// Tells how these links stand, by component, until the node stops.
pub(super) fn report(context: &NodeContext, links: Vec<(String, Link)>) -> Result<(), NodeError> {
    let Some(node) = context.ros.as_ref().filter(|_| !links.is_empty()) else { return Ok(()) };
    let (health, shutdown) = (node.diagnostics(&context.machine.machine.name), context.shutdown.clone());
    let telling = move || {
        while !shutdown.sleep(REPORT_EVERY) {
            for (component, link) in &links {
                let status = link.status();
                let (level, message) = told(&status);
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

fn told(status: &LinkStatus) -> (u8, String) {
    match &status.state {
        LinkState::Waiting => (DiagnosticStatus::WARN, "nothing has been reached yet".to_owned()),
        LinkState::Connected(whom) => (DiagnosticStatus::OK, format!("connected with {whom}")),
        LinkState::Silent(words) => (DiagnosticStatus::STALE, words.clone()),
        LinkState::Lost(words) => (DiagnosticStatus::ERROR, words.clone()),
    }
}
