//! Which nodes a value of a parameter is meant for: a node's name, its absolute name, or a pattern of it.
//!
//! Place in the flow: read of parameter files ([`super::yaml`]) and of `-p` ([`super::args`]), asked by
//! [`super::parameters`]. As in ROS 2 a pattern is of absolute names, with or without the slash in front: `*` is one part
//! of a name, `**` any number of them. A name alone, without a slash, is that of a node in any namespace.

use super::names::{NameError, NodeIdentity, check_part};

const ONE_PART: &str = "*";
const MANY_PARTS: &str = "**";

/// Nodes, by their names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Meant {
    parts: Vec<Part>,
    is_for_many: bool,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Part {
    /// This one.
    Named(String),
    /// Any one.
    One,
    /// Any number.
    Many,
}

impl Meant {
    /// What `text` names.
    ///
    /// # Errors
    /// When no node can have such a name, and it is no pattern.
    pub fn parse(text: &str) -> Result<Meant, NameError> {
        let refused = |reason| NameError { name: text.to_owned(), reason };
        let part = |part: &str| match part {
            ONE_PART => Ok(Part::One),
            MANY_PARTS => Ok(Part::Many),
            _ if part.contains('*') => Err(refused("a star is a whole part: * any one, ** any number of parts")),
            _ => check_part(part).map(|()| Part::Named(part.to_owned())).map_err(refused),
        };
        let absolute = text.strip_prefix('/');
        let relative = absolute.unwrap_or(text);
        let mut parts =
            relative.strip_suffix('/').unwrap_or(relative).split('/').map(part).collect::<Result<Vec<_>, _>>()?;
        if absolute.is_none() && matches!(parts[..], [Part::Named(_)]) {
            parts.insert(0, Part::Many);
        }
        Ok(Meant { parts, is_for_many: text.contains('*') })
    }

    /// Every node.
    #[must_use]
    pub fn every_node() -> Meant {
        Meant { parts: vec![Part::Many], is_for_many: true }
    }

    /// Whether this node is one of them.
    #[must_use]
    pub fn fits(&self, node: &NodeIdentity) -> bool {
        let qualified = node.qualified();
        let parts: Vec<Part> = qualified.split('/').skip(1).map(|part| Part::Named(part.to_owned())).collect();
        share(&self.parts, &parts)
    }

    /// Whether a node may be both one of these and one of those.
    pub(super) fn overlaps(&self, other: &Meant) -> bool {
        share(&self.parts, &other.parts)
    }

    /// Whether it is a pattern.
    #[must_use]
    pub fn is_for_many(&self) -> bool {
        self.is_for_many
    }

    /// What sorts the more special behind: names behind patterns, and among either those that name more parts.
    pub(super) fn rank(&self) -> impl Ord + use<> {
        let count = |wanted: fn(&Part) -> bool| self.parts.iter().filter(|part| wanted(part)).count();
        let many = count(|part| *part == Part::Many);
        let named = count(|part| matches!(part, Part::Named(_)));
        (!self.is_for_many, named, count(|part| *part == Part::One), many == 0)
    }
}

/// Whether there is a name that fits both.
fn share(one: &[Part], other: &[Part]) -> bool {
    // Whether the ends from here and from there share a name, from the last part on.
    let mut ends = vec![vec![false; other.len() + 1]; one.len() + 1];
    for here in (0..=one.len()).rev() {
        for there in (0..=other.len()).rev() {
            ends[here][there] = match (one.get(here), other.get(there)) {
                (None, None) => true,
                (Some(Part::Many), _) if ends[here + 1][there] => true,
                (_, Some(Part::Many)) if ends[here][there + 1] => true,
                (Some(Part::Many), Some(_)) => ends[here][there + 1],
                (Some(_), Some(Part::Many)) => ends[here + 1][there],
                (Some(first), Some(second)) => {
                    (first == second || *first == Part::One || *second == Part::One) && ends[here + 1][there + 1]
                }
                (Some(_), None) | (None, Some(_)) => false,
            };
        }
    }
    ends[0][0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn meant(text: &str) -> Meant {
        Meant::parse(text).unwrap()
    }

    #[test]
    fn a_pattern_is_of_absolute_names_with_or_without_its_slash() {
        let node = NodeIdentity::new("/hall/cmm", "geometric").unwrap();
        for text in [
            "**",
            "/**",
            "/**/",
            "**/geometric",
            "/**/geometric",
            "hall/**",
            "/hall/**/",
            "hall/*/geometric",
            "/hall/cmm/*",
            "*/cmm/geometric",
            "/*/*/*",
            "**/**/geometric",
            "**/cmm/**",
            "geometric",
            "/hall/cmm/geometric",
            "hall/cmm/geometric",
        ] {
            assert!(meant(text).fits(&node), "{text}");
        }
        for text in
            ["*", "/*", "hall/*", "**/scale", "cmm/**", "/geometric", "*/geometric", "/hall/cmm", "cmm/geometric"]
        {
            assert!(!meant(text).fits(&node), "{text}");
        }
        let root = NodeIdentity::new("/", "geometric").unwrap();
        assert!(meant("*").fits(&root) && meant("/geometric").fits(&root) && !meant("*/geometric").fits(&root));
    }

    #[test]
    fn what_no_node_can_be_called_is_refused_with_the_reason() {
        for (text, reason) in [
            ("cmm*", "a star is a whole part"),
            ("/cmm*/x", "a star is a whole part"),
            ("***", "a star is a whole part"),
            ("a//b", "a part is empty"),
            ("", "a part is empty"),
            ("/", "a part is empty"),
            ("a b", "another character"),
            ("1a", "a digit"),
        ] {
            let told = Meant::parse(text).unwrap_err().to_string();
            assert!(told.contains(reason), "{text:?}: {told}");
        }
    }

    #[test]
    fn the_more_special_is_behind_and_patterns_overlap_where_a_name_fits_both() {
        let order = [
            "/**",
            "/**/*",
            "/*/*",
            "/**/geometric",
            "/*/geometric",
            "/hall/*/geometric",
            "geometric",
            "/geometric",
            "/cmm/geometric",
        ];
        assert!(order.windows(2).all(|pair| meant(pair[0]).rank() < meant(pair[1]).rank()));
        for (one, other, is_shared) in [
            ("/hall/**", "/**/geometric", true),
            ("/hall/*", "/*/geometric", true),
            ("/hall/*", "/yard/*", false),
            ("/hall/**", "/yard/**", false),
            ("/**/a/**", "/**/b/**", true),
            ("/*/x", "/**/y", false),
            ("/*", "/*/*", false),
        ] {
            assert_eq!(meant(one).overlaps(&meant(other)), is_shared, "{one} {other}");
            assert_eq!(meant(other).overlaps(&meant(one)), is_shared, "{other} {one}");
        }
    }
}
