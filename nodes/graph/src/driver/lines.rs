//! Driver: lines of text from another program or box, over TCP, UDP or from a command.
//!
//! Place in the flow: `kind = "lines"` in a launch configuration, for controllers and instruments that write a line a reading.
//! The launch file says where lines come from ([`port`]) and what their columns are ([`row`]). A connection that ends is made
//! again; one that is silent is told of. A column without a value is a missing covariate, and never the one before it. The
//! stamp is the instrument's where a column `stamp_s` holds it, else the instant at which the line arrived.

mod port;
mod row;

use super::{DriverError, ScaleDriver, TracerDriver};
use abbe_files::MachineFile;
use abbe_msgs::{ScaleReading, TracerReading};
use abbe_runtime::Shutdown;
use port::{Event, Port};
use row::{Row, Table};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

pub use port::LinesFrom;

/// How often a driver that waits for a line looks whether to stop.
const LOOK_UP: Duration = Duration::from_millis(50);
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

/// What lines are read as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Scale,
    Tracer,
}

impl LinesConfig {
    /// The key that is wrong, and what to do; `None` where lines can be read as this.
    pub(crate) fn problem(&self, of_scale: bool) -> Option<(&'static str, String)> {
        let kind = if of_scale { Kind::Scale } else { Kind::Tracer };
        if !(self.silent_after_s > 0.0 && self.silent_after_s <= LONGEST_SILENCE_S) {
            return Some(("silent_after_s", "must be a number of seconds above 0, at most a day".to_owned()));
        }
        if let Some(problem) = self.from.problem() {
            return Some(("from", problem));
        }
        Table::separator(self).err().or_else(|| match self.columns.as_slice() {
            [] => None,
            columns => Table::new(self, columns, kind, true).err().map(|problem| ("columns", problem)),
        })
    }
}

/// Readings from lines.
pub(super) struct Lines {
    config: LinesConfig,
    kind: Kind,
    machine: MachineFile,
    port: Port,
    shutdown: Shutdown,
    /// Known from the launch file, or from the first line of a connection.
    table: Option<Table>,
    sequence: u64,
    heard: Instant,
    /// The silence was told.
    is_silent: bool,
}

/// Opens lines of this kind; `shutdown` ends the wait for one.
pub(super) fn open(
    config: &LinesConfig,
    of_scale: bool,
    machine: &MachineFile,
    shutdown: &Shutdown,
) -> Result<Lines, DriverError> {
    let config_error = |(key, problem): (&'static str, String)| DriverError::Lines { key, problem };
    config.problem(of_scale).map_or(Ok(()), |problem| Err(config_error(problem)))?;
    let kind = if of_scale { Kind::Scale } else { Kind::Tracer };
    let table = match config.columns.as_slice() {
        [] => None,
        columns => {
            let table = Table::new(config, columns, kind, is_offset_known(config, machine));
            Some(table.map_err(|problem| config_error(("columns", problem)))?)
        }
    };
    let silent_after = Duration::from_secs_f64(config.silent_after_s);
    let port = Port::open(&config.from, silent_after).map_err(|source| DriverError::Port { source })?;
    Ok(Lines {
        config: config.clone(),
        kind,
        machine: machine.clone(),
        port,
        shutdown: shutdown.clone(),
        table,
        sequence: 0,
        heard: Instant::now(),
        is_silent: false,
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
                    tracing::info!("connected with {whom}");
                    if self.config.columns.is_empty() {
                        self.table = None;
                    }
                }
                Some(Event::Lost(why)) => tracing::warn!("{}: {why}; trying again", self.config.from),
                Some(Event::TooLong) => return Err(self.of_line("it is longer than 4096 bytes".to_owned())),
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
    fn read(&mut self, line: &port::Line) -> Result<Option<Row>, DriverError> {
        let text = std::str::from_utf8(&line.text).map_err(|_| self.of_line("it is no UTF-8 text".to_owned()))?.trim();
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
        of: impl FnOnce(&Row, &LinesConfig, &MachineFile) -> Result<T, String>,
    ) -> Result<Option<T>, DriverError> {
        let Some(row) = self.next_row()? else { return Ok(None) };
        let reading = of(&row, &self.config, &self.machine).map_err(|problem| self.of_line(problem))?;
        self.sequence += 1;
        Ok(Some(reading))
    }

    fn of_line(&self, problem: String) -> DriverError {
        DriverError::Line { line: self.port.lines(), from: self.config.from.to_string(), problem }
    }

    fn note_silence(&mut self) {
        if !self.is_silent && self.heard.elapsed().as_secs_f64() > self.config.silent_after_s {
            self.is_silent = true;
            tracing::warn!("{}: silent for more than {} s", self.config.from, self.config.silent_after_s);
        }
    }

    fn note_voice(&mut self) {
        if std::mem::take(&mut self.is_silent) {
            tracing::info!("{}: lines come again, after {:.1} s", self.config.from, self.heard.elapsed().as_secs_f64());
        }
        self.heard = Instant::now();
    }
}

impl ScaleDriver for Lines {
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError> {
        self.reading(Row::scale)
    }
}

impl TracerDriver for Lines {
    fn next_reading(&mut self) -> Result<Option<TracerReading>, DriverError> {
        self.reading(Row::tracer)
    }
}
