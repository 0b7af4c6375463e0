//! What a release is called, wherever it is named, and what `packaging/release` refuses to call one.
//!
//! Place in the flow: beside it. The script runs in a small repository of its own, with stand-ins for what compiles.

#![allow(clippy::unwrap_used, clippy::expect_used)] // helpers of tests

use abbe_tests::workspace::{files, read, root};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What was measured names the version that it was measured with; the changelog has them all.
const OF_THEIR_DAY: [&str; 2] = ["docs/src/figures", "CHANGELOG.md"];

fn version() -> String {
    let cargo = read("Cargo.toml");
    let package = cargo.split("[workspace.package]").nth(1).expect("the workspace has a version");
    package.split("version = \"").nth(1).and_then(|rest| rest.split('"').next()).expect("a version").to_owned()
}

/// Versions in names of packages (`abbe_1.2.3-1_amd64.deb`) that a text names, with their line.
fn versions_in_names(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for (k, line) in text.lines().enumerate() {
        for (at, name) in line.match_indices("abbe_") {
            let rest = &line[at + name.len()..];
            let version: String = rest.chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect();
            if version.starts_with(|c: char| c.is_ascii_digit()) {
                found.push((k + 1, version));
            }
        }
    }
    found
}

#[test]
fn names_with_a_version_are_found_and_others_are_not() {
    let text = "`abbe_0.1.0-1_amd64.deb` and abbe_VERSION_ARCH.deb\nabbe_msgs, /tmp/abbe_*; dpkg -i ./abbe_10.2.33-1_arm64.deb";
    assert_eq!(versions_in_names(text), [(1, "0.1.0".to_owned()), (2, "10.2.33".to_owned())]);
}

#[test]
fn packages_that_documents_name_are_of_the_version_of_the_workspace() {
    let (version, mut seen, mut stale) = (version(), 0, Vec::new());
    let documents = files().into_iter().filter(|path| path.extension().is_some_and(|e| e == "md"));
    for document in documents.filter(|path| !OF_THEIR_DAY.iter().any(|other| path.starts_with(other))) {
        for (line, named) in versions_in_names(&read(&document)) {
            seen += 1;
            if named != version {
                stale.push(format!("{}:{line}: {named}", document.display()));
            }
        }
    }
    assert!(seen > 0, "no document names a package: is it still read rightly?");
    assert!(stale.is_empty(), "the workspace is of version {version}:\n  {}", stale.join("\n  "));
}

#[test]
fn packages_for_ros_are_of_the_version_of_the_workspace() {
    let manifests: Vec<PathBuf> = files().into_iter().filter(|path| path.ends_with("package.xml")).collect();
    assert!(manifests.len() >= 2, "{manifests:?}");
    let line = format!("<version>{}</version>", version());
    for manifest in manifests {
        assert!(read(&manifest).contains(&line), "{} lacks {line}", manifest.display());
    }
}

/// A repository with the script and nothing that has to be compiled.
struct Repository(PathBuf);

impl Repository {
    fn new(name: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(folder.join("packaging")).unwrap();
        let repository = Self(folder);
        fs::copy(root().join("packaging/release"), repository.0.join("packaging/release")).unwrap();
        repository.write(
            "Cargo.toml",
            "[workspace.package]\nversion = \"1.2.3\"\n[workspace.dependencies]\nversion = \"9.9.9\"\n",
        );
        repository.write("LICENSE", "licence\n");
        repository.write(".gitignore", "/out\n");
        // Programs that say of which version and commit they are.
        let program = "#!/bin/sh\necho \"program 1.2.3 (commit $(git rev-parse HEAD | cut -c1-12))\"\n";
        repository.write("program", program);
        let deb = "#!/bin/sh\nset -e\nmkdir -p out/package\ncp program out/package/abbe\ncp program out/package/abbe-train\n\
                   chmod +x out/package/abbe out/package/abbe-train\necho deb > out/package/abbe_1.2.3-1_amd64.deb\n";
        repository.write("packaging/deb", deb);
        repository.write("packaging/check", "#!/bin/sh\necho checked\n");
        let made =
            Command::new("chmod").args(["+x", "packaging/deb", "packaging/check"]).current_dir(&repository.0).status();
        assert!(made.unwrap().success());
        repository.git(&["init", "--quiet"]);
        repository
    }

