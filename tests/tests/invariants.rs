//! The invariants of ARCHITECTURE.md, held against the real workspace.
//!
//! Place in the flow: beside it. The rules are in the library of this crate, where each is shown to catch a
//! violation; here they meet the files and the dependency graph as they are.

use abbe_graph::launch::Launch;
use abbe_tests::dependencies::{Graph, WINDOWS};
use abbe_tests::mutual::{Modules, THERE_ARE};
use abbe_tests::source::{Found, Source};
use abbe_tests::workspace::{EVIDENCE, RustFile, files, read, root, rust_files, rust_files_below};
use abbe_tests::{documents, registry, rules};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

const EFFECTS: &str = "models/geometry/src/effects";
/// What effects share, beside them.
const SHARED_BY_EFFECTS: [&str; 7] = ["arch", "growth", "known", "registry", "shape", "source", "tests"];
/// Effects that propose no shapes of their own: the search that finds a period, a line or a dependence names them.
const FOUND_BY_A_SEARCH: [&str; 7] =
    ["axis_term", "empirical", "outlying_run", "periodic_scale", "scale_step", "stand_jump", "zero_jump"];
const EXPORTS: &str = "nodes/files/src/export";
const DRIVERS: &str = "nodes/graph/src/driver";
const FILES: &str = "abbe-files";
/// What computes with readings, which is more than reading them.
const SOLVERS: [&str; 4] = ["abbe-identify", "abbe-diagnose", "abbe-plan", "abbe-residual-training"];
/// Simulates physics with its own code, so that truth and model share no mistake; it has effects of its own.
const INDEPENDENT_TRUTH: &str = "tests/evidence/virtual-machine";

/// Live nodes.
const LIVE: &str = "nodes/graph/src";
/// Crates that only these files or folders of live nodes may name.
const NAMED_IN: [(&str, &[&str]); 4] = [
    // A capture fits the campaign as it grows, and states what identification would state of it where the plan promised it.
    ("abbe_identify", &["capture"]),
    ("abbe_diagnose", &["capture"]),
    ("abbe_plan", &["capture"]),
    // The simulated machine is a driver, is served for rehearsals, and has effects that a launch file names.
    ("abbe_virtual_machine", &["driver/virtual_machine.rs", "serving.rs", "launch/check.rs"]),
];

fn assert_none(rule: &str, violations: &[String]) {
    assert!(violations.is_empty(), "{rule}:\n  {}", violations.join("\n  "));
}

/// Violations in the production code of files below `folder`.
fn violations(folder: &str, rule: fn(&Source) -> Vec<Found>) -> Vec<String> {
    let production = rust_files_below(folder).into_iter().filter(|file| !file.for_tests);
    let mut seen = 0;
    let found = production
        .inspect(|_| seen += 1)
        .flat_map(|file| {
            rule(&file.source).into_iter().map(move |f| format!("{}:{}: {}", file.path.display(), f.line, f.what))
        })
        .collect();
    assert!(seen > 0, "no file below {folder:?} was looked at");
    found
}

/// Names of the Rust files in a folder, without their ending, `mod` left out.
fn stems(folder: &str) -> Vec<String> {
    let inside: Vec<PathBuf> = files().into_iter().filter(|path| path.parent() == Some(Path::new(folder))).collect();
    let stem = |path: &PathBuf| path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let names: Vec<String> = inside.iter().filter_map(stem).filter(|name| name != "mod").collect();
    assert!(!names.is_empty(), "no file in {folder}");
    names
}

#[test]
fn models_reach_no_ros_no_files_no_runtime() {
    let graph = Graph::of_workspace();
    assert!(graph.members_below("models").count() >= 4, "the models are part of the workspace");
    assert!(graph.reach("abbe-runtime").contains("ros2-client"), "the graph holds what the runtime is built on");
    assert_none("model crates stay pure numerics", &graph.impure_models());
}

#[test]
fn dependencies_point_one_way() {
    assert_none(
        "nodes → msgs, models, evidence; evidence → models; msgs → none",
        &Graph::of_workspace().against_direction(),
    );
}

/// A room that is built on one more is a change of the map, for whoever reads it.
#[test]
fn rooms_are_built_on_what_the_map_says() {
    let graph = Graph::of_workspace();
    for layer in ["models", "nodes"] {
        assert_eq!(documents::arrows(&read("ARCHITECTURE.md"), layer), graph.arrows(layer), "map, and {layer}/");
    }
}

