//! One thing, one place: effects and drivers.
//!
//! Place in the flow: files of a folder and the one table they are entered in, in; what is missing, double or known
//! elsewhere, out.

use crate::source::Source;
use std::collections::BTreeMap;

/// Effect files and the text of the table they are entered in disagree: each file needs `mod name;`, and one
/// `name::construct` beside one `name::NAME` in the table; no line may stand for no file.
pub fn effects_against_table(files: &[String], table: &Source) -> Vec<String> {
    let mut entered: BTreeMap<String, [usize; 2]> = BTreeMap::new();
    for found in table.paths() {
        if let Some((name, what)) = found.what.split_once("::")
            && let Some(column) = ["NAME", "construct"].iter().position(|known| *known == what)
        {
            entered.entry(name.to_owned()).or_default()[column] += 1;
        }
    }
    let mut wrong = Vec::new();
    for file in files {
        match entered.remove(file) {
            Some([1, 1]) => {}
            Some([names, constructors]) => {
                wrong.push(format!("{file}: {names} names and {constructors} constructors in the table, not one each"));
            }
            None => wrong.push(format!("{file}: a file, but not in the table")),
        }
    }
    wrong.extend(entered.into_keys().map(|name| format!("{name}: in the table, but no file")));
    wrong
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
    fn an_effect_missing_double_or_dangling_is_caught() {
        let table = source("const R: &[X] = &[(bow::NAME, bow::construct), (sag::NAME, sag::construct)];");
        assert!(effects_against_table(&names(&["bow", "sag"]), &table).is_empty());
        assert_eq!(effects_against_table(&names(&["bow", "sag", "tilt"]), &table).len(), 1, "a file not entered");
        assert_eq!(effects_against_table(&names(&["bow"]), &table).len(), 1, "a line without file");
        let double = source("const R: &[X] = &[(bow::NAME, bow::construct), (bow::NAME, bow::construct)];");
        assert_eq!(effects_against_table(&names(&["bow"]), &double).len(), 1, "entered twice");
        let crossed = source("const R: &[X] = &[(bow::NAME, sag::construct)];");
        assert_eq!(effects_against_table(&names(&["bow", "sag"]), &crossed).len(), 2, "name of one, code of another");
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