    fn write(&self, path: &str, text: &str) {
        fs::write(self.0.join(path), text).unwrap();
    }

    fn git(&self, arguments: &[&str]) {
        let mut git = Command::new("git");
        git.args(["-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]);
        let output = git.args(arguments).current_dir(&self.0).output().unwrap();
        assert!(output.status.success(), "git {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    }

    fn commit(&self) {
        self.git(&["add", "--all"]);
        self.git(&["commit", "--quiet", "--message", "x"]);
    }

    /// Runs the script: whether it made a release, and what it said.
    fn release(&self) -> (bool, String) {
        let mut script = Command::new("bash");
        script.arg("packaging/release").env_remove("ABBE_BUILT").current_dir(&self.0);
        let output = script.output().unwrap();
        let said = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
        (output.status.success(), said)
    }

    fn assert_refused(&self, because: &str) {
        let (made, said) = self.release();
        assert!(!made && said.contains(because), "not refused by {because:?}: {said}");
        assert!(!self.0.join("out/package").exists(), "it was compiled before it was refused");
    }
}

#[test]
fn a_release_has_notes_of_its_version_and_a_clean_tree() {
    let repository = Repository::new("refused-releases");
    for changes in [
        "## [Unreleased]\n",
        "## [1.2.2] - 2026-01-01\n- a\n",
        "## [1.2.3] - 2026-01-01\n\n### Added\n\n## [1.2.2]\n- a\n",
    ] {
        repository.write("CHANGELOG.md", changes);
        repository.commit();
        repository.assert_refused("CHANGELOG.md has no section \"## [1.2.3] - DATE\"");
    }
    repository.write("CHANGELOG.md", "## [Unreleased]\n\n- b\n\n## [1.2.3] - 2026-01-01\n\n- a\n");
    repository.commit();
    repository.assert_refused("CHANGELOG.md has entries below [Unreleased]");
    repository.write("CHANGELOG.md", "## [Unreleased]\n\n## [1.2.3] - 2026-01-01\n\n- a\n");
    repository.assert_refused("the tree is not clean");
    repository.commit();
    repository.write("new", "");
    repository.assert_refused("the tree is not clean");
}

#[test]
fn a_release_is_a_package_an_archive_notes_and_sums_and_is_made_once() {
    let repository = Repository::new("made-release");
    repository.write("CHANGELOG.md", "# Changelog\n\n## [Unreleased]\n\n## [1.2.3] - 2026-01-01\n\n### Added\n\n- a\n\n## [1.2.2] - 2025-01-01\n\n- b\n");
    repository.commit();
    let (made, said) = repository.release();
    assert!(made && said.contains("checked"), "{said}");
    let folder = repository.0.join("out/release/1.2.3");
    assert_eq!(fs::read_to_string(folder.join("NOTES.md")).unwrap().trim_end(), "### Added\n\n- a");
    let sums = fs::read_to_string(folder.join("SHA256SUMS")).unwrap();
    for file in ["LICENSE", "NOTES.md", "abbe-1.2.3-linux-", "abbe_1.2.3-1_amd64.deb"] {
        assert!(sums.contains(&format!("  {file}")), "no sum of {file}: {sums}");
    }
    assert_eq!(sums.lines().count(), 4, "{sums}");
    let (again, said) = repository.release();
    assert!(!again && said.contains("is there already"), "{said}");
    // A program of another commit is another program.
    fs::remove_dir_all(&folder).unwrap();
    repository.write("program", "#!/bin/sh\necho \"program 1.2.3 (commit 000000000000)\"\n");
    repository.commit();
    let (stale, said) = repository.release();
    assert!(!stale && said.contains("and no 1.2.3 of commit"), "{said}");
}
