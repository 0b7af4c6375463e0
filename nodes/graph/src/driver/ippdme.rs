//! Driver: a server of I++ DME, the protocol by which measuring software talks to controllers of measuring machines.
//!
//! Place in the flow: `kind = "ippdme"` in a launch configuration. A thread ([`session`]) is the server's client: it selects the
//! machine's coordinate system, asks for the tool, and gives positions of the tip. A reading is the position less the offset of
//! the tip. The stamp is the instant at which the position arrived: the protocol has no time of its own. Positions in mm on the
//! wire, metres in readings.

mod client;
mod mover;
mod session;

use super::{DriverError, Role, ScaleDriver, config_name};
use crate::connecting::{address_problem, stamp_of};
use crate::link::{Link, LinkState};
use crate::units::Unit;
use abbe_files::MachineFile;
use abbe_ippdme::relay::Offsets;
use abbe_msgs::{Covariates, ScaleReading};
use abbe_runtime::Shutdown;
use serde::{Deserialize, Serialize};
use session::{Event, Position, Session};
use std::collections::BTreeMap;
use std::time::Duration;

pub use mover::{Mover, Order, Outcome, SessionNumber};

/// How often a driver that waits looks whether to stop.
const LOOK_UP: Duration = Duration::from_millis(50);
/// The protocol has no reports on moves at shorter intervals (s).
const SHORTEST_REPORT_S: f64 = 0.1;
/// Longest time that can be asked for (s): a day.
const LONGEST_S: f64 = 86_400.0;
/// Bytes of a name at most.
const LONGEST_NAME: usize = 31;
/// Longest offset of a tip (mm).
const LONGEST_OFFSET_MM: f64 = 1e4;

/// What is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IppdmeReads {
    /// The server reports while the machine moves (`OnMoveReportE`).
    Moves,
    /// The position is asked for again and again (`Get`).
    Polled,
    /// Points that the operator takes by hand (`PtMeas` that the server sends unasked).
    Points,
}

/// A server, as launch configurations describe it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IppdmeConfig {
    /// The server, as `host:port`; the protocol's own port is 1294.
    pub server: String,
    /// What is read.
    pub reads: IppdmeReads,
    /// Time between two positions (s), for `moves` and `polled`; 0.1 without it.
    #[serde(default = "shortest")]
    pub every_s: f64,
    /// Way after which a move is reported in any case (mm), for `moves`; 1 without it.
    #[serde(default = "one")]
    pub every_mm: f64,
    /// Offset of the tip from the ram reference point by the name of the tool (mm, ram frame).
    #[serde(default)]
    pub tools_mm: BTreeMap<String, [f64; 3]>,
    /// The same of every other tool.
    pub offset_mm: Option<[f64; 3]>,
    /// Whether the server is asked for offsets that stand in neither (`Tool.AvrOffsets`).
    #[serde(default)]
    pub server_offsets: bool,
    /// Properties of the server that are covariates: name of the covariate, property such as `Part.Temperature`.
    #[serde(default)]
    pub covariates: BTreeMap<String, String>,
    /// Time between two questions for covariates and tool (s); 10 without it.
    #[serde(default = "ten")]
    pub covariates_every_s: f64,
    /// Silence from which the server is asked whether it lives, and a connection is made again (s); 5 without it.
    #[serde(default = "five")]
    pub silent_after_s: f64,
}

fn shortest() -> f64 {
    SHORTEST_REPORT_S
}

fn one() -> f64 {
    1.0
}

fn five() -> f64 {
    5.0
}

fn ten() -> f64 {
    10.0
}

impl IppdmeConfig {
    /// The key that is wrong, and what to do; `None` where a server can be read as this.
    pub(super) fn problem(&self, role: Role) -> Option<(&'static str, String)> {
        if role != Role::Scale {
            return Some(("kind", ONLY_SCALES.to_owned()));
        }
        if let Some(problem) = address_problem(&self.server) {
            return Some(("server", problem));
        }
        let times = [
            ("every_s", self.every_s),
            ("covariates_every_s", self.covariates_every_s),
            ("silent_after_s", self.silent_after_s),
        ];
        if let Some((key, _)) = times.into_iter().find(|(_, seconds)| !(*seconds > 0.0 && *seconds <= LONGEST_S)) {
            return Some((key, "must be a number of seconds above 0, at most a day".to_owned()));
        }
        if self.reads == IppdmeReads::Moves && self.every_s < SHORTEST_REPORT_S {
            return Some((
                "every_s",
                "must be 0.1 or more: servers report moves ten times a second at most".to_owned(),
            ));
        }
        if !(self.every_mm > 0.0 && self.every_mm <= LONGEST_OFFSET_MM) {
            return Some(("every_mm", "must be above 0, and at most 10000".to_owned()));
        }
        let offsets = self.tools_mm.values().chain(&self.offset_mm).flatten();
        if offsets.copied().any(|mm: f64| !(-LONGEST_OFFSET_MM..=LONGEST_OFFSET_MM).contains(&mm)) {
            let key = if self.offset_mm.is_some() { "offset_mm" } else { "tools_mm" };
            return Some((key, "an offset must be a number of millimetres, at most 10000".to_owned()));
        }
        if self.tools_mm.is_empty() && self.offset_mm.is_none() && !self.server_offsets {
            let problem = "name the offset of each tool here, or one for all with offset_mm, or ask the server with \
                           server_offsets = true";
            return Some(("tools_mm", problem.to_owned()));
        }
        let is_property = |text: &str| {
            let inner = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'.';
            text.starts_with(|sign: char| sign.is_ascii_alphabetic()) && text.bytes().all(inner)
        };
        for (name, property) in &self.covariates {
            let unit = Unit::of(name);
            if name.len() > LONGEST_NAME || unit.is_err() || !is_property(property) {
                let why = unit.err().unwrap_or_else(|| format!("{name} = {property:?}"));
                let example = "write a name with its unit and a property of the server, such as temp_part_c = \"Part.Temperature\"";
                return Some(("covariates", format!("{why}; {example}")));
            }
        }
        None
    }

