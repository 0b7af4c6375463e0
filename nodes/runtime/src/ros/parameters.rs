//! Parameters declared once, in one table: name, default, unit, range, meaning.
//!
//! Place in the flow: a node writes its table as a constant list of [`ParameterSpec`]; the values
//! of `--params-file` and `-p` are checked against it at the start, those that come by service
//! later ([`super::parameter_services`]). Nothing is clamped: what is out of range is refused.

use std::collections::BTreeMap;
use std::fmt;

use ros2_client::ParameterValue;
use thiserror::Error;

use super::names::NodeIdentity;
use super::yaml::{ParameterAssignment, YamlValue};

/// The parameter that every ROS 2 node has.
pub const USE_SIM_TIME: &str = "use_sim_time";

/// Which values are allowed.
#[derive(Debug, Clone, PartialEq)]
pub enum Range {
    /// Every value of the type (of numbers, every finite one).
    Any,
    /// Whole numbers from the first to the second, both included.
    Integer(i64, i64),
    /// Numbers from the first to the second, both included.
    Double(f64, f64),
    /// One of these texts.
    OneOf(&'static [&'static str]),
    /// A text that is not empty.
    NotEmpty,
}

/// One parameter of a node.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterSpec {
    /// Name, unit as suffix.
    pub name: &'static str,
    /// Value when nothing else is given; its type is the type of the parameter.
    pub default: ParameterValue,
    /// Unit of the value; empty when it has none.
    pub unit: &'static str,
    /// Which values are allowed.
    pub range: Range,
    /// Whether the value is fixed once the node runs.
    pub read_only: bool,
    /// What it does, in one sentence.
    pub description: &'static str,
}

/// The parameters of a node with their values at the start.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ParameterTable {
    entries: BTreeMap<&'static str, Entry>,
}

#[derive(Debug, Clone, PartialEq)]
struct Entry {
    spec: ParameterSpec,
    value: ParameterValue,
}

/// A value that a parameter cannot have.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ParameterError {
    /// No such parameter.
    #[error("{origin}: no parameter '{name}'; this node has: {known}")]
    Unknown {
        /// Where it was set.
        origin: String,
        /// The name.
        name: String,
        /// All names there are.
        known: String,
    },
    /// Another type.
    #[error("{origin}: parameter '{name}' is {expected}, not {found}")]
    Type {
        /// Where it was set.
        origin: String,
        /// The name.
        name: String,
        /// The type it has.
        expected: &'static str,
        /// The type that was given.
        found: &'static str,
    },
    /// Outside its range.
    #[error("{origin}: parameter '{name}' = {value} is not {allowed}")]
    Range {
        /// Where it was set.
        origin: String,
        /// The name.
        name: String,
        /// The value.
        value: String,
        /// What is allowed.
        allowed: String,
    },
    /// Declared twice.
    #[error("parameter '{name}' is declared twice")]
    Duplicate {
        /// The name.
        name: &'static str,
    },
    /// Fixed after the start.
    #[error("parameter '{name}' is fixed while the node runs; set it at the start")]
    ReadOnly {
        /// The name.
        name: String,
    },
}

impl ParameterTable {
    /// The table of these parameters, each at its default.
    ///
    /// # Errors
    /// When a name is declared twice or a default is out of its own range.
    pub fn new(specs: impl IntoIterator<Item = ParameterSpec>) -> Result<Self, ParameterError> {
        let mut entries = BTreeMap::new();
        for spec in [use_sim_time()].into_iter().chain(specs) {
            let name = spec.name;
            let value = spec.default.clone();
            check(&spec, &value, "the declaration")?;
            if entries.insert(name, Entry { spec, value }).is_some() {
                return Err(ParameterError::Duplicate { name });
            }
        }
        Ok(Self { entries })
    }

