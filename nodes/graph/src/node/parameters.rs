//! ROS parameters of the nodes: what of the launch file a `--ros-args -p` may change at the start.
//!
//! Place in the flow: declared with unit and range when a node starts; the launch file gives the defaults. The pace of a
//! recording is fixed while the node runs. What else there is may change ([`super::changes`]): a model is named by its hash in
//! each sample, the monitor's bounds correct nothing, and a replay is given each age from which a covariate was stale.

use crate::launch::{Launch, NodeName, Pace};
use abbe_runtime::TransportKind;
use abbe_runtime::gateway::COMPANION_DEPTH;
use abbe_runtime::ros::{
    NameError, ParameterAssignment, ParameterError, ParameterSpec, ParameterTable, ParameterValue, Range, RosArgs,
    RosError, TopicEnd, qos_parameters, resolve,
};
use abbe_runtime::transport::DEFAULT_DEPTH;
use std::path::{Path, PathBuf};

/// Largest number a parameter in seconds, hertz or standard uncertainties may have.
const LARGEST: f64 = 1e6;
/// Longest window that a parameter may ask for: hours of residuals at 100 Hz.
const LONGEST_WINDOW: i64 = 1_000_000;
/// Smallest number above zero that makes sense for any of them.
const SMALLEST: f64 = 1e-6;

/// Age from which a covariate is stale, of each node that looks at it.
pub(super) const MAX_COVARIATE_AGE: &str = "max_covariate_age_s";
const RATE: &str = "rate_hz";
const TIME_FACTOR: &str = "time_factor";
const SINGLE_BOUND: &str = "single_bound";
const WINDOW: &str = "window";
const MATCH_WITHIN: &str = "match_within_s";
/// Model file of a geometric and of a monitor node.
pub(super) const MODEL: &str = "model";
/// Residual model file of a residual node.
pub(super) const RESIDUAL_MODEL: &str = "residual_model";

/// Parameters for the quality of service of each topic that a node has over DDS; `resolve` gives its absolute name.
pub(super) fn qos(
    launch: &Launch,
    node: NodeName,
    resolve: impl Fn(&str) -> Result<String, NameError>,
) -> Result<Vec<ParameterSpec>, NameError> {
    let is_dds = |kind: &TransportKind| *kind == TransportKind::Dds;
    let mut specs = Vec::new();
    if launch.publishes_over(node).iter().any(is_dds) {
        if let Some(topic) = node.topic() {
            specs.extend(qos_parameters(&resolve(topic)?, TopicEnd::Publisher, DEFAULT_DEPTH));
        }
        for topic in node.companions() {
            specs.extend(qos_parameters(&resolve(topic)?, TopicEnd::Publisher, COMPANION_DEPTH.get()));
        }
    }
    let taken = node.inputs().iter().filter(|from| launch.takes_over(node.name(), **from).as_ref().is_some_and(is_dds));
    for topic in taken.filter_map(|from| from.topic()) {
        specs.extend(qos_parameters(&resolve(topic)?, TopicEnd::Subscription, DEFAULT_DEPTH));
    }
    Ok(specs)
}

/// Values for every node, or those that a pattern fits, that change nothing, in words: no node of the launch that is meant has
/// their parameter. They may be of other programs, and one that fits none of these nodes is no matter of theirs.
pub(super) fn strangers(launch: &Launch, args: &RosArgs) -> Result<Vec<String>, RosError> {
    let for_many = args.parameters.iter().filter(|one| one.meant.is_for_many());
    let mut left: Vec<(&ParameterAssignment, bool)> = for_many.map(|one| (one, false)).collect();
    for node in &launch.nodes {
        if left.is_empty() {
            break;
        }
        let identity = args.identity(&launch.namespace, node.name())?;
        let qos = qos(launch, *node, |topic| resolve(topic, &identity, &args.remaps))?;
        let table = table(launch, *node, qos)?;
        left.retain_mut(|(one, is_meant)| {
            let is_of_node = one.meant.fits(&identity);
            *is_meant |= is_of_node;
            !(is_of_node && table.spec(&one.name).is_some())
        });
    }
    let words = |one: &ParameterAssignment| {
        let ParameterAssignment { origin, name, .. } = one;
        format!("{origin}: no node of this launch has a parameter '{name}', so it changes nothing here")
    };
    Ok(left.into_iter().filter(|(_, is_meant)| *is_meant).map(|(one, _)| words(one)).collect())
}

