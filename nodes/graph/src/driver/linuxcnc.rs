//! Driver: LinuxCNC, by the samples that its own `sampler` takes in the servo thread.
//!
//! Place in the flow: `kind = "linuxcnc"` in a launch configuration. `halsampler -t` writes a line a servo period: number of the
//! sample, feedback of the joints X, Y, Z, whether each is homed, their commanded speeds, the feed; which pins that are stands in
//! `launch-config/linuxcnc/abbe.hal`. A [`sample_clock`] tells when each was taken. A joint that is not homed has no position.
//! Direction and feed are the commanded ones: `dir_x` stays as the axis moved last, `speed_mm_s` is while the machine stands the greatest
//! of the last move, as where they are [derived](crate::step). Machine units on the wire, metres in readings.

mod sample_clock;

use super::lines::LinesFrom;
use super::lines::event::{Event, Line};
use super::lines::port::{HALF, Port};
use super::{DriverError, Role, ScaleDriver, config_name};
use crate::connecting::stamp_of;
use crate::link::{Link, LinkState};
use abbe_files::MachineFile;
use abbe_geometry::Axis;
use abbe_geometry::effects::logged_side;
use abbe_msgs::{Covariates, ScaleReading, Stamp};
use abbe_runtime::Shutdown;
use sample_clock::{Dated, SampleClock};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// How often a driver that waits looks whether to stop.
const LOOK_UP: Duration = Duration::from_millis(50);
/// Longest time that can be asked for (s): a day.
const LONGEST_S: f64 = 86_400.0;
/// Servo periods that there are (s).
const PERIODS_S: (f64, f64) = (1e-5, 0.1);
/// Latest sample that can be taken (s).
const LATEST_S: f64 = 0.25;
/// Cells of a line: number, three positions, three homed, three speeds, feed.
const CELLS: usize = 11;
const AXES: [&str; 3] = ["X", "Y", "Z"];

/// A LinuxCNC, as launch configurations describe it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinuxcncConfig {
    /// Where `halsampler -t` writes to; it is run on this host without it.
    #[serde(default = "halsampler")]
    pub from: LinesFrom,
    /// Machine units of LinuxCNC (`LINEAR_UNITS` of its INI file).
    pub units: MachineUnits,
    /// Servo period (s, `SERVO_PERIOD` of its INI file); 0.001 without it.
    #[serde(default = "millisecond")]
    pub period_s: f64,
    /// Time between two readings (s), of whole servo periods; 0.01 without it.
    #[serde(default = "hundredth")]
    pub every_s: f64,
    /// A sample that comes this much later (s) than the others is not given: its number may not tell its instant; 0.03 without it.
    #[serde(default = "thirty_milliseconds")]
    pub late_s: f64,
    /// Tip or reflector relative to the ram reference point (mm, ram frame); the machine's own without it.
    pub offset_mm: Option<[f64; 3]>,
    /// Silence from which it is told of, and a connection is made again (s); 5 without it.
    #[serde(default = "five")]
    pub silent_after_s: f64,
}

/// Units of a machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MachineUnits {
    /// Millimetres.
    Mm,
    /// Inches.
    Inch,
}

impl MachineUnits {
    fn mm(self) -> f64 {
        match self {
            MachineUnits::Mm => 1.0,
            MachineUnits::Inch => 25.4,
        }
    }
}

fn halsampler() -> LinesFrom {
    // Without stdbuf it holds lines back until 4096 bytes have come together.
    LinesFrom::Command(["stdbuf", "-oL", "halsampler", "-t"].map(str::to_owned).to_vec())
}

fn millisecond() -> f64 {
    0.001
}

fn thirty_milliseconds() -> f64 {
    0.03
}

fn hundredth() -> f64 {
    0.01
}

fn five() -> f64 {
    5.0
}

const ONLY_SCALES: &str = "linuxcnc reads scales; a tracer or a sensor has another driver, such as lines";

/// LinuxCNC gives nothing else.
pub(super) fn only_scales() -> DriverError {
    DriverError::Lines { key: "kind", problem: ONLY_SCALES.to_owned() }
}

