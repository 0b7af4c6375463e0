//! `metadata.yaml` of a rosbag2 directory: written at the end, read first.
//!
//! Place in the flow: [`super::writer`] -> file -> rosbag2 and [`super::reader`]. Written is
//! version 8, which ROS 2 from Humble on reads; version 9 only for messages copied from a bag of
//! that version, whose quality of service is written in names instead of numbers. A recording in
//! several files has it after each of them, so that what is complete can be read whatever happens
//! later. Of a foreign file only the files, their storage and the numbers of messages are read.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::{BagError, convert};

/// Name of the file in the bag's directory.
pub(super) const FILE_NAME: &str = "metadata.yaml";

/// Larger than any real one; guards against reading something else as text.
const SIZE_LIMIT: u64 = 16 * 1024 * 1024;

/// What the writer knows of one topic.
#[derive(Debug, Clone)]
pub(super) struct TopicSummary {
    pub(super) topic: String,
    pub(super) ros_type: String,
    pub(super) qos_yaml: String,
    /// RIHS01 hash of the type; empty where nobody knows it.
    pub(super) type_hash: String,
    pub(super) messages: u64,
}

impl TopicSummary {
    /// Whether the quality of service is in names (`history: keep_last`), not in numbers.
    fn names_qos(&self) -> bool {
        let history = self.qos_yaml.split_once("history:");
        history.is_some_and(|(_, value)| value.trim_start().starts_with(char::is_alphabetic))
    }

    /// The quality of service as a value of `metadata.yaml`: text that holds YAML, and from
    /// version 9 on the YAML itself.
    fn qos_value(&self, version: u32) -> String {
        if version < 9 {
            quoted(&self.qos_yaml)
        } else if self.qos_yaml.is_empty() {
            "[]".to_owned()
        } else {
            format!("\n{}", indented(&self.qos_yaml, "        "))
        }
    }
}

/// What the writer knows of one file of the bag.
#[derive(Debug, Clone)]
pub(super) struct FileSummary {
    pub(super) file_name: String,
    /// First and last `log_time_ns`, when there is a message.
    pub(super) span_ns: Option<(u64, u64)>,
    pub(super) topics: Vec<TopicSummary>,
}

impl FileSummary {
    pub(super) fn messages(&self) -> u64 {
        self.topics.iter().map(|topic| topic.messages).sum()
    }
}

/// What the writer knows of the bag.
#[derive(Debug, Clone)]
pub(super) struct Metadata<'a> {
    pub(super) files: &'a [FileSummary],
}

impl Metadata<'_> {
    /// The text below `rosbag2_bagfile_information`, which also stands inside the `.mcap`.
    pub(super) fn body(&self) -> String {
        let spans = || self.files.iter().filter_map(|file| file.span_ns);
        let span_ns = spans().map(|span| span.0).min().zip(spans().map(|span| span.1).max());
        let version = self.version();
        let mut body = format!("version: {version}\nstorage_identifier: mcap\n{}", times(span_ns, self.messages()));
        body += "relative_file_paths:\n";
        // Writing to a String cannot fail.
        for file in self.files {
            let _ = writeln!(body, "  - {}", quoted(&file.file_name));
        }
        body += "compression_format: \"\"\ncompression_mode: \"\"\n";
        let topics = self.topics();
        body += if topics.is_empty() { "topics_with_message_count: []\n" } else { "topics_with_message_count:\n" };
        for topic in &topics {
            let _ = write!(
                body,
                "  - topic_metadata:\n      name: {}\n      type: {}\n      \
                 serialization_format: cdr\n      offered_qos_profiles: {}\n      \
                 type_description_hash: {}\n    message_count: {}\n",
                quoted(&topic.topic),
                quoted(&topic.ros_type),
                topic.qos_value(version),
                quoted(&topic.type_hash),
                topic.messages
            );
        }
        body += "files:\n";
        for file in self.files {
            let times = indented(&times(file.span_ns, file.messages()), "    ");
            let _ = write!(body, "  - path: {}\n{times}", quoted(&file.file_name));
        }
        body + "custom_data: ~\nros_distro: \"\"\n"
    }

    fn messages(&self) -> u64 {
        self.files.iter().map(FileSummary::messages).sum()
    }

    /// The topics of all files, in the order of their first message.
    pub(super) fn topics(&self) -> Vec<TopicSummary> {
        let mut topics: Vec<TopicSummary> = Vec::new();
        let mut places: BTreeMap<&str, usize> = BTreeMap::new();
        for topic in self.files.iter().flat_map(|file| &file.topics) {
            match places.get(topic.topic.as_str()) {
                Some(place) => topics[*place].messages += topic.messages,
                None => {
                    places.insert(&topic.topic, topics.len());
                    topics.push(topic.clone());
                }
            }
        }
        topics
    }

    fn version(&self) -> u32 {
        let mut topics = self.files.iter().flat_map(|file| &file.topics);
        if topics.any(TopicSummary::names_qos) { 9 } else { 8 }
    }

    /// The whole file.
    pub(super) fn text(&self) -> String {
        format!("rosbag2_bagfile_information:\n{}", indented(&self.body(), "  "))
    }
}

