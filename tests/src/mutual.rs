//! Files of one crate that use each other.
//!
//! Place in the flow: the sources of one crate by module in, pairs of them that name each other out. Neither of such a pair is read,
//! tested or moved without the other. A file and those below it are one thing, and no pair. Names are followed through what `mod.rs`
//! and `lib.rs` pass on, so that a way around by the parent hides nothing. Code for tests is left out.

use crate::named::Named;
use crate::source::Source;
use std::collections::{BTreeMap, BTreeSet};

/// Pairs that there are, as crate, file, file and why: no others may come, and one that is gone leaves the list.
pub const THERE_ARE: [(&str, &str, &str, &str); 21] = [
    ("models/diagnose", "context", "lags", "what varies names what lags, which is looked for in what varies"),
    ("models/diagnose", "diagnose", "together", "the diagnosis adds pairs, which are told by its own measure"),
    ("models/diagnose", "exchange", "search", "a search exchanges what it found, by searches of its own"),
    ("models/diagnose", "search", "serial", "a search tries what goes on serially, by its own rounds"),
    ("models/diagnose", "search", "step", "a step is taken on the state of the search"),
    ("models/diagnose", "search", "within_stations", "a search asks what stations say alone, by its own rounds"),
    (
        "models/diagnose",
        "study::filters",
        "study::series",
        "filters are made by the description of the noise that is fitted through them",
    ),
    ("models/diagnose", "study::fit", "study::view", "a view is what a fit leaves, and fits anew"),
    ("models/diagnose", "study::view", "study::waves", "a view finds its best wave by fits of views"),
    (
        "msgs",
        "bag::convert",
        "bag::metadata",
        "what is refused by its metadata is refused with its conversion, which reads their name",
    ),
    ("nodes/graph", "again", "driver", "a driver plays another one again"),
    (
        "nodes/graph",
        "driver::ippdme::mover",
        "driver::ippdme::session",
        "the session's thread obeys the mover, who reads its talk",
    ),
    ("nodes/opcua", "client", "session", "a client runs a session on what it asks"),
    ("nodes/opcua", "cnc", "session", "a session reads a controller, whose reads end as its own do"),
    ("nodes/runtime", "ros::diagnostics", "ros::node", "a node opens it, and it holds the node"),
    ("nodes/runtime", "ros::node", "ros::parameter_services", "a node opens them, and they hold its options"),
    ("nodes/runtime", "ros::node", "ros::queued", "a node opens it, and it holds the node"),
    ("nodes/runtime", "ros::node", "ros::trigger", "a node opens it, and it holds the node"),
    ("nodes/runtime", "ros::node", "ros::writer", "a node opens it, and it holds the node"),
    (
        "nodes/runtime",
        "transport::zenoh::publisher",
        "transport::zenoh::session",
        "a session opens it, and words its errors",
    ),
    (
        "nodes/runtime",
        "transport::zenoh::session",
        "transport::zenoh::subscriber",
        "a session opens it, and words its errors",
    ),
];
/// So often a name is passed on at most.
const LONGEST_WAY: usize = 8;

type Module = Vec<String>;

/// The sources of one crate, by the path from its `src` folder, without the ending.
#[derive(Debug, Default)]
pub struct Modules(BTreeMap<Module, Vec<Named>>);

impl Modules {
    /// Adds a file.
    pub fn add(&mut self, path: &str, source: &Source) {
        let mut words: Module = path.split('/').map(str::to_owned).collect();
        let is_of_its_folder = |word: &String| ["mod", "lib", "main"].contains(&word.as_str());
        words.pop_if(|last| is_of_its_folder(last));
        self.0.entry(words).or_default().extend(Named::all(source));
    }

    /// Pairs that use each other, as paths of modules in the order of the alphabet.
    pub fn pairs(&self) -> BTreeSet<(String, String)> {
        let used: BTreeMap<&Module, BTreeSet<Module>> =
            self.0.keys().map(|module| (module, self.used_by(module))).collect();
        let mut pairs = BTreeSet::new();
        for (one, others) in &used {
            for other in others.iter().filter(|other| *other > *one && !other.starts_with(one)) {
                if used[&other].contains(*one) {
                    pairs.insert((one.join("::"), other.join("::")));
                }
            }
        }
        pairs
    }

