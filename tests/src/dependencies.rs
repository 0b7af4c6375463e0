//! Which crate reaches which, and the directions that are allowed.
//!
//! Place in the flow: `cargo metadata` in, [`Graph`] out; the rules are functions of the graph. Only what is built
//! into the library counts: dependencies of tests and build scripts may reach anything.

use crate::workspace::{self, EVIDENCE};
use cargo_metadata::{CargoOpt, DependencyKind, Metadata, MetadataCommand};
use std::collections::{BTreeMap, BTreeSet};

/// What a pure crate must not reach, by the first part of the name: ROS, shared memory, bags, files and their
/// formats, runtimes, networks.
const IMPURE: [&str; 22] = [
    "async-std",
    "cdr-encoding",
    "csv",
    "dirs",
    "hyper",
    "iceoryx2",
    "mcap",
    "memmap2",
    "mio",
    "ros2-client",
    "rustdds",
    "rustix",
    "serde_json",
    "serde-saphyr",
    "smol",
    "socket2",
    "tempfile",
    "tokio",
    "toml",
    "tracing-subscriber",
    "walkdir",
    "burn",
];
/// The one crate of `models/` that may be built on a network framework: it trains; what runs live needs none.
const NETWORK_CRATE: &str = "abbe-residual-training";

/// What is built on what Linux alone has, or has been run there alone: live nodes are made of it.
const OF_LINUX: [&str; 6] = ["abbe-opcua", "nix", "ros2-client", "rustdds", "sd-notify", "zenoh"];
/// The platform other than Linux for which the program is built.
pub const WINDOWS: &str = "x86_64-pc-windows-gnu";

/// A crate of the workspace.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member {
    /// Its name.
    pub name: String,
    /// Its folder from the root.
    pub folder: String,
}

/// Crates and what each is built with.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    /// Crates of the workspace.
    pub members: Vec<Member>,
    /// Direct dependencies by name.
    pub direct: BTreeMap<String, BTreeSet<String>>,
    /// Crates that are built where none is named.
    pub built_by_default: BTreeSet<String>,
}

impl Graph {
    /// The graph of this workspace, for the platform this runs on.
    pub fn of_workspace() -> Graph {
        let platform = std::process::Command::new("rustc").arg("-vV").output().expect("rustc can be called");
        let text = String::from_utf8_lossy(&platform.stdout).into_owned();
        let host = text.lines().find_map(|line| line.strip_prefix("host: ")).expect("rustc names its host");
        Graph::on(host)
    }

    /// The graph of this workspace, for this platform.
    pub fn on(platform: &str) -> Graph {
        let metadata = MetadataCommand::new()
            .manifest_path(workspace::root().join("Cargo.toml"))
            .features(CargoOpt::AllFeatures)
            .other_options(["--locked".to_owned(), "--filter-platform".to_owned(), platform.to_owned()])
            .exec()
            .unwrap_or_else(|error| panic!("cargo metadata: {error}"));
        Graph::from_metadata(&metadata)
    }

    fn from_metadata(metadata: &Metadata) -> Graph {
        let names: BTreeMap<_, _> = metadata.packages.iter().map(|p| (p.id.clone(), p.name.to_string())).collect();
        let member = |package: &&cargo_metadata::Package| {
            let folder = package.manifest_path.parent().expect("a manifest has a folder");
            let folder = folder.strip_prefix(&metadata.workspace_root).expect("members lie below the root");
            Member { name: package.name.to_string(), folder: folder.as_str().replace('\\', "/") }
        };
        let members = metadata.workspace_packages().iter().map(member).collect();
        let built_by_default = metadata.workspace_default_packages().iter().map(|p| p.name.to_string()).collect();
        let mut graph = Graph { members, built_by_default, ..Graph::default() };
        for node in &metadata.resolve.as_ref().expect("metadata with dependencies").nodes {
            let built_in = node.deps.iter().filter(|d| d.dep_kinds.iter().any(|k| k.kind == DependencyKind::Normal));
            let direct = graph.direct.entry(names[&node.id].clone()).or_default();
            direct.extend(built_in.map(|dependency| names[&dependency.pkg].clone()));
        }
        graph
    }

