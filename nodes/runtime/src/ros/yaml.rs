//! Parameter values and parameter files in YAML, in the form of `ros2 param dump`.
//!
//! Place in the flow: read by [`super::args`], applied to the declared table by
//! [`super::parameters`]. Nested maps below `ros__parameters` become names with dots.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use thiserror::Error;

use super::meant::Meant;
use super::names::NameError;

const PARAMETERS_KEY: &str = "ros__parameters";

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
    /// The nodes.
    pub meant: Meant,
    /// The parameter.
    pub name: String,
    /// Its value.
    pub value: YamlValue,
    /// Where it stands, for messages.
    pub origin: String,
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
    /// A key that is to name nodes.
    #[error("parameter file {path}: {source}")]
    Node {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: NameError,
    },
    /// Two values of which neither counts.
    #[error("{first} and {second} differ, and a node may be meant by both, none more specially; take one out")]
    Tie {
        /// Where one stands.
        first: String,
        /// Where the other stands.
        second: String,
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

/// All assignments of a parameter file, the more special behind, so that they count.
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
    file.found.sort_by_key(|one| one.meant.rank());
    match tie(&file.found) {
        Some((first, second)) => Err(YamlError::Tie { first: first.origin.clone(), second: second.origin.clone() }),
        None => Ok(file.found),
    }
}

/// Two that are equally special and set the same parameter of some node to different values; `found` is sorted.
fn tie(found: &[ParameterAssignment]) -> Option<(&ParameterAssignment, &ParameterAssignment)> {
    found.chunk_by(|one, next| one.meant.rank() == next.meant.rank()).find_map(|equals| {
        equals.iter().enumerate().find_map(|(index, one)| {
            let contradicts = |other: &&ParameterAssignment| {
                one.name == other.name && one.value != other.value && one.meant.overlaps(&other.meant)
            };
            Some((one, equals[index + 1..].iter().find(contradicts)?))
        })
    })
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
                    let separator = if namespace.is_empty() { "" } else { "/" };
                    self.add_node(&format!("/{namespace}{separator}{}", key.trim_start_matches('/')), child)?;
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
        let meant = Meant::parse(node).map_err(|source| YamlError::Node { path: self.path.to_owned(), source })?;
        for (key, tree) in parameters {
            let name = format!("{prefix}{key}");
            match tree {
                Tree::Map(nested) => self.add_parameters(node, &format!("{name}."), nested)?,
                Tree::Value(value) => self.found.push(ParameterAssignment {
                    meant: meant.clone(),
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
        let names: Vec<(Meant, &str)> = found.iter().map(|one| (one.meant.clone(), one.name.as_str())).collect();
        let expected =
            [("/**", "frame"), ("geometric", "limits.age_s"), ("geometric", "rate_hz"), ("/cmm/tracer", "rate_hz")];
        assert_eq!(names, expected.map(|(node, name)| (Meant::parse(node).unwrap(), name)));
    }

    #[test]
    fn patterns_are_those_of_ros_and_the_more_special_counts() {
        let found = parse(
            "'**/geometric':\n  ros__parameters: {a: 3}\n/**:\n  ros__parameters: {a: 1}\n/hall/*/geometric:\n  \
             ros__parameters: {a: 5}\n/hall/cmm/geometric:\n  ros__parameters: {a: 7}\n/*:\n  ros__parameters: {a: 2}\n\
             /**/**/scale:\n  ros__parameters: {a: 8}\n/*/geometric:\n  ros__parameters: {a: 4}\n\
             geometric:\n  ros__parameters: {a: 6}\n",
        )
        .unwrap();
        let meant = |namespace: &str, name: &str| {
            let node = super::super::NodeIdentity::new(namespace, name).unwrap();
            let values = found.iter().filter(|one| one.meant.fits(&node)).map(|one| one.value.clone());
            let number = |value| if let YamlValue::Integer(number) = value { number } else { 0 };
            values.map(number).collect::<Vec<_>>()
        };
        assert_eq!(meant("/hall/cmm", "tracer"), [1]);
        assert_eq!(meant("/", "tracer"), [1, 2]);
        assert_eq!(meant("/cmm", "geometric"), [1, 3, 4, 6]);
        assert_eq!(meant("/hall/cmm", "scale"), [1, 8]);
        assert_eq!(meant("/hall/cmm", "geometric"), [1, 3, 5, 6, 7]);
    }

    #[test]
    fn a_namespace_may_begin_and_end_with_a_slash_and_be_the_root() {
        for text in [
            "hall/:\n  cmm: {ros__parameters: {a: 1}}\n",
            "/hall:\n  /cmm: {ros__parameters: {a: 1}}\n",
            "/:\n  hall: {cmm: {ros__parameters: {a: 1}}}\n",
            "hall/cmm: {ros__parameters: {a: 1}}\n",
        ] {
            assert_eq!(parse(text).unwrap()[0].meant, Meant::parse("/hall/cmm").unwrap(), "{text}");
        }
    }

    #[test]
    fn two_values_of_which_none_is_more_special_are_refused_unless_they_agree_or_never_meet() {
        let file = |one: &str, other: &str, value: &str| {
            parse(&format!("{one}:\n  ros__parameters: {{a: 1}}\n{other}:\n  ros__parameters: {{a: {value}}}\n"))
        };
        for (one, other) in [("/hall/**", "/**/cmm"), ("/hall/cmm", "hall/cmm/"), ("/*/cmm", "/hall/*")] {
            let told = file(one, other, "2").unwrap_err().to_string();
            assert!(told.contains(&format!("({one}: a)")) && told.contains(&format!("({other}: a)")), "{told}");
            assert!(told.contains("p.yaml") && told.contains("take one out"), "{told}");
            file(one, other, "1").unwrap();
        }
        file("/hall/*", "/yard/*", "2").unwrap();
        file("scale", "tracer", "2").unwrap();
    }

    #[test]
    fn a_file_of_another_shape_is_refused_with_its_place() {
        for text in [
            "geometric: 1\n",
            "geometric:\n  rate_hz: 1\n",
            "geometric:\n  ros__parameters: 1\n",
            "/cmm*/x:\n  ros__parameters: {a: 1}\n",
            "a//b:\n  ros__parameters: {a: 1}\n",
            "/:\n  ros__parameters: {a: 1}\n",
            "a: [\n",
            "",
            "{}",
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains("p.yaml"), "{text:?}: {error}");
        }
    }
}
