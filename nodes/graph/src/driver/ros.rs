//! Driver: standard messages on a topic of another ROS 2 program.
//!
//! Place in the flow: `kind = "ros"` in a launch configuration, for controllers, instruments and sensors that are on ROS 2
//! already. The node's gateway takes the messages over DDS and makes samples of them ([`abbe_runtime::gateway::Foreign`]);
//! here they get their sequence, and what is missing, silent or gone is told. Units are those that ROS 2 has for each message;
//! that of a bare number stands in the covariate's name.

use super::{DriverError, Role, ScaleDriver, SensorDriver, SensorValues, TracerDriver};
use crate::link::{Link, LinkState};
use crate::units::Unit;
use abbe_files::MachineFile;
use abbe_msgs::{Message, ScaleReading, TracerReading};
use abbe_runtime::gateway::{Foreign, ForeignMessage, GatewayNode, GatewaySubscriber};
use abbe_runtime::ros::RosError;
use abbe_runtime::{Shutdown, Subscribe, TransportError};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// How often a driver that waits for a message looks whether to stop.
const LOOK_UP: Duration = Duration::from_millis(50);
/// How often messages that were lost are told in the log.
const SAY_EVERY: Duration = Duration::from_secs(10);
/// Longest silence that can be asked for (s): a day.
const LONGEST_SILENCE_S: f64 = 86_400.0;
/// Longest offset that is believed (mm).
const LONGEST_OFFSET_MM: f64 = 10_000.0;
/// Messages that are refused after the last sign that several publishers are mixed.
const REFUSED_AFTER_A_TURN: u32 = 32;
/// Bytes of a name at most.
const LONGEST_NAME: usize = 31;

/// A topic, as launch configurations describe it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RosConfig {
    /// Its name, relative to the namespace of the machine where it does not begin with a slash.
    pub topic: String,
    /// What comes on it.
    pub message: RosMessage,
    /// Joints that are X, Y and Z, of `joint_state`; `x`, `y`, `z` without it.
    pub joints: Option<[String; 3]>,
    /// Tip or reflector relative to the ram reference point (mm, ram frame), of scale readings; the machine's own without it.
    pub offset_mm: Option<[f64; 3]>,
    /// Station of the tracer.
    pub station: Option<String>,
    /// Standard uncertainty of a length (µm, k = 1), of a tracer.
    pub u_length_um: Option<f64>,
    /// Name of the covariate, with its unit.
    pub covariate: Option<String>,
    /// Frame that messages name; the machine's without it, of scale readings.
    pub frame_id: Option<String>,
    /// Which instant a reading has.
    #[serde(default)]
    pub stamp: RosStamp,
    /// Silence from which it is told of (s); 5 without it.
    #[serde(default = "five")]
    pub silent_after_s: f64,
}

/// Messages that can be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RosMessage {
    /// `sensor_msgs/JointState`: scale readings (m).
    JointState,
    /// `geometry_msgs/PointStamped`: scale readings in the machine frame, or a tracer's points in its own (m).
    Point,
    /// `sensor_msgs/Range`: lengths of a tracer (m).
    Range,
    /// `sensor_msgs/Temperature`: a covariate (°C).
    Temperature,
    /// `sensor_msgs/FluidPressure`: a covariate (Pa, which become hPa).
    FluidPressure,
    /// `sensor_msgs/RelativeHumidity`: a covariate (0 to 1, which become per cent).
    RelativeHumidity,
    /// `std_msgs/Float64`: a covariate, in the unit that its name ends with.
    Float64,
}

/// Which instant a reading has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RosStamp {
    /// That of the message's header.
    #[default]
    Header,
    /// That at which it arrived on this host.
    Arrival,
}

fn five() -> f64 {
    5.0
}

impl RosMessage {
    /// Unit of the covariate that it becomes; `None` where that stands in its name.
    fn unit(self) -> Option<&'static str> {
        match self {
            RosMessage::Temperature => Some("_c"),
            RosMessage::FluidPressure => Some("_hpa"),
            RosMessage::RelativeHumidity => Some("_pct"),
            _ => None,
        }
    }

    fn fits(self, role: Role) -> bool {
        match self {
            RosMessage::JointState => role == Role::Scale,
            RosMessage::Point => role != Role::Sensor,
            RosMessage::Range => role == Role::Tracer,
            _ => role == Role::Sensor,
        }
    }
}

