//! What the documents say of the program, held against the program: every command and option that they name is in its
//! help, the book's list of commands is what it prints, and the README's tour runs as printed.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod common;
#[allow(dead_code)] // Its other rules are held elsewhere.
#[path = "../src/documents.rs"]
mod documents;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::program::{abbe, run};

/// Set, the list of commands is written anew instead of compared.
const WRITE: &str = "ABBE_WRITE_DOCS";
const COMMANDS: &str = "docs/src/reference/commands.md";
/// Understood by every command, and told by none: they are ROS 2's.
const UNTOLD: &str = "--ros-args";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Help of the program itself (""), and of each of its commands, in the order in which it lists them.
fn helps() -> Vec<(String, String)> {
    let all = run(["--help"]).ok();
    let listed = all.lines().filter_map(|line| line.strip_prefix("  ")?.split_once("  "));
    let is_command = |name: &str| !name.is_empty() && name.chars().all(|c| c.is_ascii_lowercase() || c == '-');
    let names: Vec<String> = listed
        .map(|(name, _)| name.trim().to_owned())
        .filter(|name| is_command(name) && !name.starts_with('-') && name != "help")
        .collect();
    assert!(names.len() > 20, "the help lists commands: {names:?}");
    let of = |name: String| {
        let help = run([name.as_str(), "--help"]).ok();
        (name, help)
    };
    std::iter::once((String::new(), all.clone())).chain(names.into_iter().map(of)).collect()
}

/// Markdown files of the book, and those beside it that show commands.
fn pages() -> Vec<PathBuf> {
    let mut open = vec![root().join("docs/src")];
    let mut found: Vec<PathBuf> =
        ["README.md", "CONTRIBUTING.md", "launch-config/README.md"].map(|p| root().join(p)).into();
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                found.push(path);
            }
        }
    }
    found
}

#[test]
fn every_command_and_option_that_documents_name_is_in_the_help() {
    let helps: BTreeMap<String, String> = helps().into_iter().collect();
    let (mut stale, mut seen) = (Vec::new(), 0);
    for page in pages() {
        for call in documents::calls(&fs::read_to_string(&page).unwrap(), "console", "abbe") {
            seen += 1;
            let (name, options) = documents::subcommand_and_options(&call);
            let name = name.unwrap_or_default();
            let Some(help) = helps.get(name) else {
                stale.push(format!("{}: no command {name:?}: {call}", page.display()));
                continue;
            };
            let words: Vec<&str> = help.split([' ', '\n', ',', '[', ']', '=', '`']).collect();
            for option in options.into_iter().filter(|option| *option != UNTOLD && !words.contains(option)) {
                stale.push(format!("{}: abbe {name} has no {option}: {call}", page.display()));
            }
        }
    }
    assert!(seen > 100, "only {seen} calls were looked at");
    assert!(stale.is_empty(), "documents name what the program does not have:\n  {}", stale.join("\n  "));
}

#[test]
fn the_list_of_commands_is_what_the_program_prints() {
    let mut page = format!(
        "# Commands\n\nWhat `abbe --help` and `abbe COMMAND --help` print. Made by the program: `{WRITE}=1 cargo test -p abbe --test \
         documents` writes it anew. A short form is [Every command in a line](../guide/commands.md).\n"
    );
    for (name, help) in helps() {
        let title = format!("abbe {name}");
        let lines: Vec<&str> = help.lines().map(str::trim_end).collect();
        write!(page, "\n## {}\n\n```text\n{}\n```\n", title.trim(), lines.join("\n").trim_end()).unwrap();
    }
    if std::env::var_os(WRITE).is_some() {
        fs::write(root().join(COMMANDS), &page).unwrap();
    }
    assert!(
        page == read(COMMANDS),
        "{COMMANDS} is not what the program prints; {WRITE}=1 in front of this test writes it anew"
    );
}

/// The commands below a heading of the README, in a folder with nothing in it and the program on the path.
#[test]
fn the_tour_of_the_readme_runs_as_printed() {
    let readme = read("README.md");
    let tour = readme.split("\n## ").find(|part| part.starts_with("The tour")).expect("the README has a tour");
    let commands: Vec<String> =
        documents::blocks(tour, "console").iter().flat_map(|block| documents::commands(block)).collect();
    assert_eq!(commands.len(), 5, "{commands:?}");
    let folder = tempfile::tempdir().unwrap();
    let program = PathBuf::from(env!("CARGO_BIN_EXE_abbe"));
    let path = format!("{}:{}", program.parent().unwrap().display(), std::env::var("PATH").unwrap());
    for command in &commands {
        // As the other tests start it: on loopback only, whatever the environment says.
        let prepared = abbe::<&str>([]);
        let mut shell = Command::new("sh");
        shell.args(["-c", command]).current_dir(folder.path()).env("PATH", &path);
        for (name, value) in prepared.get_envs() {
            match value {
                Some(value) => shell.env(name, value),
                None => shell.env_remove(name),
            };
        }
        let output = shell.output().unwrap();
        assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
    }
    for file in ["out/demo/report.html", "model.json", "corrected.csv", "diagnosis/report.html", "diagnosis/model.json"]
    {
        assert!(folder.path().join(file).is_file(), "the tour leaves no {file}");
    }
}