    fn offsets(&self) -> Offsets {
        let metres = |mm: [f64; 3]| mm.map(|mm| mm / 1e3);
        Offsets {
            by_tool_m: self.tools_mm.iter().map(|(name, mm)| (name.clone(), metres(*mm))).collect(),
            of_any_m: self.offset_mm.map(metres),
            from_server: self.server_offsets,
        }
    }
}

const ONLY_SCALES: &str = "ippdme reads scales; a tracer or a sensor has another driver, such as lines";

/// A server gives nothing else.
pub(super) fn only_scales() -> DriverError {
    DriverError::Lines { key: "kind", problem: ONLY_SCALES.to_owned() }
}

/// Readings from a server.
pub(super) struct Ippdme {
    server: String,
    machine: MachineFile,
    session: Session,
    mover: Option<Mover>,
    shutdown: Shutdown,
    sequence: u64,
    link: Link,
}

/// Opens a server; `shutdown` ends the wait for a reading.
pub(super) fn open(config: &IppdmeConfig, machine: &MachineFile, shutdown: &Shutdown) -> Result<Ippdme, DriverError> {
    if let Some((key, problem)) = config.problem(Role::Scale) {
        return Err(DriverError::Lines { key, problem });
    }
    let (mover, obeying) = mover::pair();
    let session = Session::open(config, config.offsets(), obeying).map_err(|source| DriverError::Port { source })?;
    let (server, machine) = (config.server.clone(), machine.clone());
    Ok(Ippdme {
        server,
        machine,
        session,
        mover: Some(mover),
        shutdown: shutdown.clone(),
        sequence: 0,
        link: Link::default(),
    })
}

impl Ippdme {
    fn refused(&self, line: u64, problem: String) -> DriverError {
        self.link.refused(format!("line {line}: {problem}"));
        DriverError::Line { line, from: format!("ippdme {}", self.server), problem }
    }

    fn reading(&self, position: &Position) -> Result<ScaleReading, String> {
        let mut covariates = Covariates::new();
        for (name, value, age_s) in &position.covariates {
            covariates.push(name, *value, *age_s).map_err(|error| error.to_string())?;
        }
        let frame_id = &self.machine.machine.frame_id;
        Ok(ScaleReading {
            stamp: stamp_of(position.arrived)?,
            sequence: self.sequence,
            reading_m: std::array::from_fn(|d| position.tip_m[d] - position.offset_m[d]),
            offset_m: position.offset_m,
            covariates,
            frame_id: config_name("frame_id", frame_id)?,
        })
    }
}

impl ScaleDriver for Ippdme {
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError> {
        while !self.shutdown.requested() {
            match self.session.next(LOOK_UP) {
                None => {}
                Some(Event::Connected(words)) => {
                    tracing::info!("ippdme {}: {words}", self.server);
                    self.link.stands(LinkState::Connected(self.server.clone()));
                }
                Some(Event::Told(words)) => tracing::warn!("ippdme {}: {words}", self.server),
                Some(Event::Lost(words)) => self.link.stands(LinkState::Lost(words)),
                Some(Event::Refused(line, problem)) => return Err(self.refused(line, problem)),
                Some(Event::Position(position)) => {
                    let reading = self.reading(&position).map_err(|problem| self.refused(position.line, problem))?;
                    // Only what is a reading is numbered.
                    self.sequence += 1;
                    return Ok(Some(reading));
                }
            }
        }
        Ok(None)
    }

    fn link(&self) -> Option<Link> {
        Some(self.link.clone())
    }

    fn mover(&mut self) -> Option<Mover> {
        self.mover.take()
    }
}
