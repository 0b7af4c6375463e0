//! The one error of every file reader and writer: which file, where in it, what is wrong, what to do.
//!
//! Place in the flow: `abbe` prints it as it is; nothing is to be added to it but the name of the command.

use std::fmt;
use thiserror::Error;

/// Where in a file something is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Place {
    /// Name of the file as the user gave it.
    pub file: String,
    /// Line, counted from 1.
    pub line: Option<u64>,
    /// What in that line, such as `column x_mm` or `key stroke_mm`.
    pub item: Option<String>,
}

impl Place {
    /// The file as a whole.
    pub fn file(file: &str) -> Place {
        Place { file: file.to_owned(), ..Place::default() }
    }

    /// The same place on that line.
    pub fn line(self, line: u64) -> Place {
        Place { line: Some(line), ..self }
    }

    /// The same place at that column.
    pub fn column(self, name: &str) -> Place {
        Place { item: Some(format!("column {name}")), ..self }
    }

    /// The same place at that key.
    pub fn key(self, name: &str) -> Place {
        Place { item: Some(format!("key {name}")), ..self }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.file)?;
        if let Some(line) = self.line {
            write!(f, ", line {line}")?;
        }
        self.item.as_ref().map_or(Ok(()), |item| write!(f, ", {item}"))
    }
}

/// Why a file could not be read or written.
#[derive(Debug, Error)]
pub enum FileError {
    /// The operating system refused.
    #[error("{file}: cannot {action}: {source}")]
    Io {
        /// Name of the file as the user gave it.
        file: String,
        /// What was tried.
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The content is wrong.
    #[error("{place}: {problem}; {remedy}")]
    Content {
        /// Where.
        place: Place,
        /// What is wrong.
        problem: String,
        /// What to do.
        remedy: String,
    },
}

impl FileError {
    /// Wrong content at a place.
    pub fn content(place: Place, problem: impl Into<String>, remedy: impl Into<String>) -> FileError {
        FileError::Content { place, problem: problem.into(), remedy: remedy.into() }
    }

    /// Where the content is wrong, if it is the content.
    pub fn place(&self) -> Option<&Place> {
        match self {
            FileError::Io { .. } => None,
            FileError::Content { place, .. } => Some(place),
        }
    }

    /// Turns what the system said into an error about that file.
    pub(crate) fn io(file: &str, action: &'static str) -> impl FnOnce(std::io::Error) -> FileError {
        let file = file.to_owned();
        move |source| FileError::Io { file, action, source }
    }
}
