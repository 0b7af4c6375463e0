//! What the columns of a line are: readings with their unit, names, covariates.
//!
//! Place in the flow: below [`super::Lines`]. Pure: a line and the instant of its arrival in, a reading out. Lengths in the
//! unit that the column's name ends with, metres inside. A cell without a number is refused where the reading needs it, and a
//! missing covariate elsewhere.

use super::super::{SensorValues, config_name};
use super::{LinesConfig, Role};
use crate::connecting::stamp_of;
use crate::units::Unit;
use abbe_files::MachineFile;
use abbe_msgs::{Covariates, ScaleReading, Stamp, TracerReading};
use std::time::SystemTime;

/// Units of a length by the end of a column's name, and metres in one.
const LENGTHS: [(&str, f64); 4] = [("_mm", 1e3), ("_um", 1e6), ("_m", 1.0), ("_inch", 1e3 / 25.4)];

/// What a column holds.
#[derive(Debug, Clone, PartialEq)]
enum Column {
    LeftOut,
    /// A length of this name, and how many of its unit are a metre.
    Length(Length, f64),
    Stamp,
    Station,
    Line,
    Covariate(Unit),
}

/// Lengths that readings have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Length {
    Reading(usize),
    Offset(usize),
    Range,
    RangeUncertainty,
}

const READINGS: [&str; 3] = ["x", "y", "z"];
const OFFSETS: [&str; 3] = ["offset_x", "offset_y", "offset_z"];
/// Bytes of a name at most.
const LONGEST_NAME: usize = 31;

/// Columns of a table.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    columns: Vec<Column>,
    separator: Option<char>,
    has_decimal_commas: bool,
}

/// One line as values; what is not there is `None`.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Row {
    stamp: Stamp,
    sequence: u64,
    reading_m: [Option<f64>; 3],
    offset_m: [Option<f64>; 3],
    length_m: Option<f64>,
    u_length_m: Option<f64>,
    station: Option<String>,
    line: Option<String>,
    covariates: Vec<(String, Option<f64>)>,
    /// The first covariate whose cell is neither empty nor a number, and what it holds: a box that writes ERR has no value.
    pub(super) unread: Option<String>,
}

fn column(name: &str) -> Result<Column, String> {
    let length = |stem: &str| {
        let place = |names: &[&str; 3]| names.iter().position(|known| *known == stem);
        let reading = place(&READINGS).map(Length::Reading);
        reading.or_else(|| place(&OFFSETS).map(Length::Offset)).or(match stem {
            "length" => Some(Length::Range),
            "u_length" => Some(Length::RangeUncertainty),
            _ => None,
        })
    };
    let with_unit = |(unit, in_a_metre): &(&str, f64)| Some((length(name.strip_suffix(unit)?)?, *in_a_metre));
    Ok(match (name, LENGTHS.iter().find_map(with_unit)) {
        (_, Some((length, in_a_metre))) => Column::Length(length, in_a_metre),
        ("-", _) => Column::LeftOut,
        ("stamp_s", _) => Column::Stamp,
        ("station", _) => Column::Station,
        ("line", _) => Column::Line,
        _ => Column::Covariate(Unit::of(name)?),
    })
}

impl Table {
    /// The separator, `None` for blanks; or the key that is wrong.
    pub(super) fn separator(config: &LinesConfig) -> Result<Option<char>, (&'static str, String)> {
        let mut signs = config.separator.chars();
        let separator = match (config.separator.as_str(), signs.next(), signs.next()) {
            ("blank", ..) => None,
            (_, Some(sign), None) if !sign.is_alphanumeric() && !matches!(sign, '.' | '-' | '+' | '"') => Some(sign),
            _ => return Err(("separator", "must be one sign that is no part of a number, or blank".to_owned())),
        };
        match config.decimal.as_str() {
            "." => Ok(separator),
            "," if separator != Some(',') => Ok(separator),
            "," => Err(("decimal", "is a comma, and so is the separator; name another separator".to_owned())),
            _ => Err(("decimal", "must be a point or a comma".to_owned())),
        }
    }

    /// Covariates among columns of these names, in the units that effects read.
    pub(super) fn covariates(names: &[String]) -> Vec<String> {
        let of = |name: &String| match column(name) {
            Ok(Column::Covariate(unit)) => Some(unit.name),
            _ => None,
        };
        names.iter().filter_map(of).collect()
    }

