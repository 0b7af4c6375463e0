//! What a message is made of, as ROS 2 tells it to programs that do not know the type, and the hash that names it.
//!
//! Place in the flow: `msg/` and `msg_standard/` -> the service `~/get_type_description` of every node, and the key
//! expressions of Zenoh. Description and hash come of the same [`TypeDescription`], so that they cannot drift apart.
//!
//! Source: REP 2011 (RIHS01: SHA-256 of the description as JSON without defaults, items separated by `, ` and `: `),
//! REP 2016 (the service), `type_description_interfaces` of ROS 2 Jazzy.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use serde::{Deserialize, Serialize};

use crate::Sha256;
use crate::definition::{self, Count};

/// What stands before the digits of a hash: the version of the scheme.
const PREFIX: &str = "RIHS01_";
/// A message inside another.
const NESTED: u8 = 1;
/// From the number of a type to that of its array.
const ARRAY: u8 = 48;
/// From the number of a type to that of its sequence without a bound.
const SEQUENCE: u8 = 144;

/// The kind of a field: `type_description_interfaces/FieldType`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FieldType {
    /// Number of the type, of its array or of its sequence.
    pub type_id: u8,
    /// Values of an array; 0 for anything else.
    pub capacity: u64,
    /// Longest text of a bounded string; no message here has one.
    pub string_capacity: u64,
    /// Full name of a message; empty for anything else.
    pub nested_type_name: String,
}

/// A field: `type_description_interfaces/Field`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Field {
    /// Its name.
    pub name: String,
    /// What it holds.
    pub kind: FieldType,
    /// What it holds if nothing is said; no message here says it.
    pub default_value: String,
}

/// One message without those inside it: `type_description_interfaces/IndividualTypeDescription`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IndividualTypeDescription {
    /// Full name, such as `abbe_msgs/msg/ScaleReading`.
    pub type_name: String,
    /// Its fields in the order of the `.msg` file.
    pub fields: Vec<Field>,
}

/// A message with all that are inside it: `type_description_interfaces/TypeDescription`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TypeDescription {
    /// The message.
    pub type_description: IndividualTypeDescription,
    /// Those inside it, and inside these, sorted by name.
    pub referenced_type_descriptions: Vec<IndividualTypeDescription>,
}

/// The text that a message was made from: `type_description_interfaces/TypeSource`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TypeSource {
    /// Full name.
    pub type_name: String,
    /// `msg`, the kind of the file.
    pub encoding: String,
    /// The `.msg` file.
    pub raw_file_contents: String,
}

impl TypeDescription {
    /// The description of a message; `None` when it is not one of this crate's.
    #[must_use]
    pub fn of(ros_type: &str) -> Option<Self> {
        let type_description = individual(ros_type)?;
        let mut referenced = BTreeMap::new();
        let mut open = nested_in(&type_description);
        while let Some(name) = open.pop() {
            let Entry::Vacant(place) = referenced.entry(name) else { continue };
            let description = individual(place.key())?;
            open.extend(nested_in(&description));
            place.insert(description);
        }
        Some(Self { type_description, referenced_type_descriptions: referenced.into_values().collect() })
    }

    /// The hash that names the type, `RIHS01_` and 64 digits.
    #[must_use]
    pub fn hash(&self) -> String {
        let referenced: Vec<String> = self.referenced_type_descriptions.iter().map(json_of_one).collect();
        let json = format!(
            r#"{{"type_description": {}, "referenced_type_descriptions": [{}]}}"#,
            json_of_one(&self.type_description),
            referenced.join(", ")
        );
        format!("{PREFIX}{}", Sha256::of(json.as_bytes()).to_hex())
    }

    /// The `.msg` files of the message and of those inside it.
    #[must_use]
    pub fn sources(&self) -> Vec<TypeSource> {
        let all = [&self.type_description].into_iter().chain(&self.referenced_type_descriptions);
        let source = |one: &IndividualTypeDescription| {
            let raw_file_contents = definition::text(&one.type_name)?.to_owned();
            Some(TypeSource { type_name: one.type_name.clone(), encoding: "msg".to_owned(), raw_file_contents })
        };
        all.filter_map(source).collect()
    }
}

/// The hash of a message by its full name; `None` when it is not one of this crate's.
#[must_use]
pub fn hash(ros_type: &str) -> Option<String> {
    TypeDescription::of(ros_type).map(|description| description.hash())
}

