//! Other people's readers read our bags with all fields right, and we read theirs.
//!
//! Needs a Python with PyPI `rosbags` and `mcap-ros2-support`; name it in `ABBE_PYTHON`. Without it
//! the tests say that they were skipped, and with `ABBE_REQUIRE_PEERS=1` they fail.

use crate::common;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use abbe_msgs::bag::{self, BagWriter, Qos};
use abbe_msgs::standard::PointStamped;
use abbe_msgs::{Message, RosType, ScaleReading, cdr, definition, type_description};
use serde_json::{Value, json};

/// Runs a script of `tests/interop`; `None` when there is no Python to run it.
fn python(script: &str, arguments: &[&Path]) -> Option<String> {
    let Ok(interpreter) = std::env::var("ABBE_PYTHON") else {
        let required = std::env::var("ABBE_REQUIRE_PEERS").is_ok_and(|value| value == "1");
        assert!(!required, "ABBE_REQUIRE_PEERS=1, but ABBE_PYTHON names no interpreter");
        println!("SKIPPED {script}: set ABBE_PYTHON to a Python with rosbags and mcap-ros2-support");
        return None;
    };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interop");
    let output = Command::new(&interpreter)
        .arg(folder.join(script))
        .args(arguments)
        .output()
        .unwrap_or_else(|error| panic!("cannot run ABBE_PYTHON={interpreter}: {error}"));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{script} failed:\n{text}{errors}");
    println!("{text}");
    Some(text)
}

/// Writes the bag and keeps what a reader should find.
struct Recorder {
    writer: BagWriter,
    expected: Vec<Value>,
}

impl Recorder {
    fn write_ros<R: RosType>(&mut self, topic: &str, ros: &R) {
        let log_time_ns = 1_700_000_000_000_000_000 + self.expected.len() as u64;
        self.writer.write_ros(topic, ros, log_time_ns).unwrap();
        let hex = |bytes: Vec<u8>| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        self.expected.push(json!({
            "topic": topic,
            "type": R::ROS_TYPE,
            "log_time_ns": log_time_ns,
            "cdr_hex": hex(cdr::encode(ros).unwrap()),
            "fields": serde_json::to_value(ros).unwrap(),
        }));
    }
}

/// Records every message type, with empty lists and texts too.
fn record(path: &Path) -> Vec<Value> {
    let mut writer = BagWriter::create(path).unwrap();
    writer.set_qos("/diagnostics", Qos::LATCHED);
    let mut recorder = Recorder { writer, expected: Vec::new() };
    for round in 0..150 {
        let scales = ScaleReading { sequence: round, ..common::scales() };
        recorder.write_ros("/bridge/scales", &scales.to_ros());
        recorder.write_ros("/bridge/tracer", &common::tracer().to_ros());
        recorder.write_ros("/bridge/corrected", &common::corrected().to_ros());
        recorder.write_ros("/bridge/residual", &common::residual().to_ros());
        recorder.write_ros("/bridge/point", &common::point());
        recorder.write_ros("/bridge/joint_states", &common::joints());
        recorder.write_ros("/diagnostics", &common::diagnostics());
    }
    recorder.write_ros("/bridge/scales", &ScaleReading::default().to_ros());
    recorder.writer.finish().unwrap();
    recorder.expected
}

#[test]
fn python_reads_our_bags_with_all_fields_right() {
    let folder = tempfile::tempdir().unwrap();
    let expected_path = folder.path().join("expected.json");
    for name in ["run", "run.mcap"] {
        let path = folder.path().join(name);
        let expected = record(&path);
        std::fs::write(&expected_path, Value::from(expected).to_string()).unwrap();
        let Some(report) = python("read_bag.py", &[&path, &expected_path]) else {
            return;
        };
        assert!(report.contains("rosbags: 1051 messages equal; 8 standard definitions equal"));
        assert!(report.contains("mcap-ros2-support: 1051 messages equal"));
    }
}

#[test]
fn python_reads_a_bag_in_several_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let mut recorder = Recorder { writer: BagWriter::create(&path).unwrap(), expected: Vec::new() };
    for round in 0..300 {
        if round % 100 == 99 {
            recorder.writer.split().unwrap();
        }
        let scales = ScaleReading { sequence: round, ..common::scales() };
        recorder.write_ros("/bridge/scales", &scales.to_ros());
        if round > 150 {
            recorder.write_ros("/bridge/tracer", &common::tracer().to_ros());
        }
    }
    assert_eq!(recorder.writer.files(), 4);
    recorder.writer.finish().unwrap();
    let expected_path = folder.path().join("expected.json");
    std::fs::write(&expected_path, Value::from(recorder.expected).to_string()).unwrap();
    let Some(report) = python("read_bag.py", &[&path, &expected_path]) else { return };
    assert!(report.contains("rosbags: 449 messages equal") && report.contains("mcap-ros2-support: 449"), "{report}");
}

