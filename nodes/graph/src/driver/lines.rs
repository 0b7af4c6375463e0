//! Driver: lines of text from another program or box, over TCP, UDP, a serial port or from a command.
//!
//! Place in the flow: `kind = "lines"` in a launch configuration, for controllers and instruments that write a line a reading.
//! The launch file says where lines come from ([`port`]) and what their columns are ([`row`]). A connection that ends is made
//! again; one that is silent is told of. A column without a value is a missing covariate, and never the one before it. The
//! stamp is the instrument's where a column `stamp_s` holds it, else the instant at which the line arrived.

pub(super) mod event;
pub(super) mod port;
mod row;
mod running;
mod serial;

use super::Role;
use super::{DriverError, ScaleDriver, SensorDriver, SensorValues, TracerDriver};
use crate::link::{Link, LinkState};
use abbe_files::MachineFile;
use abbe_msgs::{ScaleReading, TracerReading};
use abbe_runtime::Shutdown;
use event::{Event, Line};
use port::Port;
use row::{Row, Table};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant, SystemTime};

pub use port::LinesFrom;
pub use serial::{Flow, Parity, SerialConfig};

/// How often a driver that waits for a line looks whether to stop.
const LOOK_UP: Duration = Duration::from_millis(50);
/// What is said of a line of a sensor that has none.
const NO_VALUE: &str = "all of its values are empty";
/// Longest silence that can be asked for (s): a day.
const LONGEST_SILENCE_S: f64 = 86_400.0;

/// Lines of text, as launch configurations describe them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinesConfig {
    /// Where they come from.
    pub from: LinesFrom,
    /// What stands between columns: one character, or `blank` for any number of blanks and tabs; a comma without it.
    #[serde(default = "comma")]
    pub separator: String,
    /// What marks decimals: a point, or a comma; a point without it.
    #[serde(default = "point")]
    pub decimal: String,
    /// Columns in order, with their unit (`x_mm`, `length_mm`, `temp_scale_x_c`); `-` leaves one out. Empty where the first
    /// line after each connecting names them.
    #[serde(default)]
    pub columns: Vec<String>,
    /// Tip or reflector relative to the ram reference point (mm, ram frame), where no columns tell it; the machine's own
    /// without it.
    pub offset_mm: Option<[f64; 3]>,
    /// Station of the tracer, where no column tells it.
    pub station: Option<String>,
    /// Standard uncertainty of a length (µm, k = 1), where no column tells it.
    pub u_length_um: Option<f64>,
    /// Silence from which it is told of, and a connection is made again (s); 5 without it.
    #[serde(default = "five")]
    pub silent_after_s: f64,
}

fn comma() -> String {
    ",".to_owned()
}

fn point() -> String {
    ".".to_owned()
}

fn five() -> f64 {
    5.0
}

impl LinesConfig {
    /// Whether a line would be a reading, where `names` names the columns; for checks without a port.
    ///
    /// # Errors
    /// What is wrong with the names or the line, in words.
    pub fn try_line(&self, role: Role, machine: &MachineFile, names: &str, line: &str) -> Result<(), String> {
        let names: Vec<String> = Table::split(self, names).map(str::to_owned).collect();
        let table = Table::new(self, &names, role, is_offset_known(self, machine))?;
        let row = table.row(line, SystemTime::now(), 0)?;
        match role {
            Role::Scale => row.scale(self, machine).map(|_| ()),
            Role::Tracer => row.tracer(self, machine).map(|_| ()),
            Role::Sensor if row.values().values.is_empty() => Err(NO_VALUE.to_owned()),
            Role::Sensor => Ok(()),
        }
    }

    /// The key that is wrong, and what to do; `None` where lines can be read as this.
    pub(super) fn problem(&self, kind: Role) -> Option<(&'static str, String)> {
        if !(self.silent_after_s > 0.0 && self.silent_after_s <= LONGEST_SILENCE_S) {
            return Some(("silent_after_s", "must be a number of seconds above 0, at most a day".to_owned()));
        }
        if let Some(problem) = self.from.problem() {
            return Some(("from", problem));
        }
        if matches!(self.from, LinesFrom::Serial(_)) && self.columns.is_empty() {
            let problem = "must be named: a serial port has no first line that could name them";
            return Some(("columns", problem.to_owned()));
        }
        Table::separator(self).err().or_else(|| match self.columns.as_slice() {
            [] => None,
            columns => Table::new(self, columns, kind, true).err().map(|problem| ("columns", problem)),
        })
    }

