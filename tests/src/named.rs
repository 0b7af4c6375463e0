//! Paths as code names them, those of `use` told apart.
//!
//! Place in the flow: production code of one file in, what it names out, for [`crate::mutual`].

use crate::source::{Source, is_punct, joins, trees};
use proc_macro2::TokenTree;

/// A path as code names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Its words.
    pub path: Vec<String>,
    /// Whether it is a leaf of a `use`.
    pub is_use: bool,
    /// Under which name a `use` at the top of the file passes it on.
    pub passed_on_as: Option<String>,
}

impl Named {
    /// Every path in the production code of a file. Those of a `use` tree come one by one, and what they have in common not at all.
    pub fn all(source: &Source) -> Vec<Named> {
        let mut found = Vec::new();
        collect(&trees(&source.production), true, &mut found);
        found
    }
}

/// Every path of a level and below; `at_top` where it is that of the file.
fn collect(level: &[TokenTree], at_top: bool, found: &mut Vec<Named>) {
    let is_word = |k: usize, word: &str| matches!(level.get(k), Some(TokenTree::Ident(name)) if name == word);
    let mut k = 0;
    while k < level.len() {
        match &level[k] {
            // `use<…>` of a return type is no import.
            TokenTree::Ident(_) if is_word(k, "use") && !level.get(k + 1).is_some_and(|next| is_punct(next, '<')) => {
                let end = (k..level.len()).find(|end| is_punct(&level[*end], ';')).unwrap_or(level.len());
                use_tree(&level[k + 1..end], &[], at_top, found);
                k = end + 1;
            }
            TokenTree::Ident(first) => {
                let mut path = vec![first.to_string()];
                k += 1;
                while let (true, Some(TokenTree::Ident(next))) = (joins(level, k), level.get(k + 2)) {
                    path.push(next.to_string());
                    k += 3;
                }
                found.push(Named { path, is_use: false, passed_on_as: None });
            }
            TokenTree::Group(group) => {
                collect(&trees(&group.stream()), false, found);
                k += 1;
            }
            _ => k += 1,
        }
    }
}

/// The leaves of a `use` tree behind the words of `prefix`.
fn use_tree(tree: &[TokenTree], prefix: &[String], at_top: bool, found: &mut Vec<Named>) {
    let (mut path, mut alias, mut tokens) = (prefix.to_vec(), None, tree.iter().peekable());
    while let Some(token) = tokens.next() {
        match token {
            TokenTree::Ident(word) if word == "as" => alias = tokens.peek().map(ToString::to_string),
            TokenTree::Ident(_) if alias.is_some() => {}
            // The folder itself, inside its braces.
            TokenTree::Ident(word) if word == "self" && !prefix.is_empty() => {}
            TokenTree::Ident(word) => path.push(word.to_string()),
            TokenTree::Group(group) => {
                let inside = trees(&group.stream());
                inside.split(|token| is_punct(token, ',')).for_each(|leaf| use_tree(leaf, &path, at_top, found));
                return;
            }
            _ => {}
        }
    }
    if !tree.is_empty() {
        let name = alias.or_else(|| path.last().cloned());
        found.push(Named { path, is_use: true, passed_on_as: name.filter(|_| at_top) });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaves_of_a_use_tree_have_the_names_that_they_are_passed_on_by() {
        let source = Source::parse(
            "use a::{self, b::{C, D as E}};\nfn f() { use g::H; i::J::k() }\nfn l() -> impl M + use<> {}",
        );
        let named = Named::all(&source.unwrap());
        let leaf = |path: &str| named.iter().find(|named| named.path.join("::") == path).unwrap();
        for (path, name) in [("a", "a"), ("a::b::C", "C"), ("a::b::D", "E")] {
            assert!(leaf(path).is_use && leaf(path).passed_on_as.as_deref() == Some(name), "{path}");
        }
        assert!(leaf("g::H").is_use && leaf("g::H").passed_on_as.is_none(), "inside a function");
        assert!(!leaf("i::J::k").is_use && !leaf("M").is_use);
        assert!(!named.iter().any(|named| named.path.join("::") == "a::b"), "what leaves have in common");
    }
}
