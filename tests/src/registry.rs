//! One thing, one place: effects and drivers.
//!
//! Place in the flow: files of a folder and the one table they are entered in, in; what is missing, double or known
//! elsewhere, out.

use crate::source::Source;
use std::collections::{BTreeMap, BTreeSet};

/// Effect files and the table they are entered in disagree: each file needs one `name::KNOWN` in the table, and no
/// line may stand for no file.
pub fn effects_against_table(files: &[String], table: &Source) -> Vec<String> {
    let mut entered: BTreeMap<String, usize> = BTreeMap::new();
    for found in table.paths() {
        if let Some((name, "KNOWN")) = found.what.split_once("::") {
            *entered.entry(name.to_owned()).or_default() += 1;
        }
    }
    let mut wrong = Vec::new();
    for file in files {
        match entered.remove(file) {
            Some(1) => {}
            Some(lines) => wrong.push(format!("{file}: {lines} lines in the table, not one")),
            None => wrong.push(format!("{file}: a file, but not in the table")),
        }
    }
    wrong.extend(entered.into_keys().map(|name| format!("{name}: in the table, but no file")));
    wrong
}

/// Effects whose name in model files is not that of their file.
pub fn names_against_files(files: &[String], names: &[&str]) -> Vec<String> {
    let files: BTreeSet<&str> = files.iter().map(String::as_str).collect();
    let names: BTreeSet<&str> = names.iter().copied().collect();
    let without = files.difference(&names).map(|file| format!("{file}: a file, but no effect of that name"));
    without.chain(names.difference(&files).map(|name| format!("{name}: an effect, but no file of that name"))).collect()
}

/// Test files beside a program that neither it nor another of them takes in: their tests would never run.
pub fn files_without_program(files: &[String], beside: &[Source], programs: &[String]) -> Vec<String> {
    let taken: BTreeSet<String> = beside
        .iter()
        .flat_map(|source| {
            let words = source.words();
            let named = words.windows(2).filter(|pair| pair[0].what == "mod");
            named.map(|pair| pair[1].what.clone()).collect::<Vec<_>>()
        })
        .collect();
    files.iter().filter(|file| !taken.contains(*file) && !programs.contains(*file)).cloned().collect()
}

/// Words that stand in the production code of a file.
pub fn mentions(source: &Source, words: &[String]) -> Vec<String> {
    let found = source.words();
    words.iter().filter(|word| found.iter().any(|f| f.what == **word)).cloned().collect()
}

/// Driver files and the two functions that open drivers disagree: every kind of the configuration must be opened by
/// both, and every file must be used by one of them.
pub fn drivers_against_table(files: &[String], table: &Source, kinds: &str, openers: [&str; 2]) -> Vec<String> {
    let Some(variants) = table.variants(kinds) else { return vec![format!("no enum {kinds}")] };
    let mut used = Vec::new();
    let mut wrong = Vec::new();
    for opener in openers {
        let Some(paths) = table.paths_in_function(opener) else {
            wrong.push(format!("no function {opener}"));
            continue;
        };
        for variant in &variants {
            if !paths.iter().any(|path| path.what == format!("{kinds}::{variant}")) {
                wrong.push(format!("{opener} does not open {kinds}::{variant}"));
            }
        }
        used.extend(paths.into_iter().filter_map(|path| path.what.split_once("::").map(|(file, _)| file.to_owned())));
    }
    wrong.extend(
        files.iter().filter(|file| !used.contains(file)).map(|file| format!("{file}: a file, but never opened")),
    );
    wrong
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(text: &str) -> Source {
        Source::parse(text).unwrap()
    }

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|name| (*name).to_owned()).collect()
    }

    #[test]
    fn a_test_file_that_no_program_takes_in_is_found() {
        let beside = ["mod one; mod common; fn two() {}", "mod three;"].map(source);
        let files = names(&["main", "one", "two", "three", "alone"]);
        assert_eq!(files_without_program(&files, &beside, &names(&["main", "alone"])), names(&["two"]));
    }

    #[test]
    fn an_effect_missing_double_or_dangling_is_caught() {
        let table = source("use super::{bow, sag}; const R: &[Known] = &[bow::KNOWN, sag::KNOWN];");
        assert!(effects_against_table(&names(&["bow", "sag"]), &table).is_empty());
        assert_eq!(effects_against_table(&names(&["bow", "sag", "tilt"]), &table).len(), 1, "a file not entered");
        assert_eq!(effects_against_table(&names(&["bow"]), &table).len(), 1, "a line without file");
        let double = source("const R: &[Known] = &[bow::KNOWN, bow::KNOWN];");
        assert_eq!(effects_against_table(&names(&["bow"]), &double).len(), 1, "entered twice");
    }

    #[test]
    fn an_effect_with_the_name_of_another_file_is_caught() {
        assert!(names_against_files(&names(&["bow", "sag"]), &["sag", "bow"]).is_empty());
        assert_eq!(names_against_files(&names(&["bow", "sag"]), &["bow", "bow"]).len(), 1, "one name for two");
        assert_eq!(names_against_files(&names(&["bow"]), &["arch"]).len(), 2, "another name");
    }

    #[test]
    fn an_effect_known_elsewhere_is_caught() {
        let words = names(&["bow"]);
        assert_eq!(mentions(&source("fn a() { match name { \"bow\" => b() } }"), &words), ["bow"]);
        assert_eq!(mentions(&source("fn a() { effects::bow::construct() }"), &words), ["bow"]);
        assert!(mentions(&source("// bow\nfn a() { rainbow(\"a bow\") }"), &words).is_empty());
        assert!(mentions(&source("#[cfg(test)]\nmod tests { fn a() { b(\"bow\") } }"), &words).is_empty());
    }

    #[test]
    fn a_driver_not_opened_is_caught() {
        let text = |second: &str| {
            let opened = "fn open_a(c: &C) { match c { Kind::Bag { file } => bag::a(file), Kind::Csv => csv::a() } }";
            source(&format!("enum Kind {{ Bag {{ file: P }}, Csv }} {opened} fn open_b(c: &C) {{ {second} }}"))
        };
        let whole = "match c { Kind::Bag { file } => bag::b(file), Kind::Csv => csv::b() }";
        let check =
            |files: &[&str], second| drivers_against_table(&names(files), &text(second), "Kind", ["open_a", "open_b"]);
        assert!(check(&["bag", "csv"], whole).is_empty());
        assert_eq!(check(&["bag", "csv", "plc"], whole).len(), 1, "a file nobody opens");
        assert_eq!(check(&["bag", "csv"], "match c { Kind::Bag { file } => bag::b(file), _ => other() }").len(), 1);
        assert_eq!(drivers_against_table(&[], &source("fn x() {}"), "Kind", ["open_a", "open_b"]).len(), 1);
    }
}