    /// Covariates that the columns name.
    pub(super) fn covariates(&self) -> Vec<String> {
        Table::covariates(&self.columns)
    }
}

/// Readings from lines.
pub(super) struct Lines {
    config: LinesConfig,
    kind: Role,
    machine: MachineFile,
    port: Port,
    shutdown: Shutdown,
    /// Known from the launch file, or from the first line of a connection.
    table: Option<Table>,
    sequence: u64,
    heard: Instant,
    /// Who writes the lines.
    whom: String,
    /// The silence was told.
    is_silent: bool,
    /// The loss that was told last, since when no line has come.
    last_loss: Option<String>,
    link: Link,
    /// As the link says.
    is_connected: bool,
}

/// Opens lines of this kind; `shutdown` ends the wait for one.
pub(super) fn open(
    config: &LinesConfig,
    kind: Role,
    machine: &MachineFile,
    shutdown: &Shutdown,
) -> Result<Lines, DriverError> {
    let config_error = |(key, problem): (&'static str, String)| DriverError::Lines { key, problem };
    config.problem(kind).map_or(Ok(()), |problem| Err(config_error(problem)))?;
    let table = match config.columns.as_slice() {
        [] => None,
        columns => {
            let table = Table::new(config, columns, kind, is_offset_known(config, machine));
            Some(table.map_err(|problem| config_error(("columns", problem)))?)
        }
    };
    let silent_after = Duration::from_secs_f64(config.silent_after_s);
    let port =
        Port::open(&config.from, silent_after, kind == Role::Scale).map_err(|source| DriverError::Port { source })?;
    Ok(Lines {
        config: config.clone(),
        kind,
        machine: machine.clone(),
        port,
        shutdown: shutdown.clone(),
        table,
        sequence: 0,
        heard: Instant::now(),
        whom: config.from.to_string(),
        is_silent: false,
        last_loss: None,
        link: Link::default(),
        is_connected: false,
    })
}

fn is_offset_known(config: &LinesConfig, machine: &MachineFile) -> bool {
    config.offset_mm.is_some() || machine.machine.default_offset_m.is_some()
}

impl Lines {
    /// The next row; `None` when told to stop.
    fn next_row(&mut self) -> Result<Option<Row>, DriverError> {
        while !self.shutdown.requested() {
            match self.port.next(LOOK_UP) {
                None => self.note_silence(),
                Some(Event::Connected(whom)) => {
                    self.note_connection(whom);
                    if self.config.columns.is_empty() {
                        self.table = None;
                    }
                }
                Some(Event::Lost(why)) => self.note_loss(&why),
                Some(Event::TooLong) => return Err(self.of_line("it is longer than 4096 bytes".to_owned())),
                Some(Event::Half) => return Err(self.of_line(port::HALF.to_owned())),
                Some(Event::NotWhole) => {
                    self.note_voice();
                    tracing::info!(
                        "{}: the first line was left out; it may have begun before the port was opened",
                        self.config.from
                    );
                }
                Some(Event::Line(line)) => {
                    self.note_voice();
                    if let Some(row) = self.read(&line)? {
                        return Ok(Some(row));
                    }
                }
            }
        }
        Ok(None)
    }

    /// A row; `None` for blank lines, comments and the line of the column names.
    fn read(&mut self, line: &Line) -> Result<Option<Row>, DriverError> {
        let text = std::str::from_utf8(&line.text).map_err(|_| self.of_line("it is no UTF-8 text".to_owned()))?.trim();
        if text.contains('\0') {
            let problem =
                "it holds a NUL: a byte that came damaged; see that baud, bits and parity are those of the box";
            return Err(self.of_line(problem.to_owned()));
        }
        if text.is_empty() || text.starts_with('#') {
            return Ok(None);
        }
        let Some(table) = &self.table else {
            let names = Table::split(&self.config, text).map(str::to_owned).collect::<Vec<_>>();
            let table = Table::new(&self.config, &names, self.kind, is_offset_known(&self.config, &self.machine));
            self.table = Some(table.map_err(|problem| self.of_line(format!("as column names: {problem}")))?);
            return Ok(None);
        };
        table.row(text, line.arrived, self.sequence).map(Some).map_err(|problem| self.of_line(problem))
    }

    /// The next row as a reading; only readings are numbered.
    fn reading<T>(
        &mut self,
        of: impl FnOnce(Row, &LinesConfig, &MachineFile) -> Result<T, String>,
    ) -> Result<Option<T>, DriverError> {
        let Some(mut row) = self.next_row()? else { return Ok(None) };
        let unread = row.unread.take();
        let reading = of(row, &self.config, &self.machine).map_err(|problem| self.of_line(problem))?;
        if let Some(unread) = unread {
            self.link.refused(format!("line {}: {unread}", self.port.lines()));
        }
        self.sequence += 1;
        Ok(Some(reading))
    }

    fn of_line(&self, problem: String) -> DriverError {
        self.link.refused(format!("line {}: {problem}", self.port.lines()));
        DriverError::Line { line: self.port.lines(), from: self.config.from.to_string(), problem }
    }

    /// A connection on which nothing comes is as silent as the one before it.
    fn note_connection(&mut self, whom: String) {
        if self.last_loss.is_none() {
            tracing::info!("connected with {whom}");
        }
        self.whom.clone_from(&whom);
        let state = if self.is_silent { LinkState::Silent(self.silence()) } else { LinkState::Connected(whom) };
        self.stands(state);
    }

    fn note_loss(&mut self, why: &str) {
        let words = format!("{}: {why}; it is tried again", self.config.from);
        // The same words again and again would fill the log.
        if self.last_loss.as_ref() != Some(&words) {
            tracing::warn!("{words}");
        }
        self.stands(LinkState::Lost(words.clone()));
        self.last_loss = Some(words);
    }

    fn note_silence(&mut self) {
        if !self.is_silent && self.heard.elapsed().as_secs_f64() > self.config.silent_after_s {
            self.is_silent = true;
            tracing::warn!("{}", self.silence());
            if self.is_connected {
                self.stands(LinkState::Silent(self.silence()));
            }
        }
    }

    fn silence(&self) -> String {
        format!("{}: silent for more than {} s", self.config.from, self.config.silent_after_s)
    }

    fn note_voice(&mut self) {
        if std::mem::take(&mut self.is_silent) || self.last_loss.take().is_some() {
            tracing::info!("{}: lines come again, after {:.1} s", self.config.from, self.heard.elapsed().as_secs_f64());
        }
        self.heard = Instant::now();
        // Packets make no connection.
        if !self.is_connected {
            self.is_connected = true;
            self.link.stands(LinkState::Connected(self.whom.clone()));
        }
    }

    fn stands(&mut self, state: LinkState) {
        self.is_connected = matches!(state, LinkState::Connected(_));
        self.link.stands(state);
    }
}

impl ScaleDriver for Lines {
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError> {
        self.reading(|row, config, machine| row.scale(config, machine))
    }

    fn link(&self) -> Option<Link> {
        Some(self.link.clone())
    }
}

impl TracerDriver for Lines {
    fn next_reading(&mut self) -> Result<Option<TracerReading>, DriverError> {
        self.reading(|row, config, machine| row.tracer(config, machine))
    }

    fn link(&self) -> Option<Link> {
        Some(self.link.clone())
    }
}

impl SensorDriver for Lines {
    fn next_values(&mut self) -> Result<Option<SensorValues>, DriverError> {
        let said = self.reading(|row, _, _| Ok(row.values()))?;
        if said.as_ref().is_some_and(|said| said.values.is_empty()) {
            self.link.refused(format!("line {}: {NO_VALUE}", self.port.lines()));
        }
        Ok(said)
    }

    fn link(&self) -> Option<Link> {
        Some(self.link.clone())
    }
}
