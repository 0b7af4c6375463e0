//! Driver: a server of OPC UA, such as a controller's, whose nodes hold axes and sensors.
//!
//! Place in the flow: `kind = "opcua"` in a launch configuration. A thread ([`abbe_opcua::client`]) keeps a session with the server; here
//! its values become metres and the units of covariates ([`meaning`]), and values of three nodes a reading of one instant
//! ([`abbe_opcua::join`]). The stamp is the source's time where the rule of joining goes by it, else when the answer arrived.
//! What is missing, of a bad status or of another instant makes no reading, and is told.

mod config;
mod meaning;
mod sensors;

use super::{DriverError, Role, ScaleDriver, SensorDriver, SensorValues, config_name};
use crate::connecting::Waits;
use crate::link::{Link, LinkState};
use abbe_files::MachineFile;
use abbe_msgs::{ScaleReading, Stamp};
use abbe_opcua::client::{Client, Event, Found, NodeValue, Values};
use abbe_opcua::join::{AXES, AxisValue, Joined, Joiner, Told};
use abbe_runtime::Shutdown;
use meaning::{Axis, Meanings};
use sensors::Sensors;
use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant};

pub use config::{OpcuaConfig, OpcuaJoined, OpcuaReads, OpcuaSecurity};

/// How often a driver that waits looks whether to stop.
const LOOK_UP: Duration = Duration::from_millis(50);
/// Clocks that are further apart than this are told of (s).
const CLOCKS_APART_S: f64 = 1.0;

/// A server as a source.
pub(super) struct Opcua {
    config: OpcuaConfig,
    machine: MachineFile,
    role: Role,
    client: Client,
    shutdown: Shutdown,
    joiner: Joiner,
    /// What the values of this session mean.
    meanings: Option<Meanings>,
    sensors: Sensors,
    /// What was made of the last message, and is not given yet.
    ready: VecDeque<Result<(i64, [f64; AXES]), String>>,
    /// Sensor values that are not given yet.
    said: VecDeque<(i64, Said)>,
    sequence: u64,
    /// When the last reading was given, or a session begun.
    gave: Instant,
    last_words: String,
    knows_clock: bool,
    link: Link,
}

