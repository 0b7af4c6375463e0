//! Files of one crate that use each other, directly or by way of others.
//!
//! Place in the flow: the sources of one crate by module in, circles of them out. No file of a circle is read, tested or moved
//! without the others. A file and those below it are no circle, and a way that leads from one to the other is not followed. Names are
//! followed through what `mod.rs` and `lib.rs` pass on, so that a way around by the parent hides nothing. Code for tests is left out.

use crate::named::Named;
use crate::source::Source;
use std::collections::{BTreeMap, BTreeSet};

/// Circles that there are, as crate, files, how often one of them names another, and why: no others may come, none may grow or get denser,
/// and one that is smaller or gone is listed so.
pub const THERE_ARE: [(&str, &[&str], usize, &str); 10] = [
    ("models/diagnose", &["diagnose", "together"], 2, "the diagnosis adds pairs, which are told by its own measure"),
    (
        "models/diagnose",
        &["exchange", "search", "serial", "step", "within_stations"],
        10,
        "a search takes steps, exchanges what it found and asks stations alone, each by searches of its own",
    ),
    (
        "models/diagnose",
        &[
            "study::candidate",
            "study::fit",
            "study::outcome",
            "study::significance",
            "study::terms",
            "study::told",
            "study::view",
            "study::waves",
        ],
        20,
        "a candidate says what is told of it once it is found, by the view that it was found in",
    ),
    (
        "models/diagnose",
        &["study::filters", "study::series"],
        2,
        "filters are made by the description of the noise that is fitted through them",
    ),
    (
        "msgs",
        &["bag::convert", "bag::metadata"],
        2,
        "what is refused by its metadata is refused with its conversion, which reads their name",
    ),
    ("nodes/graph", &["again", "driver"], 2, "a driver plays another one again"),
    (
        "nodes/graph",
        &["driver::ippdme::mover", "driver::ippdme::session"],
        2,
        "the session's thread obeys the mover, who reads its talk",
    ),
    (
        "nodes/opcua",
        &["client", "cnc", "session"],
        4,
        "a client runs a session on what it asks, and the session reads a controller, whose reads end as its own do",
    ),
    (
        "nodes/runtime",
        &["ros::diagnostics", "ros::node", "ros::parameter_services", "ros::queued", "ros::trigger", "ros::writer"],
        13,
        "a node opens them, and they hold the node or its options",
    ),
    (
        "nodes/runtime",
        &["transport::zenoh::publisher", "transport::zenoh::session", "transport::zenoh::subscriber"],
        4,
        "a session opens them, and words their errors",
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

    /// Groups of files that lead to each other, directly or by way of others of the group, as paths of modules in the order of the alphabet, with
    /// how often one of the group names another.
    pub fn circles(&self) -> BTreeMap<Vec<String>, usize> {
        let is_of_one = |one: &Module, other: &Module| one.starts_with(other) || other.starts_with(one);
        let used = |module: &Module| -> BTreeSet<Module> {
            self.used_by(module).into_iter().filter(|other| !is_of_one(module, other)).collect()
        };
        let used: BTreeMap<&Module, BTreeSet<Module>> = self.0.keys().map(|module| (module, used(module))).collect();
        let reached = |module: &Module| {
            let (mut reached, mut open) = (BTreeSet::new(), vec![module.clone()]);
            while let Some(at) = open.pop() {
                let next = used[&at].iter().filter(|next| reached.insert((*next).clone()));
                open.extend(next.cloned().collect::<Vec<Module>>());
            }
            reached
        };
        let all: BTreeMap<&Module, BTreeSet<Module>> = self.0.keys().map(|module| (module, reached(module))).collect();
        let circle = |module: &&Module| {
            let files: Vec<&Module> = all[module].iter().filter(|other| all[other].contains(*module)).collect();
            let uses = files.iter().map(|one| used[one].iter().filter(|other| files.contains(other)).count()).sum();
            (files.iter().map(|file| file.join("::")).collect(), uses)
        };
        all.keys().filter(|module| all[*module].contains(**module)).map(circle).collect()
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

    fn circles(files: &[(&str, &str)]) -> Vec<Vec<String>> {
        let mut modules = Modules::default();
        files.iter().for_each(|(path, text)| modules.add(path, &Source::parse(text).unwrap()));
        modules.circles().into_keys().collect()
    }

    fn circle(files: &[&str]) -> Vec<Vec<String>> {
        vec![files.iter().map(|file| (*file).to_owned()).collect()]
    }

    #[test]
    fn files_that_use_each_other_are_caught_however_they_name_each_other() {
        let lib = ("lib", "mod a; mod b;");
        let b = "fn h() { crate::a::f() }";
        for a in ["use crate::b;", "use crate::{c::D, b::{self, E}};", "use super::b::E;", "fn f() { super::b::g() }"] {
            assert_eq!(circles(&[lib, ("a", a), ("b", b)]), circle(&["a", "b"]), "{a}");
        }
        assert!(circles(&[lib, ("a", "use other::b; use nalgebra;"), ("b", b)]).is_empty(), "another crate");
        assert!(circles(&[lib, ("a", ""), ("b", b)]).is_empty(), "one way");
        let in_a_test = "#[cfg(test)]\nmod tests { use crate::b; }";
        assert!(circles(&[lib, ("a", in_a_test), ("b", b)]).is_empty(), "in a test");
    }

    #[test]
    fn a_circle_is_caught_however_long() {
        let lib = ("lib", "mod a; mod b; mod c; mod d;");
        let files =
            [lib, ("a", "use crate::b;"), ("b", "use crate::c;"), ("c", "use crate::a;"), ("d", "use crate::a;")];
        assert_eq!(circles(&files), circle(&["a", "b", "c"]));
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
        assert_eq!(circles(&files), circle(&["x::a", "x::b"]));
    }

    #[test]
    fn a_file_and_what_lies_below_it_are_no_circle() {
        let files = [("lib", "mod x; fn f() {}"), ("x", "mod a; use a::D;"), ("x/a", "use super::E; use crate::f;")];
        assert!(circles(&files).is_empty());
    }
}