    /// Everything that `name` reaches, itself left out.
    pub fn reach(&self, name: &str) -> BTreeSet<String> {
        let mut reached = BTreeSet::new();
        let mut open = vec![name.to_owned()];
        while let Some(next) = open.pop() {
            for dependency in self.direct.get(&next).into_iter().flatten() {
                if reached.insert(dependency.clone()) {
                    open.push(dependency.clone());
                }
            }
        }
        reached
    }

    /// Crates below a folder of the root.
    pub fn members_below<'a>(&'a self, folder: &'a str) -> impl Iterator<Item = &'a Member> {
        self.members
            .iter()
            .filter(move |member| member.folder == folder || member.folder.starts_with(&format!("{folder}/")))
    }

    /// Of each room of a layer (`models`, `nodes`) the rooms of that layer that it is built on, by their folders.
    pub fn arrows(&self, layer: &str) -> BTreeMap<String, BTreeSet<String>> {
        let folders: BTreeMap<&String, &String> = self.members_below(layer).map(|m| (&m.name, &m.folder)).collect();
        let room = |(name, folder): (&&String, &&String)| {
            let direct = self.direct.get(*name).into_iter().flatten();
            ((*folder).clone(), direct.filter_map(|other| folders.get(other)).map(|folder| (*folder).clone()).collect())
        };
        folders.iter().map(room).collect()
    }

    /// Crates of models and evidence that reach ROS, files, runtimes or, but for the network's own, `burn`.
    pub fn impure_models(&self) -> Vec<String> {
        let mut found = Vec::new();
        for model in self.members_below("models").chain(self.members_below(EVIDENCE)) {
            let is_network = model.name == NETWORK_CRATE;
            for reached in self.reach(&model.name) {
                let is = |word: &str| reached == *word || reached.starts_with(&format!("{word}-"));
                // What `burn` brings along is the price of the network and stays in that one crate.
                if IMPURE.iter().any(|word| is(word)) && !is_network {
                    found.push(format!("{} reaches {reached}", model.name));
                }
            }
        }
        found
    }

    /// Crates that are built by default and reach what only training needs: most of what there would be to compile.
    pub fn training_by_default(&self) -> Vec<String> {
        let is_of_training =
            |reached: &String| reached == NETWORK_CRATE || reached == "burn" || reached.starts_with("burn-");
        let of = |name: &String| {
            let reached = self.reach(name).into_iter().filter(is_of_training);
            reached.map(|reached| format!("{name} reaches {reached}")).collect::<Vec<_>>()
        };
        self.built_by_default.iter().flat_map(of).collect()
    }

    /// Crates that are built by default and reach what is for Linux alone.
    pub fn of_linux_by_default(&self) -> Vec<String> {
        let of = |name: &String| {
            let reached = self.reach(name).into_iter().filter(|reached| OF_LINUX.contains(&reached.as_str()));
            reached.map(|reached| format!("{name} reaches {reached}")).collect::<Vec<_>>()
        };
        self.built_by_default.iter().flat_map(of).collect()
    }

