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

/// In the folder of the README's tour, whose files they go on from.
const WITH_THE_TOUR: [&str; 3] = ["tutorials/what-is-missing.md", "guide/identify.md", "guide/live.md"];
/// Each in the folder of the one before, as they say; the last page of the guide goes on with what the runs left.
const TUTORIALS: [&str; 5] =
    ["tutorials/your-machine.md", "tutorials/ros2.md", "tutorials/runs.md", "guide/diagnose.md", "tutorials/robot.md"];
/// In one folder beside `launch-config`.
const GUIDE: [&str; 6] = ["acceptance.md", "calibrations.md", "simulate.md", "positions.md", "reports.md", "plan.md"];
/// With the program that trains (`tests/system/residual.rs`).
const TRAINING: &str = "tutorials/residual-model.md";

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

/// Runs the commands of a page, those left out that were done already. What the page shows as printed is.
fn run_page(folder: &Path, page: &str, done: &[String]) {
    let text = read(&format!("docs/src/{page}"));
    save_files(&text, folder);
    let commands = commands_of(&text).into_iter().filter(|command| !done.contains(command));
    let mut said = run_in(folder, &commands.collect::<Vec<String>>());
    if text.contains("```console,refused") {
        said += &refused_in(folder, &text);
    }
    if text.contains("```text") {
        assert_printed(&text, &said);
    }
}

/// What the guide names of `launch-config`, as `cp -r` brings it.
fn bring_launch_config(folder: &Path) {
    run_in(folder, &[format!("cp -r '{}' .", root().join("launch-config").display())]);
}

#[test]
fn every_block_of_commands_runs_or_says_why_not() {
    let guide = GUIDE.map(|page| format!("guide/{page}"));
    let listed = WITH_THE_TOUR.into_iter().chain(TUTORIALS).chain([TRAINING]).chain(guide.iter().map(String::as_str));
    let run: Vec<PathBuf> =
        listed.map(|page| root().join("docs/src").join(page)).chain([root().join("README.md")]).collect();
    let mut wrong: Vec<String> =
        run.iter().filter(|page| !page.is_file()).map(|page| format!("no {}", page.display())).collect();
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        let name = page.display();
        wrong.extend(documents::unexplained(&text).into_iter().map(|(line, what)| format!("{name}:{line}: {what}")));
        let has_commands = !commands_of(&text).is_empty();
        if has_commands != run.contains(&page) {
            wrong.push(format!(
                "{name}: has commands to run: {has_commands}; a test of this file runs them: {}",
                !has_commands
            ));
        }
    }
    assert!(wrong.is_empty(), "commands that nobody tries:\n  {}", wrong.join("\n  "));
}

/// The tutorial of the missing effect has the same commands and goes on in the same folder: what ran is not run again.
#[test]
fn the_tour_of_the_readme_and_the_tutorial_of_the_missing_effect_run_as_printed() {
    let readme = read("README.md");
    let tour = readme.split("\n## ").find(|part| part.starts_with("The tour")).expect("the README has a tour");
    let commands = commands_of(tour);
    assert_eq!(commands.len(), 5, "{commands:?}");
    assert_eq!(commands_of(&readme), commands, "the README has commands beside its tour");
    let folder = tempfile::tempdir().unwrap();
    let said = run_in(folder.path(), &commands);
    for file in ["out/demo/report.html", "model.json", "corrected.csv", "diagnosis/report.html", "diagnosis/model.json"]
    {
        assert!(folder.path().join(file).is_file(), "the tour leaves no {file}");
    }
    let tutorial = read(&format!("docs/src/{}", WITH_THE_TOUR[0]));
    let rest: Vec<String> = commands_of(&tutorial).into_iter().filter(|command| !commands.contains(command)).collect();
    assert!(rest.len() >= 3, "{rest:?}");
    assert_printed(&tutorial, &(said + &run_in(folder.path(), &rest)));
    bring_launch_config(folder.path());
    for page in WITH_THE_TOUR.into_iter().skip(1) {
        run_page(folder.path(), page, &commands);
    }
}

/// Planning and reports, positions and artefacts: they need `launch-config` and no more.
#[test]
fn the_guide_runs_as_printed() {
    let folder = tempfile::tempdir().unwrap();
    bring_launch_config(folder.path());
    for page in GUIDE {
        run_page(folder.path(), &format!("guide/{page}"), &[]);
    }
    for file in
        ["out/plan/plan.json", "out/volumetric/report.html", "test.pdf", "test.xml", "verify.pdf", "corrected.pdf"]
    {
        assert!(folder.path().join(file).is_file(), "the guide leaves no {file}");
    }
}

/// That of the missing effect runs with the tour, that of the residual model with the program that trains.
#[test]
fn the_tutorials_run_as_printed() {
    let folder = tempfile::tempdir().unwrap();
    bring_launch_config(folder.path());
    for tutorial in TUTORIALS {
        let text = read(&format!("docs/src/{tutorial}"));
        save_files(&text, folder.path());
        let mut said = run_in(folder.path(), &commands_of(&text));
        if tutorial == TUTORIALS[0] {
            said += &refused_in(folder.path(), &text);
        }
        if tutorial != TUTORIALS[1] {
            assert_printed(&text, &said);
        }
    }
    for file in ["corrected.csv", "tables.csv", "map/report.html", "figures/report.html", "causes/report.html"] {
        assert!(folder.path().join(file).is_file(), "the tutorials leave no {file}");
    }
}