    /// The cells of a line.
    pub(super) fn split<'a>(config: &LinesConfig, text: &'a str) -> Box<dyn Iterator<Item = &'a str> + 'a> {
        match Table::separator(config) {
            Ok(Some(sign)) => Box::new(text.split(sign).map(str::trim)),
            _ => Box::new(text.split_whitespace()),
        }
    }

    /// Checks that these columns make a reading of this kind, or says what is wrong with them. `is_offset_known` where no
    /// column has to tell it.
    pub(super) fn new(
        config: &LinesConfig,
        names: &[String],
        kind: Role,
        is_offset_known: bool,
    ) -> Result<Table, String> {
        let separator = Table::separator(config).map_err(|(key, problem)| format!("{key} {problem}"))?;
        let mut columns: Vec<Column> = Vec::new();
        for name in names {
            if let Some(stem) =
                READINGS.iter().chain(&OFFSETS).chain(&["length", "u_length"]).find(|stem| *stem == name)
            {
                return Err(format!("{name} has no unit; name it {stem}_mm, {stem}_m, {stem}_um or {stem}_inch"));
            }
            let column = column(name).map_err(|problem| format!("{problem}, or write - to leave the column out"))?;
            if name.len() > LONGEST_NAME || matches!(&column, Column::Covariate(unit) if unit.name.len() > LONGEST_NAME)
            {
                return Err(format!("{name:?} is too long; a name has at most {LONGEST_NAME} bytes"));
            }
            let same = |other: &Column| match (other, &column) {
                (Column::LeftOut, _) => false,
                (Column::Length(a, _), Column::Length(b, _)) => a == b,
                (Column::Covariate(a), Column::Covariate(b)) => a.name == b.name,
                (a, b) => a == b,
            };
            if columns.iter().any(same) {
                return Err(format!("{name} stands twice"));
            }
            columns.push(column);
        }
        let has = |wanted: Length| {
            columns.iter().any(|column| matches!(column, Column::Length(length, _) if *length == wanted))
        };
        let all = |of: fn(usize) -> Length| (0..3).filter(|k| has(of(*k))).count();
        let is_covariate = |column: &Column| matches!(column, Column::Covariate(_));
        let may_sense = |column: &Column| matches!(column, Column::Covariate(_) | Column::LeftOut | Column::Stamp);
        match kind {
            Role::Sensor if !columns.iter().any(is_covariate) => {
                Err("a sensor needs a column of a value with its unit, such as temp_air_c".to_owned())
            }
            Role::Sensor if !columns.iter().all(may_sense) => {
                Err("a sensor gives covariates and stamp_s only; write - to leave another column out".to_owned())
            }
            Role::Scale if all(Length::Reading) < 3 => {
                Err("a scale reading needs x, y and z with their unit, such as x_mm".to_owned())
            }
            Role::Scale if matches!(all(Length::Offset), 1 | 2) => {
                Err("give offset_x, offset_y and offset_z, or none of them".to_owned())
            }
            Role::Scale if !is_offset_known && all(Length::Offset) == 0 => {
                Err("the machine declares no default_offset_mm; add the key offset_mm, or columns offset_x_mm to offset_z_mm".to_owned())
            }
            Role::Tracer if !has(Length::Range) => {
                Err("a tracer reading needs a length with its unit, such as length_mm".to_owned())
            }
            Role::Tracer if config.station.is_none() && !columns.contains(&Column::Station) => {
                Err("a tracer reading needs a station: a column, or the key station".to_owned())
            }
            Role::Tracer if config.u_length_um.is_none() && !has(Length::RangeUncertainty) => {
                Err("a tracer reading needs its uncertainty: a column u_length_um, or the key u_length_um".to_owned())
            }
            _ => Ok(Table { columns, separator, has_decimal_commas: config.decimal == "," }),
        }
    }

    /// The values of a line that arrived at this instant.
    pub(super) fn row(&self, text: &str, arrived: SystemTime, sequence: u64) -> Result<Row, String> {
        let cells: Vec<&str> = match self.separator {
            Some(sign) => text.split(sign).map(str::trim).collect(),
            None => text.split_whitespace().collect(),
        };
        if cells.len() != self.columns.len() {
            return Err(format!("it has {} columns, and {} are named", cells.len(), self.columns.len()));
        }
        let mut row = Row { sequence, ..Row::default() };
        let mut stamped = None;
        for (cell, column) in cells.into_iter().zip(&self.columns) {
            match column {
                Column::LeftOut => {}
                Column::Station => row.station = Some(cell.to_owned()),
                Column::Line => row.line = Some(cell.to_owned()),
                Column::Stamp => stamped = self.number(cell)?,
                Column::Covariate(unit) => {
                    let value = self.number(cell).unwrap_or_else(|problem| {
                        row.unread.get_or_insert(format!("{}: {problem}, so the value is missing", unit.name));
                        None
                    });
                    row.covariates.push((unit.name.clone(), value.map(|value| unit.convert(value))));
                }
                Column::Length(length, in_a_metre) => {
                    let value_m = self.number(cell)?.map(|value| value / in_a_metre);
                    match length {
                        Length::Reading(k) => row.reading_m[*k] = value_m,
                        Length::Offset(k) => row.offset_m[*k] = value_m,
                        Length::Range => row.length_m = value_m,
                        Length::RangeUncertainty => row.u_length_m = value_m,
                    }
                }
            }
        }
        row.stamp = match (stamped, self.columns.contains(&Column::Stamp)) {
            (Some(0.0), _) => return Err("stamp_s is 0: a clock that was never set".to_owned()),
            (Some(seconds), _) => Stamp::from_seconds(seconds).map_err(|error| format!("stamp_s: {error}"))?,
            (None, true) => return Err("stamp_s holds no number".to_owned()),
            (None, false) => stamp_of(arrived)?,
        };
        Ok(row)
    }

    /// The number in a cell; `None` where it is empty.
    fn number(&self, cell: &str) -> Result<Option<f64>, String> {
        if cell.is_empty() {
            return Ok(None);
        }
        // A point between thousands beside decimal commas is no number here.
        let has_other_mark = self.has_decimal_commas && cell.contains('.');
        let number = match self.has_decimal_commas {
            true => cell.replace(',', ".").parse::<f64>(),
            false => cell.parse::<f64>(),
        };
        match number {
            Ok(value) if value.is_finite() && !has_other_mark => Ok(Some(value)),
            _ => Err(format!("{cell:?} is no finite number")),
        }
    }
}

