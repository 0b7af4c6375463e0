//! The text form of an effect, `name key=value key=value`, taken apart and checked against the keys it may have.
//!
//! Place in the flow: [`super::from_text`] finds the entry of the name; a [`Values`] hands its builder one value a
//! key, in the unit that the key's suffix says. What is wrong is refused with the key and what would be right.

use std::collections::BTreeMap;

use crate::error::SimulationError;
use crate::machine::Axis;

/// One key of an effect's text form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Key {
    /// Its name, unit as suffix.
    pub(super) name: &'static str,
    /// Whether it may be left out, which then means that there is none of it: zero.
    pub(super) or_zero: bool,
}

/// A key that must be given.
pub(super) const fn given(name: &'static str) -> Key {
    Key { name, or_zero: false }
}

/// A key that means zero where it is left out.
pub(super) const fn or_zero(name: &'static str) -> Key {
    Key { name, or_zero: true }
}

/// The values of one effect's text.
#[derive(Debug)]
pub(super) struct Values<'a> {
    written: BTreeMap<&'a str, &'a str>,
}

impl<'a> Values<'a> {
    /// Takes `key=value` parts and refuses keys that are unknown, doubled or missing.
    pub(super) fn new(parts: impl Iterator<Item = &'a str>, keys: &[Key]) -> Result<Self, SimulationError> {
        let mut written = BTreeMap::new();
        for part in parts {
            let Some((key, value)) = part.split_once('=') else {
                return Err(SimulationError::new(part, "has no value", "write key=value without spaces around ="));
            };
            if !keys.iter().any(|known| known.name == key) {
                return Err(SimulationError::new(key, "no such key", format!("known are {}", names(keys))));
            }
            if written.insert(key, value).is_some() {
                return Err(SimulationError::new(key, "given twice", "give it once"));
            }
        }
        match keys.iter().find(|key| !key.or_zero && !written.contains_key(key.name)) {
            Some(missing) => {
                let remedy = format!("give {}=…; known are {}", missing.name, names(keys));
                Err(SimulationError::new(missing.name, "missing", remedy))
            }
            None => Ok(Self { written }),
        }
    }

    /// The text behind a key that must be given.
    pub(super) fn text(&self, key: &str) -> Result<&'a str, SimulationError> {
        self.written.get(key).copied().ok_or_else(|| SimulationError::new(key, "missing", "give it"))
    }

    /// Whether a key is there.
    pub(super) fn has(&self, key: &str) -> bool {
        self.written.contains_key(key)
    }

    /// A number in the unit of its key; zero where the key may be left out and is.
    pub(super) fn number(&self, key: &str) -> Result<f64, SimulationError> {
        let Some(text) = self.written.get(key) else { return Ok(0.0) };
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(SimulationError::new(key, format!("{text:?} is not a finite number"), "give a number like 2.5")),
        }
    }

    /// A whole number of 0 or more; zero where the key may be left out and is.
    pub(super) fn count<T: std::str::FromStr + Default>(&self, key: &str) -> Result<T, SimulationError> {
        let Some(text) = self.written.get(key) else { return Ok(T::default()) };
        text.parse().map_err(|_| {
            SimulationError::new(key, format!("{text:?} is not a whole number of 0 or more"), "give one like 7")
        })
    }

    /// An axis by its letter.
    pub(super) fn axis(&self, key: &str) -> Result<Axis, SimulationError> {
        match self.text(key)? {
            "x" | "X" => Ok(Axis::X),
            "y" | "Y" => Ok(Axis::Y),
            "z" | "Z" => Ok(Axis::Z),
            other => Err(SimulationError::new(key, format!("{other:?} is no axis"), "give x, y or z")),
        }
    }
}

fn names(keys: &[Key]) -> String {
    keys.iter().map(|key| key.name).collect::<Vec<_>>().join(", ")
}