/// Opens a server; files of the configuration are relative to `base`, `shutdown` ends the wait.
pub(super) fn open(
    config: &OpcuaConfig,
    role: Role,
    base: &Path,
    machine: &MachineFile,
    shutdown: &Shutdown,
) -> Result<Opcua, DriverError> {
    let wrong = |(key, problem): (&'static str, String)| DriverError::Lines { key, problem };
    config.problem(role).map_or(Ok(()), |problem| Err(wrong(problem)))?;
    if role == Role::Scale && config.offset_mm.is_none() && machine.machine.default_offset_m.is_none() {
        let problem = "is needed: the machine file has no default_offset_mm, and no server tells where the tip is";
        return Err(wrong(("offset_mm", problem.to_owned())));
    }
    let settings = config.settings(base).map_err(wrong)?;
    let judged = config.clone();
    let check = Box::new(move |found: &[Found]| Meanings::of(&judged, found).map(drop));
    let mut waits = Waits::new();
    let wait = Box::new(move |has_begun| {
        if has_begun {
            waits.begin_again();
        }
        waits.next()
    });
    let client = Client::open(settings, check, wait).map_err(|source| DriverError::Port { source })?;
    Ok(Opcua {
        joiner: Joiner::new(config.join_by()),
        sensors: Sensors::new(config.holds()),
        config: config.clone(),
        machine: machine.clone(),
        role,
        client,
        shutdown: shutdown.clone(),
        meanings: None,
        ready: VecDeque::new(),
        said: VecDeque::new(),
        sequence: 0,
        gave: Instant::now(),
        last_words: String::new(),
        knows_clock: false,
        link: Link::default(),
    })
}

/// What is said of a tracer behind a server of OPC UA.
pub(super) fn no_tracer() -> DriverError {
    let problem = config::NO_TRACER.to_owned();
    DriverError::Lines { key: "kind", problem }
}

impl Opcua {
    /// Takes what the thread gives, until there may be something to give on.
    fn take_one(&mut self) {
        match self.client.next(LOOK_UP) {
            None => self.note_silence(),
            Some(Event::Connected(found)) => self.begin(&found),
            Some(Event::Told(words)) => self.tell(words),
            Some(Event::Lost(why)) => {
                let words = format!("{}: {why}; it is tried again", self.config.server);
                (self.meanings, self.knows_clock) = (None, false);
                self.forget_sensors();
                self.link.stands(LinkState::Lost(words.clone()));
                self.tell(words);
            }
            Some(Event::Values(values)) => self.take_values(values),
        }
    }

    fn begin(&mut self, found: &[Found]) {
        match Meanings::of(&self.config, found) {
            Ok(meanings) => {
                for problem in &meanings.problems {
                    self.tell(problem.clone());
                }
                self.meanings = Some(meanings);
            }
            // The thread asked the same before it said that it is connected.
            Err(problem) => return self.tell(problem),
        }
        self.joiner.begin();
        self.forget_sensors();
        (self.gave, self.last_words) = (Instant::now(), String::new());
        tracing::info!("{}: session begun; {}", self.config.server, self.config.stamp_words());
        self.link.stands(LinkState::Connected(self.whom()));
    }

    /// Whoever joins what was said to readings forgets it, too.
    fn forget_sensors(&mut self) {
        self.sensors.forget();
        self.say_gone(0);
    }

    /// Says of which sensors there is no value any more.
    fn say_gone(&mut self, at_ns: i64) {
        let missing = self.sensors.gone();
        if self.role == Role::Sensor && !missing.is_empty() {
            self.said.push_back((at_ns, Said { values: Vec::new(), missing }));
        }
    }

    fn whom(&self) -> String {
        format!("{}; {}", self.config.server, self.config.stamp_words())
    }

    fn take_values(&mut self, values: Values) {
        let Some(meanings) = self.meanings.take() else { return };
        self.note_clock(&values);
        let first_sensor = meanings.axes.len();
        let mut axes = Vec::new();
        let mut told = Vec::new();
        for value in values.values {
            match meanings.axes.get(value.node) {
                Some(axis) => axes.push((value.node, axis_value(axis, value))),
                None => told.push(value),
            }
        }
        for value in told {
            let place = value.node.saturating_sub(first_sensor);
            let Some((name, Some(unit))) = meanings.covariates.get(place).map(|(name, unit)| (name, unit.as_ref()))
            else {
                continue;
            };
            if let Some(problem) = self.sensors.take(name, unit, &value, values.arrived_ns) {
                self.link.refused(problem.clone());
                self.tell(problem);
            }
        }
        self.sensors.confirm(values.server_ns.unwrap_or(values.arrived_ns));
        match self.role {
            Role::Sensor => {
                self.say_gone(values.arrived_ns);
                let news = self.sensors.news().into_iter();
                self.said.extend(news.map(|(at_ns, values)| (at_ns, Said { values, missing: Vec::new() })));
            }
            _ => {
                let answer = values.is_answer.then_some(values.server_ns);
                let joined = self.joiner.take(Told { arrived_ns: values.arrived_ns, answer, axes });
                self.ready.extend(joined.into_iter().map(|one| match one {
                    Joined::Sample { at_ns, values } => Ok((at_ns, values)),
                    Joined::Refused(problem) => Err(problem),
                }));
            }
        }
        self.meanings = Some(meanings);
        self.note_silence();
    }

    /// Readings carry the server's time: whoever joins them with others has to know how far off it is.
    fn note_clock(&mut self, values: &Values) {
        let Some(server_ns) = values.server_ns.filter(|_| !self.knows_clock) else { return };
        self.knows_clock = true;
        let ahead_s = (server_ns - values.arrived_ns) as f64 / 1e9;
        if ahead_s.abs() > CLOCKS_APART_S {
            let how = if ahead_s > 0.0 { "ahead of" } else { "behind" };
            let apart_s = ahead_s.abs();
            self.tell(format!(
                "{}: its clock is {apart_s:.1} s {how} this host's; set both by one",
                self.config.server
            ));
        }
    }

    fn note_silence(&mut self) {
        let is_connected = matches!(self.link.status().state, LinkState::Connected(_));
        if is_connected && self.gave.elapsed().as_secs_f64() > self.config.silent_after_s {
            let words = format!(
                "{}: the session stands, and has given nothing usable for more than {} s",
                self.config.server, self.config.silent_after_s
            );
            self.link.stands(LinkState::Silent(words.clone()));
            self.tell(words);
        }
    }

    fn note_voice(&mut self) {
        self.gave = Instant::now();
        if !matches!(self.link.status().state, LinkState::Connected(_)) && self.meanings.is_some() {
            self.link.stands(LinkState::Connected(self.whom()));
        }
    }

    fn reading(&self, at_ns: i64, reading_m: [f64; AXES]) -> Result<ScaleReading, String> {
        let offset_m = match self.config.offset_mm {
            Some(mm) => mm.map(|mm| mm / 1e3),
            None => self.machine.machine.default_offset_m.ok_or("where the tip is, is not known")?,
        };
        Ok(ScaleReading {
            stamp: Stamp::from_nanos(at_ns).map_err(|error| format!("the source timestamp: {error}"))?,
            sequence: self.sequence,
            reading_m,
            offset_m,
            covariates: self.sensors.at(at_ns)?,
            frame_id: config_name("frame_id", &self.machine.machine.frame_id)?,
        })
    }

    fn refused(&self, problem: String) -> DriverError {
        self.link.refused(problem.clone());
        DriverError::Value { from: self.config.server.clone(), problem }
    }

    /// Says something once: the same words again and again would fill the log.
    fn tell(&mut self, words: String) {
        if words != self.last_words {
            tracing::warn!("{words}");
            self.last_words = words;
        }
    }
}

/// What sensors say of an instant.
struct Said {
    values: Vec<(String, f64)>,
    missing: Vec<String>,
}

/// A value of an axis in metres.
fn axis_value(axis: &Axis, told: NodeValue) -> AxisValue {
    let value = told.value.map(|value| value * axis.metres).map_err(|problem| format!("{}: {problem}", axis.name));
    AxisValue { value, source_ns: told.source_ns, is_after_loss: told.is_after_loss }
}

impl ScaleDriver for Opcua {
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError> {
        while !self.shutdown.requested() {
            match self.ready.pop_front() {
                None => self.take_one(),
                Some(Err(problem)) => return Err(self.refused(problem)),
                Some(Ok((at_ns, reading_m))) => {
                    let reading = self.reading(at_ns, reading_m).map_err(|problem| self.refused(problem))?;
                    self.note_voice();
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
}

impl SensorDriver for Opcua {
    fn next_values(&mut self) -> Result<Option<SensorValues>, DriverError> {
        while !self.shutdown.requested() {
            match self.said.pop_front() {
                None => self.take_one(),
                Some((at_ns, Said { values, missing })) => {
                    let stamp = Stamp::from_nanos(at_ns).map_err(|error| self.refused(error.to_string()))?;
                    if !values.is_empty() {
                        self.note_voice();
                    }
                    return Ok(Some(SensorValues { stamp, values, missing }));
                }
            }
        }
        Ok(None)
    }

    fn link(&self) -> Option<Link> {
        Some(self.link.clone())
    }
}