    /// Dependencies between crates of the workspace against the one direction: nodes → msgs, models; evidence → models. A node reaches
    /// evidence too: the simulated machine, and the papers.
    pub fn against_direction(&self) -> Vec<String> {
        let layer = |folder: &str| match folder.starts_with(EVIDENCE) {
            true => "evidence".to_owned(),
            false => folder.split('/').next().unwrap_or_default().to_owned(),
        };
        let layer_of: BTreeMap<&str, String> =
            self.members.iter().map(|member| (member.name.as_str(), layer(&member.folder))).collect();
        let allowed = |from: &str, to: &str| match from {
            "models" => to == "models",
            "evidence" => ["models", "evidence"].contains(&to),
            "msgs" => false,
            "nodes" => ["models", "msgs", "nodes", "evidence"].contains(&to),
            _ => to != "tests",
        };
        let mut found = Vec::new();
        for (from, from_layer) in &layer_of {
            for to in self.direct.get(*from).into_iter().flatten() {
                if layer_of.get(to.as_str()).is_some_and(|to_layer| !allowed(from_layer, to_layer)) {
                    found.push(format!("{from} ({from_layer}) depends on {to}"));
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph(members: &[(&str, &str)], direct: &[(&str, &[&str])]) -> Graph {
        let member = |(name, folder): &(&str, &str)| Member { name: (*name).to_owned(), folder: (*folder).to_owned() };
        let edge = |(from, to): &(&str, &[&str])| ((*from).to_owned(), to.iter().map(|to| (*to).to_owned()).collect());
        Graph {
            members: members.iter().map(member).collect(),
            direct: direct.iter().map(edge).collect(),
            ..Graph::default()
        }
    }

    #[test]
    fn a_model_that_reaches_ros_through_another_crate_is_caught() {
        let members = [("a", "models/a"), ("b", "tests/evidence/b"), ("r", "nodes/r")];
        let dirty = graph(&members, &[("a", &["b"]), ("b", &["x"]), ("x", &["ros2-client"]), ("r", &["tokio"])]);
        assert_eq!(dirty.impure_models(), ["a reaches ros2-client", "b reaches ros2-client"]);
        let clean = graph(&members, &[("a", &["b"]), ("b", &["nalgebra"]), ("r", &["ros2-client"])]);
        assert!(clean.impure_models().is_empty());
    }

    #[test]
    fn parts_of_a_family_of_crates_are_caught_and_similar_names_are_not() {
        let members = [("a", "models/a")];
        assert_eq!(graph(&members, &[("a", &["iceoryx2-bb"])]).impure_models().len(), 1);
        assert_eq!(graph(&members, &[("a", &["burn-core"])]).impure_models().len(), 1);
        assert!(graph(&members, &[("a", &["csvless", "tomlike"])]).impure_models().is_empty());
        assert!(graph(&[(NETWORK_CRATE, "models/n")], &[(NETWORK_CRATE, &["burn"])]).impure_models().is_empty());
    }

    #[test]
    fn training_in_a_crate_that_is_built_by_default_is_caught() {
        let members = [("p", "nodes/p"), ("t", "nodes/t")];
        let mut apart = graph(&members, &[("p", &["m"]), ("t", &["p", NETWORK_CRATE]), (NETWORK_CRATE, &["burn"])]);
        apart.built_by_default = ["p".to_owned()].into();
        assert!(apart.training_by_default().is_empty());
        for (dependency, found) in [(NETWORK_CRATE, 2), ("burn", 1), ("burn-core", 1), ("burning", 0)] {
            let mut together = apart.clone();
            together.direct.insert("m".to_owned(), [dependency.to_owned()].into());
            assert_eq!(together.training_by_default().len(), found, "{dependency}");
        }
    }

    #[test]
    fn what_is_for_linux_alone_is_caught_through_another_crate() {
        let mut graph = graph(&[("p", "nodes/p")], &[("p", &["m", "nixon"]), ("m", &["nix"]), ("q", &["zenoh"])]);
        graph.built_by_default = ["p".to_owned()].into();
        assert_eq!(graph.of_linux_by_default(), ["p reaches nix"]);
        graph.direct.insert("m".to_owned(), BTreeSet::new());
        assert!(graph.of_linux_by_default().is_empty());
    }

    #[test]
    fn dependencies_against_the_direction_are_caught() {
        let members = [("m", "models/m"), ("g", "msgs"), ("n", "nodes/n"), ("e", "tests/evidence/e"), ("t", "tests")];
        let right =
            graph(&members, &[("n", &["m", "g", "e"]), ("t", &["n", "m"]), ("e", &["m"]), ("m", &["nalgebra"])]);
        assert!(right.against_direction().is_empty());
        let wrong = [("m", "g"), ("m", "n"), ("m", "e"), ("g", "m"), ("g", "n"), ("g", "e"), ("n", "t"), ("e", "n")];
        for (from, to) in wrong {
            assert_eq!(graph(&members, &[(from, &[to])]).against_direction().len(), 1, "{from} to {to}");
        }
    }

    #[test]
    fn rooms_of_a_layer_are_known_with_those_that_they_are_built_on() {
        let members = [("a", "models/a"), ("b", "models/b"), ("n", "nodes/n")];
        let arrows = graph(&members, &[("a", &["b", "n", "x"]), ("n", &["a"])]).arrows("models");
        let on = |folders: &[&str]| folders.iter().map(|folder| (*folder).to_owned()).collect::<BTreeSet<String>>();
        assert_eq!(arrows, [("models/a".to_owned(), on(&["models/b"])), ("models/b".to_owned(), on(&[]))].into());
    }

    #[test]
    fn circles_end() {
        let circle = graph(&[("a", "models/a")], &[("a", &["b"]), ("b", &["a"])]);
        assert_eq!(circle.reach("a").len(), 2);
    }
}
