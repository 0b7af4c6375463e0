//! What makes a launch file a graph: values in range, nodes with their inputs, edges that can be.
//!
//! Place in the flow: under [`Launch::parse`]. Each refusal names the file, the key and what to do.

use super::{Edge, Launch, LaunchError, NodeName, Pace, RecordConfig, Source, Stamps};
use crate::driver::{DriverConfig, Role, said_twice};
use crate::step::KEPT_READINGS;
use abbe_geometry::effects::is_derived;
use abbe_runtime::{TransportError, TransportKind};
use abbe_virtual_machine::effects::from_text;
use std::path::Path;

/// Longest time that is waited (s): a lifetime, and far from what the clock's arithmetic cannot hold.
const LONGEST_S: f64 = 1e9;
/// Most travel back that can be asked for before an axis has turned (µm).
const LONGEST_REVERSAL_UM: f64 = 1e4;
/// Longest time over which a feed can be taken (s).
const LONGEST_WINDOW_S: f64 = 10.0;
/// Slowest pace (Hz, or times the recorded one): the next sample is due at a time that the clock can hold.
const SLOWEST: f64 = 1e-6;

impl Launch {
    /// Refuses what makes no graph; `path` names the file.
    pub(super) fn check(&self, path: &Path) -> Result<(), LaunchError> {
        let wrong = |key: &str, problem: &str| {
            Err(LaunchError::Value { file: path.to_owned(), key: key.to_owned(), problem: problem.to_owned() })
        };
        let positive = |value: f64| value.is_finite() && value > 0.0;
        if !positive(self.max_covariate_age_s) {
            return wrong("max_covariate_age_s", "must be a number of seconds above 0");
        }
        if !positive(self.wait_for_subscribers_s) || self.wait_for_subscribers_s > LONGEST_S {
            return wrong("wait_for_subscribers_s", "must be a number of seconds above 0, at most 1e9");
        }
        if self.gateway_memory_mib.is_some_and(|mebibytes| mebibytes < Launch::LEAST_GATEWAY_MEMORY_MIB) {
            let problem =
                format!("must be {} or more: a gateway does not start with less", Launch::LEAST_GATEWAY_MEMORY_MIB);
            return wrong("gateway_memory_mib", &problem);
        }
        for (node, source, key) in [(NodeName::Scale, &self.scale, "scale"), (NodeName::Tracer, &self.tracer, "tracer")]
        {
            match source {
                None if self.nodes.contains(&node) => {
                    return wrong(key, "this node is started but has no driver; add a table with driver and pace");
                }
                Some(Source { pace: Pace::RateHz(value) | Pace::TimeFactor(value), .. })
                    if !positive(*value) || *value < SLOWEST =>
                {
                    return wrong(&format!("{key}.pace"), "must be above 0, 1e-6 at least");
                }
                Some(Source { pace, driver, .. }) if (*pace == Pace::AsTheyCome) != driver.is_live() => {
                    let problem =
                        "must be \"as_they_come\" for a live driver (lines, ippdme, opcua, ros), and for no other";
                    return wrong(&format!("{key}.pace"), problem);
                }
                Some(Source { driver, .. }) => {
                    let role = if node == NodeName::Scale { Role::Scale } else { Role::Tracer };
                    if let Some((part, problem)) = driver.problem(role) {
                        return wrong(&format!("{key}.driver.{part}"), &problem);
                    }
                }
                None => {}
            }
        }
        if let Some(node) = self.nodes.iter().find(|node| !self.autostart && !self.is_in_ros_graph(**node)) {
            let problem = format!(
                "false leaves the nodes to a manager, and {} is not in the ROS graph, where a manager could find it; leave out \
                 visible_in_ros = false",
                node.name()
            );
            return wrong("autostart", &problem);
        }
        if !self.autostart && !self.commands_from_ros {
            return wrong(
                "autostart",
                "false leaves the nodes to a manager, which commands_from_ros = false shuts out",
            );
        }
        self.check_covariates(path)?;
        if self.scale.as_ref().is_some_and(|source| source.repeat_from.is_some() && source.driver.is_live()) {
            return wrong("scale.repeat_from", "is for recordings; a live driver has no end to begin again at");
        }
        if self.tracer.as_ref().is_some_and(|source| source.repeat_from.is_some()) {
            return wrong(
                "tracer.repeat_from",
                "the same readings again are no new evidence; only the scale node repeats",
            );
        }
        if self.residual_model.is_some() && self.model.is_none() {
            return wrong("residual_model", "corrects what a geometric model leaves; add the key model");
        }
        self.check_effects(path)?;
        self.check_monitor(path)?;
        if self.nodes.contains(&NodeName::Recorder) && self.record.is_none() {
            return wrong("record", "the recorder is started but has no bag to write");
        }
        if let Some((key, problem)) = self.record.as_ref().and_then(RecordConfig::problem) {
            return wrong(key, &problem);
        }
        if let Some((key, problem)) = self.realtime.as_ref().and_then(|realtime| realtime.problem(self)) {
            return wrong(key, &problem);
        }
        self.check_edges(path)?;
        self.check_stamps(path)
    }