    fn used_by(&self, module: &Module) -> BTreeSet<Module> {
        let is_own = |named: &&Named| named.is_use || ["crate", "self", "super"].contains(&named.path[0].as_str());
        let own = self.0[module].iter().filter(is_own);
        own.flat_map(|named| self.targets(module, &named.path, LONGEST_WAY)).collect()
    }

    /// The file that holds what `path` names in the file `from`; none where that is of another crate, several where another one is
    /// taken for another platform.
    fn targets(&self, from: &Module, path: &[String], way: usize) -> Vec<Module> {
        let within = |module: &Module, word: &String| -> Module { module.iter().chain([word]).cloned().collect() };
        let passed_on = |module: &Module, word: &String| -> Vec<&Named> {
            let all = self.0.get(module).into_iter().flatten();
            all.filter(|named| named.passed_on_as.as_ref() == Some(word)).collect()
        };
        let ups = path.iter().take_while(|word| *word == "super").count();
        let (mut at, rest) = match path {
            [first, rest @ ..] if first == "crate" => (Vec::new(), rest),
            [first, rest @ ..] if first == "self" => (from.clone(), rest),
            [first, ..] if first == "super" => (from[..from.len().saturating_sub(ups)].to_vec(), &path[ups..]),
            [first, ..] if self.0.contains_key(&within(from, first)) || !passed_on(from, first).is_empty() => {
                (from.clone(), path)
            }
            _ => return Vec::new(),
        };
        for (k, word) in rest.iter().enumerate() {
            let below = within(&at, word);
            if self.0.contains_key(&below) {
                at = below;
                continue;
            }
            let passed_on = passed_on(&at, word);
            if passed_on.is_empty() {
                break;
            }
            let Some(way) = way.checked_sub(1) else { return Vec::new() };
            let whole = |named: &Named| named.path.iter().chain(&rest[k + 1..]).cloned().collect::<Vec<String>>();
            return passed_on.into_iter().flat_map(|named| self.targets(&at, &whole(named), way)).collect();
        }
        if self.0.contains_key(&at) { vec![at] } else { Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(files: &[(&str, &str)]) -> Vec<(String, String)> {
        let mut modules = Modules::default();
        files.iter().for_each(|(path, text)| modules.add(path, &Source::parse(text).unwrap()));
        modules.pairs().into_iter().collect()
    }

    fn pair(one: &str, other: &str) -> Vec<(String, String)> {
        vec![(one.to_owned(), other.to_owned())]
    }

    #[test]
    fn files_that_use_each_other_are_caught_however_they_name_each_other() {
        let lib = ("lib", "mod a; mod b;");
        let b = "fn h() { crate::a::f() }";
        for a in ["use crate::b;", "use crate::{c::D, b::{self, E}};", "use super::b::E;", "fn f() { super::b::g() }"] {
            assert_eq!(pairs(&[lib, ("a", a), ("b", b)]), pair("a", "b"), "{a}");
        }
        assert!(pairs(&[lib, ("a", "use other::b; use nalgebra;"), ("b", b)]).is_empty(), "another crate");
        assert!(pairs(&[lib, ("a", ""), ("b", b)]).is_empty(), "one way");
        let in_a_test = "#[cfg(test)]\nmod tests { use crate::b; }";
        assert!(pairs(&[lib, ("a", in_a_test), ("b", b)]).is_empty(), "in a test");
    }

    #[test]
    fn a_way_around_by_the_parent_hides_nothing() {
        let files = [
            ("lib", "mod x; pub use x::E;"),
            (
                "x/mod",
                "mod a; mod b; mod c; use a::{D as F}; pub use c::E; pub use b::E; use std::fmt; pub use self::fmt as shown;",
            ),
            ("x/a", "pub struct D; use crate::E; use super::shown;"),
            ("x/b", "pub struct E; use super::F;"),
            ("x/c", "pub struct E;"),
        ];
        assert_eq!(pairs(&files), pair("x::a", "x::b"));
    }

    #[test]
    fn a_file_and_what_lies_below_it_are_no_pair() {
        let files = [("lib", "mod x; fn f() {}"), ("x", "mod a; use a::D;"), ("x/a", "use super::E; use crate::f;")];
        assert!(pairs(&files).is_empty());
    }
}
