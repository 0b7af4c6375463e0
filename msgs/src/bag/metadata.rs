//! `metadata.yaml` of a rosbag2 directory: written at the end, read first.
//!
//! Place in the flow: [`super::writer`] -> file -> rosbag2 and [`super::reader`]. Written is
//! version 8, which ROS 2 from Humble on reads; version 9 only for messages copied from a bag of
//! that version, whose quality of service is written in names instead of numbers. Of a foreign
//! file only the files, their storage and the number of messages are read.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::BagError;

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

/// What the writer knows of the bag.
#[derive(Debug, Clone)]
pub(super) struct Metadata {
    pub(super) file_name: String,
    /// First and last `log_time_ns`, when there is a message.
    pub(super) span_ns: Option<(u64, u64)>,
    pub(super) topics: Vec<TopicSummary>,
}

impl Metadata {
    /// The text below `rosbag2_bagfile_information`, which also stands inside the `.mcap`.
    pub(super) fn body(&self) -> String {
        let (start, end) = self.span_ns.unwrap_or((0, 0));
        let duration = end - start;
        let count: u64 = self.topics.iter().map(|topic| topic.messages).sum();
        let file = quoted(&self.file_name);
        let times = format!(
            "duration:\n  nanoseconds: {duration}\nstarting_time:\n  \
             nanoseconds_since_epoch: {start}\nmessage_count: {count}\n"
        );
        let version = self.version();
        let mut body = format!(
            "version: {version}\nstorage_identifier: mcap\n{times}relative_file_paths:\n  - {file}\n\
             compression_format: \"\"\ncompression_mode: \"\"\n"
        );
        body += if self.topics.is_empty() { "topics_with_message_count: []\n" } else { "topics_with_message_count:\n" };
        for topic in &self.topics {
            // Writing to a String cannot fail.
            let _ = write!(
                body,
                "  - topic_metadata:\n      name: {}\n      type: {}\n      \
                 serialization_format: cdr\n      offered_qos_profiles: {}\n      \
                 type_description_hash: \"\"\n    message_count: {}\n",
                quoted(&topic.topic),
                quoted(&topic.ros_type),
                topic.qos_value(version),
                topic.messages
            );
        }
        body += &format!("files:\n  - path: {file}\n{}custom_data: ~\nros_distro: \"\"\n", indented(&times, "    "));
        body
    }

    fn version(&self) -> u32 {
        if self.topics.iter().any(TopicSummary::names_qos) { 9 } else { 8 }
    }

    /// The whole file.
    pub(super) fn text(&self) -> String {
        format!("rosbag2_bagfile_information:\n{}", indented(&self.body(), "  "))
    }
}

fn indented(text: &str, indent: &str) -> String {
    text.lines().map(|line| format!("{indent}{line}\n")).collect()
}

/// A JSON string is a double-quoted YAML string.
fn quoted(text: &str) -> String {
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
}

/// The `.mcap` files of a rosbag2 directory in their order, and how many messages they hold.
///
/// # Errors
/// When `metadata.yaml` is missing, not readable, or describes another kind of bag.
pub(super) fn read(directory: &Path) -> Result<(Vec<PathBuf>, u64), BagError> {
    let path = directory.join(FILE_NAME);
    let fault = |reason: String| BagError::Metadata { path: path.clone(), reason };
    let size = match std::fs::metadata(&path) {
        Ok(entry) => entry.len(),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return Err(fault("missing, so the recording was not finished; recover the bag".to_owned()));
        }
        Err(error) => return Err(BagError::io(&path, "read the metadata")(error)),
    };
    if size > SIZE_LIMIT {
        return Err(fault(format!("{size} bytes are too many for bag metadata; recover the bag")));
    }
    let text = std::fs::read_to_string(&path).map_err(BagError::io(&path, "read the metadata"))?;
    let information = parse(&text).map_err(fault)?;
    let files = files(directory, &information).map_err(fault)?;
    Ok((files, information.message_count))
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
        return Err(format!("storage is '{storage}', not mcap; convert the bag with 'ros2 bag convert'"));
    }
    let mode = information.compression_mode.to_lowercase();
    if !matches!(mode.as_str(), "" | "none" | "storage") {
        return Err(format!(
            "compression mode '{mode}' is not read; convert the bag with 'ros2 bag convert' \
             (compression inside MCAP chunks is read)"
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

    fn metadata(topic: &str) -> Metadata {
        Metadata {
            file_name: "run_0.mcap".to_owned(),
            span_ns: Some((5, 9)),
            topics: vec![TopicSummary {
                topic: topic.to_owned(),
                ros_type: "abbe_msgs/msg/ScaleReading".to_owned(),
                qos_yaml: super::super::Qos::STREAM.to_yaml(),
                messages: 3,
            }],
        }
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
            let mut text: Vec<char> = metadata("/scales").text().chars().collect();
            let at = at.index(text.len());
            text[at] = letter;
            let text: String = text.into_iter().collect();
            if let Ok(information) = parse(&text) {
                let _ = files(Path::new("bag"), &information);
            }
        }

        #[test]
        fn any_topic_name_gives_readable_metadata(topic: String) {
            let information = parse(&metadata(&topic).text()).unwrap();
            prop_assert_eq!(information.message_count, 3);
        }
    }
}
