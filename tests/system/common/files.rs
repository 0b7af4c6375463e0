//! The files that a test works on: a simulated campaign, its model, bags, and what lies in a folder.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use abbe_msgs::bag::messages;
use abbe_msgs::{CorrectedCoordinates, Message, RangeResidual, ScaleReading, TracerReading};
use tempfile::TempDir;

use super::program::run;

/// Who measured with what, as a file for `--identity`.
pub(crate) const WHO: &str = "[identity]\noperator = \"A. Person\"\nserial_number = \"4711\"\n\
    [identity.instrument]\nname = \"Instrument I\"\nserial_number = \"K-77\"\n";

/// Asserts that the head of a page names them.
#[track_caller]
pub(crate) fn assert_names_who(page: &str) {
    let head = page.split("</header>").next().unwrap().split("<h1>").nth(1).unwrap();
    for part in ["<dt>Operator</dt><dd>A. Person</dd>", "serial number 4711", "Instrument I, serial number K-77"] {
        assert!(head.contains(part), "{part}: {head}");
    }
}

/// The machine of the simulator.
pub(crate) fn machine() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/machines/bridge_xyz.toml").canonicalize().unwrap()
}

/// Another machine that ships.
pub(crate) fn other_machine() -> PathBuf {
    machine().with_file_name("fyxz.toml")
}

/// A folder with a simulated campaign and its model.
pub(crate) struct Bench {
    folder: TempDir,
}

impl Bench {
    /// Nothing in it.
    pub(crate) fn empty() -> Bench {
        Bench { folder: tempfile::tempdir().unwrap() }
    }

    /// `campaign.csv` and `verify.csv` of the machine with this seed.
    pub(crate) fn simulated(seed: u64) -> Bench {
        let bench = Bench::empty();
        let seed = seed.to_string();
        run(["simulate", "--machine", &text(&machine()), "--seed", &seed, "--out", &bench.text("")]).ok();
        bench
    }

    /// The same with `model.json`.
    pub(crate) fn identified(seed: u64) -> Bench {
        let bench = Bench::simulated(seed);
        let (campaign, model) = (bench.text("campaign.csv"), bench.text("model.json"));
        run(["identify", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &model]).ok();
        bench
    }

    /// A file of the folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The same as an argument.
    pub(crate) fn text(&self, name: &str) -> String {
        text(&self.path(name))
    }

    /// Content of a file of the folder.
    pub(crate) fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    /// Writes a file of the folder and gives its path as an argument.
    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) -> String {
        fs::write(self.path(name), content).unwrap();
        self.text(name)
    }
}

/// A path as an argument.
pub(crate) fn text(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

/// Everything below a folder, with sizes: to see what a command left behind.
pub(crate) fn listing(folder: &Path) -> BTreeMap<PathBuf, u64> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap().map(Result::unwrap) {
            let metadata = entry.metadata().unwrap();
            if metadata.is_dir() {
                folders.push(entry.path());
            }
            found.insert(entry.path(), if metadata.is_dir() { 0 } else { metadata.len() });
        }
    }
    found
}

/// Messages of a bag: topic → sequence → bytes. Fails when a sequence stands twice on a topic.
pub(crate) fn recorded(bag: &Path) -> BTreeMap<String, BTreeMap<u64, Vec<u8>>> {
    let mut topics: BTreeMap<String, BTreeMap<u64, Vec<u8>>> = BTreeMap::new();
    for message in messages(bag).unwrap().map(Result::unwrap) {
        let sequence = match message.ros_type() {
            ScaleReading::ROS_TYPE => message.decode::<ScaleReading>().unwrap().sequence(),
            TracerReading::ROS_TYPE => message.decode::<TracerReading>().unwrap().sequence(),
            CorrectedCoordinates::ROS_TYPE => message.decode::<CorrectedCoordinates>().unwrap().sequence(),
            RangeResidual::ROS_TYPE => message.decode::<RangeResidual>().unwrap().sequence(),
            other => panic!("unexpected type {other}"),
        };
        let before = topics.entry(message.topic().to_owned()).or_default().insert(sequence, message.cdr.clone());
        assert!(before.is_none(), "{} has sequence {sequence} twice", message.topic());
    }
    topics
}

/// Samples of one topic of a bag, in order.
pub(crate) fn samples<M: Message>(bag: &Path, topic: &str) -> Vec<M> {
    let of_topic = messages(bag).unwrap().map(Result::unwrap).filter(|message| message.topic() == topic);
    of_topic.map(|message| message.decode().unwrap()).collect()
}
