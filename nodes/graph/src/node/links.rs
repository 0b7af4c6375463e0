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
/// How long a link is warned of after something came that was no reading, or was lost on the way.
const WARN_FOR: Duration = Duration::from_secs(10);

/// Tells how these links stand, by component, until the node stops.
pub(super) fn report(context: &NodeContext, links: Vec<(String, Link)>) -> Result<(), NodeError> {
    let Some(node) = context.ros.as_ref().filter(|_| !links.is_empty()) else { return Ok(()) };
    let (health, shutdown) = (node.diagnostics(&context.machine.machine.name), context.shutdown.clone());
    let telling = move || {
        let mut seen = vec![[Lately::default(); 2]; links.len()];
        while !shutdown.sleep_beside(REPORT_EVERY) {
            for ((component, link), [refused, missed]) in links.iter().zip(&mut seen) {
                let status = link.status();
                let (level, message) = told(&status, refused.grew(status.refused), missed.grew(status.missed));
                let figures = [
                    ("losses", status.losses.to_string()),
                    ("refused", status.refused.to_string()),
                    ("last refused", status.last_refusal),
                    ("lost on the way", status.missed.to_string()),
                ];
                health.report(component, level, &message, figures);
            }
        }
    };
    thread::Builder::new().name("links".into()).spawn(telling).map_err(NodeError::Thread)?;
    Ok(())
}

/// A count, and when it grew last.
#[derive(Debug, Clone, Copy, Default)]
struct Lately {
    count: u64,
    at: Option<Instant>,
}

impl Lately {
    /// Whether it grew of late.
    fn grew(&mut self, count: u64) -> bool {
        if count > self.count {
            (self.count, self.at) = (count, Some(Instant::now()));
        }
        self.at.is_some_and(|at| at.elapsed() < WARN_FOR)
    }
}

fn told(status: &LinkStatus, was_refused_of_late: bool, was_missed_of_late: bool) -> (u8, String) {
    match &status.state {
        LinkState::Waiting => (DiagnosticStatus::WARN, "nothing has been reached yet".to_owned()),
        LinkState::Connected(whom) => {
            let mut words = format!("connected with {whom}");
            if was_missed_of_late {
                words += &format!("; {} so far were lost on the way", status.missed);
            }
            if was_refused_of_late {
                words += &format!("; {} so far were no reading, the last: {}", status.refused, status.last_refusal);
            }
            let is_well = !(was_refused_of_late || was_missed_of_late);
            (if is_well { DiagnosticStatus::OK } else { DiagnosticStatus::WARN }, words)
        }
        LinkState::Silent(words) => (DiagnosticStatus::STALE, words.clone()),
        LinkState::Lost(words) => (DiagnosticStatus::ERROR, words.clone()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// They were told where the running total was a power of two, and nowhere else.
    #[test]
    fn regress_messages_that_were_lost_on_the_way_are_told_whatever_their_number() {
        let (link, mut missed) = (Link::default(), Lately::default());
        link.stands(LinkState::Connected("/temp".to_owned()));
        assert!(!missed.grew(link.status().missed));
        link.missed(3);
        assert!(missed.grew(link.status().missed));
        let (level, words) = told(&link.status(), false, true);
        let expected = "connected with /temp; 3 so far were lost on the way";
        assert_eq!((level, words.as_str()), (DiagnosticStatus::WARN, expected));
        link.missed(2);
        assert_eq!(link.status().missed, 3);
    }

    #[test]
    fn a_link_on_which_nonsense_comes_is_not_well() {
        let link = Link::default();
        link.stands(LinkState::Connected("box".to_owned()));
        assert_eq!(told(&link.status(), false, false), (DiagnosticStatus::OK, "connected with box".to_owned()));
        link.refused("line 7: no number".to_owned());
        let (level, words) = told(&link.status(), true, false);
        assert_eq!(level, DiagnosticStatus::WARN);
        assert!(words.contains("1 so far were no reading, the last: line 7: no number"), "{words}");
        link.stands(LinkState::Lost("cut".to_owned()));
        assert_eq!(told(&link.status(), true, true), (DiagnosticStatus::ERROR, "cut".to_owned()));
    }
}
