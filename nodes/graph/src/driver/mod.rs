//! Drivers: where scale and tracer readings come from. One instrument, one file.
//!
//! Place in the flow: the scale and the tracer node publish what their driver gives, at its pace. A driver for a
//! real instrument implements [`ScaleDriver`], [`TracerDriver`] or [`SensorDriver`], gets a variant in [`DriverConfig`] with a
//! line in `DriverConfig::problem`, and one in [`open_scale`], [`open_tracer`] or [`open_sensor`]; nothing else changes.

mod bag;
mod campaign_file;
mod ippdme;
mod lines;
mod linuxcnc;
#[cfg(feature = "opcua")]
mod opcua;
#[cfg(not(feature = "opcua"))]
#[path = "opcua/absent.rs"]
mod opcua;
mod recorded;
mod ros;
mod virtual_machine;

use crate::again::Again;
use crate::link::Link;
use abbe_files::{FileError, MachineFile};
use abbe_msgs::bag::BagError;
use abbe_msgs::{CovariateError, MessageError, ScaleReading, Stamp, Text, TextError, TracerReading};
use abbe_runtime::gateway::GatewayNode;
use abbe_runtime::{Shutdown, TransportError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use thiserror::Error;
use virtual_machine::SimulationError;

pub use ippdme::{IppdmeConfig, IppdmeReads, Mover, Order, Outcome, SessionNumber};
pub use lines::{Flow, LinesConfig, LinesFrom, Parity, SerialConfig};
pub use linuxcnc::{LinuxcncConfig, MachineUnits};
pub use opcua::OpcuaConfig;
#[cfg(feature = "opcua")]
pub use opcua::{OpcuaJoined, OpcuaReads, OpcuaSecurity};
pub use ros::{RosConfig, RosMessage, RosStamp};

/// What a driver is used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Scale readings.
    Scale,
    /// Tracer readings.
    Tracer,
    /// Covariates.
    Sensor,
}

/// A source of scale readings.
pub trait ScaleDriver: Send {
    /// The next latching; `None` at the end of a recording.
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError>;

    /// How it stands with what it reads from; `None` of a recording.
    fn link(&self) -> Option<Link> {
        None
    }

    /// What moves the machine, given once; `None` where the driver only reads.
    fn mover(&mut self) -> Option<Mover> {
        None
    }
}

/// A source of tracer readings.
pub trait TracerDriver: Send {
    /// The next reading; `None` at the end of a recording.
    fn next_reading(&mut self) -> Result<Option<TracerReading>, DriverError>;

    /// How it stands with what it reads from; `None` of a recording.
    fn link(&self) -> Option<Link> {
        None
    }
}

/// Covariates of one instant, in the units that effects read.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorValues {
    /// The instant.
    pub stamp: Stamp,
    /// Names with their unit, and values.
    pub values: Vec<(String, f64)>,
    /// Names of which the sensor says that it has no value: what it said before holds no longer.
    pub missing: Vec<String>,
}

/// A source of covariates.
pub trait SensorDriver: Send {
    /// The next values; `None` when told to stop.
    fn next_values(&mut self) -> Result<Option<SensorValues>, DriverError>;

    /// How it stands with what it reads from.
    fn link(&self) -> Option<Link> {
        None
    }
}

/// Which driver, as launch configurations name it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum DriverConfig {
    /// A recorded campaign as CSV.
    Campaign {
        /// The file, relative to the launch file.
        file: PathBuf,
    },
    /// A recorded bag.
    Bag {
        /// The bag, relative to the launch file.
        file: PathBuf,
        /// Topic in the bag.
        topic: String,
    },
    /// The virtual machine, with a campaign of its own.
    VirtualMachine {
        /// Seed of machine, plan and noise.
        seed: u64,
        /// Effects beyond the 21 errors, in the simulator's text form; none without it.
        #[serde(default)]
        effects: Vec<String>,
    },
    /// Lines of text from a controller or an instrument.
    Lines(LinesConfig),
    /// LinuxCNC.
    Linuxcnc(LinuxcncConfig),
    /// A server of I++ DME.
    Ippdme(IppdmeConfig),
    /// A server of OPC UA.
    Opcua(Box<OpcuaConfig>),
    /// A topic of ROS 2 with a standard message.
    Ros(RosConfig),
}

impl DriverConfig {
    /// Whether readings come when they come, and not from a recording.
    pub fn is_live(&self) -> bool {
        match self {
            DriverConfig::Campaign { .. } | DriverConfig::Bag { .. } | DriverConfig::VirtualMachine { .. } => false,
            DriverConfig::Lines(_)
            | DriverConfig::Linuxcnc(_)
            | DriverConfig::Ippdme(_)
            | DriverConfig::Opcua(_)
            | DriverConfig::Ros(_) => true,
        }
    }

