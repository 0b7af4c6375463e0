//! Real time of the correcting path: the key `realtime` of a launch file, `true` or a table.
//!
//! Place in the flow: part of [`super::Launch`]. `true` is what nearly all want: the priority that is usual for control, on all
//! cores. The table is for a machine whose cores are shared out by hand.

use super::{Launch, NodeName};
use crate::driver::DriverConfig;
use abbe_runtime::realtime::{Realtime, online_cores};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;

/// Real time as the launch file asks for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RealtimeConfig {
    /// Priority under SCHED_FIFO; [`RealtimeConfig::PRIORITY`] without it.
    pub priority: Option<u32>,
    /// Cores to run on; all without it.
    pub cores: Option<Vec<usize>>,
}

/// Nodes between the driver and the corrected sample.
const ON_THE_PATH: [NodeName; 3] = [NodeName::Scale, NodeName::Geometric, NodeName::Residual];

impl RealtimeConfig {
    /// Priority where the launch file does not say: that of control loops, and of interrupts in a kernel made for real time.
    pub const PRIORITY: u8 = 50;
    /// What `realtime = true` means.
    pub const PLAIN: RealtimeConfig = RealtimeConfig { priority: None, cores: None };

    /// The key that is wrong, and what is wrong with it.
    pub(super) fn problem(&self, launch: &Launch) -> Option<(&'static str, String)> {
        if !launch.nodes.iter().any(|node| ON_THE_PATH.contains(node)) {
            let problem = "is for scale, geometric and residual, and this launch starts none of them; leave it out";
            return Some(("realtime", problem.to_owned()));
        }
        let (least, most) = (Realtime::PRIORITIES.start(), Realtime::PRIORITIES.end());
        if self
            .priority
            .is_some_and(|priority| !u8::try_from(priority).is_ok_and(|p| Realtime::PRIORITIES.contains(&p)))
        {
            let problem = format!("must be {least} to {most}; 99 is that of threads of the kernel");
            return Some(("realtime.priority", problem));
        }
        let cores = self.cores.as_deref()?;
        let there = online_cores();
        let problem = match cores {
            [] => "names no core; leave it out for all of them".to_owned(),
            cores => {
                let twice = cores.iter().enumerate().find(|(place, core)| cores[..*place].contains(core));
                let absent = cores.iter().find(|core| !there.contains(core));
                match (twice, absent) {
                    (Some((_, core)), _) => format!("names core {core} twice"),
                    (None, Some(core)) => format!("names core {core}, and this machine has the cores {there:?}"),
                    (None, None) => return None,
                }
            }
        };
        Some(("realtime.cores", problem))
    }
}

impl Launch {
    /// Real time of the nodes on the path of a sample; nothing where it is not asked for.
    pub fn realtime(&self) -> Option<Realtime> {
        let RealtimeConfig { priority, cores } = self.realtime.clone()?;
        let nodes = self.nodes.iter().filter(|node| ON_THE_PATH.contains(node)).count();
        // These drivers read on a thread of their own.
        let reads_apart = self.nodes.contains(&NodeName::Scale)
            && self.scale.as_ref().is_some_and(|source| {
                let driver = &source.driver;
                matches!(driver, DriverConfig::Lines(_) | DriverConfig::Linuxcnc(_) | DriverConfig::Ippdme(_))
            });
        Some(Realtime {
            priority: priority.and_then(|p| u8::try_from(p).ok()).unwrap_or(RealtimeConfig::PRIORITY),
            cores: cores.unwrap_or_default(),
            threads: nodes + usize::from(reads_apart),
        })
    }

    /// The same of one node, where it is on the path.
    pub fn realtime_of(&self, node: NodeName) -> Option<Realtime> {
        self.realtime().filter(|_| ON_THE_PATH.contains(&node))
    }

    /// What a user should know of the cores that are named: that none is left for everything else.
    pub fn realtime_remark(&self) -> Option<String> {
        let there = online_cores();
        let cores = self.realtime.as_ref()?.cores.as_ref()?;
        let takes_all = there.iter().all(|core| cores.contains(core));
        takes_all.then(|| {
            format!(
                "realtime.cores: {cores:?} are all cores of this machine: everything else, the recorder too, waits while samples are \
                 corrected; leave one core free"
            )
        })
    }
}

/// The table as it stands in the file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    priority: Option<u32>,
    cores: Option<Vec<usize>>,
}

impl Serialize for RealtimeConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self == &RealtimeConfig::PLAIN {
            return serializer.serialize_bool(true);
        }
        let RealtimeConfig { priority, cores } = self.clone();
        Table { priority, cores }.serialize(serializer)
    }
}

/// The key as it stands in the file; `false` is as if it were left out.
pub(super) fn read<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<RealtimeConfig>, D::Error> {
    struct Form;
    impl<'de> Visitor<'de> for Form {
        type Value = Option<RealtimeConfig>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("true, false, or a table with priority and cores")
        }

        fn visit_bool<E: Error>(self, is_wanted: bool) -> Result<Option<RealtimeConfig>, E> {
            Ok(is_wanted.then_some(RealtimeConfig::PLAIN))
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Option<RealtimeConfig>, A::Error> {
            let Table { priority, cores } = Table::deserialize(MapAccessDeserializer::new(map))?;
            Ok(Some(RealtimeConfig { priority, cores }))
        }
    }
    deserializer.deserialize_any(Form)
}
