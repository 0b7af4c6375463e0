//! Links of Markdown documents: targets, anchors, and files that a text names.
//!
//! Place in the flow: text of a document in; `tests/tests/documents.rs` holds what comes out against the real files.

use std::collections::BTreeMap;

/// A link and the line it stands in, from 1.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Link {
    /// Path as written, without what follows `#`; empty for a place in the same document.
    pub path: String,
    /// What follows `#`.
    pub anchor: Option<String>,
    /// Line of the document.
    pub line: usize,
}

/// Lines outside of fenced blocks of code, with their number from 1.
pub fn prose(document: &str) -> Vec<(usize, &str)> {
    let mut inside = false;
    let is_prose = |(_, line): &(usize, &str)| {
        let fence = line.trim_start().starts_with("```");
        inside ^= fence;
        !inside && !fence
    };
    document.lines().enumerate().map(|(k, line)| (k + 1, line)).filter(is_prose).collect()
}

/// Links to files of the project and to places in the document; those to sites are left out.
pub fn links(document: &str) -> Vec<Link> {
    let mut found = Vec::new();
    for (line, text) in prose(document) {
        for (at, _) in text.match_indices("](") {
            let Some((target, _)) = text[at + 2..].split_once(')') else { continue };
            if target.contains("://") || in_code(text, at) {
                continue;
            }
            let (path, anchor) = target.split_once('#').map_or((target, None), |(path, anchor)| (path, Some(anchor)));
            found.push(Link { path: path.to_owned(), anchor: anchor.map(str::to_owned), line });
        }
    }
    found
}

/// Whether a place of a line is inside a code span.
fn in_code(line: &str, at: usize) -> bool {
    line[..at].matches('`').count() % 2 == 1 && line[at..].contains('`')
}

/// Anchors of all headings, as mdBook and the forges make them.
pub fn anchors(document: &str) -> Vec<String> {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let headings = prose(document).into_iter().filter_map(|(_, line)| {
        let text = line.trim_start_matches('#');
        (text.len() < line.len() && text.starts_with(' ')).then(|| text.trim())
    });
    let numbered = |text: &str| {
        let anchor = anchor(text);
        let before = seen.entry(anchor.clone()).or_default();
        *before += 1;
        if *before == 1 { anchor } else { format!("{anchor}-{}", *before - 1) }
    };
    headings.map(numbered).collect()
}

/// Anchor of a heading: lower case, blanks as hyphens, other signs left out.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || c.is_whitespace() || "-_".contains(*c));
    kept.flat_map(char::to_lowercase).map(|c| if c.is_whitespace() { '-' } else { c }).collect()
}

/// Paths below one of these folders that a document names, in code quotes or in blocks of code, with their line.
pub fn paths_named(document: &str, folders: &[String]) -> Vec<(usize, String)> {
    let in_folder = |word: &&str| folders.iter().any(|folder| word.starts_with(&format!("{folder}/")));
    // A pattern or a place to be filled in names no file.
    let is_whole = |word: &&str| !word.contains(['*', '…', '<', '{']);
    let mut found = Vec::new();
    for (k, line) in document.lines().enumerate() {
        let words = line.split(|c: char| c.is_whitespace() || "`()[]\"'|,;=".contains(c));
        let words = words.map(|word| word.trim_end_matches(['.', ':'])).filter(in_folder).filter(is_whole);
        found.extend(words.map(|word| (k + 1, word.split('#').next().unwrap_or(word).to_owned())));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(path: &str, anchor: Option<&str>, line: usize) -> Link {
        Link { path: path.to_owned(), anchor: anchor.map(str::to_owned), line }
    }

    #[test]
    fn links_are_found_outside_of_code_only() {
        let text = "[a](b.md#c) and [d](#e)\n```text\n[f](g)\n```\n`[h](i)` [j](https://k.l/m) [n `o`](p)";
        assert_eq!(links(text), [link("b.md", Some("c"), 1), link("", Some("e"), 1), link("p", None, 5)]);
    }

    #[test]
    fn anchors_are_those_of_the_forges() {
        let text = "# A b\n## `x/y`: what, it-is_1\n```\n# no heading\n```\n#none\n## A b\n";
        assert_eq!(anchors(text), ["a-b", "xy-what-it-is_1", "a-b-1"]);
    }

    #[test]
    fn paths_of_the_project_are_told_from_others() {
        let text = "`models/a.rs` and out/x\n```console\nabbe a --in models/b.csv\n```\n[c](models/d.md#e) models/*.rs";
        let found = paths_named(text, &["models".to_owned()]);
        assert_eq!(
            found,
            [(1, "models/a.rs".to_owned()), (3, "models/b.csv".to_owned()), (5, "models/d.md".to_owned())]
        );
    }
}
