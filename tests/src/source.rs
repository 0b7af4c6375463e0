//! Rust source as tokens, without comments, and without what is compiled for tests only.
//!
//! Place in the flow: text of one file in, [`Source`] out, judged by [`crate::rules`]. Tokens instead of text, so
//! that a word in a comment or a message is never taken for code, and code inside a macro call is never missed.

use proc_macro2::{Delimiter, Group, Spacing, TokenStream, TokenTree};

/// One file, ready to be judged.
#[derive(Debug, Clone)]
pub struct Source {
    /// Every token.
    all: TokenStream,
    /// Tokens that are compiled outside tests.
    pub(crate) production: TokenStream,
}

/// Something found, and the line it stands on.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Found {
    /// Line, from 1.
    pub line: usize,
    /// What it says.
    pub what: String,
}

impl Source {
    /// Takes a file apart; a file that is no Rust is an error.
    pub fn parse(text: &str) -> Result<Source, String> {
        let all: TokenStream = text.parse().map_err(|error| format!("no Rust: {error}"))?;
        Ok(Source { production: without_tests(all.clone()), all })
    }

    /// Paths such as `std::fs::read` in production code; those of a `use` tree one by one.
    pub fn paths(&self) -> Vec<Found> {
        let mut found = Vec::new();
        collect_paths(&trees(&self.production), "", &mut found);
        found
    }

    /// Names of macros called in production code.
    pub fn macros(&self) -> Vec<Found> {
        let mut found = Vec::new();
        each_level(&self.production, &mut |level| {
            for window in level.windows(3) {
                if let [TokenTree::Ident(name), bang, TokenTree::Group(_)] = window
                    && is_punct(bang, '!')
                {
                    found.push(Found { line: name.span().start().line, what: name.to_string() });
                }
            }
        });
        found
    }

    /// Names of methods called in production code.
    pub fn methods(&self) -> Vec<Found> {
        let mut found = Vec::new();
        each_level(&self.production, &mut |level| {
            for window in level.windows(3) {
                if let [dot, TokenTree::Ident(name), TokenTree::Group(arguments)] = window
                    && is_punct(dot, '.')
                    && arguments.delimiter() == Delimiter::Parenthesis
                {
                    found.push(Found { line: name.span().start().line, what: name.to_string() });
                }
            }
        });
        found
    }

    /// Identifiers and the contents of plain string literals in production code.
    pub fn words(&self) -> Vec<Found> {
        let mut found = Vec::new();
        each_level(&self.production, &mut |level| {
            for tree in level {
                let what = match tree {
                    TokenTree::Ident(name) => name.to_string(),
                    TokenTree::Literal(literal) => literal.to_string().trim_matches('"').to_owned(),
                    _ => continue,
                };
                found.push(Found { line: tree.span().start().line, what });
            }
        });
        found
    }

    /// First words of all attributes, those of tests too.
    pub fn attributes(&self) -> Vec<Found> {
        let mut found = Vec::new();
        each_level(&self.all, &mut |level| {
            for window in level.windows(2) {
                if let [hash, TokenTree::Group(group)] = window
                    && is_punct(hash, '#')
                    && group.delimiter() == Delimiter::Bracket
                    && let Some(TokenTree::Ident(name)) = group.stream().into_iter().next()
                {
                    found.push(Found { line: name.span().start().line, what: name.to_string() });
                }
            }
        });
        found
    }

    /// Files that this one includes for tests only: `#[cfg(test)] mod name;`, by name or by `#[path]`.
    pub fn test_modules(&self) -> Vec<String> {
        let level = trees(&self.all);
        let starts = (0..level.len()).filter(|k| test_attribute_at(&level, *k));
        starts.filter_map(|k| module_file(&level[k..=item_end(&level, k).min(level.len() - 1)])).collect()
    }

    /// Values of the string constants `const NAME: &str = "value"` in production code, with their names.
    pub fn string_constants(&self) -> Vec<(String, String)> {
        let mut found = Vec::new();
        each_level(&self.production, &mut |level| {
            for (k, tree) in level.iter().enumerate() {
                let is_const = matches!(tree, TokenTree::Ident(word) if word == "const");
                let Some(TokenTree::Ident(name)) = level.get(k + 1).filter(|_| is_const) else { continue };
                let value = level[k..].iter().take_while(|tree| !is_punct(tree, ';')).find_map(|tree| match tree {
                    TokenTree::Literal(literal) => Some(literal.to_string()),
                    _ => None,
                });
                if let Some(text) = value.as_deref().and_then(|v| v.strip_prefix('"')?.strip_suffix('"')) {
                    found.push((name.to_string(), text.to_owned()));
                }
            }
        });
        found
    }