impl LinuxcncConfig {
    /// Reads lines of a sampler, one a servo period; for checks without a LinuxCNC.
    ///
    /// # Errors
    /// What is wrong with the first line that is none, in words.
    pub fn try_lines(&self, text: &str) -> Result<(), String> {
        let (mut commanded, mut clock) = (Commanded::default(), SampleClock::new(self.period_s, self.late_s));
        for (place, line) in text.lines().enumerate() {
            let sample = Sample::parse(line.trim(), self.units)?;
            commanded.take(&sample);
            if let Dated::At(at_s) = clock.date(sample.number, place as f64 * self.period_s) {
                Stamp::from_seconds(at_s).map_err(|error| error.to_string())?;
            }
        }
        Ok(())
    }

    /// The key that is wrong, and what to do; `None` where it can be read as this.
    pub(super) fn problem(&self, role: Role) -> Option<(&'static str, String)> {
        if role != Role::Scale {
            return Some(("kind", ONLY_SCALES.to_owned()));
        }
        if let Some(problem) = self.from.problem() {
            return Some(("from", problem));
        }
        let (shortest_s, longest_s) = PERIODS_S;
        if !(shortest_s..=longest_s).contains(&self.period_s) {
            return Some(("period_s", "must be the servo period in seconds, between 0.00001 and 0.1".to_owned()));
        }
        let share = self.every_s / self.period_s;
        if !(share >= 0.999 && self.every_s <= LONGEST_S && (share - share.round()).abs() < 1e-6 * share) {
            return Some(("every_s", "must be one or more whole servo periods (period_s), at most a day".to_owned()));
        }
        if !(self.late_s >= self.period_s && self.late_s <= LATEST_S) {
            return Some(("late_s", "must be a servo period or more, and at most 0.25".to_owned()));
        }
        if !(self.silent_after_s > 0.0 && self.silent_after_s <= LONGEST_S) {
            return Some(("silent_after_s", "must be a number of seconds above 0, at most a day".to_owned()));
        }
        if self.offset_mm.iter().flatten().any(|mm| !mm.is_finite()) {
            return Some(("offset_mm", "must be three numbers of millimetres".to_owned()));
        }
        None
    }
}

/// One line as values, in SI.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    number: i64,
    reading_m: [f64; 3],
    is_homed: [bool; 3],
    speed_m_s: [f64; 3],
    feed_m_s: f64,
}

impl Sample {
    fn parse(text: &str, units: MachineUnits) -> Result<Sample, String> {
        let cells: Vec<&str> = text.split_whitespace().collect();
        if cells.len() != CELLS {
            return Err(format!(
                "it has {} columns instead of {CELLS}; load the pins of launch-config/linuxcnc/abbe.hal, and run halsampler with -t",
                cells.len()
            ));
        }
        let number = |k: usize| {
            let value = cells[k].parse::<f64>().ok().filter(|value| value.is_finite());
            value.map(|value| value * units.mm() / 1e3).ok_or_else(|| format!("{:?} is no finite number", cells[k]))
        };
        let is_homed = |k: usize| match cells[k] {
            "0" => Ok(false),
            "1" => Ok(true),
            other => Err(format!("{other:?} in column {} is neither 0 nor 1", k + 1)),
        };
        Ok(Sample {
            number: cells[0].parse().map_err(|_| format!("{:?} is no number of a sample", cells[0]))?,
            reading_m: [number(1)?, number(2)?, number(3)?],
            is_homed: [is_homed(4)?, is_homed(5)?, is_homed(6)?],
            speed_m_s: [number(7)?, number(8)?, number(9)?],
            feed_m_s: number(10)?,
        })
    }
}

/// What the commands so far say of side and feed.
#[derive(Debug, Clone, Copy, Default)]
struct Commanded {
    direction: [Option<f64>; 3],
    feed_m_s: Option<f64>,
    was_moving: bool,
}

impl Commanded {
    fn take(&mut self, sample: &Sample) {
        for (direction, speed_m_s) in self.direction.iter_mut().zip(sample.speed_m_s) {
            if speed_m_s != 0.0 {
                *direction = Some(speed_m_s.signum());
            }
        }
        let is_moving = sample.feed_m_s != 0.0;
        if is_moving {
            let before = self.feed_m_s.filter(|_| self.was_moving).unwrap_or(0.0);
            self.feed_m_s = Some(sample.feed_m_s.abs().max(before));
        }
        self.was_moving = is_moving;
    }

    /// Names and values as effects read them, with the feed of now while it moves.
    fn covariates(&self, sample: &Sample) -> impl Iterator<Item = (&'static str, f64)> {
        let feed_m_s = if self.was_moving { Some(sample.feed_m_s.abs()) } else { self.feed_m_s };
        let directions = Axis::ALL.map(logged_side).into_iter().zip(self.direction);
        directions.filter_map(|(name, side)| Some((name, side?))).chain(feed_m_s.map(|m_s| ("speed_mm_s", m_s * 1e3)))
    }
}

