//! Shape of an effect: what it is not linear in, or what it is about (axis, period, sensor), by key.
//!
//! Place in the flow: part of every fitted effect in a model file; diagnosis proposes and refines it. SI.

use crate::axis::Axis;
use std::collections::BTreeMap;
use thiserror::Error;

/// One entry of a shape.
#[derive(Debug, Clone, PartialEq)]
pub enum ShapeValue {
    /// A figure, SI.
    Number(f64),
    /// A name, such as an axis or a covariate.
    Text(String),
    /// Figures, SI.
    Numbers(Vec<f64>),
    /// Names.
    Texts(Vec<String>),
}

/// Named entries that an effect is not linear in.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Shape(pub BTreeMap<String, ShapeValue>);

/// An effect that a measurement shall tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Wish {
    /// Name in the registry of effects.
    pub name: String,
    /// Entries of the shape that it must have, such as the axis.
    pub shape: Shape,
}

/// An unknown effect or a shape that does not fit it.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EffectError {
    /// No effect of that name.
    #[error("unknown effect {name:?}; known are {known}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// All names.
        known: String,
    },
    /// The shape holds a key the effect does not have, or lacks one.
    #[error("effect {effect}: shape key {key:?} {problem}")]
    Shape {
        /// Effect.
        effect: &'static str,
        /// Key.
        key: String,
        /// What is wrong.
        problem: &'static str,
    },
}

impl Shape {
    /// A shape without entries.
    pub fn new() -> Shape {
        Shape::default()
    }

    /// All its figures (SI).
    pub fn figures(&self) -> impl Iterator<Item = f64> {
        self.0.values().flat_map(|value| match value {
            ShapeValue::Number(value) => vec![*value],
            ShapeValue::Numbers(values) => values.clone(),
            ShapeValue::Text(_) | ShapeValue::Texts(_) => Vec::new(),
        })
    }

    /// The same shape with a figure (SI) more.
    pub fn number(mut self, key: &str, value: f64) -> Shape {
        self.0.insert(key.to_owned(), ShapeValue::Number(value));
        self
    }

    /// The same shape with a name more.
    pub fn text(mut self, key: &str, value: impl Into<String>) -> Shape {
        self.0.insert(key.to_owned(), ShapeValue::Text(value.into()));
        self
    }

    /// The same shape with names more.
    pub fn texts(mut self, key: &str, values: &[String]) -> Shape {
        self.0.insert(key.to_owned(), ShapeValue::Texts(values.to_vec()));
        self
    }

    /// The same shape with figures (SI) more.
    pub fn numbers(mut self, key: &str, values: &[f64]) -> Shape {
        self.0.insert(key.to_owned(), ShapeValue::Numbers(values.to_vec()));
        self
    }
}

/// Reads the entries of one effect's shape; what it was not asked for is refused by [`Reader::finish`].
pub(super) struct Reader<'a> {
    effect: &'static str,
    shape: &'a Shape,
    read: Vec<&'static str>,
}

impl<'a> Reader<'a> {
    pub(super) fn new(effect: &'static str, shape: &'a Shape) -> Reader<'a> {
        Reader { effect, shape, read: Vec::new() }
    }

    pub(super) fn wrong(&self, key: &str, problem: &'static str) -> EffectError {
        EffectError::Shape { effect: self.effect, key: key.to_owned(), problem }
    }

    fn get(&mut self, key: &'static str) -> Result<&'a ShapeValue, EffectError> {
        self.read.push(key);
        self.shape.0.get(key).ok_or_else(|| self.wrong(key, "is missing; add it"))
    }

    /// A finite figure.
    pub(super) fn number(&mut self, key: &'static str) -> Result<f64, EffectError> {
        match self.get(key)? {
            ShapeValue::Number(value) if value.is_finite() => Ok(*value),
            _ => Err(self.wrong(key, "must be a finite number")),
        }
    }

    /// A figure above zero.
    pub(super) fn positive(&mut self, key: &'static str) -> Result<f64, EffectError> {
        match self.number(key)? {
            value if value > 0.0 => Ok(value),
            _ => Err(self.wrong(key, "must be above zero")),
        }
    }

    /// A whole number from 1 to `most`.
    pub(super) fn count(&mut self, key: &'static str, most: usize) -> Result<usize, EffectError> {
        let value = self.positive(key)?;
        if value.fract() == 0.0 && value <= most as f64 {
            return Ok(value as usize);
        }
        Err(self.wrong(key, "must be a whole number within the effect's limit"))
    }

    /// A name.
    pub(super) fn text(&mut self, key: &'static str) -> Result<&'a str, EffectError> {
        match self.get(key)? {
            ShapeValue::Text(value) if !value.is_empty() => Ok(value),
            _ => Err(self.wrong(key, "must be a name")),
        }
    }

    /// Two sensors whose difference acts: the one on the warm side and another one on the cold side.
    pub(super) fn warm_and_cold(&mut self) -> Result<(String, String), EffectError> {
        let (warm, cold) = (self.text("warm")?.to_owned(), self.text("cold")?.to_owned());
        match warm == cold {
            true => Err(self.wrong("cold", "must name another sensor than warm")),
            false => Ok((warm, cold)),
        }
    }

    /// Whether the form of what bends is one beam (`beam`), or left open (`free`).
    pub(super) fn is_beam(&mut self) -> Result<bool, EffectError> {
        match self.text("form")? {
            "beam" => Ok(true),
            "free" => Ok(false),
            _ => Err(self.wrong("form", "must be beam or free")),
        }
    }

    /// Names, at least one, none twice.
    pub(super) fn texts(&mut self, key: &'static str) -> Result<&'a [String], EffectError> {
        let values = match self.get(key)? {
            ShapeValue::Texts(values) if !values.is_empty() => values,
            _ => return Err(self.wrong(key, "must be a list of names")),
        };
        match (1..values.len()).any(|k| values[..k].contains(&values[k])) {
            true => Err(self.wrong(key, "names something twice; name it once")),
            false => Ok(values),
        }
    }

    /// Finite figures, at least one.
    pub(super) fn numbers(&mut self, key: &'static str) -> Result<&'a [f64], EffectError> {
        match self.get(key)? {
            ShapeValue::Numbers(values) if !values.is_empty() && values.iter().all(|v| v.is_finite()) => Ok(values),
            _ => Err(self.wrong(key, "must be a list of finite numbers")),
        }
    }

    /// An axis, `x`, `y` or `z`.
    pub(super) fn axis(&mut self, key: &'static str) -> Result<Axis, EffectError> {
        let text = self.text(key)?;
        Axis::from_lower(text).ok_or_else(|| self.wrong(key, "must be x, y or z"))
    }

    /// Refuses entries that nobody asked for.
    pub(super) fn finish(self) -> Result<(), EffectError> {
        match self.shape.0.keys().find(|key| !self.read.contains(&key.as_str())) {
            Some(key) => Err(self.wrong(key, "is not known to this effect; remove it")),
            None => Ok(()),
        }
    }
}
