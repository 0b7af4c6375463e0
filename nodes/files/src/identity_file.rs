//! Reads who measured, from a machine file or a file with nothing else.
//!
//! Place in the flow: commands that write reports → here → [`Identity`].

use crate::error::{FileError, Place};
use crate::identity::Identity;
use crate::machine::{SEE_EXAMPLES, parse_machine};
use crate::toml_place::{line_of, syntax};
use serde::Deserialize;
use std::path::Path;

/// A file with nothing but `[identity]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    identity: Identity,
}

/// Reads the `[identity]` of a machine file or of a file with nothing else; with the name of the machine where the file has it.
///
/// # Errors
/// A file that cannot be read or is neither, a key that is not known, a day that is none; with line and key.
pub fn read_identity(path: &Path) -> Result<(Option<String>, Identity), FileError> {
    let file = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(FileError::io(&file, "read the file"))?;
    let text = text.trim_start_matches('\u{feff}');
    // Only a machine file has a chain.
    if line_of(text, &["chain"]).is_some() {
        let machine = parse_machine(text, &file)?;
        let name = machine.machine.name;
        let none = || {
            let remedy = "add one, or name a file that has it; the page on machine files lists its keys";
            FileError::content(Place::file(&file), "the machine file has no [identity]", remedy)
        };
        return Ok((Some(name), machine.identity.ok_or_else(none)?));
    }
    let document: Document = toml::from_str(text).map_err(|error| syntax(text, &file, &error, SEE_EXAMPLES))?;
    document.identity.check(text, &file)?;
    Ok((None, document.identity))
}
