//! The ROS 2 domain and how far discovery reaches, from the environment.
//!
//! Place in the flow: read once at the start of a node. The DDS library does not look at these
//! variables itself. Rules as in ROS 2 Jazzy (`rcl`):
//! - `ROS_DOMAIN_ID`: 0 to 232, 0 when unset;
//! - `ROS_LOCALHOST_ONLY`: deprecated, but wins when set: 1 = this host only, 0 = the network;
//! - `ROS_AUTOMATIC_DISCOVERY_RANGE`: `LOCALHOST`, `SUBNET` or `SYSTEM_DEFAULT`; `OFF` is refused;
//! - `ROS_DISCOVERY_SERVER`: refused unless empty: the DDS library knows none, and a node that nobody finds would look as if it
//!   worked. `ROS_STATIC_PEERS` stands in `static_peers.rs`.

use std::borrow::Cow;

use thiserror::Error;

/// Highest domain whose ports lie below 65536.
const MAX_DOMAIN_ID: u16 = 232;

/// What to do without a server.
const DISCOVERY_SERVER: &str =
    "a discovery server is not supported; unset it, and name hosts that multicast does not reach in ROS_STATIC_PEERS";

/// How far DDS discovers and is discovered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DiscoveryRange {
    /// This host, over the loopback interface alone.
    Localhost,
    /// Whatever multicast reaches.
    #[default]
    Subnet,
}

/// Where in the world of ROS 2 a node lives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Domain {
    id: u16,
    /// How far discovery reaches.
    pub range: DiscoveryRange,
}

/// A variable that cannot be followed.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("environment variable {variable}='{value}': {remedy}")]
pub struct EnvironmentError {
    /// Name of the variable.
    pub variable: &'static str,
    /// Its value.
    pub value: String,
    /// What to set instead.
    pub remedy: Cow<'static, str>,
}

impl Domain {
    /// The domain `id` within `range`.
    ///
    /// # Errors
    /// When the id is above 232.
    pub fn new(id: u16, range: DiscoveryRange) -> Result<Self, EnvironmentError> {
        if id > MAX_DOMAIN_ID {
            return Err(domain_error(&id.to_string()));
        }
        Ok(Self { id, range })
    }

    /// The domain that the environment of this process asks for.
    ///
    /// # Errors
    /// When a variable has a value that cannot be followed.
    pub fn from_environment() -> Result<Self, EnvironmentError> {
        Self::from_variables(|name| std::env::var(name).ok())
    }

    /// As [`Domain::from_environment`], with another source of variables.
    ///
    /// # Errors
    /// As [`Domain::from_environment`].
    pub fn from_variables(variable: impl Fn(&str) -> Option<String>) -> Result<Self, EnvironmentError> {
        // Empty counts as unset, as in rcl.
        let set = |name| variable(name).filter(|value| !value.is_empty());
        if let Some(value) = set("ROS_DISCOVERY_SERVER") {
            return Err(EnvironmentError { variable: "ROS_DISCOVERY_SERVER", value, remedy: DISCOVERY_SERVER.into() });
        }
        let id = match set("ROS_DOMAIN_ID") {
            None => 0,
            Some(value) => value.parse().map_err(|_| domain_error(&value))?,
        };
        let range = match set("ROS_LOCALHOST_ONLY") {
            Some(value) => localhost_only(&value)?,
            None => match set("ROS_AUTOMATIC_DISCOVERY_RANGE") {
                Some(value) => discovery_range(&value)?,
                None => DiscoveryRange::default(),
            },
        };
        Self::new(id, range)
    }

    /// The number of the domain.
    #[must_use]
    pub fn id(self) -> u16 {
        self.id
    }
}

fn domain_error(value: &str) -> EnvironmentError {
    EnvironmentError {
        variable: "ROS_DOMAIN_ID",
        value: value.into(),
        remedy: "use a whole number from 0 to 232".into(),
    }
}

fn localhost_only(value: &str) -> Result<DiscoveryRange, EnvironmentError> {
    match value {
        "1" => Ok(DiscoveryRange::Localhost),
        "0" => Ok(DiscoveryRange::Subnet),
        _ => Err(EnvironmentError {
            variable: "ROS_LOCALHOST_ONLY",
            value: value.into(),
            remedy: "use 1 or 0, or better ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST".into(),
        }),
    }
}

fn discovery_range(value: &str) -> Result<DiscoveryRange, EnvironmentError> {
    match value {
        "LOCALHOST" => Ok(DiscoveryRange::Localhost),
        "SUBNET" | "SYSTEM_DEFAULT" => Ok(DiscoveryRange::Subnet),
        _ => Err(EnvironmentError {
            variable: "ROS_AUTOMATIC_DISCOVERY_RANGE",
            value: value.into(),
            remedy: "use LOCALHOST or SUBNET; OFF is not supported, leave the DDS edges out instead".into(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn domain(variables: &[(&str, &str)]) -> Result<Domain, EnvironmentError> {
        Domain::from_variables(|name| {
            let found = variables.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn nothing_set_is_domain_0_on_the_subnet() {
        assert_eq!(domain(&[("ROS_DISCOVERY_SERVER", "")]), Domain::new(0, DiscoveryRange::Subnet));
        assert_eq!(domain(&[]), Domain::new(0, DiscoveryRange::Subnet));
        assert_eq!(domain(&[("ROS_DOMAIN_ID", "")]), Domain::new(0, DiscoveryRange::Subnet));
    }

    #[test]
    fn localhost_only_wins_over_the_range() {
        let both = [("ROS_DOMAIN_ID", "7"), ("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")];
        assert_eq!(domain(&both), Domain::new(7, DiscoveryRange::Localhost));
        let range = [("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")];
        assert_eq!(domain(&range), Domain::new(0, DiscoveryRange::Localhost));
    }

    #[test]
    fn a_value_that_cannot_be_followed_is_refused_by_name() {
        for (variable, value) in [
            ("ROS_DOMAIN_ID", "233"),
            ("ROS_DOMAIN_ID", "-1"),
            ("ROS_DOMAIN_ID", "seven"),
            ("ROS_LOCALHOST_ONLY", "yes"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"),
            ("ROS_DISCOVERY_SERVER", "192.168.0.7:11811"),
        ] {
            let error = domain(&[(variable, value)]).unwrap_err();
            assert_eq!((error.variable, error.value.as_str()), (variable, value));
        }
    }
}
