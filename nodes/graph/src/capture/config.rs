//! What `abbe capture` is told: machine, plan, drivers, and what counts as a reading.
//!
//! Place in the flow: read from a TOML file before anything is opened; drivers, covariates and motion are described as in a launch
//! file. Millimetres and micrometres in the file, metres behind it.

use crate::driver::{DriverConfig, IppdmeReads, LinesConfig, LinuxcncConfig, Role, said_twice};
use crate::launch::MotionConfig;
use abbe_measurement::standstill::StandstillSettings;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use thiserror::Error;

/// Longest time that can be asked for (s).
const LONGEST_S: f64 = 86_400.0;
/// Where the driver of the tracer names no station, the plan does.
pub(super) const BY_PLAN: &str = "(as planned)";

/// A capture, as its file describes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaptureConfig {
    /// Machine file, relative to this file.
    pub machine: PathBuf,
    /// Folder of `abbe plan`, relative to this file.
    pub plan: PathBuf,
    /// Driver of the scales.
    pub scale: DriverConfig,
    /// Driver of the tracer.
    pub tracer: DriverConfig,
    /// Sensors whose values become covariates.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub covariates: Vec<DriverConfig>,
    /// Age from which a covariate is left out (s).
    #[serde(default = "ten")]
    pub max_covariate_age_s: f64,
    /// How side of approach, feed and acceleration are derived from the scales.
    #[serde(default = "usual_motion")]
    pub motion: MotionConfig,
    /// What counts as a standstill.
    #[serde(default)]
    pub standstill: StandstillConfig,
    /// What counts as being at a point.
    #[serde(default)]
    pub points: PointsConfig,
    /// What counts as a length.
    #[serde(default)]
    pub lengths: LengthsConfig,
    /// What readings are held against.
    #[serde(default)]
    pub check: CheckConfig,
    /// How the machine is driven; it is moved by somebody else without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drive: Option<DriveConfig>,
}

/// How the machine is driven to the points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveConfig {
    /// Speed of every move (mm/s).
    pub speed_mm_s: f64,
    /// Reading of Z (mm) to which it goes up between points that do not follow one another on a line; straight without it.
    pub over_z_mm: Option<f64>,
    /// How long a reading is waited for at a point (s).
    pub wait_s: Option<f64>,
}

/// What counts as a standstill.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StandstillConfig {
    /// Span of each axis at most (µm).
    pub span_um: f64,
    /// Creep of each axis over the standstill at most (µm).
    pub creep_um: f64,
    /// Shortest standstill (s).
    pub shortest_s: f64,
    /// Time that is averaged at most (s).
    pub longest_s: f64,
    /// Longest pause between two readings of the scales (s).
    pub pause_s: f64,
    /// Left out at both ends (s): what the clocks of scales and tracer may be apart.
    pub margin_s: f64,
}

impl Default for StandstillConfig {
    fn default() -> StandstillConfig {
        StandstillConfig { span_um: 3.0, creep_um: 0.5, shortest_s: 0.5, longest_s: 2.0, pause_s: 0.5, margin_s: 0.05 }
    }
}

/// When a point is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Takes {
    /// When the machine stands still.
    Standstill,
    /// At each reading of the scale driver: the controller latches where it stands.
    Trigger,
}

/// What counts as being at a point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PointsConfig {
    /// Distance from the planned point at most (mm).
    pub within_mm: f64,
    /// When a point is taken.
    pub takes: Takes,
    /// Time before and after a trigger over which lengths are averaged (s).
    pub trigger_s: f64,
}

impl Default for PointsConfig {
    fn default() -> PointsConfig {
        PointsConfig { within_mm: 0.5, takes: Takes::Standstill, trigger_s: 0.2 }
    }
}

/// What counts as a length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LengthsConfig {
    /// Fewest lengths of a standstill.
    pub fewest: usize,
    /// Longest pause between two of them (s).
    pub pause_s: f64,
    /// Standard deviation of a length at most (µm); one that is three times as far off is a gross error.
    pub scatter_um: f64,
    /// Drift over the standstill at most (µm).
    pub creep_um: f64,
    /// Last digit of the tracer (µm), where it is coarser than its noise; without it a length that never changes is an old one.
    pub step_um: Option<f64>,
}

impl Default for LengthsConfig {
    fn default() -> LengthsConfig {
        LengthsConfig { fewest: 5, pause_s: 0.25, scatter_um: 2.0, creep_um: 1.0, step_um: None }
    }
}

/// What readings are held against while the campaign grows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CheckConfig {
    /// Error of a point along the beam before the machine is identified (µm, k = 1).
    pub raw_error_um: f64,
    /// How far the tracer may stand from its planned place (mm, k = 1).
    pub station_mm: f64,
}

impl Default for CheckConfig {
    fn default() -> CheckConfig {
        CheckConfig { raw_error_um: 50.0, station_mm: 50.0 }
    }
}

fn ten() -> f64 {
    10.0
}

fn usual_motion() -> MotionConfig {
    MotionConfig { reversal_um: 20.0, window_s: 0.25 }
}

