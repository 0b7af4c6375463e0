//! The next command: the one that follows from an answer, said right after it, on the terminal and in the report.
//!
//! Place in the flow: every command that ends with a result makes one. The terminal shows paths as they were given, ready to be
//! run. So does a report, but of folders of this machine, which mean nothing where it is read, it leaves out which: a bare name
//! would be taken for another file of that name. What the program cannot know stands in capitals.

use abbe_report::NextStep;
use std::path::{Path, PathBuf};

/// Points whose actual position is known, that no fit has seen.
pub const KNOWN_POINTS: &str = "--points KNOWN.csv";
/// Readings of the user's own.
pub const READINGS: &str = "--in READINGS.csv --out corrected.csv";

/// A command, and what it is for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Next {
    what_for: String,
    words: Vec<Word>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Word {
    Text(String),
    File(PathBuf),
}

impl Next {
    /// A subcommand, with options that need no quoting.
    pub fn new(what_for: &str, command: &str) -> Self {
        Self { what_for: what_for.to_owned(), words: Vec::new() }.text("abbe").text(command)
    }

    /// Adds words as they are.
    #[must_use]
    pub fn text(mut self, words: &str) -> Self {
        self.words.push(Word::Text(words.to_owned()));
        self
    }

    /// Adds an option with a file or a folder.
    #[must_use]
    pub fn file(mut self, option: &str, path: &Path) -> Self {
        self.words.extend([Word::Text(option.to_owned()), Word::File(path.to_owned())]);
        self
    }

    /// Adds a file or a folder.
    #[must_use]
    pub fn path(mut self, path: &Path) -> Self {
        self.words.push(Word::File(path.to_owned()));
        self
    }

    fn command(&self, shown: impl Fn(&Path) -> String) -> String {
        let word = |word: &Word| match word {
            Word::Text(text) => text.clone(),
            Word::File(path) => quoted(&shown(path)),
        };
        self.words.iter().map(word).collect::<Vec<_>>().join(" ")
    }

    /// For a report: paths as they were given, of whole ones the end.
    pub fn step(&self) -> NextStep {
        let shown = |path: &Path| match path.is_absolute() {
            false => path.display().to_string(),
            true => {
                let name = path.file_name().map_or(path.as_os_str(), |name| name);
                Path::new("\u{2026}").join(name).display().to_string()
            }
        };
        NextStep { what_for: self.what_for.clone(), command: self.command(shown) }
    }

    /// For the terminal: ready to be run where this command was.
    pub fn words(&self) -> String {
        format!("next, {}:\n  {}\n", self.what_for, self.command(|path| path.display().to_string()))
    }

    /// Says it on standard output.
    pub fn print(&self) {
        print!("{}", self.words());
    }
}

/// A word as a shell takes it for one.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+,:=@%\u{2026}".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_report_names_the_file_that_the_terminal_names_and_no_folder_of_this_machine() {
        let next = Next::new("to see", "verify").file("--model", Path::new("a b/it's.json")).text(KNOWN_POINTS);
        assert_eq!(next.words(), "next, to see:\n  abbe verify --model 'a b/it'\\''s.json' --points KNOWN.csv\n");
        assert_eq!(next.step().command, "abbe verify --model 'a b/it'\\''s.json' --points KNOWN.csv");
        let whole = Next::new("to see", "verify").file("--model", Path::new("/srv/of/somebody/model.json"));
        assert_eq!(whole.step().command, "abbe verify --model \u{2026}/model.json");
        assert_eq!(
            Next::new("", "launch").path(Path::new("x/ü-1.toml")).words(),
            "next, :\n  abbe launch x/ü-1.toml\n"
        );
    }
}
