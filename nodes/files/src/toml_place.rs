//! Where in a TOML text a key stands, for error messages.
//!
//! Place in the flow: [`crate::machine`] reads the text into plain structures and asks here only once something
//! is wrong.

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

/// What begins like a number or a word and is no value of TOML, in words with the remedy: the parser names what the first letter made it
/// expect (`nan` for `none`), which helps nobody.
pub(crate) fn no_value(text: &str, error: &toml::de::Error) -> Option<(String, &'static str)> {
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