impl Row {
    /// As a scale reading.
    pub(super) fn scale(&self, config: &LinesConfig, machine: &MachineFile) -> Result<ScaleReading, String> {
        let stated_m = config.offset_mm.map(|offset_mm| offset_mm.map(|mm| mm / 1e3));
        let offset_m = match (self.offset_m, stated_m.or(machine.machine.default_offset_m)) {
            ([Some(x), Some(y), Some(z)], _) => [x, y, z],
            ([None, None, None], Some(offset_m)) => offset_m,
            _ => return Err("a component of the offset is empty".to_owned()),
        };
        let [Some(x), Some(y), Some(z)] = self.reading_m else {
            return Err("x, y or z is empty".to_owned());
        };
        let mut covariates = Covariates::new();
        for (name, value) in self.covariates.iter().filter_map(|(name, value)| Some((name, (*value)?))) {
            covariates.push(name, value, 0.0).map_err(|error| error.to_string())?;
        }
        Ok(ScaleReading {
            stamp: self.stamp,
            sequence: self.sequence,
            reading_m: [x, y, z],
            offset_m,
            covariates,
            frame_id: config_name("frame_id", &machine.machine.frame_id)?,
        })
    }

    /// As what a sensor says; an empty cell says that it has no value.
    pub(super) fn values(self) -> SensorValues {
        let mut said = SensorValues { stamp: self.stamp, values: Vec::new(), missing: Vec::new() };
        for (name, value) in self.covariates {
            match value {
                Some(value) => said.values.push((name, value)),
                None => said.missing.push(name),
            }
        }
        said
    }

    /// As a tracer reading.
    pub(super) fn tracer(&self, config: &LinesConfig, machine: &MachineFile) -> Result<TracerReading, String> {
        let length_m = self.length_m.ok_or("the length is empty")?;
        let u_length_m = self.u_length_m.or(config.u_length_um.map(|um| um / 1e6)).ok_or("the uncertainty is empty")?;
        let station = self.station.as_deref().or(config.station.as_deref()).unwrap_or_default();
        if station.is_empty() {
            return Err("the station is empty".to_owned());
        }
        Ok(TracerReading {
            stamp: self.stamp,
            sequence: self.sequence,
            length_m,
            u_length_m,
            frame_id: config_name("frame_id", &machine.machine.frame_id)?,
            station: config_name("station", station)?,
            line: config_name("line", self.line.as_deref().unwrap_or_default())?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::time::UNIX_EPOCH;

    fn config(separator: &str, decimal: &str) -> LinesConfig {
        let text = format!("from = {{ tcp = \"a:1\" }}\nseparator = {separator:?}\ndecimal = {decimal:?}\n");
        toml::from_str(&text).unwrap()
    }

    proptest! {
        /// Whatever comes over the wire is a row or a refusal.
        #[test]
        fn no_line_and_no_name_ends_the_program(
            names in prop::collection::vec("[a-z_-]{0,12}|x_mm|y_mm|z_mm|stamp_s|station|temp_k", 0..8),
            line in "\\PC{0,60}|[-0-9.,; e+]{0,60}",
            separator in "[,;|#]|blank",
            decimal in "[.,]",
            kind in prop::sample::select(vec![Role::Scale, Role::Tracer, Role::Sensor]),
        ) {
            let config = config(&separator, &decimal);
            if let Ok(table) = Table::new(&config, &names, kind, true)
                && let Ok(row) = table.row(&line, UNIX_EPOCH, 0)
            {
                prop_assert!(row.reading_m.iter().flatten().all(|value| value.is_finite()));
            }
        }
    }
}