impl RosConfig {
    /// The covariate as effects read it; without one whose unit only the message tells.
    pub(super) fn covariates(&self) -> Vec<String> {
        self.covariate.iter().filter_map(|name| Unit::of(name).ok()).map(|unit| unit.name).collect()
    }

    /// The key that is wrong, and what to do; `None` where the topic can be read as this.
    pub(super) fn problem(&self, role: Role) -> Option<(&'static str, String)> {
        let wrong = |key, problem: &str| Some((key, problem.to_owned()));
        if !(self.silent_after_s > 0.0 && self.silent_after_s <= LONGEST_SILENCE_S) {
            return wrong("silent_after_s", "must be a number of seconds above 0, at most a day");
        }
        if !self.message.fits(role) {
            let problem = match role {
                Role::Scale => "scale readings are joint_state or point",
                Role::Tracer => "tracer readings are range or point",
                Role::Sensor => "covariates are temperature, fluid_pressure, relative_humidity or float64",
            };
            return wrong("message", problem);
        }
        if self.joints.is_some() && self.message != RosMessage::JointState {
            return wrong("joints", "is of joint_state; leave it out");
        }
        if let Some([x, y, z]) = &self.joints
            && (x == y || y == z || x == z || [x, y, z].iter().any(|name| name.is_empty()))
        {
            return wrong("joints", "must be three different names, of X, Y and Z");
        }
        self.problem_of_use(role)
    }

    fn problem_of_use(&self, role: Role) -> Option<(&'static str, String)> {
        let wrong = |key, problem: &str| Some((key, problem.to_owned()));
        let misplaced = [
            ("offset_mm", self.offset_mm.is_some(), Role::Scale),
            ("station", self.station.is_some(), Role::Tracer),
            ("u_length_um", self.u_length_um.is_some(), Role::Tracer),
            ("covariate", self.covariate.is_some(), Role::Sensor),
        ];
        if let Some((key, ..)) = misplaced.into_iter().find(|(_, is_set, of)| *is_set && *of != role) {
            return wrong(key, "says nothing of this source; leave it out");
        }
        let offsets = self.offset_mm.iter().flatten().copied();
        if offsets.into_iter().any(|mm: f64| !(-LONGEST_OFFSET_MM..=LONGEST_OFFSET_MM).contains(&mm)) {
            return wrong("offset_mm", "must be three numbers of millimetres, at most 10000");
        }
        match role {
            Role::Scale => None,
            Role::Tracer if self.station.as_ref().is_none_or(String::is_empty) => {
                wrong("station", "a tracer reading needs its station; name it")
            }
            Role::Tracer if !self.u_length_um.is_some_and(|u_um| u_um.is_finite() && u_um > 0.0) => {
                wrong("u_length_um", "a tracer reading needs its standard uncertainty (k = 1), above 0")
            }
            Role::Tracer if self.frame_id.is_none() => wrong(
                "frame_id",
                "name the frame of the instrument that the messages carry, so that no other one is taken for it",
            ),
            Role::Tracer => None,
            Role::Sensor => self.problem_of_covariate(),
        }
    }

    fn problem_of_covariate(&self) -> Option<(&'static str, String)> {
        let Some(name) = &self.covariate else {
            return Some(("covariate", "name it with its unit, such as temp_air_c".to_owned()));
        };
        let unit = match Unit::of(name) {
            Ok(unit) if unit.name.len().max(name.len()) <= LONGEST_NAME => unit,
            Ok(_) => return Some(("covariate", format!("{name:?} is too long; it has at most {LONGEST_NAME} bytes"))),
            Err(problem) => return Some(("covariate", problem)),
        };
        if let Some(expected) = self.message.unit()
            && !(unit.name == *name && name.ends_with(expected))
        {
            return Some((
                "covariate",
                format!("{name:?} must end with {expected}, the unit that this message becomes"),
            ));
        }
        (self.message == RosMessage::Float64 && self.stamp == RosStamp::Header)
            .then(|| ("stamp", "std_msgs/Float64 has no stamp; write stamp = \"arrival\"".to_owned()))
    }

