//! Evidence for launch files: what is refused, where, and that no text makes the parser panic.

use abbe_graph::launch::{Launch, NodeName, Stamps};
use abbe_runtime::TransportKind;
use abbe_runtime::realtime::online_cores;
use proptest::prelude::*;
use std::path::Path;

const GOOD: &str = r#"
namespace = "bridge_xyz"
machine = "machines/bridge_xyz.toml"
model = "model.json"
nodes = ["scale", "geometric", "residual"]
max_covariate_age_s = 10.0
wait_for_subscribers_s = 5.0

[scale]
driver = { kind = "campaign", file = "campaign.csv" }
pace = { rate_hz = 1000.0 }

[[edges]]
from = "scale"
to = "geometric"
transport = "shared-memory"

[[edges]]
from = "geometric"
to = "residual"
transport = "shared-memory"

[[edges]]
from = "residual"
to = "*"
transport = "dds"

[[edges]]
from = "residual"
to = "user"
transport = "shared-memory"
"#;

fn parse(text: &str) -> Result<Launch, String> {
    Launch::parse(text, Path::new("graph.toml")).map_err(|error| error.to_string())
}

fn refusal(from: &str, to: &str) -> String {
    assert!(GOOD.contains(from), "the test's own text lacks {from:?}");
    parse(&GOOD.replacen(from, to, 1)).unwrap_err()
}

#[test]
fn a_scale_recording_may_be_repeated_and_a_tracer_recording_may_not() {
    let repeated = GOOD.replacen("pace = { rate_hz = 1000.0 }", "pace = { rate_hz = 1000.0 }\nrepeat_from = 7", 1);
    let launch = parse(&repeated).unwrap();
    let from = |launch: Launch| launch.scale.unwrap().repeat_from;
    assert_eq!((from(launch.clone()), from(parse(GOOD).unwrap())), (Some(7), None));
    assert_eq!(parse(&launch.to_text().unwrap()).unwrap(), launch, "what is written is read back");
    let tracer = repeated.replacen("[scale]", "[tracer]", 1).replacen("\"scale\", ", "", 1);
    let refused = parse(&tracer).unwrap_err();
    assert!(refused.contains("tracer.repeat_from") && refused.contains("no new evidence"), "{refused}");
}

#[test]
fn a_good_file_says_who_talks_to_whom_over_what() {
    let launch = parse(GOOD).unwrap();
    assert_eq!(launch.publishes_over(NodeName::Residual), [TransportKind::SharedMemory, TransportKind::Dds]);
    assert_eq!(launch.takes_over("geometric", NodeName::Scale), Some(TransportKind::SharedMemory));
    assert_eq!(launch.takes_over("monitor", NodeName::Residual), None);
    assert_eq!(launch.awaited(NodeName::Residual), 1, "everyone on DDS is not waited for");
    assert!(launch.uses(NodeName::Residual, TransportKind::Dds));
    assert!(!launch.uses(NodeName::Geometric, TransportKind::Dds));
    assert_eq!(parse(&launch.to_text().unwrap()).unwrap(), launch);
}

#[test]
fn every_node_is_in_the_ros_graph_whatever_its_edges_unless_the_file_says_no() {
    let hidden = parse(&GOOD.replacen("max_covariate", "visible_in_ros = false\nmax_covariate", 1)).unwrap();
    for node in [NodeName::Scale, NodeName::Geometric, NodeName::Residual] {
        assert!(parse(GOOD).unwrap().is_in_ros_graph(node), "{node:?}");
        assert_eq!(hidden.is_in_ros_graph(node), node == NodeName::Residual, "{node:?}: it alone publishes over DDS");
    }
}