    /// What recordings are stamped with leaves scale and tracer readings of one instant together.
    fn check_stamps(&self, path: &Path) -> Result<(), LaunchError> {
        let wrong = |key: &str, problem: &str| {
            Err(LaunchError::Value { file: path.to_owned(), key: key.to_owned(), problem: problem.to_owned() })
        };
        let played: Vec<&Source> = self.played().collect();
        if self.publish_clock {
            if self.scale.as_ref().is_none_or(|source| source.driver.is_live()) || self.stamps() == Stamps::Now {
                return wrong(
                    "publish_clock",
                    "gives the instants of a recording: scale needs one, with stamps = \"recorded\"",
                );
            }
            if !self.is_in_ros_graph(NodeName::Scale) {
                return wrong(
                    "publish_clock",
                    "needs scale in the ROS graph; add an edge from it over dds, or leave out visible_in_ros = false",
                );
            }
        }
        if self.stamps() == Stamps::Recorded || played.is_empty() && self.stamps.is_none() {
            return Ok(());
        }
        if played.is_empty() {
            return wrong(
                "stamps",
                "is about recordings; a live driver stamps with the present anyway, so leave the key out",
            );
        }
        let is_by_count = |source: &&&Source| matches!(source.pace, Pace::RateHz(_));
        if played.iter().filter(is_by_count).any(|source| matches!(source.driver, DriverConfig::Bag { .. })) {
            return wrong(
                "stamps",
                "the present needs the recorded distances of a bag: play it with pace = { time_factor = 1.0 }, or with \
                 stamps = \"recorded\"",
            );
        }
        if let [scale, tracer] = played[..]
            && (scale.pace != tracer.pace || is_by_count(&&scale) && scale.driver != tracer.driver)
        {
            let problem = "stamps of the present would tear pairs apart: give scale and tracer the same pace, and with rate_hz the same \
                           recording; or say stamps = \"recorded\"";
            return wrong("stamps", problem);
        }
        Ok(())
    }

    /// Covariates are joined to readings that come now, by sensors that say something.
    fn check_covariates(&self, path: &Path) -> Result<(), LaunchError> {
        let wrong = |key: String, problem: &str| {
            Err(LaunchError::Value { file: path.to_owned(), key, problem: problem.to_owned() })
        };
        for (place, driver) in self.covariates.iter().enumerate() {
            if let Some((part, problem)) = driver.problem(Role::Sensor) {
                return wrong(format!("covariates[{place}].{part}"), &problem);
            }
        }
        if let Some((place, problem)) = said_twice(&self.covariates) {
            return wrong(format!("covariates[{place}]"), &problem);
        }
        if !self.covariates.is_empty() && !self.scale.as_ref().is_some_and(|source| source.driver.is_live()) {
            let problem = "are joined to readings of a live scale driver (lines, ippdme, opcua, ros); a recording carries its own";
            return wrong("covariates".to_owned(), problem);
        }
        for (place, name) in self.lagged.iter().enumerate() {
            let problem = match is_derived(name) {
                false => {
                    "names no lagged covariate; write the name with its time constant before the unit, as in \
                         temp_air_lag_1800s_c, or a side with its travel, as in dir_x_over_5000um"
                }
                true if self.lagged[..place].contains(name) => "is named twice",
                true if self.scale.is_none() => "is made from scale readings; add a table scale with its driver",
                true => continue,
            };
            return wrong(format!("lagged[{place}]"), problem);
        }
        let Some(motion) = self.motion else { return Ok(()) };
        if self.scale.is_none() {
            return wrong("motion".to_owned(), "is derived from scale readings; add a table scale with its driver");
        }
        if !(motion.reversal_um > 0.0 && motion.reversal_um <= LONGEST_REVERSAL_UM) {
            return wrong("motion.reversal_um".to_owned(), "must be a number of micrometres above 0, at most 10000");
        }
        if !(motion.window_s > 0.0 && motion.window_s <= LONGEST_WINDOW_S) {
            return wrong("motion.window_s".to_owned(), "must be a number of seconds above 0, at most 10");
        }
        Ok(())
    }

    /// Effects to simulate can be told from their text, and both sources simulate the same machine.
    fn check_effects(&self, path: &Path) -> Result<(), LaunchError> {
        let wrong = |key: String, problem: String| Err(LaunchError::Value { file: path.to_owned(), key, problem });
        let mut simulated = None;
        for (source, name) in [(&self.scale, "scale"), (&self.tracer, "tracer")] {
            let Some(Source { driver: DriverConfig::VirtualMachine { seed, effects }, .. }) = source else { continue };
            for (place, text) in effects.iter().enumerate() {
                if let Err(error) = from_text(text) {
                    return wrong(format!("{name}.driver.effects[{place}]"), error.to_string());
                }
            }
            if *simulated.get_or_insert((seed, effects)) != (seed, effects) {
                let problem = "scale and tracer see different machines; give both the same seed and effects";
                return wrong(format!("{name}.driver"), problem.to_owned());
            }
        }
        Ok(())
    }