#[test]
fn files_are_read_and_written_without_what_solves() {
    let reached = Graph::of_workspace().reach(FILES);
    assert!(reached.contains("abbe-measurement"), "the graph holds what files are read into");
    let solvers: Vec<&String> = reached.iter().filter(|name| SOLVERS.contains(&name.as_str())).collect();
    assert!(solvers.is_empty(), "{FILES} reaches {solvers:?}: what is read belongs into models/measurement");
}

#[test]
fn what_is_built_by_default_trains_nothing() {
    let graph = Graph::of_workspace();
    assert!(graph.built_by_default.contains("abbe"), "the program is built by default");
    assert!(graph.reach("abbe-train").contains("burn"), "the graph holds what training is built on");
    assert_none("training is a program of its own, and nobody else compiles it", &graph.training_by_default());
}

#[test]
fn the_program_for_windows_reaches_nothing_that_is_for_linux_alone() {
    let host = Graph::of_workspace().of_linux_by_default();
    assert!(host.iter().any(|found| found.ends_with("reaches ros2-client")), "on Linux live nodes are built");
    let graph = Graph::on(WINDOWS);
    assert!(graph.built_by_default.contains("abbe"), "the program is built by default");
    assert_none(
        "live nodes stay on Linux: depend on it under [target.'cfg(target_os = \"linux\")'.dependencies]",
        &graph.of_linux_by_default(),
    );
}

#[test]
fn models_use_no_file_no_clock_no_environment_no_terminal() {
    for folder in ["models", EVIDENCE] {
        assert_none("a model crate computes and nothing else", &violations(folder, rules::impure));
    }
}

#[test]
fn production_code_returns_errors_instead_of_ending_the_program() {
    let mut found = Vec::new();
    for folder in ["models", "msgs", "nodes", EVIDENCE] {
        found.extend(violations(folder, rules::endings));
    }
    assert_none("no unwrap, expect, panic or todo outside tests", &found);
}

#[test]
fn live_nodes_solve_nothing_and_are_simulated_in_one_place() {
    let mut found = Vec::new();
    let live = rust_files_below(LIVE);
    for (name, places) in NAMED_IN {
        let mut seen = vec![false; places.len()];
        for file in live.iter().filter(|file| !file.for_tests) {
            let named = rules::names_of(&file.source, name);
            match places.iter().position(|place| file.path.starts_with(Path::new(LIVE).join(place))) {
                Some(place) => seen[place] |= !named.is_empty(),
                None => found.extend(named.iter().map(|f| format!("{}:{}: {name}", file.path.display(), f.line))),
            }
        }
        let idle = places.iter().zip(seen).filter(|(_, seen)| !seen);
        found.extend(idle.map(|(place, _)| format!("{place} does not name {name} any more: take it off the list")));
    }
    assert_none("only a capture identifies, and only the simulator's own files simulate", &found);
}

#[test]
fn files_of_a_crate_use_each_other_one_way() {
    let mut crates: BTreeMap<String, Modules> = BTreeMap::new();
    for file in rust_files().iter().filter(|file| !file.for_tests) {
        let path = file.path.to_string_lossy().replace('\\', "/");
        let Some((folder, module)) = path.strip_suffix(".rs").and_then(|path| path.split_once("/src/")) else {
            continue;
        };
        crates.entry(folder.to_owned()).or_default().add(module, &file.source);
    }
    assert!(crates.len() >= 20, "{:?}", crates.keys());
    let words = |folder: &str, files: &[&str], uses: usize| format!("{folder}: {} ({uses} uses)", files.join(", "));
    let of = |(folder, modules): (&String, &Modules)| -> Vec<String> {
        let circles = modules.circles().into_iter();
        let each = |(files, uses): (Vec<String>, usize)| {
            words(folder, &files.iter().map(String::as_str).collect::<Vec<&str>>(), uses)
        };
        circles.map(each).collect()
    };
    let found: BTreeSet<String> = crates.iter().flat_map(of).collect();
    let listed: BTreeSet<String> =
        THERE_ARE.iter().map(|(folder, files, uses, _)| words(folder, files, *uses)).collect();
    let new: Vec<String> = found.difference(&listed).cloned().collect();
    assert_none("move what they need of each other into a file below them", &new);
    let gone: Vec<String> = listed.difference(&found).cloned().collect();
    assert_none("a circle that is smaller or gone is listed so in tests/src/mutual.rs", &gone);
}

#[test]
fn no_test_is_switched_off() {
    let found = rust_files().into_iter().flat_map(|file| {
        rules::ignored_tests(&file.source).into_iter().map(move |f| format!("{}:{}", file.path.display(), f.line))
    });
    assert_none("a test runs or does not exist", &found.collect::<Vec<_>>());
}