fn individual(ros_type: &str) -> Option<IndividualTypeDescription> {
    let fields = definition::fields(ros_type)?.into_iter().map(field).collect::<Option<_>>()?;
    Some(IndividualTypeDescription { type_name: ros_type.to_owned(), fields })
}

fn field(declared: definition::Field) -> Option<Field> {
    let is_nested = declared.kind.contains('/');
    let one = if is_nested { NESTED } else { primitive(&declared.kind)? };
    let (type_id, capacity) = match declared.count {
        Count::One => (one, 0),
        Count::Fixed(values) => (one + ARRAY, u64::try_from(values).ok()?),
        Count::Sequence => (one + SEQUENCE, 0),
    };
    let nested_type_name = if is_nested { declared.kind } else { String::new() };
    let kind = FieldType { type_id, capacity, string_capacity: 0, nested_type_name };
    Some(Field { name: declared.name, kind, default_value: String::new() })
}

/// Number of a primitive type, as `FieldType.msg` has it.
fn primitive(kind: &str) -> Option<u8> {
    Some(match kind {
        "int8" => 2,
        "uint8" | "char" => 3,
        "int16" => 4,
        "uint16" => 5,
        "int32" => 6,
        "uint32" => 7,
        "int64" => 8,
        "uint64" => 9,
        "float32" => 10,
        "float64" => 11,
        "bool" => 15,
        "byte" => 16,
        "string" => 17,
        "wstring" => 18,
        _ => return None,
    })
}

fn nested_in(description: &IndividualTypeDescription) -> Vec<String> {
    let names = description.fields.iter().map(|field| field.kind.nested_type_name.clone());
    names.filter(|name| !name.is_empty()).collect()
}

/// Names are letters, digits, `_` and `/`, so that nothing has to be escaped.
fn json_of_one(description: &IndividualTypeDescription) -> String {
    let fields: Vec<String> = description.fields.iter().map(json_of_field).collect();
    format!(r#"{{"type_name": "{}", "fields": [{}]}}"#, description.type_name, fields.join(", "))
}

fn json_of_field(field: &Field) -> String {
    let FieldType { type_id, capacity, string_capacity, nested_type_name } = &field.kind;
    format!(
        r#"{{"name": "{}", "type": {{"type_id": {type_id}, "capacity": {capacity}, "string_capacity": {string_capacity}, "nested_type_name": "{nested_type_name}"}}}}"#,
        field.name
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_ros_2_jazzy_hashes_of_standard_messages_are_those_that_it_ships() {
        // `share/PACKAGE/msg/NAME.json` of ROS 2 Jazzy: one without others inside, one with, one with bytes and lists.
        for (name, digits) in [
            ("builtin_interfaces/msg/Time", "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197"),
            ("std_msgs/msg/Header", "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"),
            ("diagnostic_msgs/msg/DiagnosticArray", "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"),
        ] {
            assert_eq!(hash(name).unwrap(), format!("RIHS01_{digits}"), "{name}");
        }
        assert_eq!(hash("abbe_msgs/msg/Nothing"), None);
    }

    #[test]
    fn every_message_is_described_with_all_that_is_inside_it_and_named_by_a_hash_of_its_own() {
        let mut hashes = BTreeMap::new();
        for (name, text) in definition::DEFINITIONS {
            let description = TypeDescription::of(name).unwrap_or_else(|| panic!("{name} is not described"));
            let names: Vec<_> = description.referenced_type_descriptions.iter().map(|one| &one.type_name).collect();
            assert!(names.is_sorted() && !names.contains(&&(*name).to_owned()), "{name}: {names:?}");
            let sources = description.sources();
            assert_eq!((sources.len(), sources[0].raw_file_contents.as_str()), (1 + names.len(), *text));
            assert_eq!(hashes.insert(description.hash(), name), None, "{name}");
        }
    }

    #[test]
    fn lists_arrays_and_messages_have_their_numbers() {
        let description = TypeDescription::of("abbe_msgs/msg/ScaleReading").unwrap().type_description;
        let kind = |name: &str| {
            let field = description.fields.iter().find(|field| field.name == name).unwrap();
            (field.kind.type_id, field.kind.capacity, field.kind.nested_type_name.as_str())
        };
        assert_eq!(kind("header"), (1, 0, "std_msgs/msg/Header"));
        assert_eq!(kind("sequence"), (9, 0, ""));
        assert_eq!(kind("reading_m"), (59, 3, ""));
        assert_eq!(kind("covariate_names"), (161, 0, ""));
        assert_eq!(kind("covariate_values"), (155, 0, ""));
    }
}