#[test]
fn services_may_change_what_a_node_does_unless_the_file_says_no() {
    let silent = GOOD.replacen("max_covariate", "commands_from_ros = false\nmax_covariate", 1);
    let launch = parse(&silent).unwrap();
    assert_eq!((parse(GOOD).unwrap().commands_from_ros, launch.commands_from_ros), (true, false));
    assert_eq!(parse(&launch.to_text().unwrap()).unwrap(), launch, "what is written is read back");
    assert!(parse(&silent.replacen("false", "\"no\"", 1)).unwrap_err().contains("commands_from_ros"));
    // Who waits for a manager has to be found by one, and to obey it.
    let waiting = |more: &str| GOOD.replacen("max_covariate", &format!("autostart = false\n{more}max_covariate"), 1);
    assert!(parse(&waiting("")).is_ok());
    assert!(parse(&waiting("visible_in_ros = false\n")).unwrap_err().contains("visible_in_ros = false"));
    let shut = parse(&waiting("commands_from_ros = false\n")).unwrap_err();
    assert!(shut.contains("autostart") && shut.contains("commands_from_ros"), "{shut}");
}

#[test]
fn what_is_played_is_stamped_with_the_present_unless_the_file_says_otherwise_or_gives_its_own_clock() {
    let with = |keys: &str| parse(&format!("{keys}\n{GOOD}"));
    for (keys, stamps) in [
        ("", Stamps::Now),
        ("stamps = \"now\"", Stamps::Now),
        ("stamps = \"recorded\"", Stamps::Recorded),
        ("publish_clock = true", Stamps::Recorded),
    ] {
        let launch = with(keys).unwrap();
        assert_eq!(launch.stamps(), stamps, "{keys}");
        assert_eq!(parse(&launch.to_text().unwrap()).unwrap(), launch, "what is written is read back");
    }
    assert!(with("stamps = \"now\"\npublish_clock = true").unwrap_err().contains("publish_clock"));
    // What cannot be played in the present is refused, and may be played with its own stamps.
    let played = "driver = { kind = \"campaign\", file = \"campaign.csv\" }\npace = { rate_hz = 1000.0 }";
    let bag = played.replace("kind = \"campaign\"", "kind = \"bag\", topic = \"/a\"");
    let other_pace = played.replace("1000.0", "999.0");
    let paired = diagnosing("").replacen(
        "driver = { kind = \"virtual_machine\", seed = 1 }\npace = { rate_hz = 100.0 }",
        &other_pace,
        1,
    );
    for torn in [GOOD.replacen(played, &bag, 1), paired] {
        let refused = parse(&torn).unwrap_err();
        assert!(refused.contains(": stamps: ") && refused.contains("stamps = \"recorded\""), "{refused}");
        parse(&format!("stamps = \"recorded\"\n{torn}")).unwrap();
    }
}

#[test]
fn shipped_launch_files_are_good() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config");
    let mut found = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "toml") {
            let launch = Launch::read(&path).unwrap();
            assert!(path.parent().unwrap().join(launch.machine).exists(), "{}", path.display());
            found += 1;
        }
    }
    assert!(found > 0, "at least one launch file ships");
}

#[test]
fn each_mistake_is_named_with_file_and_key() {
    let cases = [
        ("transport = \"dds\"", "transport = \"tcp\"", "edges[2]", "shared-memory"),
        ("to = \"geometric\"", "to = \"geometrc\"", "edges[0]", "geometric"),
        ("to = \"geometric\"", "to = \"tracer\"", "edges[0]", "does not take"),
        ("rate_hz = 1000.0", "rate_hz = 0.0", "scale.pace", "above 0"),
        ("max_covariate_age_s = 10.0", "max_covariate_age_s = -1.0", "max_covariate_age_s", "above 0"),
        ("\"residual\"]", "\"residual\", \"monitor\"]", "monitor", "bounds"),
        ("\"residual\"]", "\"residual\", \"recorder\"]", "record", "bag"),
        ("\"residual\"]", "\"residual\", \"tracer\"]", "tracer", "driver"),
        ("namespace", "namespce", "namespce", "unknown field"),
        ("kind = \"campaign\"", "kind = \"campain\"", "campain", "campaign"),
    ];
    for (from, to, key, words) in cases {
        let error = refusal(from, to);
        assert!(error.contains("graph.toml") && error.contains(key) && error.contains(words), "{from} → {to}: {error}");
    }
}