/// Tests of a package are one program; a file that it does not take in would never run, and nobody would notice.
#[test]
fn every_test_file_is_part_of_a_program() {
    let all = files();
    let manifests: String = all.iter().filter(|path| path.ends_with("Cargo.toml")).map(read).collect();
    let is_main = |path: &&PathBuf| path.ends_with("tests/main.rs") || path.ends_with("system/main.rs");
    let folders: Vec<&Path> = all.iter().filter(is_main).filter_map(|path| path.parent()).collect();
    assert!(folders.len() >= 2, "{folders:?}");
    let mut found = Vec::new();
    for folder in folders {
        let last = folder.file_name().unwrap_or_default().to_string_lossy();
        let names = stems(&folder.to_string_lossy());
        let is_program = |name: &&String| manifests.contains(&format!("{last}/{name}.rs\""));
        let programs: Vec<String> = names.iter().filter(is_program).cloned().collect();
        let parsed = |name: &String| Source::parse(&read(folder.join(format!("{name}.rs")))).expect("Rust");
        let beside: Vec<Source> = names.iter().map(parsed).collect();
        let lost = registry::files_without_program(&names, &beside, &programs);
        found.extend(lost.into_iter().map(|name| format!("{}/{name}.rs", folder.display())));
    }
    assert_none("a line `mod NAME;` in main.rs", &found);
}

#[test]
fn every_source_file_says_what_it_is_for() {
    let silent = |file: &&RustFile| !rules::has_header(&file.text) && !file.path.ends_with("build.rs");
    let found: Vec<String> = rust_files().iter().filter(silent).map(|file| file.path.display().to_string()).collect();
    assert_none("a file begins with `//!`: its purpose and place in the flow", &found);
}

#[test]
fn no_source_file_is_too_long_to_read() {
    let long = |file: &RustFile| rules::too_long(&file.text).map(|n| format!("{}: {n} lines", file.path.display()));
    assert_none("split the file", &rust_files().iter().filter_map(long).collect::<Vec<_>>());
}

#[test]
fn no_file_names_a_folder_of_somebodys_machine() {
    let mut found = Vec::new();
    for path in files() {
        // What is not text cannot be read as such and is left out.
        let Ok(text) = std::fs::read_to_string(root().join(&path)) else { continue };
        found.extend(
            rules::machine_paths(&text).into_iter().map(|f| format!("{}:{}: {}", path.display(), f.line, f.what)),
        );
    }
    assert_none("paths are relative to the project", &found);
}

#[test]
fn an_effect_is_one_file_and_one_line() {
    let (shared, mut names): (Vec<String>, Vec<String>) =
        stems(EFFECTS).into_iter().partition(|name| SHARED_BY_EFFECTS.contains(&name.as_str()));
    assert_eq!(shared.len(), SHARED_BY_EFFECTS.len(), "what effects share is there");
    let all = rust_files();
    let is_table = |file: &&RustFile| file.path == Path::new(EFFECTS).join("registry.rs");
    let table = all.iter().find(is_table).expect("the table of effects");
    assert_none("effects and their table", &registry::effects_against_table(&names, &table.source));
    let registered: Vec<&str> = abbe_geometry::effects::REGISTRY.iter().map(|known| known.name).collect();
    assert_eq!(names.len(), registered.len(), "one entry a file");
    assert_none("effects and their files", &registry::names_against_files(&names, &registered));
    names.retain(|name| !FOUND_BY_A_SEARCH.contains(&name.as_str()));
    let elsewhere = |file: &&RustFile| {
        !file.for_tests
            && !file.path.starts_with(EFFECTS)
            && !file.path.starts_with(INDEPENDENT_TRUTH)
            && (!file.path.starts_with("tests") || file.path.starts_with(EVIDENCE))
    };
    let mut found = Vec::new();
    for file in all.iter().filter(elsewhere) {
        let known = registry::mentions(&file.source, &names);
        found.extend(known.into_iter().map(|name| format!("{} knows {name}", file.path.display())));
    }
    assert_none("no code but its own file knows an effect by name", &found);
}