/// Readings from LinuxCNC.
pub(super) struct Linuxcnc {
    config: LinuxcncConfig,
    machine: MachineFile,
    offset_m: [f64; 3],
    port: Port,
    shutdown: Shutdown,
    clock: SampleClock,
    commanded: Commanded,
    every: i64,
    sequence: u64,
    heard: Instant,
    whom: String,
    /// What was said of the link last.
    stands: Option<LinkState>,
    link: Link,
}

/// Opens LinuxCNC; `shutdown` ends the wait for a reading.
pub(super) fn open(
    config: &LinuxcncConfig,
    machine: &MachineFile,
    shutdown: &Shutdown,
) -> Result<Linuxcnc, DriverError> {
    let error = |(key, problem)| DriverError::Lines { key, problem };
    config.problem(Role::Scale).map_or(Ok(()), |problem| Err(error(problem)))?;
    let stated_m = config.offset_mm.map(|mm| mm.map(|mm| mm / 1e3));
    let offset_m = stated_m.or(machine.machine.default_offset_m).ok_or_else(|| {
        error(("offset_mm", "is needed: the machine declares no default_offset_mm, and LinuxCNC tells none".to_owned()))
    })?;
    let silent_after = Duration::from_secs_f64(config.silent_after_s);
    Ok(Linuxcnc {
        machine: machine.clone(),
        offset_m,
        port: Port::open(&config.from, silent_after, true).map_err(|source| DriverError::Port { source })?,
        shutdown: shutdown.clone(),
        clock: SampleClock::new(config.period_s, config.late_s),
        commanded: Commanded::default(),
        every: (config.every_s / config.period_s).round() as i64,
        sequence: 0,
        heard: Instant::now(),
        whom: config.from.to_string(),
        stands: None,
        link: Link::default(),
        config: config.clone(),
    })
}

impl Linuxcnc {
    /// What a line gives; `None` where it is no reading, and nothing is wrong with it.
    fn take(&mut self, line: &Line) -> Result<Option<ScaleReading>, String> {
        self.heard = Instant::now();
        let text = std::str::from_utf8(&line.text).map_err(|_| "it is no UTF-8 text".to_owned())?.trim();
        if text.is_empty() {
            return Ok(None);
        }
        if text == "overrun" {
            self.begin_anew("samples were lost: nobody read them in time");
            return Ok(None);
        }
        let sample = Sample::parse(text, self.config.units)?;
        self.commanded.take(&sample);
        let arrived_s = stamp_of(line.arrived)?.to_seconds();
        let at_s = match self.clock.date(sample.number, arrived_s) {
            Dated::At(at_s) => at_s,
            Dated::NotYet => return Ok(None),
            Dated::Late(late_s) if sample.number.rem_euclid(self.every) == 0 => {
                return Err(format!("it came {:.0} ms late, and may not be of its instant (late_s)", late_s * 1e3));
            }
            Dated::Late(_) => return Ok(None),
            Dated::Lost(late_s) => {
                let why = late_s.map_or("samples are missing".to_owned(), |s| format!("a sample came {s:.2} s late"));
                self.begin_anew(&why);
                return Ok(None);
            }
        };
        if let Some(axis) = sample.is_homed.iter().position(|is| !is) {
            self.stand(LinkState::Lost(format!("{} is not homed, and has no position; home the machine", AXES[axis])));
            return Ok(None);
        }
        self.stand(LinkState::Connected(self.whom.clone()));
        if sample.number.rem_euclid(self.every) != 0 {
            return Ok(None);
        }
        let mut covariates = Covariates::new();
        for (name, value) in self.commanded.covariates(&sample) {
            covariates.push(name, value, 0.0).map_err(|error| error.to_string())?;
        }
        Ok(Some(ScaleReading {
            stamp: Stamp::from_seconds(at_s).map_err(|error| error.to_string())?,
            sequence: self.sequence,
            reading_m: sample.reading_m,
            offset_m: self.offset_m,
            covariates,
            frame_id: config_name("frame_id", &self.machine.machine.frame_id)?,
        }))
    }

    /// Numbers are tied to the clock anew.
    fn begin_anew(&mut self, why: &str) {
        tracing::warn!("{}: {why}; readings go on when instants are certain again", self.whom);
        self.clock.forget();
        self.commanded = Commanded::default();
    }

