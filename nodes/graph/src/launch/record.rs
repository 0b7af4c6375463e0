//! What the recorder writes: the key `record` of a launch file, a path or a table.
//!
//! Place in the flow: part of [`super::Launch`]. `record = "bag"` is a bag in one file; the table adds when to begin the next
//! file and how much of the disk to leave free.

use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::path::PathBuf;

/// The recorder's bag.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordConfig {
    /// The bag, relative to the launch file.
    pub bag: PathBuf,
    /// Size from which the next file of the bag is begun (MiB); one file without it.
    pub split_mib: Option<u64>,
    /// Time of recording after which the next file of the bag is begun (s); one file without it.
    pub split_s: Option<f64>,
    /// Free space of the disk at which recording stops (MiB); [`RecordConfig::LEAST_FREE_MIB`] without it.
    pub least_free_mib: Option<u64>,
}

impl RecordConfig {
    /// Free space at which recording stops where the launch file does not say (MiB).
    pub const LEAST_FREE_MIB: u64 = 256;
    /// Less does not hold what completes a bag and what others write meanwhile (MiB).
    pub const LOWEST_LEAST_FREE_MIB: u64 = 16;

    /// A bag in one file.
    pub fn new(bag: impl Into<PathBuf>) -> RecordConfig {
        RecordConfig { bag: bag.into(), split_mib: None, split_s: None, least_free_mib: None }
    }

    /// Free space at which recording stops (bytes).
    pub fn least_free_bytes(&self) -> u64 {
        self.least_free_mib.unwrap_or(RecordConfig::LEAST_FREE_MIB).saturating_mul(1 << 20)
    }

    /// The key that is wrong, and what is wrong with it.
    pub(super) fn problem(&self) -> Option<(&'static str, String)> {
        let splits = self.split_mib.is_some() || self.split_s.is_some();
        let least = RecordConfig::LOWEST_LEAST_FREE_MIB;
        if splits && self.bag.extension().is_some_and(|extension| extension == "mcap") {
            return Some(("record.bag", "is one .mcap file, which cannot be split; name a folder".to_owned()));
        }
        if self.split_mib == Some(0) {
            return Some(("record.split_mib", "must be 1 or more".to_owned()));
        }
        if self.split_s.is_some_and(|seconds| !(1.0..=1e9).contains(&seconds)) {
            return Some(("record.split_s", "must be a number of seconds from 1 to 1e9".to_owned()));
        }
        if self.least_free_mib.is_some_and(|free| free < least) {
            return Some(("record.least_free_mib", format!("must be {least} or more, which completing a bag needs")));
        }
        None
    }
}

/// The table as it stands in the file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    bag: PathBuf,
    split_mib: Option<u64>,
    split_s: Option<f64>,
    least_free_mib: Option<u64>,
}

impl Serialize for RecordConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let RecordConfig { bag, split_mib, split_s, least_free_mib } = self.clone();
        if self == &RecordConfig::new(&bag) {
            return bag.serialize(serializer);
        }
        Table { bag, split_mib, split_s, least_free_mib }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for RecordConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<RecordConfig, D::Error> {
        struct Form;
        impl<'de> Visitor<'de> for Form {
            type Value = RecordConfig;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the path of a bag, or a table with bag, split_mib, split_s and least_free_mib")
            }

            fn visit_str<E: Error>(self, path: &str) -> Result<RecordConfig, E> {
                Ok(RecordConfig::new(path))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<RecordConfig, A::Error> {
                let table = Table::deserialize(MapAccessDeserializer::new(map))?;
                let Table { bag, split_mib, split_s, least_free_mib } = table;
                Ok(RecordConfig { bag, split_mib, split_s, least_free_mib })
            }
        }
        deserializer.deserialize_any(Form)
    }
}