#[test]
fn sensors_and_motion_are_checked_with_file_and_key() {
    let live = "driver = { kind = \"lines\", from = { tcp = \"a:1\" }, columns = [\"x_mm\", \"y_mm\", \"z_mm\"] }\n\
                pace = \"as_they_come\"";
    let recorded = "driver = { kind = \"campaign\", file = \"campaign.csv\" }\npace = { rate_hz = 1000.0 }";
    let sensor = "[[covariates]]\nkind = \"lines\"\nfrom = { udp = \"a:2\" }\ncolumns = [\"temp_air_c\"]\n";
    let motion = "[motion]\nreversal_um = 5.0\nwindow_s = 0.05\n";
    let with = |scale: &str, more: &str| parse(&GOOD.replacen(recorded, &format!("{scale}\n{more}"), 1));
    let launch = with(live, &format!("{sensor}{motion}")).unwrap();
    assert_eq!(parse(&launch.to_text().unwrap()).unwrap(), launch, "what is written is read back");
    assert!(with(recorded, motion).is_ok(), "of a recorded stream as well");
    let other = sensor.replace("a:2", "a:3").replace("temp_air_c", "stamp_s\", \"-\", \"temp_x_c");
    let one = sensor.replace("temp_air_c", "stamp_s\", \"-\", \"temp_air_c");
    assert!(with(live, &format!("{one}{other}")).is_ok());
    for (scale, more, words) in [
        (recorded, sensor.to_owned(), "covariates: are joined to readings of a live scale driver"),
        (live, sensor.replace("temp_air_c", "temp_air"), "covariates[0].columns: \"temp_air\" ends with no unit"),
        (live, sensor.replace("temp_air_c", "x_mm"), "covariates[0].columns: a sensor needs a column of a value"),
        (
            live,
            format!("{sensor}{}", sensor.replace("a:2", "a:3").replace("temp_air_c", "load_kg\", \"temp_air_k")),
            "covariates[1]: says temp_air_c, as does covariates[0]",
        ),
        (
            live,
            format!(
                "{sensor}[[covariates]]\nkind = \"ros\"\ntopic = \"/t\"\nmessage = \"temperature\"\n\
                 covariate = \"temp_air_c\"\n"
            ),
            "covariates[1]: says temp_air_c, as does covariates[0]",
        ),
        (
            live,
            "[[covariates]]\nkind = \"campaign\"\nfile = \"a.csv\"\n".to_owned(),
            "covariates[0].kind: is a recording, which carries its covariates already",
        ),
        (live, motion.replace("5.0", "0.0"), "motion.reversal_um"),
        (live, motion.replace("0.05", "nan"), "motion.window_s"),
        (live, motion.replace("window_s", "windw_s"), "unknown field"),
    ] {
        let refused = with(scale, &more).unwrap_err();
        assert!(refused.contains("graph.toml") && refused.contains(words), "{more}: {refused}");
    }
}

#[test]
fn lagged_covariates_are_checked_with_file_and_key() {
    let with = |names: &str| parse(&format!("lagged = [{names}]\n{GOOD}"));
    let launch = with("\"temp_air_lag_1800s_c\"").unwrap();
    assert_eq!(parse(&launch.to_text().unwrap()).unwrap(), launch, "what is written is read back");
    for (names, words) in [
        ("\"temp_air_c\"", "lagged[0]: names no lagged covariate"),
        ("\"temp_air_lag_60s_c\", \"temp_air_lag_60s_c\"", "lagged[1]: is named twice"),
    ] {
        let refused = with(names).unwrap_err();
        assert!(refused.contains("graph.toml") && refused.contains(words), "{names}: {refused}");
    }
}

#[test]
fn a_node_without_its_input_is_refused() {
    let error = refusal("from = \"geometric\"\nto = \"residual\"", "from = \"geometric\"\nto = \"user\"");
    assert!(error.contains("residual is started but has no edge from geometric"), "{error}");
}