    /// The same, once it is known by which clock the node goes. Between two ticks of `/clock` its time stands: positions and lengths
    /// of a moving machine would share an instant, and be paired with each other's.
    fn problem_of_clock(&self, role: Role, is_simulated: bool) -> Option<(&'static str, String)> {
        (is_simulated && role != Role::Sensor && self.stamp == RosStamp::Arrival).then(|| {
            let problem = "with use_sim_time \"arrival\" is for covariates: /clock stands between its ticks, and does not tell when \
                           within one a position or a length came; let its publisher stamp it, or leave out use_sim_time";
            ("stamp", problem.to_owned())
        })
    }

    fn offset_m(&self, machine: &MachineFile) -> Result<[f64; 3], DriverError> {
        let stated_m = self.offset_mm.map(|offset_mm| offset_mm.map(|mm| mm / 1e3));
        stated_m.or(machine.machine.default_offset_m).ok_or_else(|| DriverError::Lines {
            key: "offset_mm",
            problem: "the machine declares no default_offset_mm; add the key offset_mm".to_owned(),
        })
    }

    fn message(&self, role: Role, machine: &MachineFile) -> Result<ForeignMessage, DriverError> {
        let joints = || self.joints.clone().unwrap_or_else(crate::scene::joint_names);
        let station = || self.station.clone().unwrap_or_default();
        let u_m = self.u_length_um.unwrap_or(f64::NAN) / 1e6;
        let covariate = self.covariate.clone().unwrap_or_default();
        Ok(match (self.message, role) {
            (RosMessage::JointState, _) => ForeignMessage::Joints(joints(), self.offset_m(machine)?),
            (RosMessage::Point, Role::Tracer) => ForeignMessage::Distance(station(), u_m),
            (RosMessage::Point, _) => ForeignMessage::Position(self.offset_m(machine)?),
            (RosMessage::Range, _) => ForeignMessage::Range(station(), u_m),
            (RosMessage::Temperature, _) => ForeignMessage::Temperature(covariate),
            (RosMessage::FluidPressure, _) => ForeignMessage::Pressure(covariate),
            (RosMessage::RelativeHumidity, _) => ForeignMessage::Humidity(covariate),
            (RosMessage::Float64, _) => ForeignMessage::Number(covariate),
        })
    }
}

/// Samples of a topic.
pub(super) struct RosTopic<M: Message> {
    topic: String,
    samples: GatewaySubscriber<M>,
    shutdown: Shutdown,
    silent_after_s: f64,
    sequence: u64,
    refused: u64,
    heard: Instant,
    has_heard: bool,
    told_lost: (u64, Option<Instant>),
    /// Times that publishers took turns, and messages that are still refused for it.
    turns: u64,
    mixed: u32,
    link: Link,
    /// As the link says.
    state: LinkState,
    /// Of a bare number.
    unit: Option<Unit>,
    /// What a sensor gives, as its configuration names it.
    covariate: Option<String>,
}

pub(super) fn open_scale(
    config: &RosConfig,
    machine: &MachineFile,
    shutdown: &Shutdown,
    ros: Option<&GatewayNode>,
) -> Result<RosTopic<ScaleReading>, DriverError> {
    open(config, Role::Scale, machine, shutdown, ros)
}

pub(super) fn open_tracer(
    config: &RosConfig,
    machine: &MachineFile,
    shutdown: &Shutdown,
    ros: Option<&GatewayNode>,
) -> Result<RosTopic<TracerReading>, DriverError> {
    open(config, Role::Tracer, machine, shutdown, ros)
}

pub(super) fn open_sensor(
    config: &RosConfig,
    machine: &MachineFile,
    shutdown: &Shutdown,
    ros: Option<&GatewayNode>,
) -> Result<RosTopic<ScaleReading>, DriverError> {
    open(config, Role::Sensor, machine, shutdown, ros)
}