fn times(span_ns: Option<(u64, u64)>, messages: u64) -> String {
    let (start, end) = span_ns.unwrap_or((0, 0));
    format!(
        "duration:\n  nanoseconds: {}\nstarting_time:\n  nanoseconds_since_epoch: {start}\nmessage_count: {messages}\n",
        end - start
    )
}

fn indented(text: &str, indent: &str) -> String {
    text.lines().map(|line| format!("{indent}{line}\n")).collect()
}

/// A JSON string is a double-quoted YAML string.
pub(super) fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[derive(Debug, Deserialize)]
struct Document {
    rosbag2_bagfile_information: Information,
}

#[derive(Debug, Deserialize)]
struct Information {
    storage_identifier: String,
    relative_file_paths: Vec<String>,
    message_count: u64,
    #[serde(default)]
    compression_mode: String,
    #[serde(default)]
    files: Vec<FileInformation>,
    /// Those without a message as well.
    #[serde(default)]
    topics_with_message_count: Vec<TopicInformation>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct TopicInformation {
    topic_metadata: TopicName,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct TopicName {
    name: String,
}

#[derive(Debug, Deserialize)]
struct FileInformation {
    path: String,
    message_count: u64,
}

/// The files of a bag, and what is promised of them.
pub(super) struct Listing {
    /// In their order.
    pub(super) files: Vec<PathBuf>,
    /// The `metadata.yaml` and the number of messages it promises.
    pub(super) promised: Option<(PathBuf, u64)>,
    /// What is wrong with the bag as a whole, although its files may be readable.
    pub(super) at_end: Option<BagError>,
    /// Topics that `metadata.yaml` names.
    pub(super) topics: BTreeSet<String>,
}

impl Listing {
    /// A bag that is one file.
    pub(super) fn file(path: &Path) -> Listing {
        Listing { files: vec![path.to_owned()], promised: None, at_end: None, topics: BTreeSet::new() }
    }
}

/// The `.mcap` files of a rosbag2 directory. One whose recording was not finished has files that no
/// `metadata.yaml` names: they come last, by their numbers.
///
/// # Errors
/// When `metadata.yaml` is not readable or describes another kind of bag, or there is nothing at all.
pub(super) fn list(directory: &Path) -> Result<Listing, BagError> {
    let path = directory.join(FILE_NAME);
    let fault = |reason: String| BagError::Metadata { path: path.clone(), reason };
    let found = numbered_files(directory)?;
    let Some(information) = read(&path)? else {
        let missing = fault("missing, so the recording was not finished; recover the bag".to_owned());
        if found.is_empty() {
            convert::refuse_unlisted(directory)?;
            return Err(missing);
        }
        return Ok(Listing { files: found, promised: None, at_end: Some(missing), topics: BTreeSet::new() });
    };
    let mut files = files(directory, &information).map_err(fault)?;
    let unnamed: Vec<PathBuf> = found.into_iter().filter(|file| !files.contains(file)).collect();
    let at_end = unnamed.first().map(|file| {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let path = directory.join(FILE_NAME);
        let reason =
            format!("does not name {name}, which lies beside it, so the recording was not finished; recover the bag");
        BagError::Metadata { path, reason }
    });
    files.extend(unnamed);
    let topics = information.topics_with_message_count.into_iter().map(|topic| topic.topic_metadata.name);
    let topics = topics.filter(|name| !name.is_empty()).collect();
    Ok(Listing { files, promised: Some((path, information.message_count)), at_end, topics })
}

/// What a `metadata.yaml` says of each file by its name: the messages in it, where it says so.
pub(super) fn promises(directory: &Path) -> BTreeMap<PathBuf, Option<u64>> {
    // Whatever is wrong with it: the files themselves are looked at.
    let Ok(Some(information)) = read(&directory.join(FILE_NAME)) else { return BTreeMap::new() };
    let Ok(named) = files(directory, &information) else { return BTreeMap::new() };
    let count = |path: &PathBuf| {
        let name = path.file_name();
        let of_file = information.files.iter().find(|file| Path::new(&file.path).file_name() == name);
        of_file.map(|file| file.message_count).or((named.len() == 1).then_some(information.message_count))
    };
    named.iter().map(|path| (path.clone(), count(path))).collect()
}

/// The `.mcap` files of a directory, in the order of the number that rosbag2 puts at the end of a name.
pub(super) fn numbered_files(directory: &Path) -> Result<Vec<PathBuf>, BagError> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(directory).map_err(BagError::io(directory, "list the bag"))? {
        let path = entry.map_err(BagError::io(directory, "list the bag"))?.path();
        if path.extension().is_some_and(|extension| extension == "mcap") {
            files.push(path);
        }
    }
    files.sort_by_key(|path| (split_number(path), path.clone()));
    Ok(files)
}

/// The number that rosbag2 puts at the end of a file's name.
pub(super) fn split_number(path: &Path) -> Option<u64> {
    let stem = path.file_stem()?.to_str()?;
    stem.rsplit_once('_')?.1.parse().ok()
}

/// The file's content; `None` where there is no file.
fn read(path: &Path) -> Result<Option<Information>, BagError> {
    let fault = |reason: String| BagError::Metadata { path: path.to_owned(), reason };
    let size = match std::fs::metadata(path) {
        Ok(entry) => entry.len(),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(BagError::io(path, "read the metadata")(error)),
    };
    if size > SIZE_LIMIT {
        return Err(fault(format!("{size} bytes are too many for bag metadata; recover the bag")));
    }
    let text = std::fs::read_to_string(path).map_err(BagError::io(path, "read the metadata"))?;
    parse(&text).map(Some).map_err(fault)
}

fn parse(text: &str) -> Result<Information, String> {
    match serde_saphyr::from_str::<Document>(text) {
        Ok(document) => Ok(document.rosbag2_bagfile_information),
        Err(error) => Err(format!("not the metadata of a rosbag2 bag: {error}; recover the bag to write it anew")),
    }
}

fn files(directory: &Path, information: &Information) -> Result<Vec<PathBuf>, String> {
    let storage = &information.storage_identifier;
    if storage != "mcap" {
        return Err(format!("storage is '{storage}', not mcap; {}", convert::by_rosbag2(directory)));
    }
    let mode = information.compression_mode.to_lowercase();
    if !matches!(mode.as_str(), "" | "none" | "storage") {
        return Err(format!(
            "compression mode '{mode}' is not read (compression inside MCAP chunks is); {}",
            convert::by_rosbag2(directory)
        ));
    }
    if information.relative_file_paths.is_empty() {
        return Err("names no file; recover the bag".to_owned());
    }
    // Older recorders wrote the directory in front; the files always lie beside metadata.yaml.
    information
        .relative_file_paths
        .iter()
        .map(|path| match Path::new(path).file_name() {
            Some(name) => Ok(directory.join(name)),
            None => Err(format!("'{path}' is not the name of a file; recover the bag")),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn metadata(topic: &str) -> String {
        let file = FileSummary {
            file_name: "run_0.mcap".to_owned(),
            span_ns: Some((5, 9)),
            topics: vec![TopicSummary {
                topic: topic.to_owned(),
                ros_type: "abbe_msgs/msg/ScaleReading".to_owned(),
                qos_yaml: super::super::Qos::STREAM.to_yaml(),
                type_hash: String::new(),
                messages: 3,
            }],
        };
        let files = [file.clone(), FileSummary { file_name: "run_1.mcap".to_owned(), ..file }];
        Metadata { files: &files }.text()
    }

    proptest! {
        #[test]
        fn arbitrary_metadata_is_survived(text: String) {
            if let Ok(information) = parse(&text) {
                let _ = files(Path::new("bag"), &information);
            }
        }

        #[test]
        fn damaged_metadata_is_survived(at in any::<prop::sample::Index>(), letter: char) {
            let mut text: Vec<char> = metadata("/scales").chars().collect();
            let at = at.index(text.len());
            text[at] = letter;
            let text: String = text.into_iter().collect();
            if let Ok(information) = parse(&text) {
                let _ = files(Path::new("bag"), &information);
            }
        }

        #[test]
        fn any_topic_name_gives_readable_metadata(topic: String) {
            let information = parse(&metadata(&topic)).unwrap();
            prop_assert_eq!(information.message_count, 6);
            prop_assert_eq!(information.files.len(), 2);
        }
    }
}