/// A key that is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{key}: {problem}")]
pub struct ConfigError {
    /// The key.
    pub key: String,
    /// What is wrong, and what to do.
    pub problem: String,
}

impl CaptureConfig {
    /// The key that is wrong, and what to do.
    ///
    /// # Errors
    /// As it says.
    pub fn check(&self) -> Result<(), ConfigError> {
        let wrong = |key: &str, problem: &str| Err(ConfigError { key: key.to_owned(), problem: problem.to_owned() });
        for (name, driver, role) in [("scale", &self.scale, Role::Scale), ("tracer", &self.tracer, Role::Tracer)] {
            if !driver.is_live() {
                return wrong(
                    &format!("{name}.kind"),
                    "is a recording, which is a campaign already; name a live driver, such as lines",
                );
            }
            if let Some((key, problem)) = with_what_the_plan_tells(driver, role).problem(role) {
                return wrong(&format!("{name}.{key}"), &problem);
            }
        }
        for (place, driver) in self.covariates.iter().enumerate() {
            if let Some((key, problem)) = driver.problem(Role::Sensor) {
                return wrong(&format!("covariates[{place}].{key}"), &problem);
            }
        }
        if let Some((place, problem)) = said_twice(&self.covariates) {
            return wrong(&format!("covariates[{place}]"), &problem);
        }
        if let (DriverConfig::Ippdme(server), Takes::Standstill) = (&self.scale, self.points.takes)
            && server.reads != IppdmeReads::Polled
        {
            let problem = "must be \"polled\": reports on moves fall silent where the machine stands, and points of the operator \
                           are triggers (points.takes = \"trigger\")";
            return wrong("scale.reads", problem);
        }
        if let Some(drive) = &self.drive {
            if !matches!(self.scale, DriverConfig::Ippdme(_)) || self.points.takes != Takes::Standstill {
                let problem = "moves a machine by its server of I++ DME alone (scale.kind = \"ippdme\"), from standstill to standstill \
                               (points.takes = \"standstill\"); leave it out, and move the machine otherwise";
                return wrong("drive", problem);
            }
            if drive.wait_s.is_some_and(|wait_s| wait_s <= self.standstill.longest_s) {
                return wrong("drive.wait_s", "must be more than standstill.longest_s: the reading comes after it");
            }
        }
        if let (DriverConfig::Opcua(server), Takes::Standstill) = (&self.scale, self.points.takes)
            && server.is_silent_at_standstill()
        {
            let problem = "must be \"polled\" with joined = \"held\": a server tells what changes, and a machine that stands changes nothing";
            return wrong("scale.reads", problem);
        }
        match &self.scale {
            DriverConfig::Lines(lines) if lines.columns.is_empty() && lines.offset_mm.is_none() => {
                let problem = "must be named here, or the offset in offset_mm: whether the controller tells offsets has to be known \
                               beforehand";
                wrong("scale.columns", problem)
            }
            _ => self.check_numbers(),
        }
    }

    fn check_numbers(&self) -> Result<(), ConfigError> {
        let wrong = |key: &str, problem: &str| Err(ConfigError { key: key.to_owned(), problem: problem.to_owned() });
        let StandstillConfig { span_um, creep_um, shortest_s, longest_s, pause_s, margin_s } = self.standstill;
        let numbers = [
            ("max_covariate_age_s", self.max_covariate_age_s, 1e9),
            ("motion.reversal_um", self.motion.reversal_um, 1e4),
            ("motion.window_s", self.motion.window_s, 10.0),
            ("standstill.span_um", span_um, 1e3),
            ("standstill.creep_um", creep_um, 1e3),
            ("standstill.shortest_s", shortest_s, LONGEST_S),
            ("standstill.longest_s", longest_s, LONGEST_S),
            ("standstill.pause_s", pause_s, LONGEST_S),
            ("points.within_mm", self.points.within_mm, 100.0),
            ("points.trigger_s", self.points.trigger_s, LONGEST_S),
            ("lengths.pause_s", self.lengths.pause_s, LONGEST_S),
            ("lengths.scatter_um", self.lengths.scatter_um, 1e3),
            ("lengths.creep_um", self.lengths.creep_um, 1e3),
            ("lengths.step_um", self.lengths.step_um.unwrap_or(1.0), 1e3),
            ("drive.speed_mm_s", self.drive.map_or(1.0, |drive| drive.speed_mm_s), 1e3),
            ("drive.wait_s", self.drive.and_then(|drive| drive.wait_s).unwrap_or(1.0), LONGEST_S),
            ("check.raw_error_um", self.check.raw_error_um, 1e4),
            ("check.station_mm", self.check.station_mm, 1e4),
        ];
        if let Some((key, _, most)) = numbers.into_iter().find(|(_, value, most)| !(*value > 0.0 && value <= most)) {
            return wrong(key, &format!("must be a number above 0, at most {most}"));
        }
        if longest_s < shortest_s {
            return wrong("standstill.longest_s", "must not be less than shortest_s");
        }
        if !(0.0..=shortest_s / 4.0).contains(&margin_s) {
            return wrong(
                "standstill.margin_s",
                "must be 0 or more, and at most a quarter of shortest_s, or little is left to average",
            );
        }
        if pause_s >= shortest_s.max(0.5) * 10.0 {
            return wrong(
                "standstill.pause_s",
                "must be less than ten times shortest_s: what is not seen is not known to stand still",
            );
        }
        if self.lengths.fewest < 2 {
            return wrong("lengths.fewest", "must be 2 or more: one length has no scatter");
        }
        Ok(())
    }

