//! `abbe train` and `abbe compare` are the work of another program: where it is missing or of another version, that is said, and
//! where it is there, nobody sees that there are two.

use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::assert_says;
use crate::common::program::{Ran, Started, abbe, program, run};
use tempfile::TempDir;

const OTHER: &str = "abbe-train";
const TRAIN: [&str; 5] = ["train", "--residuals", "none.csv", "--out", "residual.json"];
const COMPARE: [&str; 3] = ["compare", "--residuals", "none.csv"];

/// `abbe` alone in a folder of its own, on the disk of the build.
fn alone() -> TempDir {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    fs::hard_link(program(), folder.path().join("abbe")).unwrap();
    folder
}

/// Runs the `abbe` of a folder, with these folders as the path.
fn run_of(folder: &Path, path: &[&Path], arguments: &[&str]) -> Ran {
    let prepared = abbe(arguments);
    let mut command = Command::new(folder.join("abbe"));
    command.args(prepared.get_args()).env_remove("RUST_LOG").env("PATH", std::env::join_paths(path).unwrap());
    command.current_dir(folder);
    Started::start(command).finish()
}

fn other() -> PathBuf {
    PathBuf::from(env!("CARGO_BIN_EXE_abbe-train"))
}

#[test]
fn a_missing_program_is_told_with_how_to_get_it() {
    let folder = alone();
    for arguments in [TRAIN.as_slice(), &COMPARE] {
        let said = run_of(folder.path(), &[], arguments).refused();
        assert_says(
            &said,
            &["abbe: training is the work of the program abbe-train", "neither beside this one nor on the path"],
        );
        assert_says(
            &said,
            &["cargo install --path nodes/train", "cargo build --release -p abbe-train", "Debian package"],
        );
    }
    // What needs no training needs no such program, its help included.
    assert_says(&run_of(folder.path(), &[], &["train", "--help"]).ok(), &["Usage: abbe train", "--resume"]);
    assert_eq!(run_of(folder.path(), &[], &["train"]).code, Some(2));
    run_of(folder.path(), &[], &["--version"]).ok();
}

#[test]
fn a_program_of_another_version_is_refused_by_name_before_it_does_anything() {
    let folder = alone();
    let stale = folder.path().join(OTHER);
    // Written by another process: a file that this one still writes to cannot be run.
    let text = "#!/bin/sh\n[ \"$1\" = --version ] && echo 'abbe-train 0.0.9 (commit 0123456789ab)' || touch done\n";
    let write = "printf '%s' \"$1\" > \"$2\" && chmod 755 \"$2\"";
    let written = Command::new("sh").args(["-c", write, "sh", text]).arg(&stale).status().unwrap();
    assert!(written.success());
    let own = run(["--version"]).ok();
    let (_, version) = own.trim().split_once(' ').unwrap();
    for arguments in [TRAIN.as_slice(), &COMPARE] {
        // The right one on the path does not help: the first that is found is told, never passed over.
        let said = run_of(folder.path(), &[other().parent().unwrap()], arguments).refused();
        assert_says(&said, &["0.0.9 (commit 0123456789ab)", version, stale.to_str().unwrap(), "cargo install"]);
        assert!(!folder.path().join("done").exists(), "it was started all the same");
    }
    // Nor is any other program of that name, or what cannot be run.
    fs::remove_file(&stale).unwrap();
    symlink("/bin/false", &stale).unwrap();
    assert_says(&run_of(folder.path(), &[], &TRAIN).refused(), &["this is \"", version]);
    fs::remove_file(&stale).unwrap();
    fs::write(&stale, "no program").unwrap();
    fs::set_permissions(&stale, fs::Permissions::from_mode(0o644)).unwrap();
    assert_says(&run_of(folder.path(), &[], &TRAIN).refused(), &["abbe-train: cannot be started", "cargo install"]);
}

#[test]
fn the_program_is_found_on_the_path_and_gets_the_same_words() {
    let folder = alone();
    let path = other();
    let path = [path.parent().unwrap()];
    // The data that are missing are its own complaint; the exit code comes through.
    for arguments in [TRAIN.as_slice(), &COMPARE] {
        let said = run_of(folder.path(), &path, arguments).refused();
        assert_says(&said, &["abbe: none.csv"]);
    }
    let said = run_of(folder.path(), &path, &["compare", "--residuals", "none.csv", "--seeds", "0"]).refused();
    assert_says(&said, &["--seeds must be at least 1"]);
    // Further arguments of ROS are refused as by every other command that is no node.
    let words = [&COMPARE[..], &["--ros-args", "-r", "a:=b"]].concat();
    assert_says(&run_of(folder.path(), &path, &words).refused(), &["take --ros-args other than --log-level"]);
}

#[test]
fn both_programs_say_the_same_version_and_describe_the_commands_alike() {
    let own = run(["--version"]).ok();
    let of_other = |arguments: &[&str]| {
        let output = Command::new(other()).args(arguments).output().unwrap();
        assert!(output.status.success());
        String::from_utf8(output.stdout).unwrap()
    };
    assert_eq!(of_other(&["--version"]).replace(OTHER, "abbe"), own);
    for command in ["train", "compare"] {
        assert_eq!(of_other(&[command, "--help"]).replace(OTHER, "abbe"), run([command, "--help"]).ok());
    }
}
