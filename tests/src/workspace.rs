//! The workspace on disk: its root, its text files, its sources with the crate each belongs to.
//!
//! Place in the flow: feeds [`crate::rules`] and [`crate::registry`] with the real files. Only files of the project
//! count: those that version control knows or would take; without it, everything but build outputs.

use crate::source::Source;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Crates that are evidence for the product: what it is measured against, and the papers it repeats.
pub const EVIDENCE: &str = "tests/evidence";

/// One Rust file.
#[derive(Debug)]
pub struct RustFile {
    /// Path from the root of the workspace.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
    /// Its tokens.
    pub source: Source,
    /// Whether it is compiled for tests only: below `tests`, `benches`, `examples` of its crate, or included so.
    pub for_tests: bool,
}

/// Folder that holds the workspace's `Cargo.toml`.
pub fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().expect("this crate lies one folder below the root").to_owned()
}

/// Files of the project from the root, sorted; links and build outputs left out.
pub fn files() -> Vec<PathBuf> {
    let listed = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard", "-z"])
        .current_dir(root())
        .output();
    let mut files: Vec<PathBuf> = match listed {
        Ok(output) if output.status.success() => {
            String::from_utf8_lossy(&output.stdout).split_terminator('\0').map(PathBuf::from).collect()
        }
        _ => walk(&root()),
    };
    files.retain(|path| fs::symlink_metadata(root().join(path)).is_ok_and(|metadata| metadata.is_file()));
    files.sort();
    assert!(files.len() > 100, "the project has more than {} files", files.len());
    files
}

/// Everything below a folder but hidden files, build outputs and results.
fn walk(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("folders of the project can be read").map_while(Result::ok) {
        let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
        if path.is_dir() && !["target", "out", ".git", ".venv"].contains(&name.as_str()) {
            found.extend(walk(&path));
        } else if path.is_file() {
            found.push(path.strip_prefix(root()).expect("below the root").to_owned());
        }
    }
    found
}

/// Text of a file of the project.
pub fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// All Rust files.
pub fn rust_files() -> Vec<RustFile> {
    rust_files_below("")
}

/// Rust files below a folder that holds sources of whole crates: taking all apart takes seconds.
pub fn rust_files_below(folder: &str) -> Vec<RustFile> {
    let is_meant = |path: &PathBuf| path.starts_with(folder) && path.extension().is_some_and(|ending| ending == "rs");
    let mut files: Vec<RustFile> = files().into_iter().filter(is_meant).map(open).collect();
    let included: BTreeSet<PathBuf> = files.iter().flat_map(test_files_of).collect();
    for file in &mut files {
        file.for_tests |= included.contains(&file.path);
    }
    files
}

fn open(path: PathBuf) -> RustFile {
    let text = read(&path);
    let source = Source::parse(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let outside = ["tests", "benches", "examples", "fuzz"];
    // Crates of the evidence are held to what holds for models, although they lie below `tests`.
    let in_crate = path.strip_prefix(EVIDENCE).unwrap_or(&path);
    let for_tests = in_crate.components().any(|part| outside.iter().any(|name| part.as_os_str() == *name));
    RustFile { path, text, source, for_tests }
}

/// Files that `file` includes for tests only.
fn test_files_of(file: &RustFile) -> Vec<PathBuf> {
    let folder = file.path.parent().expect("a file has a folder");
    let stem = file.path.file_stem().expect("a file has a name");
    let is_root = ["lib", "main", "mod"].iter().any(|name| stem == *name);
    let below = if is_root { folder.to_owned() } else { folder.join(stem) };
    let names = file.source.test_modules();
    names.iter().flat_map(|name| [below.join(name), folder.join(name)]).collect()
}
