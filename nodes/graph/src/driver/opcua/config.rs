//! What a launch file says of a server of OPC UA, and what of it cannot be.
//!
//! Place in the flow: read with the launch file; the password is read from its file when the driver is opened, and stands nowhere else.

use super::super::Role;
use crate::units::Unit;
use abbe_opcua::client::{Asks, Security, Settings, User};
use abbe_opcua::join::{AXES, JoinBy, NAMES};
use abbe_opcua::node::NodeName;
use abbe_opcua::units::length_of;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest time that can be asked for (s): a day.
const LONGEST_S: f64 = 86_400.0;
/// Shortest time between two values (s).
const SHORTEST_S: f64 = 0.001;
/// Longest offset of a tip (mm).
const LONGEST_OFFSET_MM: f64 = 1e4;
/// Longest password, and what is more than a password's file (bytes).
const LONGEST_PASSWORD: u64 = 1024;
/// An axis that has not changed for so many looks of the server stands still.
const STILL_AFTER_LOOKS: f64 = 3.0;
/// What is said of a tracer.
pub(super) const NO_TRACER: &str =
    "opcua gives scale readings and covariates; a tracer needs another driver, such as lines";

/// How values are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OpcuaReads {
    /// The server tells what changes (a subscription).
    Subscribed,
    /// All nodes are read again and again.
    Polled,
}

/// How values of several nodes become one reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OpcuaJoined {
    /// By equal source timestamps.
    Source,
    /// By source timestamps; a value holds until the server tells another.
    Held,
    /// What comes in one answer; the server has no source timestamps.
    Arrival,
}

/// How messages are protected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum OpcuaSecurity {
    /// Not at all.
    None,
    /// The policy of this name.
    Basic256Sha256,
    /// The policy of this name.
    #[serde(rename = "Aes128_Sha256_RsaOaep")]
    Aes128Sha256RsaOaep,
    /// The policy of this name.
    #[serde(rename = "Aes256_Sha256_RsaPss")]
    Aes256Sha256RsaPss,
}

/// A server, as launch configurations describe it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpcuaConfig {
    /// The server, as `opc.tcp://host:port/path`.
    pub server: String,
    /// Axes `x`, `y`, `z`, with their unit of length or the server's, and their nodes.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub axes: BTreeMap<String, String>,
    /// Covariates, with their unit or the server's, and their nodes.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub covariates: BTreeMap<String, String>,
    /// How values are asked for; subscribed without it.
    #[serde(default = "subscribed")]
    pub reads: OpcuaReads,
    /// Time between two looks of the server at a node, or two questions (s); 0.1 without it.
    #[serde(default = "tenth")]
    pub every_s: f64,
    /// How values of several nodes become one reading; by source timestamps without it.
    #[serde(default = "by_source")]
    pub joined: OpcuaJoined,
    /// How far apart source timestamps of one instant may be (ms); 0 without it.
    #[serde(default)]
    pub apart_ms: f64,
    /// An axis that has not changed for this long stands still (ms), for `held`; three times `every_s` without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub still_ms: Option<f64>,
    /// Tip or reflector relative to the ram reference point (mm, ram frame); the machine's own without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset_mm: Option<[f64; 3]>,
    /// How messages are protected; not at all without it.
    #[serde(default = "none")]
    pub security: OpcuaSecurity,
    /// Whether messages are signed, and not encrypted.
    #[serde(default)]
    pub signed_only: bool,
    /// Folder of certificates: own, trusted, rejected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub certificates: Option<PathBuf>,
    /// Who logs in; anonymous without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub user: Option<String>,
    /// File with the password.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub password_file: Option<PathBuf>,
    /// Whether the password may go to a server that nobody has made sure of.
    #[serde(default)]
    pub password_without_security: bool,
    /// Silence from which a session is given up and begun again (s); 5 without it.
    #[serde(default = "five")]
    pub silent_after_s: f64,
}

fn subscribed() -> OpcuaReads {
    OpcuaReads::Subscribed
}

fn by_source() -> OpcuaJoined {
    OpcuaJoined::Source
}

fn none() -> OpcuaSecurity {
    OpcuaSecurity::None
}

fn tenth() -> f64 {
    0.1
}

fn five() -> f64 {
    5.0
}

