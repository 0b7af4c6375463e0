//! The commit that the program is made of, for `abbe --version`.
//!
//! In: `ABBE_COMMIT` of the environment, for sources without a repository; else what git says of this checkout. Out: the
//! variable `ABBE_BUILD` of the build. Without either, the version says that the commit is not known.

use std::path::Path;
use std::process::Command;

/// Characters of a commit that tell it from all others here.
const SHORT: usize = 12;

fn main() {
    println!("cargo::rerun-if-env-changed=ABBE_COMMIT");
    // The one file that every commit and every checkout writes to.
    let log = git(&["rev-parse", "--path-format=absolute", "--git-path", "logs/HEAD"]);
    match log.filter(|path| Path::new(path).exists()) {
        Some(path) => println!("cargo::rerun-if-changed={path}"),
        None => println!("cargo::rerun-if-changed=build.rs"),
    }
    let given = std::env::var("ABBE_COMMIT").ok().filter(|commit| !commit.is_empty());
    let commit = given.or_else(|| git(&["rev-parse", "HEAD"]));
    let build = match commit {
        Some(commit) => format!("commit {}", commit.chars().take(SHORT).collect::<String>()),
        None => "commit not known".to_owned(),
    };
    println!("cargo::rustc-env=ABBE_BUILD={build}");
}

/// What git says; `None` where there is no git, or no repository.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    let text = String::from_utf8(output.stdout).ok()?;
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}