    fn stand(&mut self, state: LinkState) {
        if self.stands.as_ref() != Some(&state) {
            match &state {
                LinkState::Connected(whom) => tracing::info!("{whom}: positions come"),
                LinkState::Silent(words) | LinkState::Lost(words) => tracing::warn!("{}: {words}", self.whom),
                LinkState::Waiting => {}
            }
            self.link.stands(state.clone());
            self.stands = Some(state);
        }
    }

    fn refused(&self, problem: String) -> DriverError {
        self.link.refused(format!("line {}: {problem}", self.port.lines()));
        DriverError::Line { line: self.port.lines(), from: self.config.from.to_string(), problem }
    }
}

impl ScaleDriver for Linuxcnc {
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError> {
        while !self.shutdown.requested() {
            match self.port.next(LOOK_UP) {
                None if self.heard.elapsed().as_secs_f64() > self.config.silent_after_s => {
                    if matches!(self.stands, Some(LinkState::Connected(_))) {
                        let words = format!("silent for more than {} s", self.config.silent_after_s);
                        self.stand(LinkState::Silent(words));
                    }
                }
                None => {}
                Some(Event::Connected(_)) => {
                    self.clock.forget();
                    self.commanded = Commanded::default();
                }
                Some(Event::Lost(why)) => self.stand(LinkState::Lost(format!("{why}; it is tried again"))),
                Some(Event::TooLong) => return Err(self.refused("it is longer than 4096 bytes".to_owned())),
                Some(Event::Half) => return Err(self.refused(HALF.to_owned())),
                Some(Event::NotWhole) => {}
                Some(Event::Line(line)) => match self.take(&line) {
                    Ok(None) => {}
                    Ok(Some(reading)) => {
                        self.sequence += 1;
                        return Ok(Some(reading));
                    }
                    Err(problem) => return Err(self.refused(problem)),
                },
            }
        }
        Ok(None)
    }

    fn link(&self) -> Option<Link> {
        Some(self.link.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(text: &str) -> Sample {
        Sample::parse(text, MachineUnits::Mm).unwrap()
    }

    #[test]
    fn a_line_of_a_real_linuxcnc_is_read_and_the_last_command_stays() {
        // Written by LinuxCNC 2.9 on its way to X 90 at 600 mm/min.
        let moving = sample("5999 97.040000 50.000000 10.000000 1 1 1 -10.000000 0.000000 0.000000 10.000000 ");
        assert_eq!((moving.number, moving.is_homed), (5999, [true; 3]));
        assert!((moving.reading_m[0] - 0.09704).abs() < 1e-15 && moving.feed_m_s == 0.01);
        let inches = Sample::parse("1 1 0 0 1 1 0 2 0 0 2", MachineUnits::Inch).unwrap();
        assert!((inches.reading_m[0] - 0.0254).abs() < 1e-15 && (inches.feed_m_s - 0.0508).abs() < 1e-15);
        let mut commanded = Commanded::default();
        let said = |commanded: &mut Commanded, sample: &Sample| {
            commanded.take(sample);
            commanded.covariates(sample).collect::<Vec<_>>()
        };
        let standing = sample("1 0 0 0 1 1 1 0 0 0 0");
        assert_eq!(said(&mut commanded, &standing), []);
        assert_eq!(said(&mut commanded, &moving), [("dir_x", -1.0), ("speed_mm_s", 10.0)]);
        let braking = sample("1 0 0 0 1 1 1 -2 0 0 2");
        assert_eq!(said(&mut commanded, &braking), [("dir_x", -1.0), ("speed_mm_s", 2.0)]);
        assert_eq!(said(&mut commanded, &standing), [("dir_x", -1.0), ("speed_mm_s", 10.0)]);
        let other = sample("1 0 0 0 1 1 1 0 3 0 3");
        assert_eq!(said(&mut commanded, &other), [("dir_x", -1.0), ("dir_y", 1.0), ("speed_mm_s", 3.0)]);
    }

    proptest! {
        #[test]
        fn no_line_ends_the_program(line in "\\PC{0,80}|[-0-9. e]{0,80}|([0-9]{1,3} ){11}") {
            if let Ok(sample) = Sample::parse(&line, MachineUnits::Inch) {
                prop_assert!(sample.reading_m.iter().all(|m| m.is_finite()));
            }
        }
    }
}
