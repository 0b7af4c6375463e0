//! Parameter values and parameter files in YAML, in the form of `ros2 param dump`.
//!
//! Place in the flow: read by [`super::args`], applied to the declared table by
//! [`super::parameters`]. Nested maps below `ros__parameters` become names with dots.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use thiserror::Error;

/// The key under which a file holds values for every node.
pub(super) const ANY_NODE: &str = "/**";

const PARAMETERS_KEY: &str = "ros__parameters";
/// Parts of a pattern.
const ONE_PART: &str = "*";
const MANY_PARTS: &str = "**";

/// A value a parameter can have.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum YamlValue {
    /// `true`, `false`.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number with point or exponent.
    Double(f64),
    /// Text.
    Text(String),
    /// `[true, false]`.
    Bools(Vec<bool>),
    /// `[1, 2]`.
    Integers(Vec<i64>),
    /// `[1.0, 2.5]`.
    Doubles(Vec<f64>),
    /// `[a, b]`.
    Texts(Vec<String>),
}

/// One value for one parameter of some nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterAssignment {
    /// A node's name, its absolute name, or a pattern of it: `/**` for all, `/*` for one part of a name.
    pub node: String,
    /// The parameter.
    pub name: String,
    /// Its value.
    pub value: YamlValue,
    /// Where it stands, for messages.
    pub origin: String,
}

impl ParameterAssignment {
    /// Whether it is meant for this node.
    #[must_use]
    pub fn applies_to(&self, node: &super::NodeIdentity) -> bool {
        let parts = |name: &str| name.split('/').skip(1).map(str::to_owned).collect::<Vec<_>>();
        let qualified = node.qualified();
        let fits = || self.is_for_many() && pattern_fits(&parts(&self.node), &parts(&qualified));
        self.node == node.name || self.node == qualified || fits()
    }

    /// Whether it is meant for whatever nodes a pattern fits.
    #[must_use]
    pub fn is_for_many(&self) -> bool {
        self.node.contains('*')
    }
}

/// Whether a name fits a pattern, part by part: `*` is one part, `**` any number of them.
fn pattern_fits(pattern: &[String], name: &[String]) -> bool {
    let Some((first, rest)) = pattern.split_first() else { return name.is_empty() };
    if first == MANY_PARTS {
        // Two in a row say no more than one.
        let rest = &rest[rest.iter().take_while(|part| *part == MANY_PARTS).count()..];
        return (0..=name.len()).any(|skipped| pattern_fits(rest, &name[skipped..]));
    }
    name.split_first().is_some_and(|(head, tail)| (first == ONE_PART || first == head) && pattern_fits(rest, tail))
}

/// Parameters that cannot be read.
#[derive(Debug, Error)]
pub enum YamlError {
    /// The file itself.
    #[error("parameter file {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Its text.
    #[error("parameter file {path}: {reason}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, and what is wrong.
        reason: String,
    },
    /// The shape of its maps.
    #[error("parameter file {path}: '{key}' {problem}")]
    Shape {
        /// The file.
        path: PathBuf,
        /// Keys down to the place.
        key: String,
        /// What is wrong there.
        problem: &'static str,
    },
    /// A value on the command line.
    #[error("parameter {name}: '{text}' is not a value ({reason})")]
    Value {
        /// The parameter.
        name: String,
        /// The text.
        text: String,
        /// What is wrong.
        reason: String,
    },
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Tree {
    Value(YamlValue),
    Map(BTreeMap<String, Tree>),
}

/// The value that a text on the command line stands for.
pub(super) fn parse_value(name: &str, text: &str) -> Result<YamlValue, YamlError> {
    serde_saphyr::from_str(text).map_err(|error| YamlError::Value {
        name: name.to_owned(),
        text: text.to_owned(),
        reason: error.to_string(),
    })
}

/// All assignments of a parameter file: those for every node first, then those of other patterns, so that those for one
/// node count.
pub(super) fn read_file(path: &Path) -> Result<Vec<ParameterAssignment>, YamlError> {
    let text = std::fs::read_to_string(path).map_err(|source| YamlError::Read { path: path.to_owned(), source })?;
    parse_file(path, &text)
}

fn parse_file(path: &Path, text: &str) -> Result<Vec<ParameterAssignment>, YamlError> {
    let nodes: BTreeMap<String, Tree> = serde_saphyr::from_str(text)
        .map_err(|error| YamlError::Syntax { path: path.to_owned(), reason: error.to_string() })?;
    let mut file = File { path, found: Vec::new() };
    for (name, tree) in nodes {
        file.add_node(&name, tree)?;
    }
    if file.found.is_empty() {
        return Err(file.shape(PARAMETERS_KEY, "is nowhere in it; a file must hold parameters"));
    }
    // Stable: within one node the order of the file's (sorted) names stays.
    file.found.sort_by_key(|one| (one.node != ANY_NODE, !one.is_for_many()));
    Ok(file.found)
}

struct File<'a> {
    path: &'a Path,
    found: Vec<ParameterAssignment>,
}

