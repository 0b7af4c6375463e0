//! Quality of service set from outside, by parameters named as in rclcpp: `qos_overrides./topic.publisher.reliability`.
//!
//! Place in the flow: a node declares [`qos_parameters`] for each topic that it has over DDS, fixed once it runs; its
//! gateway opens the topic with what they say. Nobody can ask for what would hold up a stream: depth ends where the
//! window of a writer does, and history is never "keep all".

use ros2_client::qos::{History, Reliability};
use ros2_client::{ParameterValue, QosProfile};

use super::RosNode;
use super::parameters::{ParameterSpec, Range};
use super::qos::NEVER_WAITS;
use super::writer::WINDOW;

const RELIABLE: &str = "reliable";
const BEST_EFFORT: &str = "best_effort";
const KEEP_LAST: &str = "keep_last";

/// Which end of a topic a node has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TopicEnd {
    /// It publishes.
    Publisher,
    /// It subscribes.
    Subscription,
}

impl TopicEnd {
    fn name(self) -> &'static str {
        match self {
            TopicEnd::Publisher => "publisher",
            TopicEnd::Subscription => "subscription",
        }
    }

    fn default_reliability(self) -> &'static str {
        match self {
            TopicEnd::Publisher => RELIABLE,
            TopicEnd::Subscription => BEST_EFFORT,
        }
    }
}

/// The parameters of one end of `topic`, an absolute name, with `depth` unless they say else.
#[must_use]
pub fn qos_parameters(topic: &str, end: TopicEnd, depth: usize) -> Vec<ParameterSpec> {
    let text = |policy, default: &str, range, description| ParameterSpec {
        // Declared once in the life of a node, so this is as lasting as a constant.
        name: parameter(topic, end, policy).leak(),
        default: ParameterValue::String(default.to_owned()),
        unit: "",
        range: Range::OneOf(range),
        read_only: true,
        description,
    };
    let reliability = text(
        "reliability",
        end.default_reliability(),
        &[RELIABLE, BEST_EFFORT],
        "What is offered to, or asked of, the other end of the topic.",
    );
    let history = text("history", KEEP_LAST, &[KEEP_LAST], "What is kept for the other end, or for this node.");
    let depth = ParameterSpec {
        name: parameter(topic, end, "depth").leak(),
        default: ParameterValue::Integer(i64::try_from(depth).unwrap_or(i64::MAX)),
        unit: "samples",
        range: Range::Integer(1, i64::try_from(WINDOW).unwrap_or(i64::MAX)),
        read_only: true,
        description: "How many of the newest samples are kept.",
    };
    vec![reliability, history, depth]
}

/// Makes what is offered best effort unless the user says else: in a secured domain nothing can acknowledge in the name of a reliable
/// reader that lags, so that one alone would hold up the stream for all.
pub fn offer_best_effort(parameters: &mut [ParameterSpec]) {
    let offered = format!(".{}.reliability", TopicEnd::Publisher.name());
    for parameter in parameters.iter_mut().filter(|parameter| parameter.name.ends_with(&offered)) {
        parameter.default = ParameterValue::String(BEST_EFFORT.to_owned());
    }
}

/// The quality of service of an end of a topic, after what the node's parameters say.
pub(crate) fn overridden(node: &RosNode, topic: &str, end: TopicEnd, qos: QosProfile) -> QosProfile {
    let value = |policy| node.parameter(&parameter(topic, end, policy));
    let reliability = match value("reliability") {
        Some(ParameterValue::String(word)) if word == RELIABLE => NEVER_WAITS,
        Some(ParameterValue::String(word)) if word == BEST_EFFORT => Reliability::BestEffort,
        _ => qos.reliability,
    };
    let depth = value("depth").and_then(|depth| match depth {
        ParameterValue::Integer(depth) => usize::try_from(depth).ok(),
        _ => None,
    });
    let history = depth.map_or(qos.history, |depth| History::KeepLast { depth });
    QosProfile { reliability, history, ..qos }
}

fn parameter(topic: &str, end: TopicEnd, policy: &str) -> String {
    format!("qos_overrides.{topic}.{}.{policy}", end.name())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::{ParameterTable, RosArgs};

    fn with(assignment: &str) -> Result<ParameterTable, String> {
        let specs = qos_parameters("/test/corrected", TopicEnd::Publisher, 64);
        let (args, _) =
            RosArgs::split(["--ros-args", "-p", assignment].map(str::to_owned)).map_err(|e| e.to_string())?;
        let identity = args.identity("/test", "residual").map_err(|e| e.to_string())?;
        let table = ParameterTable::new(specs).map_err(|e| e.to_string())?;
        table.with_assignments(&identity, &args.parameters).map_err(|e| e.to_string())
    }

    #[test]
    fn in_a_secured_domain_streams_are_offered_as_best_effort_and_nothing_else_changes() {
        let both =
            || [TopicEnd::Publisher, TopicEnd::Subscription].map(|end| qos_parameters("/test/corrected", end, 64));
        let mut secured = both().concat();
        offer_best_effort(&mut secured);
        let changed: Vec<_> =
            both().concat().into_iter().zip(secured).filter(|(open, one)| open.default != one.default).collect();
        assert_eq!(changed.len(), 1);
        assert_eq!(changed[0].1.name, "qos_overrides./test/corrected.publisher.reliability");
        assert_eq!(changed[0].1.default, ParameterValue::String("best_effort".to_owned()));
    }

    #[test]
    fn names_are_those_of_rclcpp_and_other_topics_and_values_are_refused() {
        let table = with("qos_overrides./test/corrected.publisher.reliability:=best_effort").unwrap();
        let name = "qos_overrides./test/corrected.publisher.reliability";
        let value = table.values().find(|(known, _)| *known == name).unwrap().1.clone();
        assert_eq!(value, ParameterValue::String("best_effort".to_owned()));
        for (wrong, part) in [
            ("residual:qos_overrides./other.publisher.reliability:=reliable", "no parameter"),
            ("qos_overrides./test/corrected.publisher.reliability:=sometimes", "reliable, best_effort"),
            ("qos_overrides./test/corrected.publisher.history:=keep_all", "keep_last"),
            ("qos_overrides./test/corrected.publisher.depth:=0", "within 1 to 4096"),
        ] {
            let refused = with(wrong).unwrap_err();
            assert!(refused.contains(part), "{wrong}: {refused}");
        }
    }
}