fn open<M: Message>(
    config: &RosConfig,
    role: Role,
    machine: &MachineFile,
    shutdown: &Shutdown,
    ros: Option<&GatewayNode>,
) -> Result<RosTopic<M>, DriverError> {
    if let Some((key, problem)) = config.problem(role) {
        return Err(DriverError::Lines { key, problem });
    }
    let node = ros.ok_or(DriverError::NoRos)?;
    if let Some((key, problem)) = config.problem_of_clock(role, node.clock().is_simulated()) {
        return Err(DriverError::Lines { key, problem });
    }
    let machine_frame_id = machine.machine.frame_id.clone();
    let foreign = Foreign {
        message: config.message(role, machine)?,
        // What a sensor of the surroundings is called is nobody's business here; its topic names it.
        frame_id: config.frame_id.clone().unwrap_or_else(|| machine_frame_id.clone()),
        machine_frame_id,
        is_stamped: config.stamp == RosStamp::Header,
    };
    let topic = node.resolve(&config.topic).map_err(|error| TransportError::from(RosError::from(error)))?;
    let samples = GatewaySubscriber::open_foreign(node, &topic, foreign)?;
    let named = config.covariate.as_deref().filter(|_| config.message == RosMessage::Float64);
    Ok(RosTopic {
        topic,
        samples,
        shutdown: shutdown.clone(),
        silent_after_s: config.silent_after_s,
        sequence: 0,
        refused: 0,
        heard: Instant::now(),
        has_heard: false,
        told_lost: (0, None),
        turns: 0,
        mixed: 0,
        link: Link::default(),
        state: LinkState::Waiting,
        unit: named.and_then(|name| Unit::of(name).ok()),
        covariate: config.covariate.clone(),
    })
}

impl<M: Message> RosTopic<M> {
    /// The next sample, and its number; `None` when told to stop.
    fn next(&mut self) -> Result<Option<(M, u64)>, DriverError> {
        while !self.shutdown.requested() {
            match self.samples.take_within(LOOK_UP) {
                Ok(Some(sample)) => {
                    self.note_voice();
                    if self.is_mixed() {
                        let problem = "several publishers take turns on the topic; stop all but one".to_owned();
                        return Err(self.of_message(problem));
                    }
                    self.sequence += 1;
                    return Ok(Some((sample, self.sequence - 1)));
                }
                Ok(None) => self.note_silence(),
                Err(TransportError::Malformed { reason, .. }) => return Err(self.of_message(reason)),
                Err(error) => {
                    self.stands(LinkState::Lost(error.to_string()));
                    self.shutdown.sleep(LOOK_UP);
                }
            }
        }
        Ok(None)
    }

    /// Whether messages are of several publishers: these have no sequence that could tell it further on.
    fn is_mixed(&mut self) -> bool {
        let turns = self.samples.interleaved();
        self.mixed = if turns > self.turns { REFUSED_AFTER_A_TURN } else { self.mixed.saturating_sub(1) };
        self.turns = turns;
        self.mixed > 0
    }

    fn of_message(&mut self, problem: String) -> DriverError {
        self.refused += 1;
        self.link.refused(problem.clone());
        // Somebody speaks, if only nonsense.
        self.heard = Instant::now();
        DriverError::Line { line: self.refused, from: format!("ros {}", self.topic), problem }
    }

    fn note_voice(&mut self) {
        (self.heard, self.has_heard) = (Instant::now(), true);
        self.stands(LinkState::Connected(self.topic.clone()));
        let lost = self.samples.lost();
        self.link.missed(lost);
        let (told, when) = self.told_lost;
        if lost > told && when.is_none_or(|when| when.elapsed() >= SAY_EVERY) {
            tracing::warn!("ros {}: {} messages were lost on the way, {lost} so far", self.topic, lost - told);
            self.told_lost = (lost, Some(Instant::now()));
        }
    }