    /// Names of the covariates that its readings can hold, where its configuration tells.
    pub(crate) fn covariate_names(&self) -> Option<Vec<String>> {
        match self {
            DriverConfig::VirtualMachine { .. } => Some(virtual_machine::covariate_names()),
            DriverConfig::Ippdme(config) => Some(config.covariates.keys().cloned().collect()),
            _ => None,
        }
    }

    /// Covariates that a sensor of this configuration says, in the units that effects read; without those that only the sensor itself
    /// names.
    fn says(&self) -> Vec<String> {
        match self {
            DriverConfig::Lines(config) => config.covariates(),
            DriverConfig::Opcua(config) => config.covariates(),
            DriverConfig::Ros(config) => config.covariates(),
            _ => Vec::new(),
        }
    }

    /// The key that is wrong for this use, and what to do; `None` where the driver can be opened.
    pub(crate) fn problem(&self, role: Role) -> Option<(&'static str, String)> {
        match self {
            DriverConfig::Campaign { .. } | DriverConfig::Bag { .. } | DriverConfig::VirtualMachine { .. } => {
                let problem = "is a recording, which carries its covariates already; name a live driver, such as lines";
                (role == Role::Sensor).then(|| ("kind", problem.to_owned()))
            }
            DriverConfig::Lines(lines) => lines.problem(role),
            DriverConfig::Linuxcnc(config) => config.problem(role),
            DriverConfig::Ippdme(config) => config.problem(role),
            DriverConfig::Opcua(config) => config.problem(role),
            DriverConfig::Ros(config) => config.problem(role),
        }
    }
}

/// The number of the sensor that says what another says as well, and in words; nobody knows which of both is meant.
pub(crate) fn said_twice(sensors: &[DriverConfig]) -> Option<(usize, String)> {
    let mut said = BTreeMap::new();
    sensors.iter().enumerate().find_map(|(place, sensor)| {
        let twice = sensor.says().into_iter().find_map(|name| Some((name.clone(), said.insert(name, place)?)));
        twice.map(|(name, first)| {
            let who =
                if first == place { "in another unit".to_owned() } else { format!("as does covariates[{first}]") };
            (
                place,
                format!("says {name}, {who}; give each a name of its own, or write - or leave it out in one of them"),
            )
        })
    })
}