#[test]
fn regress_a_node_whose_output_nobody_takes_is_refused_with_who_could() {
    let to_geometric = GOOD.split("[[edges]]\nfrom = \"geometric\"").next().unwrap();
    for (nodes, words) in [
        ("[\"geometric\", \"scale\"]", "geometric is started but has no edge from it; add one to residual, user or *"),
        ("[\"tracer\"]", "tracer is started but has no edge from it; add one to monitor, user or *"),
    ] {
        let text = to_geometric.replace("[\"scale\", \"geometric\", \"residual\"]", nodes);
        let text = text + "[tracer]\ndriver = { kind = \"campaign\", file = \"c.csv\" }\npace = { rate_hz = 9.0 }\n";
        let error = parse(&text).unwrap_err();
        assert!(error.contains("graph.toml") && error.contains(words), "{error}");
    }
    let alone = to_geometric.replace("\"scale\", \"geometric\", \"residual\"", "\"scale\"");
    parse(&alone).unwrap();
}

/// A graph with a monitor that diagnoses.
fn diagnosing(keys: &str) -> String {
    let edge = |from: &str, to: &str| {
        format!("\n[[edges]]\nfrom = \"{from}\"\nto = \"{to}\"\ntransport = \"shared-memory\"\n")
    };
    let source = "driver = { kind = \"virtual_machine\", seed = 1 }\npace = { rate_hz = 100.0 }\n";
    let monitor = format!("\n[monitor]\nsingle_bound = 4.0\nwindow = 200\nmatch_within_s = 0.0005\n{keys}\n");
    GOOD.replacen("\"residual\"]", "\"residual\", \"monitor\", \"tracer\"]", 1).replacen(
        "driver = { kind = \"campaign\", file = \"campaign.csv\" }\npace = { rate_hz = 1000.0 }\n",
        source,
        1,
    ) + &format!("\n[tracer]\n{source}{monitor}")
        + &edge("residual", "monitor")
        + &edge("tracer", "monitor")
        + &edge("scale", "monitor")
}

#[test]
fn diagnoses_are_off_unless_asked_for_and_no_model_is_adopted_unless_wanted() {
    let config = |keys: &str| parse(&diagnosing(keys)).unwrap().monitor.unwrap();
    let off = config("");
    assert_eq!((off.diagnosis_folder, off.diagnose_when_degraded, off.adopt_diagnosed_model), (None, false, false));
    let on = config("diagnosis_folder = \"diagnoses\"\ndiagnosis_readings = 50\ndiagnose_when_degraded = true");
    assert_eq!((on.least_readings(), on.diagnose_when_degraded, on.adopt_diagnosed_model), (50, true, false));
}

#[test]
fn a_diagnosis_that_cannot_be_is_refused_by_its_key() {
    let folder = "diagnosis_folder = \"diagnoses\"\n";
    let from_scale = "from = \"scale\"\nto = \"monitor\"";
    let cases = [
        (diagnosing("diagnose_when_degraded = true"), "monitor.diagnose_when_degraded", "diagnosis_folder"),
        (diagnosing("adopt_diagnosed_model = true"), "monitor.adopt_diagnosed_model", "diagnosis_folder"),
        (diagnosing(&format!("{folder}diagnosis_readings = 0")), "monitor.diagnosis_readings", "100000"),
        (diagnosing(folder).replace(from_scale, "from = \"scale\"\nto = \"user\""), "monitor.diagnosis_folder", "edge"),
    ];
    for (text, key, words) in cases {
        let error = parse(&text).unwrap_err();
        assert!(error.contains("graph.toml") && error.contains(key) && error.contains(words), "{error}");
    }
}

#[test]
fn effects_are_refused_by_place_and_both_sources_simulate_one_machine() {
    let both = |effects: &str| diagnosing("").replace("seed = 1 }", &format!("seed = 1, effects = [{effects}] }}"));
    assert!(parse(&both("\"backlash axis=x size_um=3 from_s=600\"")).is_ok());
    let error = parse(&both("\"backlash axis=x size_um=3\", \"backlsh axis=x\"")).unwrap_err();
    assert!(error.contains("scale.driver.effects[1]") && error.contains("backlash"), "{error}");
    let error = parse(&diagnosing("").replacen("seed = 1 }", "seed = 2 }", 1)).unwrap_err();
    assert!(error.contains("tracer.driver") && error.contains("same seed"), "{error}");
}

