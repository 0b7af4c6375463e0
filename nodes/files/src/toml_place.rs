//! Where in a TOML text a key stands, for error messages.
//!
//! Place in the flow: [`crate::machine`] reads the text into plain structures and asks here only once something
//! is wrong.

use crate::error::{FileError, Place};
use toml::de::{DeTable, DeValue};

/// How the parser begins to say that a value is none.
const NO_VALUE: [&str; 7] = [
    "invalid float",
    "invalid integer number",
    "invalid mantissa",
    "invalid fraction",
    "invalid exponent",
    "invalid boolean",
    "string values must be quoted",
];
const NO_VALUE_REMEDY: &str =
    "write a number with a decimal point and no unit, such as 0.25, or put the text in quotation marks";

/// Line (from 1) of a byte position.
pub(crate) fn line_at(text: &str, byte: usize) -> u64 {
    1 + text.bytes().take(byte).filter(|b| *b == b'\n').count() as u64
}

/// Line of the deepest part of `path` that exists; numbers in the path index arrays.
pub(crate) fn line_of(text: &str, path: &[&str]) -> Option<u64> {
    let table = DeTable::parse(text).ok()?;
    let mut byte = None;
    let mut here: Option<&DeValue<'_>> = None;
    for step in path {
        let found = match here {
            None => table.get_ref().get_key_value(*step),
            Some(DeValue::Table(inner)) => inner.get_key_value(*step),
            Some(DeValue::Array(items)) => {
                let Some(item) = step.parse().ok().and_then(|k: usize| items.get(k)) else { break };
                byte = Some(item.span().start);
                here = Some(item.get_ref());
                continue;
            }
            Some(_) => None,
        };
        let Some((key, value)) = found else { break };
        byte = Some(key.span().start);
        here = Some(value.get_ref());
    }
    byte.map(|byte| line_at(text, byte))
}

/// Key that the line of a byte position assigns, if it assigns one.
pub(crate) fn key_at(text: &str, byte: usize) -> Option<String> {
    let start = text.get(..byte)?.rfind('\n').map_or(0, |newline| newline + 1);
    let line = text.get(start..)?.lines().next()?;
    let (key, _) = line.split_once('=')?;
    let key = key.trim();
    (!key.is_empty() && !key.starts_with('#')).then(|| key.to_owned())
}

/// What the parser refuses, with its line and key, and what to do; `see` says where a whole file is to be seen.
pub(crate) fn syntax(text: &str, file: &str, error: &toml::de::Error, see: &str) -> FileError {
    let message = error.message().trim().replace('\n', ", ");
    let mut place = Place::file(file);
    // A key missing from the top level has no line.
    if let Some(span) = error.span().filter(|span| span.start > 0 || !message.contains("missing field")) {
        place.line = Some(line_at(text, span.start));
        place.item = key_at(text, span.start).map(|key| format!("key {key}"));
    }
    if let Some((problem, remedy)) = no_value(text, error) {
        return FileError::content(place, problem, format!("{remedy}; {see}"));
    }
    let remedy = if message.contains("unknown field") {
        "correct the spelling or remove the key"
    } else if message.contains("is neither that nor") {
        "correct the spelling, or add the key"
    } else if message.contains("missing field") {
        "add the key"
    } else {
        "correct this line"
    };
    FileError::content(place, message, format!("{remedy}; {see}"))
}

/// What begins like a number or a word and is no value of TOML, in words with the remedy: the parser names what the first letter made it
/// expect (`nan` for `none`), which helps nobody.
fn no_value(text: &str, error: &toml::de::Error) -> Option<(String, &'static str)> {
    let message = error.message();
    let begins = |start: &&&str| message.trim_start().starts_with(**start);
    NO_VALUE.iter().find(begins)?;
    let written = value_at(text, error.span()?.start)?;
    Some((format!("`{written}` is neither a number nor a text in quotation marks"), NO_VALUE_REMEDY))
}

/// What stands between the signs of TOML around a byte position.
fn value_at(text: &str, byte: usize) -> Option<&str> {
    let start = text.get(..byte)?.rfind(['=', ',', '[', '{', '\n']).map_or(0, |sign| sign + 1);
    let rest = text.get(start..)?;
    let written = rest.get(..rest.find([',', ']', '}', '#', '\n']).unwrap_or(rest.len()))?.trim();
    (!written.is_empty()).then_some(written)
}