/// The parameters of a node with the launch file's values, and `more`.
pub(super) fn table(
    launch: &Launch,
    node: NodeName,
    more: Vec<ParameterSpec>,
) -> Result<ParameterTable, ParameterError> {
    let positive = |name, value: f64, unit, description| {
        let range = Range::Double(SMALLEST.min(value), LARGEST.max(value));
        ParameterSpec { name, default: ParameterValue::Double(value), unit, range, read_only: true, description }
    };
    let pace = |pace: Pace| match pace {
        Pace::RateHz(rate) => Some(positive(RATE, rate, "Hz", "Readings a second that a recording is played at.")),
        Pace::TimeFactor(factor) => Some(positive(TIME_FACTOR, factor, "", "How many times faster than recorded.")),
        Pace::AsTheyCome => None,
    };
    // The three nodes that look at the age of a covariate read the same figure; one that is to be stricter is to be so in each.
    let age = || ParameterSpec {
        read_only: false,
        ..positive(MAX_COVARIATE_AGE, launch.max_covariate_age_s, "s", "Age from which a covariate is stale.")
    };
    let specs: Vec<ParameterSpec> = match node {
        NodeName::Scale => launch.scale.iter().filter_map(|source| pace(source.pace)).collect(),
        NodeName::Tracer => launch.tracer.iter().filter_map(|source| pace(source.pace)).collect(),
        NodeName::Geometric => file(MODEL, launch.model.as_deref()).into_iter().chain([age()]).collect(),
        NodeName::Monitor => {
            let model = file(MODEL, launch.model.as_deref()).into_iter();
            model
                .chain(monitor(launch, positive).into_iter().map(|spec| ParameterSpec { read_only: false, ..spec }))
                .chain([age()])
                .collect()
        }
        NodeName::Residual => {
            file(RESIDUAL_MODEL, launch.residual_model.as_deref()).into_iter().chain([age()]).collect()
        }
        NodeName::Recorder => Vec::new(),
    };
    ParameterTable::new(specs.into_iter().chain(more))
}

/// A file that the launch file names; none where it names none.
fn file(name: &'static str, path: Option<&Path>) -> Option<ParameterSpec> {
    Some(ParameterSpec {
        name,
        default: ParameterValue::String(path?.to_string_lossy().into_owned()),
        unit: "",
        range: Range::NotEmpty,
        read_only: false,
        description: "File in use, relative to the launch file.",
    })
}