    fn note_silence(&mut self) {
        let is_silent = self.heard.elapsed().as_secs_f64() > self.silent_after_s;
        let topic = &self.topic;
        match (self.samples.publishers(), self.has_heard) {
            // A publisher that was heard and is not counted may be one that was just found.
            (0, true) if is_silent => {
                self.stands(LinkState::Lost(format!("nobody publishes {topic} any more; start its publisher again")));
            }
            (0, false) => {}
            (_, _) if is_silent => {
                let after_s = self.silent_after_s;
                self.stands(LinkState::Silent(format!("{topic}: silent for more than {after_s} s")));
            }
            _ => {}
        }
    }

    fn stands(&mut self, state: LinkState) {
        if self.state == state {
            return;
        }
        match &state {
            LinkState::Connected(_) => tracing::info!("ros {}: messages come", self.topic),
            LinkState::Silent(words) | LinkState::Lost(words) => tracing::warn!("ros: {words}"),
            LinkState::Waiting => {}
        }
        self.state = state.clone();
        self.link.stands(state);
    }
}

impl ScaleDriver for RosTopic<ScaleReading> {
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError> {
        Ok(self.next()?.map(|(reading, sequence)| ScaleReading { sequence, ..reading }))
    }

    fn link(&self) -> Option<Link> {
        Some(self.link.clone())
    }
}

impl TracerDriver for RosTopic<TracerReading> {
    fn next_reading(&mut self) -> Result<Option<TracerReading>, DriverError> {
        Ok(self.next()?.map(|(reading, sequence)| TracerReading { sequence, ..reading }))
    }

    fn link(&self) -> Option<Link> {
        Some(self.link.clone())
    }
}

impl SensorDriver for RosTopic<ScaleReading> {
    fn next_values(&mut self) -> Result<Option<SensorValues>, DriverError> {
        let Some((said, _)) = self.next()? else { return Ok(None) };
        Ok(Some(values_of(&said, self.covariate.as_deref(), self.unit.as_ref())))
    }

    fn link(&self) -> Option<Link> {
        Some(self.link.clone())
    }
}

/// What a sensor said; a message without its covariate says that there is no value now.
fn values_of(said: &ScaleReading, covariate: Option<&str>, unit: Option<&Unit>) -> SensorValues {
    let value = |name: &str, value: f64| match unit {
        Some(unit) => (unit.name.clone(), unit.convert(value)),
        None => (name.to_owned(), value),
    };
    let values: Vec<_> = said.covariates.iter().map(|one| value(one.name.as_str(), one.value)).collect();
    let missing = covariate.filter(|_| values.is_empty()).map(|name| value(name, 0.0).0);
    SensorValues { stamp: said.stamp, values, missing: missing.into_iter().collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_message_without_a_value_voids_the_one_before_under_the_name_that_effects_read() {
        let unit = Unit::of("pressure_pa").unwrap();
        let mut said = ScaleReading::default();
        let of = |said: &ScaleReading| values_of(said, Some("pressure_pa"), Some(&unit));
        assert_eq!((of(&said).values, of(&said).missing), (Vec::new(), vec!["pressure_hpa".to_owned()]));
        let air = values_of(&said, Some("temp_air_c"), None);
        assert_eq!((air.values, air.missing), (Vec::new(), vec!["temp_air_c".to_owned()]));
        said.covariates.push("pressure_pa", 101_325.0, 0.0).unwrap();
        assert_eq!((of(&said).values, of(&said).missing), (vec![("pressure_hpa".to_owned(), 1013.25)], Vec::new()));
    }

    #[test]
    fn what_moves_does_not_arrive_by_simulated_time() {
        let config = |message: &str, more: &str| -> RosConfig {
            toml::from_str(&format!("topic = \"t\"\nmessage = \"{message}\"\n{more}")).unwrap()
        };
        let arrival = "stamp = \"arrival\"";
        for (role, message) in [(Role::Scale, "joint_state"), (Role::Scale, "point"), (Role::Tracer, "range")] {
            let (key, problem) = config(message, arrival).problem_of_clock(role, true).unwrap();
            assert!(key == "stamp" && problem.contains("let its publisher stamp it"), "{problem}");
            assert_eq!(config(message, arrival).problem_of_clock(role, false), None);
            assert_eq!(config(message, "").problem_of_clock(role, true), None);
        }
        assert_eq!(config("float64", arrival).problem_of_clock(Role::Sensor, true), None);
    }
}