    /// Names of the variants of an enum, in order; `None` where there is no such enum.
    pub fn variants(&self, enumeration: &str) -> Option<Vec<String>> {
        let body = self.body_after(&["enum", enumeration])?;
        let mut names = Vec::new();
        let mut at_start = true;
        let mut level = trees(&body).into_iter().peekable();
        while let Some(tree) = level.next() {
            match tree {
                TokenTree::Punct(ref p) if p.as_char() == '#' => drop(level.next()),
                TokenTree::Punct(ref p) if p.as_char() == ',' => at_start = true,
                TokenTree::Ident(name) if at_start => {
                    names.push(name.to_string());
                    at_start = false;
                }
                _ => {}
            }
        }
        Some(names)
    }

    /// Paths inside the body of a function of this file; `None` where there is no such function.
    pub fn paths_in_function(&self, function: &str) -> Option<Vec<Found>> {
        let mut found = Vec::new();
        collect_paths(&trees(&self.body_after(&["fn", function])?), "", &mut found);
        Some(found)
    }

    /// Names of the fields of all structs of this file that are `pub`.
    pub fn public_fields(&self) -> Vec<String> {
        let mut names = Vec::new();
        each_level(&self.production, &mut |level| {
            for window in level.windows(4) {
                if let [TokenTree::Ident(word), TokenTree::Ident(name), colon, next] = window
                    && word == "pub"
                    && is_punct(colon, ':')
                    && !is_punct(next, ':')
                {
                    names.push(name.to_string());
                }
            }
        });
        names
    }

    /// The first braces after these two words at the top level of the file.
    fn body_after(&self, words: &[&str; 2]) -> Option<TokenStream> {
        let level = trees(&self.production);
        let is = |tree: &TokenTree, word: &str| matches!(tree, TokenTree::Ident(name) if name == word);
        let at = level.windows(2).position(|pair| is(&pair[0], words[0]) && is(&pair[1], words[1]))?;
        level[at..].iter().find_map(|tree| match tree {
            TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => Some(group.stream()),
            _ => None,
        })
    }
}

pub(crate) fn trees(stream: &TokenStream) -> Vec<TokenTree> {
    stream.clone().into_iter().collect()
}

pub(crate) fn is_punct(tree: &TokenTree, character: char) -> bool {
    matches!(tree, TokenTree::Punct(punct) if punct.as_char() == character)
}

/// Shows `see` the tokens of every nesting level.
fn each_level(stream: &TokenStream, see: &mut impl FnMut(&[TokenTree])) {
    let level = trees(stream);
    see(&level);
    for tree in &level {
        if let TokenTree::Group(group) = tree {
            each_level(&group.stream(), see);
        }
    }
}

/// Leaves out every item behind `#[cfg(test)]` or `#[test]`.
fn without_tests(stream: TokenStream) -> TokenStream {
    let level = trees(&stream);
    let mut kept = Vec::new();
    let mut k = 0;
    while k < level.len() {
        if test_attribute_at(&level, k) {
            k = item_end(&level, k) + 1;
            continue;
        }
        kept.push(match &level[k] {
            TokenTree::Group(group) => {
                let mut inner = Group::new(group.delimiter(), without_tests(group.stream()));
                inner.set_span(group.span());
                TokenTree::Group(inner)
            }
            other => other.clone(),
        });
        k += 1;
    }
    kept.into_iter().collect()
}

fn test_attribute_at(level: &[TokenTree], k: usize) -> bool {
    let (Some(hash), Some(TokenTree::Group(group))) = (level.get(k), level.get(k + 1)) else { return false };
    let words = group.stream().to_string().replace(' ', "");
    is_punct(hash, '#') && (words == "cfg(test)" || words == "test")
}

/// Last token of the item that the attribute at `k` belongs to: its braces, or its semicolon.
fn item_end(level: &[TokenTree], k: usize) -> usize {
    let ends = |tree: &TokenTree| {
        let braces = matches!(tree, TokenTree::Group(group) if group.delimiter() == Delimiter::Brace);
        braces || is_punct(tree, ';')
    };
    (k..level.len()).find(|end| ends(&level[*end])).unwrap_or(level.len())
}

