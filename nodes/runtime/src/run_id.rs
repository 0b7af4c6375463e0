//! The name of one run of the graph.
//!
//! Place in the flow: chosen by the launcher, handed to every node it starts. All shared-memory
//! files of a run carry it, so that several runs live side by side and what a killed run leaves
//! behind can be removed without touching another.

use std::fmt;
use std::str::FromStr;
use std::time::{SystemTime, UNIX_EPOCH};

use thiserror::Error;

/// Longest name, so that the paths made from it stay below the limit of a Unix socket (108 bytes).
const MAX_BYTES: usize = 32;

/// A name of 1 to 32 lower-case letters, digits and hyphens.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RunId(String);

/// A name that cannot be that of a run.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "'{name}' cannot name a run; use 1 to {MAX_BYTES} lower-case letters, digits and hyphens, such \
     as 'line-2'"
)]
pub struct RunIdError {
    /// The name as given.
    pub name: String,
}

impl RunId {
    /// A name that no other run on this host has: process id and time of day.
    #[must_use]
    pub fn unique() -> Self {
        let nanos = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
        // 40 bits of nanoseconds tell apart all runs of one process id.
        Self(format!("{:x}-{:x}", std::process::id(), nanos & 0xff_ffff_ffff))
    }

    /// The process that chose the name by [`RunId::unique`]; none for a name of another form.
    #[must_use]
    pub fn chosen_by(&self) -> Option<u32> {
        let (process, nanos) = self.0.split_once('-')?;
        u64::from_str_radix(nanos, 16).ok()?;
        u32::from_str_radix(process, 16).ok()
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for RunId {
    type Err = RunIdError;

    fn from_str(name: &str) -> Result<Self, RunIdError> {
        let known = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
        if name.is_empty() || name.len() > MAX_BYTES || !name.bytes().all(known) {
            return Err(RunIdError { name: name.into() });
        }
        Ok(Self(name.into()))
    }
}

impl fmt::Display for RunId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_could_leave_their_folder_are_refused() {
        for name in ["", "..", "a/b", "a_b", "A", "a b", "ä", &"x".repeat(33)] {
            assert!(name.parse::<RunId>().is_err(), "{name:?} was accepted");
        }
        assert_eq!("line-2".parse::<RunId>().unwrap().as_str(), "line-2");
    }

    #[test]
    fn a_unique_name_is_a_valid_name() {
        let run = RunId::unique();
        assert_eq!(run.as_str().parse::<RunId>().unwrap(), run);
        assert_eq!(run.chosen_by(), Some(std::process::id()));
        for name in ["line-2", "line", "12", "12-34-56", "-12", "12-"] {
            assert_eq!(name.parse::<RunId>().unwrap().chosen_by(), None, "{name}");
        }
    }
}