/// Why a driver cannot go on.
#[derive(Debug, Error)]
pub enum DriverError {
    /// A file cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A bag cannot be read.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// A bag without the topic that is to be played.
    #[error("driver.topic: no topic {topic} in {}; it has: {known}; name one of them", bag.display())]
    NoTopic {
        /// The bag.
        bag: PathBuf,
        /// What was asked for.
        topic: String,
        /// Its topics.
        known: String,
    },
    /// The virtual machine refuses its configuration.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// A value does not fit its message.
    #[error("reading {reading}: {source}")]
    Message {
        /// Number of the reading, from 1.
        reading: usize,
        /// What does not fit.
        source: MessageError,
    },
    /// A name does not fit its message.
    #[error("reading {reading}: {what}: {source}")]
    Text {
        /// Number of the reading, from 1.
        reading: usize,
        /// Which name.
        what: &'static str,
        /// What does not fit.
        source: TextError,
    },
    /// A covariate does not fit its message.
    #[error("reading {reading}: {source}; a sample carries at most 32 covariates")]
    Covariate {
        /// Number of the reading, from 1.
        reading: usize,
        /// What does not fit.
        source: CovariateError,
    },
    /// A recording that is played over and over has come to the last instant that a stamp can name.
    #[error("the recording has been played again until its stamps ended; start the node again")]
    StampsEnd,
    /// What is to be taken from ROS 2 by a node that is not in its graph.
    #[error("driver.kind: a topic of ROS 2 is taken by `abbe launch`, `abbe node` and `abbe capture` alone")]
    NoRos,
    /// The gateway cannot open a topic.
    #[error("driver.topic: {0}")]
    Topic(#[from] TransportError),
    /// A recording as a source of covariates.
    #[error("a recording carries its covariates already and is no sensor; name a live driver, such as lines")]
    NoSensor,
    /// A key of a live driver is wrong.
    #[error("driver.{key}: {problem}")]
    Lines {
        /// The key.
        key: &'static str,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// A port cannot be opened.
    #[error("driver.from: {source}; check the address, and that no other program has it")]
    Port {
        /// Why.
        source: std::io::Error,
    },
    /// A line is no reading.
    #[error("line {line} from {from}: {problem}")]
    Line {
        /// Number of the line, from 1.
        line: u64,
        /// Where it came from.
        from: String,
        /// What is wrong.
        problem: String,
    },
    /// Values are no reading.
    #[error("{from}: {problem}")]
    Value {
        /// Where they came from.
        from: String,
        /// What is wrong.
        problem: String,
    },
}

impl DriverError {
    /// Whether one reading cannot be a sample, and the ones after it may be.
    pub fn is_of_one_reading(&self) -> bool {
        matches!(
            self,
            DriverError::Message { .. }
                | DriverError::Text { .. }
                | DriverError::Covariate { .. }
                | DriverError::Line { .. }
                | DriverError::Value { .. }
        )
    }
}

/// Opens the driver of the scale node; paths are relative to `base`, `shutdown` ends the wait of a live one, `ros` is the
/// node's place in the ROS 2 graph.
pub fn open_scale(
    config: &DriverConfig,
    base: &Path,
    machine: &MachineFile,
    shutdown: &Shutdown,
    ros: Option<&GatewayNode>,
) -> Result<Box<dyn ScaleDriver>, DriverError> {
    Ok(match config {
        DriverConfig::Campaign { file } => Box::new(campaign_file::open(&base.join(file), machine)?),
        DriverConfig::Bag { file, topic } => Box::new(bag::open_scale(&base.join(file), topic)?),
        DriverConfig::VirtualMachine { seed, effects } => Box::new(virtual_machine::open(*seed, effects, machine)?),
        DriverConfig::Lines(lines) => Box::new(lines::open(lines, Role::Scale, machine, shutdown)?),
        DriverConfig::Linuxcnc(config) => Box::new(linuxcnc::open(config, machine, shutdown)?),
        DriverConfig::Ippdme(config) => Box::new(ippdme::open(config, machine, shutdown)?),
        DriverConfig::Opcua(config) => Box::new(opcua::open(config, Role::Scale, base, machine, shutdown)?),
        DriverConfig::Ros(config) => Box::new(ros::open_scale(config, machine, shutdown, ros)?),
    })
}

/// Opens a source of covariates; the rest is as for [`open_scale`].
pub fn open_sensor(
    config: &DriverConfig,
    base: &Path,
    machine: &MachineFile,
    shutdown: &Shutdown,
    ros: Option<&GatewayNode>,
) -> Result<Box<dyn SensorDriver>, DriverError> {
    match config {
        DriverConfig::Campaign { .. } | DriverConfig::Bag { .. } | DriverConfig::VirtualMachine { .. } => {
            Err(DriverError::NoSensor)
        }
        DriverConfig::Lines(lines) => Ok(Box::new(lines::open(lines, Role::Sensor, machine, shutdown)?)),
        DriverConfig::Linuxcnc(_) => Err(linuxcnc::only_scales()),
        DriverConfig::Ippdme(_) => Err(ippdme::only_scales()),
        DriverConfig::Opcua(config) => Ok(Box::new(opcua::open(config, Role::Sensor, base, machine, shutdown)?)),
        DriverConfig::Ros(config) => Ok(Box::new(ros::open_sensor(config, machine, shutdown, ros)?)),
    }
}

/// The same as [`open_scale`], beginning again with the reading of this sequence at its end.
pub fn open_scale_again(
    config: &DriverConfig,
    base: &Path,
    machine: &MachineFile,
    shutdown: &Shutdown,
    from: u64,
) -> Result<Box<dyn ScaleDriver>, DriverError> {
    Ok(Box::new(Again::new(open_scale(config, base, machine, shutdown, None)?, from)))
}

/// Opens the driver of the tracer node; the rest is as for [`open_scale`].
pub fn open_tracer(
    config: &DriverConfig,
    base: &Path,
    machine: &MachineFile,
    shutdown: &Shutdown,
    ros: Option<&GatewayNode>,
) -> Result<Box<dyn TracerDriver>, DriverError> {
    Ok(match config {
        DriverConfig::Campaign { file } => Box::new(campaign_file::open(&base.join(file), machine)?),
        DriverConfig::Bag { file, topic } => Box::new(bag::open_tracer(&base.join(file), topic)?),
        DriverConfig::VirtualMachine { seed, effects } => Box::new(virtual_machine::open(*seed, effects, machine)?),
        DriverConfig::Lines(lines) => Box::new(lines::open(lines, Role::Tracer, machine, shutdown)?),
        DriverConfig::Linuxcnc(_) => return Err(linuxcnc::only_scales()),
        DriverConfig::Ippdme(_) => return Err(ippdme::only_scales()),
        DriverConfig::Opcua(_) => return Err(opcua::no_tracer()),
        DriverConfig::Ros(config) => Box::new(ros::open_tracer(config, machine, shutdown, ros)?),
    })
}

/// A text that has to fit a message, with its name for errors.
fn config_name<const N: usize>(what: &str, value: &str) -> Result<Text<N>, String> {
    Text::new(value).map_err(|error| format!("{what}: {error}"))
}