type Wrong = (&'static str, String);

impl OpcuaConfig {
    /// Covariates as effects read them; without those whose unit only the server names.
    pub(in super::super) fn covariates(&self) -> Vec<String> {
        self.covariates.keys().filter_map(|name| Self::unit_named(name)).map(|unit| unit.name).collect()
    }

    /// The key that is wrong, and what to do; `None` where a server can be read as this.
    pub(in super::super) fn problem(&self, role: Role) -> Option<Wrong> {
        self.problem_of_nodes(role).or_else(|| self.problem_of_times()).or_else(|| self.problem_of_login())
    }

    fn problem_of_nodes(&self, role: Role) -> Option<Wrong> {
        if role == Role::Tracer {
            return Some(("kind", NO_TRACER.to_owned()));
        }
        let host = self.server.strip_prefix("opc.tcp://").and_then(|rest| rest.split('/').next());
        if host.is_none_or(|host| {
            !host.rsplit_once(':').is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok())
        }) {
            let problem =
                format!("{:?} is no address of OPC UA; write it like \"opc.tcp://10.0.0.5:4840/path\"", self.server);
            return Some(("server", problem));
        }
        match role {
            Role::Sensor if !self.axes.is_empty() => {
                return Some(("axes", "are of the scale driver; a sensor has covariates alone".to_owned()));
            }
            Role::Sensor if self.covariates.is_empty() => {
                return Some(("covariates", "is needed: the names of the covariates and their nodes".to_owned()));
            }
            Role::Sensor => {}
            _ => {
                let is_one =
                    |axis: &usize| self.axes.keys().filter(|name| axis_place(name) == Some(*axis)).count() == 1;
                if self.axes.len() != AXES || !(0..AXES).all(|axis| is_one(&axis)) {
                    let problem = "must name x, y and z once each, with a unit of length (x_mm, x_um, x_m, x_in) or with the \
                                   server's (x), and their nodes";
                    return Some(("axes", problem.to_owned()));
                }
            }
        }
        let is_plain =
            |name: &str| !name.is_empty() && name.bytes().all(|byte| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'_'));
        if let Some(name) = self.covariates.keys().find(|name| !is_plain(name)) {
            return Some(("covariates", format!("{name:?}: a name is made of small letters, digits and underlines")));
        }
        let wrong = |nodes: &BTreeMap<String, String>| {
            nodes.iter().find_map(|(name, node)| Some(format!("{name}: {}", NodeName::parse(node).err()?)))
        };
        let of_axes = wrong(&self.axes).map(|problem| ("axes", problem));
        of_axes.or_else(|| wrong(&self.covariates).map(|problem| ("covariates", problem)))
    }

    fn problem_of_times(&self) -> Option<Wrong> {
        if !(self.every_s >= SHORTEST_S && self.every_s <= LONGEST_S) {
            return Some(("every_s", "must be a number of seconds, 0.001 or more, at most a day".to_owned()));
        }
        if !(self.silent_after_s > self.every_s && self.silent_after_s <= LONGEST_S) {
            return Some(("silent_after_s", "must be a number of seconds above every_s, at most a day".to_owned()));
        }
        let every_ms = self.every_s * 1e3;
        if !(self.apart_ms >= 0.0 && self.apart_ms < every_ms / 2.0) {
            let problem = "must be 0 or more, and below half of every_s, or values of two instants may be joined";
            return Some(("apart_ms", problem.to_owned()));
        }
        if self
            .still_ms
            .is_some_and(|ms| self.joined != OpcuaJoined::Held || !(ms >= every_ms && ms <= LONGEST_S * 1e3))
        {
            return Some((
                "still_ms",
                "is for joined = \"held\", and must be every_s at least, at most a day".to_owned(),
            ));
        }
        if self.joined == OpcuaJoined::Arrival && self.reads != OpcuaReads::Polled {
            let problem = "\"arrival\" joins what comes in one answer, and needs reads = \"polled\"";
            return Some(("joined", problem.to_owned()));
        }
        let is_offset = |mm: &f64| (-LONGEST_OFFSET_MM..=LONGEST_OFFSET_MM).contains(mm);
        let offset = self.offset_mm.filter(|offset| !offset.iter().all(is_offset));
        offset.map(|_| ("offset_mm", "an offset must be a number of millimetres, at most 10000".to_owned()))
    }

    fn problem_of_login(&self) -> Option<Wrong> {
        let is_open = self.security == OpcuaSecurity::None;
        if !is_open && self.certificates.is_none() {
            let problem = "is needed with security: a folder for the own certificate, trusted and rejected ones";
            return Some(("certificates", problem.to_owned()));
        }
        if is_open && (self.certificates.is_some() || self.signed_only) {
            let key = if self.signed_only { "signed_only" } else { "certificates" };
            return Some((key, "means nothing without security; name a policy, such as Basic256Sha256".to_owned()));
        }
        match (&self.user, &self.password_file) {
            (None, Some(_)) => Some(("user", "is needed with a password_file".to_owned())),
            (Some(_), None) => {
                Some(("password_file", "is needed with a user: the file that holds the password".to_owned()))
            }
            (Some(_), Some(_)) if is_open && !self.password_without_security => {
                let problem = "a password would go to whoever answers at that address, and as plain text where the server asks for \
                               that; name a security, or allow it with password_without_security = true";
                Some(("user", problem.to_owned()))
            }
            _ => None,
        }
    }

    /// Names in the order of the nodes: axes X, Y, Z, then covariates.
    pub(super) fn axis_names(&self) -> Vec<&str> {
        (0..AXES)
            .filter_map(|axis| self.axes.keys().find(|name| axis_place(name) == Some(axis)))
            .map(String::as_str)
            .collect()
    }

    /// Whether a value holds until there is another.
    pub(super) fn holds(&self) -> bool {
        self.joined == OpcuaJoined::Held
    }

    /// The rule of joining.
    pub(super) fn join_by(&self) -> JoinBy {
        // Milliseconds of a day at most.
        let ns = |ms: f64| (ms * 1e6).round() as i64;
        match self.joined {
            OpcuaJoined::Source => JoinBy::Source { apart_ns: ns(self.apart_ms) },
            OpcuaJoined::Held => {
                let still_ms = self.still_ms.unwrap_or(self.every_s * 1e3 * STILL_AFTER_LOOKS);
                JoinBy::Held { apart_ns: ns(self.apart_ms), still_ns: ns(still_ms) }
            }
            OpcuaJoined::Arrival => JoinBy::Arrival,
        }
    }

    /// Which clock the stamps are of, in words.
    pub(super) fn stamp_words(&self) -> &'static str {
        match (self.joined, self.reads) {
            (OpcuaJoined::Source, _) | (OpcuaJoined::Held, OpcuaReads::Subscribed) => {
                "stamps are its source timestamps"
            }
            (OpcuaJoined::Held, OpcuaReads::Polled) => {
                "stamps are its source timestamps, at a standstill the time of its answers"
            }
            (OpcuaJoined::Arrival, _) => "stamps are when answers arrive here",
        }
    }

    /// What the client is told; the password is read here.
    pub(super) fn settings(&self, base: &Path) -> Result<Settings, Wrong> {
        let axes = self.axis_names().into_iter().filter_map(|name| self.axes.get(name));
        let nodes = axes.chain(self.covariates.values()).map(|node| NodeName::parse(node)).collect::<Result<_, _>>();
        let user = match (&self.user, &self.password_file) {
            (Some(name), Some(file)) => Some(User { name: name.clone(), password: password(&base.join(file))? }),
            _ => None,
        };
        let every = Duration::from_secs_f64(self.every_s);
        Ok(Settings {
            server: self.server.clone(),
            security: match self.security {
                OpcuaSecurity::None => Security::None,
                OpcuaSecurity::Basic256Sha256 => Security::Basic256Sha256,
                OpcuaSecurity::Aes128Sha256RsaOaep => Security::Aes128Sha256RsaOaep,
                OpcuaSecurity::Aes256Sha256RsaPss => Security::Aes256Sha256RsaPss,
            },
            signed_only: self.signed_only,
            user,
            certificates: self.certificates.as_ref().map(|folder| base.join(folder)),
            nodes: nodes.map_err(|problem| ("axes", problem))?,
            asks: match self.reads {
                OpcuaReads::Subscribed => Asks::Subscribed(every),
                OpcuaReads::Polled => Asks::Polled(every),
            },
            silent_after: Duration::from_secs_f64(self.silent_after_s),
        })
    }

    /// Whether where the tip is stands here.
    pub(crate) fn tells_offset(&self) -> bool {
        self.offset_mm.is_some()
    }

    /// The same, with an offset that a plan's takes the place of where none stands here.
    pub(crate) fn with_some_offset(&self) -> OpcuaConfig {
        OpcuaConfig { offset_mm: self.offset_mm.or(Some([0.0; 3])), ..self.clone() }
    }

    /// Whether no readings come while the machine stands still.
    pub(crate) fn is_silent_at_standstill(&self) -> bool {
        self.holds() && self.reads == OpcuaReads::Subscribed
    }

    /// What decides which numbers are read, as text.
    pub(crate) fn identity(&self) -> String {
        format!("{:?} {:?} {:?} {:?}", self.axes, self.covariates, self.joined, self.offset_mm)
    }

    /// Whether a covariate's unit stands in its name.
    pub(super) fn unit_named(name: &str) -> Option<Unit> {
        Unit::of(name).ok()
    }
}

/// The first line of a file, and nothing of it in any message.
fn password(file: &Path) -> Result<String, Wrong> {
    let wrong = |why: &str| ("password_file", format!("{}: {why}", file.display()));
    let long = || wrong("is longer than any password; it holds the password and nothing else");
    let size = std::fs::metadata(file).map_err(|error| wrong(&format!("{error}; put the password there")))?.len();
    if size > LONGEST_PASSWORD {
        return Err(long());
    }
    let text = std::fs::read_to_string(file).map_err(|error| wrong(&error.to_string()))?;
    let password = text.strip_suffix('\n').unwrap_or(&text);
    let password = password.strip_suffix('\r').unwrap_or(password);
    if password.is_empty() || password.contains('\n') {
        return Err(wrong("must hold the password in one line, and nothing else"));
    }
    Ok(password.to_owned())
}

/// Which axis a name is of.
fn axis_place(name: &str) -> Option<usize> {
    let stem = length_of(name).0;
    NAMES.iter().position(|axis| *axis == stem)
}

#[cfg(test)]
mod tests;
