//! What the documents say of the program, held against the program: every command and option that they name is in its
//! help, the book's list of commands is what it prints, and the README's tour and the tutorials run as printed.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::printed::{assert_printed, commands_of, documents, listed, read, refused_in, run_in, save_files};
use crate::common::program::run;

/// Set, the list of commands is written anew instead of compared.
const WRITE: &str = "ABBE_WRITE_DOCS";
const COMMANDS: &str = "docs/src/reference/commands.md";
/// Understood by every command, and told by none: they are ROS 2's.
const UNTOLD: &str = "--ros-args";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Help of the program itself (""), and of each of its commands, in the order in which it lists them.
fn helps() -> Vec<(String, String)> {
    let all = run(["--help"]).ok();
    let of = |name: String| {
        let help = run([name.as_str(), "--help"]).ok();
        (name, help)
    };
    std::iter::once((String::new(), all)).chain(listed().into_iter().map(of)).collect()
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
        // What is not run is in the help all the same.
        let text = fs::read_to_string(&page).unwrap();
        let text = text.replace("```console,no-run", "```console").replace("```console,refused", "```console");
        for call in documents::calls(&text, "console", "abbe") {
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
        "# Commands\n\nWhat `abbe --help` and `abbe COMMAND --help` print. Made by the program: `{WRITE}=1 cargo test -p abbe --test system \
         documents::` writes it anew. A short form is [Every command in a line](../guide/commands.md).\n"
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

#[test]
fn manual_pages_and_completions_hold_every_command_and_option() {
    let folder = tempfile::tempdir().unwrap();
    let pages = folder.path().join("man");
    run(["man", "--out", pages.to_str().unwrap()]).ok();
    let completions = ["bash", "zsh", "fish"].map(|shell| run(["completions", shell]).ok());
    for (name, help) in helps() {
        let page = if name.is_empty() { "abbe.1".to_owned() } else { format!("abbe-{name}.1") };
        let page = fs::read_to_string(pages.join(&page)).unwrap_or_else(|error| panic!("{page}: {error}"));
        // Hyphens are escaped there.
        let page = page.replace("\\-", "-");
        let options = help.split([' ', '\n', ',']).filter(|word| word.starts_with("--") && word.len() > 2);
        for option in options.filter(|option| !matches!(*option, "--ros-args" | "--log-level")) {
            let option = option.trim_end_matches(['.', ':', ';', ')', '`']);
            assert!(page.contains(option), "the page of {name:?} lacks {option}");
            assert!(completions[0].contains(option), "bash does not complete {option} of {name:?}");
        }
        assert!(completions.iter().all(|words| words.contains(&name)), "{name}");
        let example = format!("abbe {name}");
        assert!(page.contains(&example), "the page of {name:?} has no example");
    }
    assert!(run(["--version"]).ok().contains("commit"));
}

/// The tutorial of the missing effect has the same commands and goes on in the same folder: what ran is not run again.
#[test]
fn the_tour_of_the_readme_and_the_tutorial_of_the_missing_effect_run_as_printed() {
    let readme = read("README.md");
    let tour = readme.split("\n## ").find(|part| part.starts_with("The tour")).expect("the README has a tour");
    let commands = commands_of(tour);
    assert_eq!(commands.len(), 5, "{commands:?}");
    let folder = tempfile::tempdir().unwrap();
    let said = run_in(folder.path(), &commands);
    for file in ["out/demo/report.html", "model.json", "corrected.csv", "diagnosis/report.html", "diagnosis/model.json"]
    {
        assert!(folder.path().join(file).is_file(), "the tour leaves no {file}");
    }
    let tutorial = read("docs/src/tutorials/what-is-missing.md");
    let rest: Vec<String> = commands_of(&tutorial).into_iter().filter(|command| !commands.contains(command)).collect();
    assert!(rest.len() >= 3, "{rest:?}");
    assert_printed(&tutorial, &(said + &run_in(folder.path(), &rest)));
}

/// Each in the folder of the one before, as they say. That of the missing effect runs with the tour, that of the residual
/// model with the program that trains.
#[test]
fn the_tutorials_run_as_printed() {
    let folder = tempfile::tempdir().unwrap();
    for tutorial in ["your-machine", "ros2", "runs", "robot"] {
        let text = read(&format!("docs/src/tutorials/{tutorial}.md"));
        save_files(&text, folder.path());
        let mut said = run_in(folder.path(), &commands_of(&text));
        if tutorial == "your-machine" {
            said += &refused_in(folder.path(), &text);
        }
        if tutorial != "ros2" {
            assert_printed(&text, &said);
        }
    }
    for file in ["corrected.csv", "tables.csv", "map/report.html", "figures/report.html", "causes/report.html"] {
        assert!(folder.path().join(file).is_file(), "the tutorials leave no {file}");
    }
}
