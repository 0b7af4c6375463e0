//! The documents against the files they speak of: links, anchors, paths, the length of the README, the book's contents.
//!
//! Place in the flow: beside it. The rules are in the library of this crate, where each is shown to catch a violation;
//! what documents say of the program itself is held by `tests/system/documents.rs`.

use abbe_tests::links::{anchors, links, paths_named};
use abbe_tests::workspace::{files, read, root};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What a reader takes in before trying: more belongs into the book.
const MOST_WORDS: usize = 1300;
const BOOK: &str = "docs/src";

fn documents() -> Vec<PathBuf> {
    files().into_iter().filter(|path| path.extension().is_some_and(|e| e == "md")).collect()
}

/// The book and what its readers come from.
fn for_users() -> Vec<PathBuf> {
    documents().into_iter().filter(|path| path.starts_with(BOOK) || path.parent() == Some(Path::new(""))).collect()
}

fn assert_none(rule: &str, violations: &[String]) {
    assert!(violations.is_empty(), "{rule}:\n  {}", violations.join("\n  "));
}

#[test]
fn the_readme_is_short() {
    let words = read("README.md").split_whitespace().count();
    assert!(words <= MOST_WORDS, "README.md has {words} words; {MOST_WORDS} at most, the rest belongs into {BOOK}");
}

#[test]
fn every_link_and_anchor_leads_somewhere() {
    let mut dead = Vec::new();
    for document in documents() {
        let (text, folder) = (read(&document), root().join(&document).parent().expect("a folder").to_owned());
        for link in links(&text) {
            let at = format!("{}:{}", document.display(), link.line);
            let target = if link.path.is_empty() { root().join(&document) } else { folder.join(&link.path) };
            if !target.exists() {
                dead.push(format!("{at}: no {}", link.path));
                continue;
            }
            let Some(anchor) = link.anchor else { continue };
            // A forge shows the README of a folder.
            let page = if target.is_dir() { target.join("README.md") } else { target };
            let known = std::fs::read_to_string(&page).map(|text| anchors(&text)).unwrap_or_default();
            if !known.contains(&anchor) {
                dead.push(format!("{at}: no #{anchor} in {}", page.display()));
            }
        }
    }
    assert_none("dead links", &dead);
}

/// A link from the book to a Markdown file outside of it would lead to a page that is not made: it links the folder.
#[test]
fn links_that_leave_the_book_are_not_to_its_pages() {
    let mut wrong = Vec::new();
    let book = root().join(BOOK).canonicalize().expect("the book");
    for document in documents().into_iter().filter(|path| path.starts_with(BOOK)) {
        let folder = root().join(&document).parent().expect("a folder").to_owned();
        for link in links(&read(&document)).into_iter().filter(|link| link.path.ends_with(".md")) {
            if folder.join(&link.path).canonicalize().is_ok_and(|target| !target.starts_with(&book)) {
                wrong.push(format!("{}:{}: {}", document.display(), link.line, link.path));
            }
        }
    }
    assert_none("link the folder, or name the file in code quotes", &wrong);
}

#[test]
fn every_file_that_a_document_names_is_there() {
    let all = files();
    let folders: BTreeSet<String> = all
        .iter()
        .filter_map(|path| path.components().next())
        .map(|first| first.as_os_str().to_string_lossy().into_owned())
        .filter(|first| root().join(first).is_dir())
        .collect();
    let folders: Vec<String> = folders.into_iter().collect();
    let mut missing = Vec::new();
    for document in for_users().into_iter().filter(|path| !path.ends_with("CHANGELOG.md")) {
        for (line, path) in paths_named(&read(&document), &folders) {
            if !root().join(&path).exists() {
                missing.push(format!("{}:{line}: {path}", document.display()));
            }
        }
    }
    assert_none("files that are not there", &missing);
}

#[test]
fn every_page_of_the_book_stands_in_its_contents_once() {
    let contents = Path::new(BOOK).join("SUMMARY.md");
    let listed: Vec<PathBuf> = links(&read(&contents)).iter().map(|link| Path::new(BOOK).join(&link.path)).collect();
    let mut wrong = Vec::new();
    for page in documents().into_iter().filter(|path| path.starts_with(BOOK) && *path != contents) {
        let times = listed.iter().filter(|path| **path == page).count();
        if times != 1 {
            wrong.push(format!("{}: {times} times", page.display()));
        }
    }
    assert_none("docs/src/SUMMARY.md lists", &wrong);
}

#[test]
fn the_citation_names_the_version_of_the_workspace() {
    let cargo = read("Cargo.toml");
    let package = cargo.split("[workspace.package]").nth(1).expect("the workspace has a version");
    let version = package.split("version = \"").nth(1).and_then(|rest| rest.split('"').next()).expect("a version");
    let citation = read("CITATION.cff");
    assert!(
        citation.lines().any(|line| line == format!("version: {version}")),
        "CITATION.cff is not of version {version}"
    );
}
