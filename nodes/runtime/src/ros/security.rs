//! DDS Security: which keys a node joins the graph with, from the environment and `--enclave`.
//!
//! Place in the flow: read once at the start of a node, handed to its gateway, and there to the participant. A keystore is a
//! folder as `ros2 security create_keystore` makes it. Rules as in ROS 2 Jazzy (`rcl`):
//! - `ROS_SECURITY_ENABLE`: `true` or `false`; unset is `false`;
//! - `ROS_SECURITY_KEYSTORE`: the folder;
//! - `ROS_SECURITY_STRATEGY`: `Enforce`, or `Permissive`, which is meant when it is unset: a node without keys then joins without security,
//!   and says so;
//! - `--enclave /name`, or `ROS_SECURITY_ENCLAVE_OVERRIDE` before it: the keys in `enclaves/name` of the keystore; `/` if there is neither.
//!
//! The library for it is there where this was built with the feature `dds-security`. Without it whatever asks for security is refused:
//! a node that joined in the open would look as if it worked.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Whether this program can do it at all.
const IS_BUILT: bool = cfg!(feature = "dds-security");

const ENABLE: &str = "ROS_SECURITY_ENABLE";
const KEYSTORE: &str = "ROS_SECURITY_KEYSTORE";
const STRATEGY: &str = "ROS_SECURITY_STRATEGY";
const OVERRIDE: &str = "ROS_SECURITY_ENCLAVE_OVERRIDE";

/// What lies in the folder of an enclave.
const FILES: [&str; 6] =
    ["identity_ca.cert.pem", "cert.pem", "key.pem", "permissions_ca.cert.pem", "governance.p7s", "permissions.p7s"];
const GOVERNANCE: &str = "governance.p7s";
/// How the payload of samples is protected, in the governance of a domain.
const DATA_PROTECTION: &str = "<data_protection_kind>";

/// The keys that a node joins the graph with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Enclave {
    folder: PathBuf,
}

/// Why there is no security where some was asked for.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum SecurityError {
    /// The program was built without.
    #[error(
        "{asked} asks for DDS Security, which this program was built without; build it with \
         `cargo build --release --features dds-security`, or unset it"
    )]
    NotBuilt {
        /// What asks for it.
        asked: String,
    },
    /// A variable that cannot be followed.
    #[error("environment variable {variable}='{value}': {remedy}")]
    Variable {
        /// Its name.
        variable: &'static str,
        /// Its value.
        value: String,
        /// What to set instead.
        remedy: &'static str,
    },
    /// A name of an enclave that is none.
    #[error("enclave '{name}': must begin with a slash and consist of names between slashes, as /bridge_xyz/scale")]
    Name {
        /// The name.
        name: String,
    },
    /// No keys.
    #[error("DDS Security: {} cannot be read ({problem}); make the enclave with `ros2 security create_enclave`, or set {KEYSTORE} and --enclave", .path.display())]
    NoKeys {
        /// What should be there.
        path: PathBuf,
        /// Why it is not.
        problem: String,
    },
}

impl Enclave {
    /// The keys that the environment asks for, in the enclave of `--enclave`; none where it asks for no security.
    ///
    /// # Errors
    /// When security is asked for and cannot be had.
    pub fn from_environment(enclave: Option<&str>) -> Result<Option<Self>, SecurityError> {
        Self::from_variables(enclave, IS_BUILT, |name| std::env::var(name).ok())
    }

    fn from_variables(
        enclave: Option<&str>,
        is_built: bool,
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<Option<Self>, SecurityError> {
        // Empty counts as unset, as in rcl.
        let set = |name| variable(name).filter(|value| !value.is_empty());
        let is_wanted = match set(ENABLE).as_deref() {
            None | Some("false") => false,
            Some("true") => true,
            Some(value) => return Err(of_variable(ENABLE, value, "use true or false")),
        };
        if is_wanted && !is_built {
            return Err(SecurityError::NotBuilt { asked: format!("{ENABLE}=true") });
        }
        if !is_wanted {
            if let Some(name) = enclave {
                tracing::warn!("--enclave {name} does nothing: {ENABLE} is not true, so there is no security");
            }
            return Ok(None);
        }
        let is_enforced = match set(STRATEGY).as_deref() {
            Some("Enforce") => true,
            None | Some("Permissive") => false,
            Some(value) => return Err(of_variable(STRATEGY, value, "use Enforce or Permissive")),
        };
        let name = set(OVERRIDE).or(enclave.map(str::to_owned)).unwrap_or("/".to_owned());
        match Self::find(set(KEYSTORE), &name) {
            Err(error @ SecurityError::NoKeys { .. }) if !is_enforced => {
                tracing::warn!("{error}. {STRATEGY} is not Enforce: the node joins WITHOUT security");
                Ok(None)
            }
            found => found.map(Some),
        }
    }

    fn find(keystore: Option<String>, name: &str) -> Result<Self, SecurityError> {
        let no_keys = |path: PathBuf, problem: String| SecurityError::NoKeys { path, problem };
        let Some(keystore) = keystore else {
            return Err(no_keys(PathBuf::from("the keystore"), format!("{KEYSTORE} is not set")));
        };
        let parts = name.strip_prefix('/').filter(|rest| {
            rest.is_empty() || rest.split('/').all(|part| !part.is_empty() && part != "." && part != "..")
        });
        let parts = parts.ok_or_else(|| SecurityError::Name { name: name.to_owned() })?;
        let folder = PathBuf::from(keystore).join("enclaves").join(parts);
        for file in FILES {
            let path = folder.join(file);
            if let Err(error) = std::fs::File::open(&path) {
                return Err(no_keys(path, error.to_string()));
            }
        }
        let found = Self { folder };
        if found.protects_payloads() {
            tracing::warn!(
                "{}: data_protection_kind is not NONE: the DDS library cannot read such payloads of others unless their length \
                 is a multiple of four, so that services do not answer; protect metadata and rtps instead",
                found.folder.join(GOVERNANCE).display()
            );
        }
        Ok(found)
    }

    /// Whether any topic has its payload protected by itself.
    fn protects_payloads(&self) -> bool {
        let text = std::fs::read(self.folder.join(GOVERNANCE)).unwrap_or_default();
        let text = String::from_utf8_lossy(&text);
        text.split(DATA_PROTECTION).skip(1).any(|kind| !kind.trim_start().starts_with("NONE"))
    }

    /// The files for the library.
    #[cfg(feature = "dds-security")]
    pub(super) fn files(&self) -> ros2_client::dds::rustdds::DomainParticipantSecurityConfigFiles {
        let no_password = String::new();
        ros2_client::dds::rustdds::DomainParticipantSecurityConfigFiles::with_ros_default_names(
            &self.folder,
            no_password,
        )
    }
}

fn of_variable(variable: &'static str, value: &str, remedy: &'static str) -> SecurityError {
    SecurityError::Variable { variable, value: value.to_owned(), remedy }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECURED: [(&str, &str); 2] = [(ENABLE, "true"), (STRATEGY, "Enforce")];

    fn found(
        enclave: Option<&str>,
        is_built: bool,
        variables: &[(&str, &str)],
    ) -> Result<Option<Enclave>, SecurityError> {
        Enclave::from_variables(enclave, is_built, |name| {
            let found = variables.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| (*value).to_owned())
        })
    }