    fn check_monitor(&self, path: &Path) -> Result<(), LaunchError> {
        let wrong = |key: &str, problem: &str| {
            Err(LaunchError::Value { file: path.to_owned(), key: key.to_owned(), problem: problem.to_owned() })
        };
        let started = self.nodes.contains(&NodeName::Monitor);
        if started && self.model.is_none() {
            return wrong("model", "the monitor needs a model to predict with");
        }
        let Some(monitor) = &self.monitor else {
            let problem = "the monitor is started but has no bounds; add single_bound, window, match_within_s";
            return if started { wrong("monitor", problem) } else { Ok(()) };
        };
        let bounds = [monitor.single_bound, monitor.match_within_s];
        if bounds.iter().any(|bound| !bound.is_finite())
            || monitor.single_bound <= 0.0
            || monitor.match_within_s < 0.0
            || monitor.window == 0
        {
            return wrong("monitor", "single_bound and window must be above 0, match_within_s 0 or more");
        }
        if !(1..=KEPT_READINGS).contains(&monitor.least_readings()) {
            let problem = format!("must be 1 to {KEPT_READINGS}, which is what the monitor keeps");
            return wrong("monitor.diagnosis_readings", &problem);
        }
        if monitor.diagnosis_folder.is_none() {
            let without = "needs diagnosis_folder, the folder that diagnoses are put into";
            let keys = [
                ("monitor.diagnosis_readings", monitor.diagnosis_readings.is_some()),
                ("monitor.diagnose_when_degraded", monitor.diagnose_when_degraded),
                ("monitor.adopt_diagnosed_model", monitor.adopt_diagnosed_model),
            ];
            return keys.iter().find(|(_, set)| *set).map_or(Ok(()), |(key, _)| wrong(key, without));
        }
        if started && self.takes_over(NodeName::Monitor.name(), NodeName::Scale).is_none() {
            let problem = "a diagnosis needs the covariates of the scale readings; add an edge from scale to monitor";
            return wrong("monitor.diagnosis_folder", problem);
        }
        Ok(())
    }

    fn check_edges(&self, path: &Path) -> Result<(), LaunchError> {
        for (index, edge) in self.edges.iter().enumerate() {
            let wrong = |problem: String| {
                Err(LaunchError::Value { file: path.to_owned(), key: format!("edges[{index}]"), problem })
            };
            match edge.transport.parse::<TransportKind>() {
                Err(error) => return wrong(error.to_string()),
                Ok(kind) if !kind.is_built() => return wrong(TransportError::NotBuilt { kind }.to_string()),
                Ok(_) => {}
            }
            if edge.from == NodeName::Recorder {
                return wrong("the recorder publishes nothing".to_owned());
            }
            if edge.to != "*" && edge.to != "user" {
                let taker: NodeName = match edge.to.parse() {
                    Ok(node) => node,
                    Err(error) => return wrong(format!("to: {error}, user or *")),
                };
                if !taker.inputs().contains(&edge.from) {
                    return wrong(format!("{} does not take what {} gives", edge.to, edge.from.name()));
                }
            }
            let twice = |other: &Edge| other.from == edge.from && other.to == edge.to && edge.to != "*";
            if self.edges[..index].iter().any(twice) {
                return wrong(format!("a second edge from {} to {}", edge.from.name(), edge.to));
            }
        }
        for node in &self.nodes {
            let missing = node.needs().iter().find(|input| self.takes_over(node.name(), **input).is_none());
            if let Some(input) = missing {
                let problem = format!("{} is started but has no edge from {}", node.name(), input.name());
                return Err(LaunchError::Value { file: path.to_owned(), key: "edges".to_owned(), problem });
            }
            if let Some(problem) = self.problem_of_output(*node) {
                return Err(LaunchError::Value { file: path.to_owned(), key: "edges".to_owned(), problem });
            }
        }
        Ok(())
    }

    /// What is wrong where nobody takes what a node is there to give. The monitor also tells on `/diagnostics`, and the
    /// recorder gives nothing.
    fn problem_of_output(&self, node: NodeName) -> Option<String> {
        let gives = !matches!(node, NodeName::Monitor | NodeName::Recorder);
        let taker = NodeName::ALL.into_iter().find(|taker| taker.needs().contains(&node));
        let taker = taker.filter(|_| gives && self.publishes_over(node).is_empty())?;
        let (node, taker) = (node.name(), taker.name());
        Some(format!("{node} is started but has no edge from it; add one to {taker}, user or *"))
    }
}