impl File<'_> {
    /// A node's map, or a namespace's map of nodes.
    fn add_node(&mut self, node: &str, tree: Tree) -> Result<(), YamlError> {
        let Tree::Map(children) = tree else {
            return Err(self.shape(node, "must hold ros__parameters, or nodes that do"));
        };
        let is_known = |part: &str| !part.contains('*') || part == ONE_PART || part == MANY_PARTS;
        if !node.split('/').all(is_known) {
            return Err(self.shape(
                node,
                "is no pattern; a part of a name is * (any) or ** (any number of parts), or has no star",
            ));
        }
        for (key, child) in children {
            match (key.as_str(), child) {
                (PARAMETERS_KEY, Tree::Map(parameters)) => {
                    self.add_parameters(node, "", parameters)?;
                }
                (PARAMETERS_KEY, Tree::Value(_)) => {
                    return Err(self.shape(node, "has ros__parameters without names"));
                }
                (_, child) => {
                    let namespace = node.trim_matches('/');
                    self.add_node(&format!("/{namespace}/{key}"), child)?;
                }
            }
        }
        Ok(())
    }

    fn add_parameters(
        &mut self,
        node: &str,
        prefix: &str,
        parameters: BTreeMap<String, Tree>,
    ) -> Result<(), YamlError> {
        for (key, tree) in parameters {
            let name = format!("{prefix}{key}");
            match tree {
                Tree::Map(nested) => self.add_parameters(node, &format!("{name}."), nested)?,
                Tree::Value(value) => self.found.push(ParameterAssignment {
                    node: node.to_owned(),
                    origin: format!("{} ({node}: {name})", self.path.display()),
                    name,
                    value,
                }),
            }
        }
        Ok(())
    }

    fn shape(&self, key: &str, problem: &'static str) -> YamlError {
        YamlError::Shape { path: self.path.to_owned(), key: key.to_owned(), problem }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Vec<ParameterAssignment>, YamlError> {
        parse_file(Path::new("p.yaml"), text)
    }

    #[test]
    fn values_have_the_types_of_ros() {
        for (text, value) in [
            ("true", YamlValue::Bool(true)),
            ("1000", YamlValue::Integer(1000)),
            ("1000.0", YamlValue::Double(1000.0)),
            ("1e-6", YamlValue::Double(1e-6)),
            ("machine", YamlValue::Text("machine".into())),
            ("'1'", YamlValue::Text("1".into())),
            ("[1, 2]", YamlValue::Integers(vec![1, 2])),
            ("[1.0, 2.5]", YamlValue::Doubles(vec![1.0, 2.5])),
            ("[a, b]", YamlValue::Texts(vec!["a".into(), "b".into()])),
        ] {
            assert_eq!(parse_value("p", text).unwrap(), value, "{text}");
        }
    }

    #[test]
    fn a_file_names_nodes_namespaces_and_nested_parameters() {
        let found = parse(
            "geometric:\n  ros__parameters:\n    rate_hz: 500.0\n    limits: {age_s: 0.1}\n\
             cmm:\n  tracer:\n    ros__parameters: {rate_hz: 10.0}\n\
             /**:\n  ros__parameters: {frame: machine}\n",
        )
        .unwrap();
        let names: Vec<(&str, &str)> = found.iter().map(|one| (one.node.as_str(), one.name.as_str())).collect();
        let expected =
            [("/**", "frame"), ("/cmm/tracer", "rate_hz"), ("geometric", "limits.age_s"), ("geometric", "rate_hz")];
        assert_eq!(names, expected);
    }

    #[test]
    fn patterns_are_those_of_ros_and_the_more_special_counts() {
        let found = parse(
            "/**/geometric:\n  ros__parameters: {a: 3}\n/**:\n  ros__parameters: {a: 1}\n/hall/*/geometric:\n  \
             ros__parameters: {a: 4}\n/hall/cmm/geometric:\n  ros__parameters: {a: 5}\n/*:\n  ros__parameters: {a: 2}\n\
             /**/**/scale:\n  ros__parameters: {a: 6}\n",
        )
        .unwrap();
        let meant = |namespace: &str, name: &str| {
            let node = super::super::NodeIdentity::new(namespace, name).unwrap();
            let values = found.iter().filter(|one| one.applies_to(&node)).map(|one| one.value.clone());
            let number = |value| if let YamlValue::Integer(number) = value { number } else { 0 };
            values.map(number).collect::<Vec<_>>()
        };
        assert_eq!(meant("/hall/cmm", "tracer"), [1]);
        assert_eq!(meant("/", "tracer"), [1, 2]);
        assert_eq!(meant("/cmm", "geometric"), [1, 3]);
        assert_eq!(meant("/hall/cmm", "scale"), [1, 6]);
        let mut all = meant("/hall/cmm", "geometric");
        assert_eq!((all[0], all.pop()), (1, Some(5)));
        all.sort_unstable();
        assert_eq!(all, [1, 3, 4]);
    }

    #[test]
    fn a_file_of_another_shape_is_refused_with_its_place() {
        for text in [
            "geometric: 1\n",
            "geometric:\n  rate_hz: 1\n",
            "geometric:\n  ros__parameters: 1\n",
            "/cmm*/x:\n  ros__parameters: {a: 1}\n",
            "a: [\n",
            "",
            "{}",
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains("p.yaml"), "{text:?}: {error}");
        }
    }
}