    /// The table with the values that are meant for `node` set.
    ///
    /// A value for one node must name a parameter it has. A value for every node (`/**` or another pattern, `-p` without a
    /// node, as launch gives all nodes what `SetParameter` says) may be another node's: see [`ParameterTable::strangers`].
    ///
    /// # Errors
    /// When a parameter is unknown, or its value has another type or is out of range.
    pub fn with_assignments(
        mut self,
        node: &NodeIdentity,
        assignments: &[ParameterAssignment],
    ) -> Result<Self, ParameterError> {
        for assignment in assignments.iter().filter(|one| one.meant.fits(node)) {
            if !self.is_stranger(assignment) {
                self.assign(assignment)?;
            }
        }
        Ok(self)
    }

    /// Values for every node whose parameter this one does not have: if no other has it either, they change nothing, and
    /// whoever knows the others says so.
    pub fn strangers<'a>(
        &'a self,
        node: &'a NodeIdentity,
        assignments: &'a [ParameterAssignment],
    ) -> impl Iterator<Item = &'a ParameterAssignment> {
        assignments.iter().filter(|assignment| assignment.meant.fits(node) && self.is_stranger(assignment))
    }

    fn is_stranger(&self, assignment: &ParameterAssignment) -> bool {
        assignment.meant.is_for_many() && !self.entries.contains_key(assignment.name.as_str())
    }

    fn assign(&mut self, assignment: &ParameterAssignment) -> Result<(), ParameterError> {
        let known = self.known();
        let origin = assignment.origin.as_str();
        let entry = self.entries.get_mut(assignment.name.as_str());
        let entry = entry.ok_or_else(|| ParameterError::Unknown {
            origin: origin.to_owned(),
            name: assignment.name.clone(),
            known,
        })?;
        let value = typed(&assignment.value, &entry.spec.default);
        check(&entry.spec, &value, origin)?;
        entry.value = value;
        Ok(())
    }

    /// Checks a value that comes while the node runs.
    ///
    /// # Errors
    /// When the parameter is unknown or fixed, or the value has another type or is out of range.
    pub fn check_change(&self, name: &str, value: &ParameterValue) -> Result<(), ParameterError> {
        let origin = "set_parameters";
        let entry = self.entries.get(name).ok_or_else(|| ParameterError::Unknown {
            origin: origin.to_owned(),
            name: name.to_owned(),
            known: self.known(),
        })?;
        check(&entry.spec, value, origin)?;
        // The start itself sets every value once, and setting the same again changes nothing.
        if entry.spec.read_only && *value != entry.value {
            return Err(ParameterError::ReadOnly { name: name.into() });
        }
        Ok(())
    }

    /// The same table with every parameter fixed while the node runs.
    #[must_use]
    pub fn fixed(mut self) -> Self {
        self.entries.values_mut().for_each(|entry| entry.spec.read_only = true);
        self
    }

    /// A parameter that may change while the node runs; none where all are fixed.
    #[must_use]
    pub fn changeable(&self) -> Option<&'static str> {
        self.entries.values().find(|entry| !entry.spec.read_only).map(|entry| entry.spec.name)
    }

    /// The declaration of a parameter.
    #[must_use]
    pub fn spec(&self, name: &str) -> Option<&ParameterSpec> {
        self.entries.get(name).map(|entry| &entry.spec)
    }

    /// Names and values at the start, sorted by name.
    pub fn values(&self) -> impl Iterator<Item = (&'static str, &ParameterValue)> {
        self.entries.iter().map(|(name, entry)| (*name, &entry.value))
    }

    /// Whether the node goes by `/clock`.
    #[must_use]
    pub fn uses_sim_time(&self) -> bool {
        self.entries.get(USE_SIM_TIME).is_some_and(|entry| entry.value == ParameterValue::Boolean(true))
    }

    /// The same table for a node that goes by `/clock`, or does not.
    pub(crate) fn with_sim_time(mut self, uses_it: bool) -> Self {
        if let Some(entry) = self.entries.get_mut(USE_SIM_TIME) {
            entry.value = ParameterValue::Boolean(uses_it);
        }
        self
    }

    fn known(&self) -> String {
        let names: Vec<&str> = self.entries.keys().copied().collect();
        match names.is_empty() {
            true => "none".into(),
            false => names.join(", "),
        }
    }
}