fn monitor(
    launch: &Launch,
    positive: impl Fn(&'static str, f64, &'static str, &'static str) -> ParameterSpec,
) -> Vec<ParameterSpec> {
    let Some(bounds) = &launch.monitor else { return Vec::new() };
    let window = i64::try_from(bounds.window).unwrap_or(i64::MAX);
    let within = positive(MATCH_WITHIN, bounds.match_within_s, "s", "Stamps this close are the same instant.");
    vec![
        positive(
            SINGLE_BOUND,
            bounds.single_bound,
            "",
            "Standard uncertainties from which one residual is out of bounds.",
        ),
        ParameterSpec {
            name: WINDOW,
            default: ParameterValue::Integer(window),
            unit: "",
            range: Range::Integer(1, LONGEST_WINDOW.max(window)),
            read_only: true,
            description: "Residuals over which the mean square is taken.",
        },
        ParameterSpec { range: Range::Double(0.0, LARGEST), ..within },
    ]
}

/// Puts values of parameters where the node looks for them.
pub(super) fn apply<'n, 'v>(
    values: impl IntoIterator<Item = (&'n str, &'v ParameterValue)>,
    launch: &mut Launch,
    node: NodeName,
) {
    for (name, value) in values {
        match (name, value) {
            (MODEL, ParameterValue::String(path)) => put(&mut launch.model, path),
            (RESIDUAL_MODEL, ParameterValue::String(path)) => put(&mut launch.residual_model, path),
            (MAX_COVARIATE_AGE, ParameterValue::Double(seconds)) => launch.max_covariate_age_s = *seconds,
            (RATE, ParameterValue::Double(rate)) => set_pace(launch, node, Pace::RateHz(*rate)),
            (TIME_FACTOR, ParameterValue::Double(factor)) => set_pace(launch, node, Pace::TimeFactor(*factor)),
            _ => set_bound(launch, name, value),
        }
    }
}

/// A path that cannot be told as text stays as it is, unless it is given another.
fn put(named: &mut Option<PathBuf>, path: &str) {
    if named.as_ref().is_some_and(|named| named.to_string_lossy() != path) {
        *named = Some(PathBuf::from(path));
    }
}

fn set_pace(launch: &mut Launch, node: NodeName, pace: Pace) {
    let source = if node == NodeName::Scale { &mut launch.scale } else { &mut launch.tracer };
    if let Some(source) = source {
        source.pace = pace;
    }
}

fn set_bound(launch: &mut Launch, name: &str, value: &ParameterValue) {
    let Some(bounds) = &mut launch.monitor else { return };
    match (name, value) {
        (SINGLE_BOUND, ParameterValue::Double(bound)) => bounds.single_bound = *bound,
        (MATCH_WITHIN, ParameterValue::Double(seconds)) => bounds.match_within_s = *seconds,
        (WINDOW, ParameterValue::Integer(window)) => bounds.window = usize::try_from(*window).unwrap_or(bounds.window),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn launch() -> Launch {
        let text = include_str!("../../../../launch-config/bridge_xyz_virtual.toml");
        Launch::parse(text, Path::new("bridge_xyz_virtual.toml")).unwrap()
    }

    fn with(node: NodeName, assignment: &str) -> Result<Launch, String> {
        let arguments = ["--ros-args", "-p", assignment].map(str::to_owned);
        let (args, _) = RosArgs::split(arguments).map_err(|e| e.to_string())?;
        let identity = args.identity("bridge_xyz", node.name()).map_err(|e| e.to_string())?;
        let mut launch = launch();
        let table = table(&launch, node, Vec::new()).map_err(|e| e.to_string())?;
        let table = table.with_assignments(&identity, &args.parameters).map_err(|e| e.to_string())?;
        apply(table.values(), &mut launch, node);
        Ok(launch)
    }

    #[test]
    fn without_arguments_the_launch_file_holds() {
        for node in NodeName::ALL {
            let mut applied = launch();
            apply(table(&launch(), node, Vec::new()).unwrap().values(), &mut applied, node);
            assert_eq!(applied, launch());
        }
    }

    #[test]
    fn an_argument_changes_its_figure_only() {
        for node in [NodeName::Geometric, NodeName::Residual, NodeName::Monitor] {
            let changed = with(node, "max_covariate_age_s:=2.5").unwrap();
            assert_eq!(changed.max_covariate_age_s, 2.5, "{node:?}");
            assert_eq!(Launch { max_covariate_age_s: 10.0, ..changed }, launch());
        }
        let slower = with(NodeName::Scale, "rate_hz:=50.0").unwrap();
        assert_eq!(slower.scale.unwrap().pace, Pace::RateHz(50.0));
        assert_eq!(slower.tracer.unwrap().pace, Pace::RateHz(100.0));
        assert_eq!(with(NodeName::Monitor, "window:=50").unwrap().monitor.unwrap().window, 50);
        let other = with(NodeName::Geometric, "model:=other.json").unwrap();
        assert_eq!(other.model, Some(PathBuf::from("other.json")));
    }

    #[test]
    fn a_value_for_every_node_that_no_node_has_is_told() {
        let strangers = |assignment: &str| {
            let (args, _) = RosArgs::split(["--ros-args", "-p", assignment].map(str::to_owned)).unwrap();
            strangers(&launch(), &args).unwrap()
        };
        let other = "qos_overrides./bridge_xyz/corrected.publisher.depth:=8";
        for of_another in ["max_covariate_age_s:=2.5", "window:=7", "use_sim_time:=true", other] {
            assert_eq!(strangers(of_another), [""; 0], "{of_another}");
        }
        for of_others in ["/hall/*:max_covariate_age:=2.5", "/**/controller:gain:=1.0"] {
            assert_eq!(strangers(of_others), [""; 0], "{of_others}");
        }
        assert_eq!(strangers("/*/tracer:max_covariate_age_s:=2.5").len(), 1, "it is of those that correct or judge");
        let told = strangers("max_covariate_age:=2.5");
        assert_eq!(told.len(), 1);
        assert!(told[0].contains("-p max_covariate_age:=2.5: no node of this launch has a parameter"), "{told:?}");
    }

    #[test]
    fn only_the_pace_of_a_recording_is_fixed_while_a_node_runs() {
        let changeable = |node| {
            let table = table(&launch(), node, Vec::new()).unwrap();
            let names: Vec<&str> = table.values().map(|(name, _)| name).collect();
            names.into_iter().filter(|name| !table.spec(name).unwrap().read_only).collect::<Vec<_>>()
        };
        assert_eq!(changeable(NodeName::Scale), [""; 0]);
        assert_eq!(changeable(NodeName::Geometric), ["max_covariate_age_s", "model"]);
        let of_monitor = ["match_within_s", "max_covariate_age_s", "model", "single_bound", "window"];
        assert_eq!(changeable(NodeName::Monitor), of_monitor);
    }

    #[test]
    fn values_out_of_range_and_unknown_names_are_refused() {
        assert!(with(NodeName::Geometric, "max_covariate_age_s:=-1.0").unwrap_err().contains("max_covariate_age_s"));
        assert!(with(NodeName::Monitor, "window:=0").unwrap_err().contains("window"));
        assert!(with(NodeName::Monitor, "window:=1000001").unwrap_err().contains("window"));
        assert!(with(NodeName::Geometric, "model:=''").unwrap_err().contains("not empty"));
        assert!(with(NodeName::Geometric, "geometric:rate_hz:=10.0").unwrap_err().contains("rate_hz"));
    }
}
