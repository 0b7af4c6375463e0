//! From the name in the code to the name in the graph: `~`, namespace, remapping.
//!
//! Place in the flow: every topic and service of a node passes [`resolve`] once. Names handed to
//! the DDS library are always absolute: it leaves `~` alone and makes `rt//name` of a relative name
//! in the root namespace.

use thiserror::Error;

/// A name that ROS 2 does not allow.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "'{name}' is not a ROS 2 name ({reason}); use parts of letters, digits and single underscores, \
     separated by '/'"
)]
pub struct NameError {
    /// The name.
    pub name: String,
    /// What is wrong with it.
    pub reason: &'static str,
}

/// The name of a node in the graph, after remapping.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeIdentity {
    /// Absolute; `/` is the root.
    pub namespace: String,
    /// Without a slash.
    pub name: String,
}

impl NodeIdentity {
    /// The identity of a node called `name` in `namespace`.
    ///
    /// # Errors
    /// When either is not a ROS 2 name.
    pub fn new(namespace: &str, name: &str) -> Result<Self, NameError> {
        check_part(name).map_err(|reason| error(name, reason))?;
        let namespace = format!("/{}", namespace.trim_start_matches('/'));
        if namespace != "/" {
            check_absolute(&namespace)?;
        }
        Ok(Self { namespace, name: name.to_owned() })
    }

    /// Namespace and name together, absolute.
    #[must_use]
    pub fn qualified(&self) -> String {
        join(&self.namespace, &self.name)
    }
}

/// `[node:]from:=to`.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct RemapRule {
    /// The node it is meant for; none means all.
    pub node: Option<String>,
    /// Name in the code.
    pub from: String,
    /// Name in the graph.
    pub to: String,
}

impl RemapRule {
    /// Whether the rule is meant for this node.
    #[must_use]
    pub fn applies_to(&self, node: &NodeIdentity) -> bool {
        self.node.as_ref().is_none_or(|name| *name == node.name)
    }
}

/// The absolute name in the graph of what the node calls `name`: expanded, then remapped by the
/// first rule that fits.
///
/// # Errors
/// When the name, or what a rule makes of it, is not a ROS 2 name.
pub fn resolve(name: &str, node: &NodeIdentity, rules: &[RemapRule]) -> Result<String, NameError> {
    let expanded = expand(name, node)?;
    for rule in rules.iter().filter(|rule| rule.applies_to(node)) {
        if expand(&rule.from, node)? == expanded {
            return expand(&rule.to, node);
        }
    }
    Ok(expanded)
}

fn expand(name: &str, node: &NodeIdentity) -> Result<String, NameError> {
    let absolute = if name.starts_with('/') {
        name.to_owned()
    } else if let Some(private) = name.strip_prefix("~/") {
        join(&node.qualified(), private)
    } else if name == "~" {
        node.qualified()
    } else {
        join(&node.namespace, name)
    };
    check_absolute(&absolute).map_err(|found| error(name, found.reason))?;
    Ok(absolute)
}

fn join(namespace: &str, name: &str) -> String {
    format!("{}/{name}", namespace.trim_end_matches('/'))
}

fn check_absolute(name: &str) -> Result<(), NameError> {
    let relative = name.strip_prefix('/').unwrap_or(name);
    for part in relative.split('/') {
        check_part(part).map_err(|reason| error(name, reason))?;
    }
    Ok(())
}

pub(super) fn check_part(part: &str) -> Result<(), &'static str> {
    if part.is_empty() {
        return Err("a part is empty");
    }
    if part.starts_with(|first: char| first.is_ascii_digit()) {
        return Err("a part begins with a digit");
    }
    if part.contains("__") {
        return Err("two underscores follow each other");
    }
    if !part.chars().all(|one| one.is_ascii_alphanumeric() || one == '_') {
        return Err("it contains another character");
    }
    Ok(())
}

fn error(name: &str, reason: &'static str) -> NameError {
    NameError { name: name.to_owned(), reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rule(node: Option<&str>, from: &str, to: &str) -> RemapRule {
        RemapRule { node: node.map(str::to_owned), from: from.to_owned(), to: to.to_owned() }
    }

    #[test]
    fn names_are_expanded_as_in_ros() {
        let node = NodeIdentity::new("/cmm", "geometric").unwrap();
        let root = NodeIdentity::new("/", "geometric").unwrap();
        for (name, in_cmm, in_root) in [
            ("scale", "/cmm/scale", "/scale"),
            ("/scale", "/scale", "/scale"),
            ("~/model", "/cmm/geometric/model", "/geometric/model"),
            ("~", "/cmm/geometric", "/geometric"),
            ("a/b_1", "/cmm/a/b_1", "/a/b_1"),
        ] {
            assert_eq!(resolve(name, &node, &[]).unwrap(), in_cmm);
            assert_eq!(resolve(name, &root, &[]).unwrap(), in_root);
        }
    }

    #[test]
    fn the_first_rule_that_fits_counts_and_others_nodes_rules_do_not() {
        let node = NodeIdentity::new("/cmm", "geometric").unwrap();
        let rules = [
            rule(Some("tracer"), "scale", "wrong"),
            rule(Some("geometric"), "scale", "/left/scale"),
            rule(None, "scale", "late"),
            rule(None, "/cmm/corrected", "better"),
        ];
        assert_eq!(resolve("scale", &node, &rules).unwrap(), "/left/scale");
        assert_eq!(resolve("corrected", &node, &rules).unwrap(), "/cmm/better");
    }

    #[test]
    fn what_ros_does_not_allow_is_refused() {
        let node = NodeIdentity::new("/", "n").unwrap();
        for name in ["", "/", "a//b", "a/", "1a", "a__b", "a-b", "ä", "~x", "a b"] {
            assert!(resolve(name, &node, &[]).is_err(), "{name:?} was accepted");
        }
        for name in ["", "a/b", "1", "a b"] {
            assert!(NodeIdentity::new("/", name).is_err(), "{name:?} was accepted");
        }
        assert!(NodeIdentity::new("/a//b", "n").is_err());
    }
}
