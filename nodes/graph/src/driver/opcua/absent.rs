//! The driver `opcua` of a program that was built without it: a launch file that names it is refused, with what to do.
//!
//! Place in the flow: in place of `driver/opcua.rs` where the feature `opcua` is off.

use super::{DriverError, Role};
use crate::serving::NO_OPCUA;
use abbe_files::MachineFile;
use abbe_runtime::Shutdown;
use serde::{Deserialize, Serialize};
use std::convert::Infallible;
use std::path::Path;

/// A server of OPC UA, of which nothing is read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OpcuaConfig {
    #[serde(flatten)]
    keys: toml::Table,
}

impl OpcuaConfig {
    pub(super) fn covariates(&self) -> Vec<String> {
        Vec::new()
    }

    pub(super) fn problem(&self, _: Role) -> Option<(&'static str, String)> {
        Some(("kind", NO_OPCUA.to_owned()))
    }

    pub(crate) fn tells_offset(&self) -> bool {
        true
    }

    pub(crate) fn with_some_offset(&self) -> OpcuaConfig {
        self.clone()
    }

    pub(crate) fn is_silent_at_standstill(&self) -> bool {
        false
    }

    pub(crate) fn identity(&self) -> String {
        String::new()
    }
}

/// A driver that there is none of.
pub(super) struct Absent(Infallible);

impl super::ScaleDriver for Absent {
    fn next_reading(&mut self) -> Result<Option<abbe_msgs::ScaleReading>, DriverError> {
        match self.0 {}
    }
}

impl super::SensorDriver for Absent {
    fn next_values(&mut self) -> Result<Option<super::SensorValues>, DriverError> {
        match self.0 {}
    }
}

pub(super) fn open(_: &OpcuaConfig, _: Role, _: &Path, _: &MachineFile, _: &Shutdown) -> Result<Absent, DriverError> {
    Err(no_tracer())
}

pub(super) fn no_tracer() -> DriverError {
    DriverError::Lines { key: "kind", problem: NO_OPCUA.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::driver::DriverConfig;

    #[test]
    fn a_launch_file_that_names_the_driver_is_refused_with_what_to_do() {
        let keys = "kind = \"opcua\"\nserver = \"opc.tcp://h:4840\"\naxes = { x_mm = \"i=1\" }";
        let config: DriverConfig = toml::from_str(keys).unwrap();
        let (key, problem) = config.problem(Role::Scale).unwrap();
        assert!(key == "kind" && problem.contains("--features opcua"), "{problem}");
    }
}
