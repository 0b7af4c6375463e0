//! What a node remarks on the samples that come to it: one component of `/diagnostics`, and the log.
//!
//! Place in the flow: the correcting nodes and the monitor hand over, once a second, what they counted. A count that rises
//! makes the component WARN for [`REMARKED_FOR`], in words that say what to do; the counts stay. So one lost sample of last
//! week does not cover what goes wrong now.

use super::NodeSummary;
use super::traffic::Trouble;
use crate::step::{REMARKED_STEP_S, StreamCounts};
use abbe_msgs::standard::DiagnosticStatus;
use abbe_runtime::ros::Diagnostics;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// How long a count that has risen makes a WARN.
const REMARKED_FOR: Duration = Duration::from_secs(10);
/// How often the same remark is put into the log.
const SAY_EVERY: Duration = Duration::from_secs(60);

/// One input of a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Input {
    /// What comes there.
    pub(super) name: &'static str,
    /// What its stream was found to be.
    pub(super) counts: StreamCounts,
    /// Samples of one publisher between those of another.
    pub(super) interleaved: u64,
}

/// When a count rose last, and when that was put into the log.
#[derive(Debug, Clone, Copy)]
struct Risen {
    count: u64,
    at: Option<Instant>,
    said: Option<Instant>,
}

/// Remarks so far, by what is counted.
#[derive(Default)]
pub(super) struct Remarks {
    risen: BTreeMap<String, Risen>,
}

/// Something that is counted, and what to say when it rises.
struct Counted {
    name: String,
    count: u64,
    words: String,
}

impl Remarks {
    /// Tells what came in, and what of it is remarkable.
    pub(super) fn report(&mut self, health: Option<&Diagnostics>, summary: &NodeSummary, inputs: &[Input]) {
        let counted: Vec<Counted> = inputs.iter().flat_map(of_input).chain(of_node(summary)).collect();
        let words = self.remarkable(&counted, Instant::now());
        let Some(health) = health else { return };
        let (level, message) = match words.is_empty() {
            true => (DiagnosticStatus::OK, "samples come in order, from one source each".to_owned()),
            false => (DiagnosticStatus::WARN, words.join("; ")),
        };
        let figures = counted.iter().map(|one| (one.name.as_str(), one.count.to_string()));
        health.report("input", level, &message, figures);
    }

    /// Words about what has risen lately; what is new goes into the log as well.
    fn remarkable<'a>(&mut self, counted: &'a [Counted], now: Instant) -> Vec<&'a str> {
        let mut words = Vec::new();
        for one in counted {
            let risen = self.risen.entry(one.name.clone()).or_insert(Risen { count: 0, at: None, said: None });
            if one.count > risen.count {
                (risen.count, risen.at) = (one.count, Some(now));
            }
            if risen.at.is_none_or(|at| now.duration_since(at) >= REMARKED_FOR) {
                continue;
            }
            words.push(one.words.as_str());
            if risen.said.is_none_or(|said| now.duration_since(said) >= SAY_EVERY) {
                risen.said = Some(now);
                tracing::warn!(count = one.count, "{}", one.words);
            }
        }
        words
    }
}

fn of_input(input: &Input) -> Vec<Counted> {
    let Input { name, counts, interleaved } = *input;
    let counted = |what: &str, count: u64, words: String| Counted { name: format!("{name}: {what}"), count, words };
    let one = "two launches in one namespace, or a recording beside the machine? Stop all but one";
    vec![
        counted(
            "other frame",
            counts.other_frame,
            format!(
                "{name} in another frame are refused: is another machine in this namespace? An empty frame_id counts as another"
            ),
        ),
        counted(
            "several sources",
            counts.several_sources,
            format!("{name} of several sources are mixed and nothing is made of them: {one}"),
        ),
        counted("interleaved publishers", interleaved, format!("{name} come from several publishers at a time: {one}")),
        counted("missing", counts.missing, format!("{name} are missing in the sequence")),
        counted("repeated", counts.repeated, format!("{name} come more than once")),
        counted("restarts", counts.restarts, format!("the sequence of {name} went back: their source started again")),
        counted(
            "sequence stands still",
            counts.sequences_standing,
            format!(
                "the sequence of {name} stands still: losses and new starts cannot be noticed; let the driver count"
            ),
        ),
        counted(
            "stamps back",
            counts.stamps_back,
            format!("stamps of {name} went back: look after the clock of their source"),
        ),
        counted(
            "stamps stand still",
            counts.stamps_standing,
            format!("{name} differ, but their stamps stand still: let the driver stamp each at its latching"),
        ),
        counted(
            "stamps jumped",
            counts.stamp_jumps,
            format!("stamps of {name} jumped by more than {REMARKED_STEP_S} s: a pause, or a clock that was set"),
        ),
    ]
}

fn of_node(summary: &NodeSummary) -> Vec<Counted> {
    let troubles = &summary.troubles;
    let of = |trouble: Trouble, name: &str| {
        let (count, words) = (troubles.count(trouble), troubles.words(trouble).to_owned());
        Counted { name: name.to_owned(), count, words }
    };
    vec![
        of(Trouble::Malformed, "malformed"),
        of(Trouble::Receiving, "failures to receive"),
        of(Trouble::Sending, "failures to send"),
        of(Trouble::Covariate, "covariates left out"),
        Counted {
            name: "stamps ahead of the clock".to_owned(),
            count: troubles.ahead_of_clock(),
            words: "stamps are ahead of this node's clock by more than 1 s: set the clocks of machine and host"
                .to_owned(),
        },
    ]
}

/// Counts for the node's summary; what never happened is left out.
pub(super) fn figures(summary: &mut NodeSummary, inputs: &[Input]) {
    let counted: Vec<Counted> = inputs.iter().flat_map(of_input).chain(of_node(summary)).collect();
    for one in counted.into_iter().filter(|one| one.count > 0) {
        summary.figures.insert(one.name.replace(": ", "_").replace(' ', "_"), one.count as f64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(count: u64) -> [Counted; 1] {
        [Counted { name: "x".to_owned(), count, words: "something".to_owned() }]
    }

    #[test]
    fn what_rises_is_remarked_for_a_while_and_again_when_it_rises_again() {
        let (mut remarks, start) = (Remarks::default(), Instant::now());
        let mut at =
            |seconds: u64, count: u64| remarks.remarkable(&counted(count), start + Duration::from_secs(seconds)).len();
        assert_eq!([at(0, 0), at(1, 3), at(5, 3), at(12, 3), at(13, 4), at(24, 4)], [0, 1, 1, 0, 1, 0]);
    }
}