    /// A keystore with an enclave `/a/b` whose governance protects payloads by `kind`.
    fn keystore(kind: &str) -> tempfile::TempDir {
        let keystore = tempfile::tempdir().unwrap();
        let folder = keystore.path().join("enclaves/a/b");
        std::fs::create_dir_all(&folder).unwrap();
        for file in FILES {
            std::fs::write(folder.join(file), format!("{DATA_PROTECTION}NONE<{DATA_PROTECTION}{kind}</")).unwrap();
        }
        keystore
    }

    #[test]
    fn a_program_without_the_library_refuses_security_and_an_enclave_alone_asks_for_none() {
        for enclave in [None, Some("/a")] {
            let words = found(enclave, false, &[(ENABLE, "true")]).unwrap_err().to_string();
            assert!(words.contains("--features dds-security") && words.contains("ROS_SECURITY_ENABLE=true"), "{words}");
            assert_eq!(found(enclave, false, &[(ENABLE, "")]), Ok(None), "as in ROS 2");
            assert_eq!(found(enclave, false, &[(ENABLE, "false")]), Ok(None));
        }
    }

    #[test]
    fn the_enclave_is_that_of_the_override_then_of_the_argument_then_the_root() {
        let keystore = keystore("NONE");
        let path = keystore.path().to_str().unwrap();
        let with = |more: &[(&'static str, &'static str)], enclave| {
            let variables: Vec<_> = [(KEYSTORE, path)].into_iter().chain(SECURED).chain(more.iter().copied()).collect();
            found(enclave, true, &variables)
        };
        let folder = keystore.path().join("enclaves/a/b");
        assert_eq!(with(&[], Some("/a/b")), Ok(Some(Enclave { folder: folder.clone() })));
        assert_eq!(with(&[(OVERRIDE, "/a/b")], Some("/c")), Ok(Some(Enclave { folder })));
        // No keys at the root of this keystore.
        let missing = with(&[], None).unwrap_err().to_string();
        assert!(missing.contains("enclaves/identity_ca.cert.pem"), "{missing}");
        for name in ["a/b", "/a//b", "/a/../b", "/a/"] {
            assert_eq!(with(&[], Some(name)), Err(SecurityError::Name { name: name.to_owned() }));
        }
    }

    #[test]
    fn without_keys_a_node_joins_in_the_open_only_where_that_is_permitted() {
        let enforced = found(None, true, &SECURED).unwrap_err().to_string();
        assert!(enforced.contains("ROS_SECURITY_KEYSTORE is not set"), "{enforced}");
        assert_eq!(found(None, true, &[(ENABLE, "true")]), Ok(None));
        assert_eq!(found(None, true, &[(ENABLE, "true"), (STRATEGY, "Permissive")]), Ok(None));
        assert_eq!(found(Some("/a"), true, &[]), Ok(None), "nobody asked for security");
        for (variable, value) in [(ENABLE, "yes"), (STRATEGY, "enforce")] {
            let variables = [(ENABLE, "true"), (variable, value)];
            let last_first: Vec<_> = variables.into_iter().rev().collect();
            let refused = found(None, true, &last_first).unwrap_err().to_string();
            assert!(refused.contains(variable) && refused.contains(value), "{refused}");
        }
    }

    #[test]
    fn protected_payloads_are_noticed_at_any_topic() {
        for (kind, is_noticed) in [("NONE", false), ("ENCRYPT", true), ("SIGN", true)] {
            let keystore = keystore(kind);
            let enclave = Enclave { folder: keystore.path().join("enclaves/a/b") };
            assert_eq!(enclave.protects_payloads(), is_noticed, "{kind}");
        }
    }
}