/// The file of `mod name;`, which an item of tokens may be.
fn module_file(item: &[TokenTree]) -> Option<String> {
    if !is_punct(item.last()?, ';') {
        return None;
    }
    let path = item.iter().find_map(|tree| match tree {
        TokenTree::Group(group) => group
            .stream()
            .to_string()
            .strip_prefix("path = \"")
            .and_then(|rest| rest.strip_suffix('"'))
            .map(str::to_owned),
        _ => None,
    });
    let name = item.windows(2).find_map(|pair| match pair {
        [TokenTree::Ident(word), TokenTree::Ident(name)] if word == "mod" => Some(format!("{name}.rs")),
        _ => None,
    });
    name.map(|name| path.unwrap_or(name))
}

/// Every path of a level and below, `prefix` before each of its first words.
fn collect_paths(level: &[TokenTree], prefix: &str, found: &mut Vec<Found>) {
    let mut k = 0;
    while k < level.len() {
        match &level[k] {
            TokenTree::Ident(first) => {
                let mut path = format!("{prefix}{first}");
                let line = first.span().start().line;
                k += 1;
                while joins(level, k) {
                    match level.get(k + 2) {
                        Some(TokenTree::Ident(next)) => path = format!("{path}::{next}"),
                        Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Brace => {
                            collect_paths(&trees(&group.stream()), &format!("{path}::"), found);
                        }
                        _ => break,
                    }
                    k += 3;
                }
                found.push(Found { line, what: path });
            }
            TokenTree::Group(group) => {
                collect_paths(&trees(&group.stream()), "", found);
                k += 1;
            }
            _ => k += 1,
        }
    }
}

/// Whether a path goes on here by `::`.
pub(crate) fn joins(level: &[TokenTree], k: usize) -> bool {
    let first =
        matches!(level.get(k), Some(TokenTree::Punct(p)) if p.as_char() == ':' && p.spacing() == Spacing::Joint);
    first && level.get(k + 1).is_some_and(|tree| is_punct(tree, ':'))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whats(found: Vec<Found>) -> Vec<String> {
        found.into_iter().map(|found| found.what).collect()
    }

    #[test]
    fn paths_of_a_use_tree_are_told_apart() {
        let source = Source::parse("use std::{fs, io::{Read, Write}, time::Duration};").unwrap();
        let paths = whats(source.paths());
        for path in ["std::fs", "std::io::Read", "std::io::Write", "std::time::Duration"] {
            assert!(paths.contains(&path.to_owned()), "{path} in {paths:?}");
        }
    }

    #[test]
    fn code_for_tests_is_left_out_wherever_it_stands() {
        let text = "fn a() { b.unwrap(); }\n#[cfg(test)]\nmod tests { fn c() { d.expect(\"e\"); } }\n\
                    impl X { #[cfg(test)] fn f() { panic!() } fn g() { todo!() } }\n#[cfg(test)]\nuse h::i;\nfn j() {}";
        let source = Source::parse(text).unwrap();
        assert_eq!(whats(source.methods()), ["unwrap"]);
        assert_eq!(whats(source.macros()), ["todo"]);
        assert!(!whats(source.words()).contains(&"h".to_owned()));
        assert!(whats(source.words()).contains(&"j".to_owned()), "what follows a test item is kept");
    }

    #[test]
    fn comments_and_messages_are_no_code_but_macro_arguments_are() {
        let text = "/// call unwrap()\nfn a() { log!(\"x.unwrap()\", b.unwrap()); } // todo!()";
        let source = Source::parse(text).unwrap();
        assert_eq!(source.methods(), [Found { line: 2, what: "unwrap".to_owned() }]);
        assert_eq!(whats(source.macros()), ["log"]);
    }

    #[test]
    fn modules_for_tests_are_named() {
        let text =
            "mod a;\n#[cfg(test)]\nmod b;\n#[cfg(test)]\n#[path = \"c_tests.rs\"]\nmod tests;\n#[cfg(test)]\nmod d {}";
        assert_eq!(Source::parse(text).unwrap().test_modules(), ["b.rs", "c_tests.rs"]);
    }

    #[test]
    fn constants_variants_and_fields_are_found() {
        let text = "pub const A: &str = \"x/y\";\n#[derive(B)]\npub enum E { #[c] One { file: P }, Two }\n\
                    pub struct S { pub seed: u64, hidden: u8 }\nfn open() { E::One => d(), }";
        let source = Source::parse(text).unwrap();
        assert_eq!(source.string_constants(), [("A".to_owned(), "x/y".to_owned())]);
        assert_eq!(source.variants("E").unwrap(), ["One", "Two"]);
        assert_eq!(source.public_fields(), ["seed"]);
        assert!(whats(source.paths_in_function("open").unwrap()).contains(&"E::One".to_owned()));
        assert_eq!(source.variants("F"), None);
    }
}
