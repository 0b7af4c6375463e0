//! Documents as a user follows them: files that they say to save, commands as printed, and what they say these print.
//!
//! Place in the flow: Markdown in, a folder with everything that its commands make out. For those tests that need it; the
//! others do not know it.

use std::fs;
use std::path::Path;
use std::process::Command;

#[allow(dead_code)] // Its other rules are held elsewhere.
#[path = "../../src/documents.rs"]
#[allow(unreachable_pub)] // Public where it is a library of its own.
pub(crate) mod documents;

use crate::common::program::{abbe, program};

/// A document of the repository.
pub(crate) fn read(path: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    fs::read_to_string(root.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The commands of all blocks that are to be run.
pub(crate) fn commands_of(text: &str) -> Vec<String> {
    documents::blocks(text, "console").iter().flat_map(|block| documents::commands(block)).collect()
}

/// "Save this as `NAME`" stands before each block that is a file; its language is the ending of the name.
pub(crate) fn save_files(text: &str, folder: &Path) {
    for (k, part) in text.split("Save this as `").skip(1).enumerate() {
        let name = part.split('`').next().unwrap();
        let language = name.rsplit('.').next().unwrap();
        let file = documents::blocks(part, language).into_iter().next();
        let file = file.unwrap_or_else(|| panic!("no block for file {k}, {name}"));
        fs::write(folder.join(name), file).unwrap();
    }
}

/// Runs commands one after the other as a user's shell would, with the program on the path. What all of them printed.
pub(crate) fn run_in(folder: &Path, commands: &[String]) -> String {
    let path = format!("{}:{}", program().parent().unwrap().display(), std::env::var("PATH").unwrap());
    let mut said = String::new();
    for command in commands {
        // As the other tests start it: on loopback only, whatever the environment says.
        let prepared = abbe::<&str>([]);
        let mut shell = Command::new("sh");
        shell.args(["-c", command]).current_dir(folder).env("PATH", &path);
        for (name, value) in prepared.get_envs() {
            match value {
                Some(value) => shell.env(name, value),
                None => shell.env_remove(name),
            };
        }
        let output = shell.output().unwrap();
        assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
        said.push_str(&String::from_utf8_lossy(&output.stdout));
    }
    said
}

/// Asserts that what a document shows as output was printed, line by line; `...` stands for what it leaves out.
pub(crate) fn assert_printed(text: &str, said: &str) {
    let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
    let said: Vec<String> = said.lines().map(words).collect();
    let shown = documents::blocks(text, "text");
    let shown: Vec<String> = shown.iter().flat_map(|block| block.lines()).map(words).collect();
    let missing: Vec<&String> = shown.iter().filter(|line| *line != "..." && !said.contains(line)).collect();
    assert!(shown.len() > 5, "only {} lines are shown", shown.len());
    assert!(missing.is_empty(), "shown, and not printed:\n{missing:#?}\nprinted:\n{}", said.join("\n"));
}
