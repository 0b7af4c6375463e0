//! What a user is told to do, followed: files that documents say to save, commands as printed and what they say these print, and the
//! next command at the end of an answer.
//!
//! Place in the flow: Markdown or an answer in, a folder with everything that its commands make out. For those tests that need it;
//! the others do not know it.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Next commands that take minutes, or a machine: their options are looked at, and no more.
const LONG: [&str; 5] = ["capture", "compare", "demo", "papers", "train"];

#[allow(dead_code)] // Its other rules are held elsewhere.
#[path = "../../src/documents.rs"]
#[allow(unreachable_pub)] // Public where it is a library of its own.
pub(crate) mod documents;

use crate::common::program::{abbe, program, run};

/// A document of the repository.
pub(crate) fn read(path: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    fs::read_to_string(root.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Names of the commands, in the order in which the program's help lists them.
pub(crate) fn listed() -> Vec<String> {
    let all = run(["--help"]).ok();
    let lines = all.lines().filter_map(|line| line.strip_prefix("  ")?.split_once("  "));
    let is_command = |name: &&str| name.starts_with(|c: char| c.is_ascii_lowercase()) && *name != "help";
    let names: Vec<String> = lines.map(|(name, _)| name.trim()).filter(is_command).map(str::to_owned).collect();
    assert!(names.len() > 20, "the help lists commands: {names:?}");
    names
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

/// Runs commands one after the other as a user's shell would, with the program on the path. What all of them said.
pub(crate) fn run_in(folder: &Path, commands: &[String]) -> String {
    let mut said = String::new();
    for command in commands {
        let output = shell(folder, command);
        assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
        said.push_str(&String::from_utf8_lossy(&output.stdout));
        said.push_str(&String::from_utf8_lossy(&output.stderr));
    }
    said
}

/// The same of blocks that show what is refused: every command of the program ends with 1, the others make its input.
pub(crate) fn refused_in(folder: &Path, text: &str) -> String {
    let mut said = String::new();
    for command in documents::blocks(text, "console,refused").iter().flat_map(|block| documents::commands(block)) {
        let output = shell(folder, &command);
        let code = if command.starts_with("abbe ") { 1 } else { 0 };
        assert_eq!(output.status.code(), Some(code), "{command}: {}", String::from_utf8_lossy(&output.stderr));
        said.push_str(&String::from_utf8_lossy(&output.stderr));
    }
    assert!(!said.is_empty(), "nothing is shown as refused");
    said
}

fn shell(folder: &Path, command: &str) -> Output {
    let path = format!("{}:{}", program().parent().unwrap().display(), std::env::var("PATH").unwrap());
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
    shell.output().unwrap()
}

/// Asserts that what a document shows as output was printed, line by line; `...` stands for what it leaves out, between lines or
/// of one.
pub(crate) fn assert_printed(text: &str, said: &str) {
    let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
    let said: Vec<String> = said.lines().map(words).collect();
    let shown = documents::blocks(text, "text");
    let shown: Vec<String> = shown.iter().flat_map(|block| block.lines()).map(words).collect();
    let missing: Vec<&String> = shown.iter().filter(|line| !said.iter().any(|said| is_shown(line, said))).collect();
    assert!(shown.len() > 1, "only {} lines are shown", shown.len());
    assert!(missing.is_empty(), "shown, and not printed:\n{missing:#?}\nprinted:\n{}", said.join("\n"));
}

/// Whether a line of a document is this one, but for what it leaves out.
fn is_shown(line: &str, said: &str) -> bool {
    let Some((beginning, rest)) = line.split_once("...") else { return line == said };
    let Some(said) = said.strip_prefix(beginning.trim_end()) else { return false };
    let mut left = said;
    let are_there = rest.split("...").all(|part| match left.split_once(part.trim()) {
        Some((_, after)) => {
            left = after;
            true
        }
        None => false,
    });
    are_there && (left.is_empty() || line.ends_with("..."))
}

/// The command that an answer ends with; it is this one, and the program takes it. What it writes stays in the folder.
#[track_caller]
pub(crate) fn follows(folder: &Path, said: &str, command: &str) -> String {
    let said = format!("\n{said}");
    let (_, next) = said.rsplit_once("\nnext, ").unwrap_or_else(|| panic!("no next command: {said}"));
    let (what_for, line) = next.split_once(":\n  ").unwrap();
    assert!(what_for.starts_with("to ") && line.ends_with('\n') && line.trim().lines().count() == 1, "{next}");
    let words: Vec<&str> = line.trim().split(' ').collect();
    assert_eq!(words[..2], ["abbe", command]);
    let more: &[&str] = if LONG.contains(&command) { &["--help"] } else { &[] };
    // Options that the command has not, or lacks, end it with 2.
    let ended = abbe(words[1..].iter().chain(more)).current_dir(folder).output().unwrap();
    assert_ne!(ended.status.code(), Some(2), "{line}: {}", String::from_utf8_lossy(&ended.stderr));
    line.trim().to_owned()
}