/// What a power cut leaves: the files that were completed, named in `metadata.yaml`, and one that was not.
#[test]
fn python_reads_the_complete_files_of_a_bag_that_was_not_finished() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let mut recorder = Recorder { writer: BagWriter::create(&path).unwrap(), expected: Vec::new() };
    recorder.write_ros("/bridge/scales", &common::scales().to_ros());
    recorder.writer.split().unwrap();
    let complete = recorder.expected.clone();
    recorder.write_ros("/bridge/scales", &common::scales().to_ros());
    recorder.writer.flush().unwrap();
    std::mem::forget(recorder.writer);
    std::fs::rename(path.join("run_1.mcap"), folder.path().join("cut")).unwrap();
    let expected_path = folder.path().join("expected.json");
    std::fs::write(&expected_path, Value::from(complete).to_string()).unwrap();
    python("read_bag.py", &[&path, &expected_path]);
}

#[test]
fn python_reads_a_recovered_bag() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole.mcap");
    let mut expected = record(&whole);
    let bytes = std::fs::read(&whole).unwrap();
    let cut = folder.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let saved = folder.path().join("saved");
    let recovery = bag::recover(&cut, &saved).unwrap();
    assert!(recovery.messages_saved > 200 && !recovery.is_complete(), "{recovery:?}");
    expected.truncate(usize::try_from(recovery.messages_saved).unwrap());
    let expected_path = folder.path().join("expected.json");
    std::fs::write(&expected_path, Value::from(expected).to_string()).unwrap();
    python("read_bag.py", &[&saved, &expected_path]);
}

#[test]
fn we_read_and_copy_a_bag_of_python() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("jazzy");
    if python("write_bag.py", &[&path]).is_none() {
        return;
    }
    let messages: Vec<_> = bag::messages(&path).unwrap().map(Result::unwrap).collect();
    assert_eq!(messages.len(), 10);
    let mut expected = Vec::new();
    for (n, message) in messages.iter().enumerate() {
        let point: PointStamped = message.decode_ros().unwrap();
        assert_eq!((point.point.x, point.header.stamp.nanosec), (n as f64, n as u32));
        expected.push(json!({
            "topic": "/point",
            "type": PointStamped::ROS_TYPE,
            "log_time_ns": message.log_time_ns,
            "cdr_hex": message.cdr.iter().map(|b| format!("{b:02x}")).collect::<String>(),
            "fields": serde_json::to_value(&point).unwrap(),
        }));
    }
    // What was copied is read again by Python, quality of service and foreign schema included.
    let copy = folder.path().join("copy");
    assert_eq!(bag::recover(&path, &copy).unwrap().messages_saved, 10);
    let expected_path = folder.path().join("expected.json");
    std::fs::write(&expected_path, Value::from(expected).to_string()).unwrap();
    python("read_bag.py", &[&copy, &expected_path]);
    let profiles = json!([{"history": "KEEP_LAST", "depth": 5, "reliability": "RELIABLE", "durability": "VOLATILE"}]);
    assert_eq!(offered(&copy).unwrap(), BTreeMap::from([("/point".to_owned(), profiles)]));
}

/// By topic, the quality of service that `rosbags` finds in a bag; `None` when there is no Python to run it.
fn offered(bag: &Path) -> Option<BTreeMap<String, Value>> {
    Some(serde_json::from_str(&python("read_qos.py", &[bag])?).unwrap())
}

/// What is offered so matches who asks for reliable samples, as ROS 2 does by default, and who takes them as they come.
#[test]
fn val_rosbags_finds_streams_offered_as_reliable_and_volatile() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["run", "run.mcap"] {
        let path = folder.path().join(name);
        record(&path);
        let Some(offered) = offered(&path) else { return };
        assert_eq!(offered.len(), 7);
        for (topic, profiles) in offered {
            let (depth, durability) = if topic == "/diagnostics" { (1, "TRANSIENT_LOCAL") } else { (10, "VOLATILE") };
            let expected = json!([
                {"history": "KEEP_LAST", "depth": depth, "reliability": "RELIABLE", "durability": durability}
            ]);
            assert_eq!(profiles, expected, "{name}: {topic}");
        }
    }
}

#[test]
fn val_rosbags_and_ros_2_jazzy_give_every_message_the_same_hash() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("definitions.json");
    let texts: BTreeMap<&str, &str> = definition::DEFINITIONS.iter().copied().collect();
    std::fs::write(&path, serde_json::to_string(&texts).unwrap()).unwrap();
    let Some(said) = python("hash_types.py", &[&path]) else { return };
    let hashes: BTreeMap<String, (String, Option<String>)> = serde_json::from_str(&said).unwrap();
    assert_eq!(hashes.len(), definition::DEFINITIONS.len());
    for (name, (of_text, of_jazzy)) in hashes {
        let ours = type_description::hash(&name).unwrap();
        assert_eq!(ours, of_text, "{name}");
        assert_eq!(of_jazzy.is_none(), name.starts_with("abbe_msgs/"), "{name}");
        assert_eq!(of_jazzy.unwrap_or(ours.clone()), ours, "{name} is not what ROS 2 Jazzy defines");
    }
}