#[test]
fn real_time_is_a_word_or_a_table_and_means_the_same_when_it_is_written() {
    let with = |text: &str| parse(&format!("{text}\n{GOOD}"));
    let of = |launch: &Launch, node| launch.realtime_of(node).map(|realtime| (realtime.priority, realtime.cores));
    for (text, means) in [
        ("", None),
        ("realtime = false", None),
        ("realtime = true", Some((50, vec![]))),
        ("realtime = { priority = 70 }", Some((70, vec![]))),
        ("realtime = { cores = [0] }", Some((50, vec![0]))),
    ] {
        let launch = with(text).unwrap();
        for node in [NodeName::Scale, NodeName::Geometric, NodeName::Residual] {
            assert_eq!(of(&launch, node), means, "{text}");
        }
        for node in [NodeName::Tracer, NodeName::Monitor, NodeName::Recorder] {
            assert_eq!(of(&launch, node), None, "{text}: {node:?} is not on the path");
        }
        assert_eq!(parse(&launch.to_text().unwrap()).unwrap(), launch, "what is written is read back");
    }
    assert!(with("realtime = true").unwrap().to_text().unwrap().contains("realtime = true"));
}

#[test]
fn the_threads_that_share_the_cores_are_those_of_the_path_and_that_of_a_driver() {
    let threads = |text: &str| parse(&format!("realtime = true\n{text}")).unwrap().realtime().unwrap().threads;
    assert_eq!(threads(GOOD), 3);
    let recorded = "driver = { kind = \"campaign\", file = \"campaign.csv\" }\npace = { rate_hz = 1000.0 }";
    let live = "driver = { kind = \"lines\", from = { tcp = \"a:1\" }, columns = [\"x_mm\", \"y_mm\", \"z_mm\"] }\n\
                pace = \"as_they_come\"";
    assert_eq!(threads(&GOOD.replacen(recorded, live, 1)), 4);
}

#[test]
fn real_time_that_cannot_be_is_refused_by_its_key() {
    let with = |text: &str| parse(&format!("{text}\n{GOOD}")).unwrap_err();
    let absent = online_cores().len() + 1000;
    for (text, key, words) in [
        ("realtime = { priority = 99 }", "realtime.priority", "1 to 98"),
        ("realtime = { priority = 0 }", "realtime.priority", "1 to 98"),
        ("realtime = { priority = -1 }", "priority", "u32"),
        ("realtime = { cores = [] }", "realtime.cores", "leave it out"),
        ("realtime = { cores = [0, 0] }", "realtime.cores", "twice"),
        (&format!("realtime = {{ cores = [{absent}] }}"), "realtime.cores", "this machine has the cores"),
        ("realtime = { prority = 50 }", "prority", "unknown field"),
        ("realtime = 50", "realtime", "true, false, or a table"),
    ] {
        let refused = with(text);
        assert!(
            refused.contains("graph.toml") && refused.contains(key) && refused.contains(words),
            "{text}: {refused}"
        );
    }
    let path = "nodes = [\"scale\", \"geometric\", \"residual\"]";
    let beside = format!("realtime = true\n{}", GOOD.replacen(path, "nodes = []", 1));
    assert!(parse(&beside).unwrap_err().contains("starts none of them"));
}

#[test]
fn cores_that_are_all_of_the_machine_are_remarked() {
    let cores = online_cores();
    let remark =
        |cores: &[usize]| parse(&format!("realtime = {{ cores = {cores:?} }}\n{GOOD}")).unwrap().realtime_remark();
    assert!(remark(&cores).unwrap().contains("all cores of this machine"));
    if cores.len() > 1 {
        assert_eq!(remark(&cores[1..]), None);
    }
}

#[test]
fn an_unknown_node_is_told_the_known_ones() {
    let error = "geometry".parse::<NodeName>().unwrap_err().to_string();
    assert!(error.contains("geometric") && error.contains("recorder"), "{error}");
}

proptest! {
    #[test]
    fn no_text_makes_the_parser_panic(text in ".{0,400}") {
        let _ = parse(&text);
    }

    #[test]
    fn no_mangled_file_makes_the_parser_panic(at in 0..GOOD.len(), with in ".{0,8}") {
        let mut text = GOOD.to_owned();
        text.replace_range(at..at, &with);
        let _ = parse(&text);
    }
}
