//! The envelope of the files that Abbe trusts: JSON content under a format, a version and the hash of its bytes.
//!
//! Place in the flow: under [`crate::model_file`] and [`crate::residual_file`].
//! `{"format":"abbe-model","version":1,"sha256":"…","model":{…}}`, where the hash is of the bytes of the last value. What
//! is cut off, changed in one bit, of an unknown version or of another kind is refused.

use crate::error::{FileError, Place};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use sha2::{Digest, Sha256};

/// A kind of file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FileKind {
    /// Word in the file.
    pub(crate) format: &'static str,
    /// Version of the content.
    pub(crate) version: u64,
    /// What it is called in messages, such as `model`.
    pub(crate) name: &'static str,
    /// Command that writes it.
    pub(crate) maker: &'static str,
    /// How it is made again, such as `identify the model again`.
    pub(crate) again: &'static str,
}

/// A trusted content: exactly one of these stands in a file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Envelope<'a> {
    format: &'a str,
    version: u64,
    sha256: &'a str,
    #[serde(borrow, default, skip_serializing_if = "Option::is_none")]
    model: Option<&'a RawValue>,
    #[serde(borrow, default, skip_serializing_if = "Option::is_none")]
    residual: Option<&'a RawValue>,
}

/// What is read first, so that a later version is recognised as such.
#[derive(Deserialize)]
struct Head {
    format: String,
    version: u64,
}

/// Bytes of the file and hash of the content.
pub(crate) fn seal(kind: &FileKind, content: &impl Serialize, file: &str) -> Result<(Vec<u8>, [u8; 32]), FileError> {
    let unwritable = |error: serde_json::Error| {
        FileError::content(Place::file(file), format!("the {} cannot be written: {error}", kind.name), "report this")
    };
    let content = serde_json::to_string_pretty(content).map_err(unwritable)?;
    let digest: [u8; 32] = Sha256::digest(content.as_bytes()).into();
    let content = RawValue::from_string(content).map_err(unwritable)?;
    let (model, residual) = match kind.name {
        "model" => (Some(&*content), None),
        _ => (None, Some(&*content)),
    };
    let envelope = Envelope { format: kind.format, version: kind.version, sha256: &hex(&digest), model, residual };
    // No line end after the last brace: every byte counts, so that a file cut by one byte is recognised.
    Ok((serde_json::to_vec(&envelope).map_err(unwritable)?, digest))
}

/// Content of a file of this kind and its hash; `file` is its name in messages.
pub(crate) fn open<T: for<'de> Deserialize<'de>>(
    kind: &FileKind,
    bytes: &[u8],
    file: &str,
) -> Result<(T, [u8; 32]), FileError> {
    let head: Head = serde_json::from_slice(bytes).map_err(|error| unreadable(kind, file, bytes, &error))?;
    let refuse = |key: &str, problem: String, remedy: String| {
        Err(FileError::content(Place::file(file).key(key), problem, remedy))
    };
    if head.format != kind.format {
        let problem = format!("{:?} is not a {}, which says {:?} here", head.format, kind.name, kind.format);
        return refuse("format", problem, format!("give a file that {} has written", kind.maker));
    }
    if head.version != kind.version {
        let problem = format!("version {} is not known; this software reads version {}", head.version, kind.version);
        return refuse("version", problem, format!("use the software that wrote the {}, or {}", kind.name, kind.again));
    }
    let envelope: Envelope<'_> =
        serde_json::from_slice(bytes).map_err(|error| unreadable(kind, file, bytes, &error))?;
    let content = match kind.name {
        "model" => envelope.model,
        _ => envelope.residual,
    };
    let Some(content) = content else {
        let problem = format!("the file says {:?} but holds no such content", kind.format);
        return refuse("format", problem, format!("give a file that {} has written", kind.maker));
    };
    let digest: [u8; 32] = Sha256::digest(content.get().as_bytes()).into();
    if envelope.sha256 != hex(&digest) {
        let problem = "the content does not match its hash: it was changed after it was written".to_owned();
        return refuse("sha256", problem, format!("copy the file again, or {}", kind.again));
    }
    let content = serde_json::from_str(content.get()).map_err(|error| unreadable(kind, file, bytes, &error))?;
    Ok((content, digest))
}

/// SHA-256 of these bytes, in hexadecimal digits.
pub fn sha256_hex(bytes: &[u8]) -> String {
    let digest: [u8; 32] = Sha256::digest(bytes).into();
    hex(&digest)
}

/// Lower-case hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The hash that 64 lower-case hexadecimal digits stand for.
pub fn sha256_of_hex(text: &str) -> Option<[u8; 32]> {
    let digits = text.as_bytes();
    if digits.len() != 64 || digits.iter().any(|b| !matches!(b, b'0'..=b'9' | b'a'..=b'f')) {
        return None;
    }
    let mut bytes = [0; 32];
    for (k, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(text.get(2 * k..2 * k + 2)?, 16).ok()?;
    }
    Some(bytes)
}

fn unreadable(kind: &FileKind, file: &str, bytes: &[u8], error: &serde_json::Error) -> FileError {
    let place = Place::file(file).line(error.line() as u64);
    // A file cut within a number is no end of file to the parser, but no whole file ends without its brace.
    let cut_off = error.is_eof() || (bytes.starts_with(b"{") && !bytes.ends_with(b"}"));
    let (problem, remedy) = if cut_off {
        (format!("the {} file is cut off", kind.name), format!("copy it again, or {}", kind.again))
    } else {
        (format!("this is no {} file: {error}", kind.name), format!("give a file that {} has written", kind.maker))
    };
    FileError::content(place, problem, remedy)
}
