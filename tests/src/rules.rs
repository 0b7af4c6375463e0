//! Rules that hold for the text of a file.
//!
//! Place in the flow: one file in, what violates the rule out, with the line. Each rule is shown a violation in the
//! tests below, so that it cannot stop working unnoticed.

use crate::source::{Found, Source};

/// Longest file that is still read in one go.
pub const MOST_LINES: usize = 600;

/// Paths by which code reaches files, the clock, the environment, other processes or the network.
const OUTSIDE: [&str; 10] = [
    "std::fs",
    "std::env",
    "std::io",
    "std::net",
    "std::process",
    "std::os",
    "std::time::Instant",
    "std::time::SystemTime",
    "Instant::now",
    "SystemTime",
];
/// Macros by which code speaks to the terminal.
const PRINTING: [&str; 5] = ["print", "println", "eprint", "eprintln", "dbg"];
/// Methods and macros that end the program.
const ENDING_METHODS: [&str; 4] = ["unwrap", "expect", "unwrap_err", "expect_err"];
const ENDING_MACROS: [&str; 3] = ["panic", "todo", "unimplemented"];

/// What production code of a pure crate does beyond its arguments and results.
pub fn impure(source: &Source) -> Vec<Found> {
    let outside = |path: &str| {
        OUTSIDE.iter().any(|forbidden| path == *forbidden || path.starts_with(&format!("{forbidden}::")))
            || path.split("::").next() == Some("File")
    };
    let paths = source.paths().into_iter().filter(|found| outside(&found.what));
    let printing = source.macros().into_iter().filter(|found| PRINTING.contains(&found.what.as_str()));
    paths.chain(printing).collect()
}

/// What ends the program in production code instead of returning an error.
pub fn endings(source: &Source) -> Vec<Found> {
    let methods = source.methods().into_iter().filter(|found| ENDING_METHODS.contains(&found.what.as_str()));
    let macros = source.macros().into_iter().filter(|found| ENDING_MACROS.contains(&found.what.as_str()));
    methods.chain(macros).collect()
}

/// Where production code names a crate.
pub fn names_of(source: &Source, name: &str) -> Vec<Found> {
    source.words().into_iter().filter(|found| found.what == name).collect()
}

/// Tests that are switched off.
pub fn ignored_tests(source: &Source) -> Vec<Found> {
    source.attributes().into_iter().filter(|found| found.what == "ignore").collect()
}

/// Whether the file begins by saying what it is for.
pub fn has_header(text: &str) -> bool {
    text.lines().next().is_some_and(|line| line.strip_prefix("//! ").is_some_and(|words| words.trim().len() > 10))
}

/// Number of lines, where there are too many.
pub fn too_long(text: &str) -> Option<usize> {
    let lines = text.lines().count();
    (lines > MOST_LINES).then_some(lines)
}