    /// What counts as a standstill, in SI.
    pub(super) fn standstill(&self) -> StandstillSettings {
        let own = self.standstill;
        StandstillSettings {
            span_m: own.span_um / 1e6,
            creep_m: own.creep_um / 1e6,
            shortest_s: own.shortest_s,
            longest_s: own.longest_s,
            pause_s: own.pause_s,
        }
    }

    /// The drivers as they are opened.
    pub(super) fn drivers(&self) -> (DriverConfig, DriverConfig) {
        (with_what_the_plan_tells(&self.scale, Role::Scale), with_what_the_plan_tells(&self.tracer, Role::Tracer))
    }

    /// Whether the driver of the scales tells where the tip is.
    pub fn tells_offset(&self) -> bool {
        match &self.scale {
            DriverConfig::Lines(lines) => lines.offset_mm.is_some() || names(lines, "offset_x"),
            DriverConfig::Opcua(server) => server.tells_offset(),
            DriverConfig::Linuxcnc(own) => own.offset_mm.is_some(),
            DriverConfig::Ros(topic) => topic.offset_mm.is_some(),
            _ => true,
        }
    }

    /// Whether a driver takes its readings from ROS 2, so that the capture has to be in its graph.
    pub(super) fn is_in_ros_graph(&self) -> bool {
        let all = [&self.scale, &self.tracer].into_iter().chain(&self.covariates);
        all.into_iter().any(|driver| matches!(driver, DriverConfig::Ros(_)))
    }

    /// Whether the driver of the tracer tells its station.
    pub fn tells_station(&self) -> bool {
        match &self.tracer {
            // Columns that the first line names are not known yet.
            DriverConfig::Lines(lines) => {
                lines.station.is_some() || lines.columns.is_empty() || names(lines, "station")
            }
            DriverConfig::Ros(topic) => topic.station.is_some(),
            _ => true,
        }
    }

    /// What decides which numbers are read, as text: a journal is not gone on with when it changes. Addresses do not belong to it.
    pub fn identity(&self) -> String {
        let of = |driver: &DriverConfig| match driver {
            DriverConfig::Lines(lines) => {
                format!("lines {:?} {:?} {:?}", lines.columns, lines.decimal, lines.offset_mm)
            }
            DriverConfig::Linuxcnc(own) => format!("linuxcnc {:?} {:?}", own.units, own.offset_mm),
            DriverConfig::Ippdme(server) => {
                format!("ippdme {:?} {:?} {}", server.tools_mm, server.offset_mm, server.server_offsets)
            }
            DriverConfig::Opcua(server) => format!("opcua {}", server.identity()),
            other => format!("{other:?}"),
        };
        format!("{}\n{}", of(&self.scale), of(&self.tracer))
    }
}

fn names(lines: &LinesConfig, stem: &str) -> bool {
    lines.columns.iter().any(|column| column.starts_with(stem))
}

/// A driver that does not tell the station or the offset is told one that the plan's takes the place of.
fn with_what_the_plan_tells(driver: &DriverConfig, role: Role) -> DriverConfig {
    let mut lines = match driver {
        DriverConfig::Lines(lines) => lines.clone(),
        DriverConfig::Opcua(server) if role == Role::Scale => {
            return DriverConfig::Opcua(Box::new(server.with_some_offset()));
        }
        DriverConfig::Linuxcnc(own) if role == Role::Scale => {
            let offset_mm = own.offset_mm.or(Some([0.0; 3]));
            return DriverConfig::Linuxcnc(LinuxcncConfig { offset_mm, ..own.clone() });
        }
        DriverConfig::Ros(topic) => {
            let mut topic = topic.clone();
            match role {
                Role::Scale => topic.offset_mm = topic.offset_mm.or(Some([0.0; 3])),
                Role::Tracer => topic.station = topic.station.or_else(|| Some(BY_PLAN.to_owned())),
                Role::Sensor => {}
            }
            return DriverConfig::Ros(topic);
        }
        _ => return driver.clone(),
    };
    match role {
        Role::Tracer if lines.station.is_none() && !lines.columns.is_empty() && !names(&lines, "station") => {
            lines.station = Some(BY_PLAN.to_owned());
        }
        Role::Scale if lines.offset_mm.is_none() && !names(&lines, "offset_x") => lines.offset_mm = Some([0.0; 3]),
        _ => {}
    }
    DriverConfig::Lines(lines)
}