#[test]
fn an_export_format_is_one_file_and_one_line_and_is_documented() {
    let names: Vec<&str> = abbe_files::export::FORMATS.iter().map(|format| format.name).collect();
    // What several formats share is no format itself.
    let shared = ["approach", "left_out", "said", "skew", "steps", "tip", "volume"];
    let own = |stem: &String| !shared.contains(&stem.as_str());
    let files: Vec<String> = stems(EXPORTS).into_iter().filter(own).map(|stem| stem.replace('_', "-")).collect();
    assert_none("export formats and their files", &registry::names_against_files(&files, &names));
    let words: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
    assert_none(
        "docs/src/reference/exports.md lacks",
        &documents::not_named(&read("docs/src/reference/exports.md"), &words),
    );
}

#[test]
fn a_driver_is_one_file_and_its_lines_in_one_table() {
    // The form that all drivers of a campaign in memory share is no driver itself.
    let names: Vec<String> = stems(DRIVERS).into_iter().filter(|name| name != "recorded").collect();
    let all = rust_files();
    let table = all.iter().find(|file| file.path == Path::new(DRIVERS).join("mod.rs")).expect("the table of drivers");
    let wrong = registry::drivers_against_table(&names, &table.source, "DriverConfig", ["open_scale", "open_tracer"]);
    assert_none("drivers and their table", &wrong);
}

#[test]
fn shipped_machines_load_under_their_file_names() {
    let machines: Vec<PathBuf> = files()
        .into_iter()
        .filter(|path| path.starts_with("launch-config/machines") && path.extension().is_some_and(|e| e == "toml"))
        .collect();
    assert!(machines.len() >= 3, "{machines:?}");
    for path in machines {
        let machine = abbe_files::read_machine(&root().join(&path)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(
            Some(machine.machine.name.as_ref()),
            path.file_stem().and_then(|stem| stem.to_str()),
            "{}",
            path.display()
        );
    }
}

/// The example of `launch-config/README.md` and every launch file beside it.
#[test]
fn launch_files_make_a_graph_of_files_that_are_there() {
    let folder = Path::new("launch-config");
    let examples = documents::blocks(&read(folder.join("README.md")), "toml");
    assert!(!examples.is_empty(), "launch-config/README.md shows a launch file");
    let is_launch = |path: &PathBuf| path.parent() == Some(folder) && path.extension().is_some_and(|e| e == "toml");
    let shipped = files().into_iter().filter(is_launch).map(|path| (read(&path), path));
    for (text, path) in examples.into_iter().map(|text| (text, folder.join("README.md"))).chain(shipped) {
        let launch = Launch::parse(&text, &path).unwrap_or_else(|error| panic!("{error}"));
        let machine = root().join(folder).join(&launch.machine);
        assert!(machine.is_file(), "{}: no machine {}", path.display(), machine.display());
    }
}

#[test]
fn the_architecture_names_every_crate() {
    let folders: Vec<String> = Graph::of_workspace().members.into_iter().map(|member| member.folder).collect();
    assert_none("ARCHITECTURE.md lacks", &documents::not_named(&read("ARCHITECTURE.md"), &folders));
}

#[test]
fn the_table_of_topics_is_whole() {
    let all = rust_files();
    let topics = all.iter().find(|file| file.path.ends_with("nodes/graph/src/topics.rs")).expect("the topics");
    let names: Vec<String> = topics.source.string_constants().into_iter().map(|(_, value)| value).collect();
    assert!(names.len() >= 5, "{names:?}");
    assert_none("docs/src/reference/live.md lacks", &documents::not_named(&read("docs/src/reference/live.md"), &names));
}

#[test]
fn the_table_of_launch_keys_is_whole() {
    let all = rust_files();
    let files = ["graph/src/launch.rs", "graph/src/launch/record.rs", "graph/src/launch/realtime.rs"];
    let is_launch = |path: &Path| files.iter().any(|file| path.ends_with(file));
    let launch: Vec<_> = all.iter().filter(|file| is_launch(&file.path)).collect();
    assert_eq!(launch.len(), files.len(), "the launch file and its tables that may be one word");
    let keys: Vec<_> = launch.iter().flat_map(|file| file.source.public_fields()).collect();
    assert!(keys.len() >= 10, "{keys:?}");
    assert_none("docs/src/reference/live.md lacks", &documents::not_named(&read("docs/src/reference/live.md"), &keys));
}

/// What the README promises in its first lines is what continuous integration runs; not optimised, which would be one more build of all.
#[test]
fn the_two_commands_of_the_readme_are_those_of_ci() {
    let commands = documents::first_commands(&read("README.md"));
    assert_eq!(commands.len(), 2, "main job and tests: {commands:?}");
    let ci = read(".ci/run");
    for command in &commands {
        assert!(documents::runs(&ci, command), ".ci/run does not run {command:?}");
    }
}