/// Lines that name a folder of somebody's machine.
pub fn machine_paths(text: &str) -> Vec<Found> {
    // Put together here, so that this file does not name them itself.
    let roots = ["work", "root", "home", "Users"].map(|root| format!("/{root}/"));
    let names_one = |line: &&str| {
        roots.iter().any(|root| {
            line.match_indices(root.as_str()).any(|(at, _)| {
                let before = line[..at].chars().next_back();
                !before.is_some_and(|c| c.is_alphanumeric() || "._-})>/".contains(c))
            })
        })
    };
    let found = text.lines().enumerate().filter(|(_, line)| names_one(line));
    found.map(|(k, line)| Found { line: k + 1, what: line.trim().to_owned() }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whats(found: Vec<Found>) -> Vec<String> {
        found.into_iter().map(|found| found.what).collect()
    }

    #[test]
    fn files_clock_environment_and_terminal_are_caught() {
        let cases = [
            ("use std::fs;", "std::fs"),
            ("use std::{collections::BTreeMap, env};", "std::env"),
            ("fn a() -> Vec<u8> { std::fs::read(\"b\").unwrap_or_default() }", "std::fs::read"),
            ("use std::time::{Duration, Instant};", "std::time::Instant"),
            ("fn a() { let t = Instant::now(); }", "Instant::now"),
            ("fn a() { let t = std::time::SystemTime::now(); }", "std::time::SystemTime::now"),
            ("fn a() { let f = File::open(\"b\"); }", "File::open"),
            ("use std::io::Write;", "std::io::Write"),
            ("fn a() { println!(\"b\"); }", "println"),
            ("fn a() { let b = vec![dbg!(1)]; }", "dbg"),
        ];
        for (text, what) in cases {
            assert!(whats(impure(&Source::parse(text).unwrap())).contains(&what.to_owned()), "{text}");
        }
    }

    #[test]
    fn pure_code_and_tests_of_pure_code_pass() {
        let text = "//! Reads no std::fs.\nuse std::time::Duration;\nuse std::collections::BTreeMap;\n\
                    fn filesystem() {}\n#[cfg(test)]\nmod tests { use std::fs; fn a() { println!(\"b\"); } }";
        assert!(impure(&Source::parse(text).unwrap()).is_empty());
    }

    #[test]
    fn endings_are_caught_outside_tests_only() {
        let text = "fn a() { b.unwrap(); c.expect(\"d\"); vec![e.unwrap_err()]; panic!(); todo!(); unimplemented!(); \
                    f.unwrap_or(0); g.unwrap_or_default(); }\n#[cfg(test)]\nmod tests { fn h() { i.unwrap(); panic!() } }";
        let found = whats(endings(&Source::parse(text).unwrap()));
        assert_eq!(found, ["unwrap", "expect", "unwrap_err", "panic", "todo", "unimplemented"]);
    }

    #[test]
    fn a_crate_that_is_named_is_caught_outside_tests() {
        let text = "//! Not abbe_identify.\nuse abbe_identify::identify;\nfn a() { let b = abbe_identify::IdentifyOptions::default(); }\n\
                    #[cfg(test)]\nmod tests { use abbe_identify::identify; }";
        let lines: Vec<usize> =
            names_of(&Source::parse(text).unwrap(), "abbe_identify").iter().map(|f| f.line).collect();
        assert_eq!(lines, [2, 3]);
    }

    #[test]
    fn tests_switched_off_are_caught() {
        let off = "#[cfg(test)]\nmod tests { #[test]\n#[ignore = \"slow\"]\nfn a() {} }";
        assert_eq!(ignored_tests(&Source::parse(off).unwrap()).len(), 1);
        assert!(ignored_tests(&Source::parse("#[test]\nfn a() { let ignore = 1; }").unwrap()).is_empty());
    }

    #[test]
    fn files_without_a_header_are_caught() {
        assert!(has_header("//! Reads what the scales say.\nfn a() {}"));
        for text in
            ["", "fn a() {}", "// Reads what the scales say.", "//!", "//! x", "\n//! Reads what the scales say."]
        {
            assert!(!has_header(text), "{text:?}");
        }
    }

    #[test]
    fn long_files_are_caught() {
        assert_eq!(too_long(&"a\n".repeat(MOST_LINES)), None);
        assert_eq!(too_long(&"a\n".repeat(MOST_LINES + 1)), Some(MOST_LINES + 1));
    }

    #[test]
    fn folders_of_a_machine_are_caught() {
        for root in ["work", "root", "home", "Users"] {
            for line in [format!("see /{root}/abbe/x.csv"), format!("\"/{root}/x\""), format!("a=/{root}/x")] {
                assert_eq!(machine_paths(&format!("fine\n{line}")), [Found { line: 2, what: line.clone() }]);
            }
            for line in [format!("https://example.org/{root}/x"), format!("target/{root}/x"), format!("/{root}ing")] {
                assert!(machine_paths(&line).is_empty(), "{line}");
            }
        }
    }
}
