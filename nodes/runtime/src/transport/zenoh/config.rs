//! How a session is set up: by rmw_zenoh's environment, else as rmw_zenoh does.
//!
//! Place in the flow: read where a session is opened, once a process.
//!
//! | variable | meaning |
//! |---|---|
//! | `ZENOH_SESSION_CONFIG_URI` | a configuration file of Zenoh (JSON5), in place of what is below |
//! | `ZENOH_CONFIG_OVERRIDE` | `key=value` pairs behind `;`, such as `mode="client";connect/endpoints=["tcp/10.0.7.20:7447"]` |
//!
//! Else the session is a peer that looks for the router on this host, listens on loopback, and sends nothing by multicast.
//! `ZENOH_ROUTER_CONFIG_URI` is the router's own affair; `ZENOH_ROUTER_CHECK_ATTEMPTS` has no meaning here, because
//! nothing waits for a router: one that comes later is found.

use std::env;

use zenoh::Config;

use crate::transport::{TransportError, TransportKind};

/// As rmw_zenoh has it. Besides: room for a burst of a thousand samples, and no message longer than a thousand of them
/// together.
const OWN: &str = r#"{
    mode: "peer",
    connect: { endpoints: ["tcp/localhost:7447"] },
    listen: { endpoints: ["tcp/localhost:0"] },
    scouting: { multicast: { enabled: false } },
    transport: { link: { tx: { queue: { size: { data: 16 } } }, rx: { max_message_size: 1048576 } } },
}"#;
const FILE: &str = "ZENOH_SESSION_CONFIG_URI";
const OVERRIDE: &str = "ZENOH_CONFIG_OVERRIDE";

/// The configuration of a session.
#[derive(Debug, Clone)]
pub struct ZenohConfig(Config);

impl ZenohConfig {
    /// What the environment says.
    ///
    /// # Errors
    /// When a variable is no text, the file is missing or no configuration, or a pair is none.
    pub fn from_environment() -> Result<Self, TransportError> {
        let text = |name: &'static str| match env::var(name) {
            Ok(text) => Ok(Some(text).filter(|text| !text.is_empty())),
            Err(env::VarError::NotPresent) => Ok(None),
            Err(env::VarError::NotUnicode(_)) => Err(refused(format!("{name} is no text"))),
        };
        Self::new(text(FILE)?.as_deref(), text(OVERRIDE)?.as_deref())
    }

    /// The configuration of a file, or else our own, with some keys set.
    ///
    /// # Errors
    /// When the file is missing or no configuration, or a pair is none.
    pub fn new(file: Option<&str>, pairs: Option<&str>) -> Result<Self, TransportError> {
        let config = match file {
            None => Config::from_json5(OWN),
            Some(file) => Config::from_file(file.trim_start_matches("file://")),
        };
        let mut config = config.map_err(|error| refused(format!("{FILE}={}: {error}", file.unwrap_or_default())))?;
        for pair in pairs.into_iter().flat_map(|pairs| pairs.split(';')).map(str::trim).filter(|pair| !pair.is_empty())
        {
            let because = |reason: &dyn std::fmt::Display| refused(format!("{OVERRIDE}, entry '{pair}': {reason}"));
            let (key, value) = pair.split_once('=').ok_or_else(|| because(&"it has no '='"))?;
            config.insert_json5(key.trim(), value.trim()).map_err(|error| because(&error))?;
        }
        Ok(Self(config))
    }

    pub(super) fn into_inner(self) -> Config {
        self.0
    }
}

fn refused(reason: String) -> TransportError {
    TransportError::Open { kind: TransportKind::Zenoh, reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn json(config: &ZenohConfig, key: &str) -> String {
        config.0.get_json(key).unwrap()
    }

    #[test]
    fn without_an_environment_it_is_as_with_rmw_zenoh() {
        let config = ZenohConfig::new(None, None).unwrap();
        assert_eq!(json(&config, "mode"), "\"peer\"");
        assert_eq!(json(&config, "connect/endpoints"), "[\"tcp/localhost:7447\"]");
        assert_eq!(json(&config, "listen/endpoints"), "[\"tcp/localhost:0\"]");
        assert_eq!(json(&config, "scouting/multicast/enabled"), "false");
        assert_eq!(json(&config, "transport/link/tx/queue/size/data"), "16");
        assert_eq!(json(&config, "transport/link/tx/queue/size/control"), "2", "what is not set stays");
        assert_eq!(json(&config, "transport/link/rx/max_message_size"), "1048576");
    }

    #[test]
    fn a_file_comes_in_its_place_and_pairs_after_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("session.json5");
        std::fs::write(&file, "{ mode: \"client\", connect: { endpoints: [\"tcp/10.0.7.20:7447\"] } }").unwrap();
        let named = format!("file://{}", file.display());
        let config = ZenohConfig::new(Some(&named), Some("queries_default_timeout=7; mode=\"router\";")).unwrap();
        assert_eq!(json(&config, "mode"), "\"router\"");
        assert_eq!(json(&config, "connect/endpoints"), "[\"tcp/10.0.7.20:7447\"]");
        assert_eq!(json(&config, "queries_default_timeout"), "7");
    }

    #[test]
    fn what_cannot_be_followed_is_refused_by_name() {
        for (file, pairs, says) in [
            (Some("/nowhere.json5"), None, "ZENOH_SESSION_CONFIG_URI=/nowhere.json5"),
            (None, Some("mode"), "entry 'mode': it has no '='"),
            (None, Some("mode=\"king\""), "entry 'mode=\"king\"'"),
            (None, Some("no/such/key=1"), "entry 'no/such/key=1'"),
        ] {
            let error = ZenohConfig::new(file, pairs).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