fn use_sim_time() -> ParameterSpec {
    ParameterSpec {
        name: USE_SIM_TIME,
        default: ParameterValue::Boolean(false),
        unit: "",
        range: Range::Any,
        read_only: true,
        description: "Whether time is that of /clock.",
    }
}

/// The value in the type of the parameter where that loses nothing: YAML cannot tell `1000` meant
/// as a double from an integer.
fn typed(value: &YamlValue, like: &ParameterValue) -> ParameterValue {
    match (value, like) {
        (YamlValue::Integer(whole), ParameterValue::Double(_)) if whole.unsigned_abs() < 1 << 53 => {
            ParameterValue::Double(*whole as f64)
        }
        (YamlValue::Bool(value), _) => ParameterValue::Boolean(*value),
        (YamlValue::Integer(value), _) => ParameterValue::Integer(*value),
        (YamlValue::Double(value), _) => ParameterValue::Double(*value),
        (YamlValue::Text(value), _) => ParameterValue::String(value.clone()),
        (YamlValue::Bools(values), _) => ParameterValue::BooleanArray(values.clone()),
        (YamlValue::Integers(values), _) => ParameterValue::IntegerArray(values.clone()),
        (YamlValue::Doubles(values), _) => ParameterValue::DoubleArray(values.clone()),
        (YamlValue::Texts(values), _) => ParameterValue::StringArray(values.clone()),
    }
}

fn check(spec: &ParameterSpec, value: &ParameterValue, origin: &str) -> Result<(), ParameterError> {
    if std::mem::discriminant(value) != std::mem::discriminant(&spec.default) {
        return Err(ParameterError::Type {
            origin: origin.to_owned(),
            name: spec.name.to_owned(),
            expected: type_name(&spec.default),
            found: type_name(value),
        });
    }
    if is_allowed(&spec.range, value) {
        return Ok(());
    }
    Err(ParameterError::Range {
        origin: origin.to_owned(),
        name: spec.name.to_owned(),
        value: format!("{value:?}"),
        allowed: format!("{}{}{}", spec.range, if spec.unit.is_empty() { "" } else { " " }, spec.unit),
    })
}

fn is_allowed(range: &Range, value: &ParameterValue) -> bool {
    match (range, value) {
        (Range::Any, ParameterValue::Double(value)) => value.is_finite(),
        (Range::Any, ParameterValue::DoubleArray(values)) => values.iter().all(|one| one.is_finite()),
        (Range::Any, _) => true,
        (Range::Integer(from, to), ParameterValue::Integer(value)) => (from..=to).contains(&value),
        (Range::Double(from, to), ParameterValue::Double(value)) => (from..=to).contains(&value),
        (Range::OneOf(texts), ParameterValue::String(value)) => texts.contains(&value.as_str()),
        (Range::NotEmpty, ParameterValue::String(value)) => !value.is_empty(),
        // A range of another type than the default: nothing is allowed, so that declaring it fails.
        _ => false,
    }
}

fn type_name(value: &ParameterValue) -> &'static str {
    match value {
        ParameterValue::NotSet => "unset",
        ParameterValue::Boolean(_) => "a boolean",
        ParameterValue::Integer(_) => "an integer",
        ParameterValue::Double(_) => "a double",
        ParameterValue::String(_) => "a text",
        ParameterValue::ByteArray(_) => "a list of bytes",
        ParameterValue::BooleanArray(_) => "a list of booleans",
        ParameterValue::IntegerArray(_) => "a list of integers",
        ParameterValue::DoubleArray(_) => "a list of doubles",
        ParameterValue::StringArray(_) => "a list of texts",
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Any => f.write_str("finite"),
            Self::Integer(from, to) => write!(f, "within {from} to {to}"),
            Self::Double(from, to) => write!(f, "within {from} to {to}"),
            Self::NotEmpty => f.write_str("a text that is not empty"),
            Self::OneOf(texts) => write!(f, "one of {}", texts.join(", ")),
        }
    }
}

#[cfg(test)]
#[path = "parameters_tests.rs"]
mod tests;
