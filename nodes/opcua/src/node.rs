//! Names of nodes as launch files write them: `ns=2;s=Axes.X`, or with the namespace by its name, `nsu=http://maker/ua;s=Axes.X`; or the
//! name of an axis, `opc40502:X`, where the server follows that specification.
//!
//! Place in the flow: read when a launch file is checked; the namespace by its name becomes the server's number for it when a session begins, because
//! servers number their namespaces as they like. Axes are looked for then, too.

use opcua::types::{NodeId, UAString};
use std::str::FromStr;

/// Longest name of a node.
const LONGEST: usize = 4096;

/// What an axis by its name begins with: its own measuring system, and the motor's.
const AXES: [(&str, Measures); 2] = [("opc40502:", Measures::Direct), ("opc40502-indirect:", Measures::Indirect)];

/// The name of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeName {
    place: Place,
    text: String,
}

/// How a node is found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Place {
    /// By its identifier.
    Node {
        /// Namespace by its name.
        namespace: Option<String>,
        id: NodeId,
    },
    /// As the position of an axis.
    Axis(AxisName),
}

/// Which position of an axis is meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measures {
    /// That of its own measuring system.
    Direct,
    /// That of the motor's.
    Indirect,
}

/// An axis as OPC 40502 names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct AxisName {
    /// Name of the CNC interface, for servers with several.
    pub(crate) interface: Option<String>,
    pub(crate) axis: String,
    pub(crate) measures: Measures,
}

impl NodeName {
    /// Reads a name.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn parse(text: &str) -> Result<NodeName, String> {
        let wrong = || {
            format!(
                "{text:?} names no node; write it like \"ns=2;s=Axes.X\", \"ns=3;i=1007\" or \"nsu=http://maker.example/ua;s=Axes.X\", or an axis of OPC 40502 like \"opc40502:X\""
            )
        };
        if text.len() > LONGEST {
            return Err(format!("a name of a node has {LONGEST} characters at most"));
        }
        if let Some((rest, measures)) =
            AXES.iter().find_map(|(begin, measures)| Some((text.strip_prefix(begin)?, *measures)))
        {
            let (interface, axis) =
                rest.rsplit_once('/').map_or((None, rest), |(own, axis)| (Some(own.to_owned()), axis));
            if axis.is_empty() || interface.as_ref().is_some_and(String::is_empty) {
                return Err(format!(
                    "{text:?} names no axis; write it like \"opc40502:X\" or \"opc40502:INTERFACE/X\""
                ));
            }
            let place = Place::Axis(AxisName { interface, axis: axis.to_owned(), measures });
            return Ok(NodeName { place, text: text.to_owned() });
        }
        let (namespace, rest) = match text.strip_prefix("nsu=") {
            Some(named) => {
                // The name of a namespace has semicolons as %3B.
                let (uri, rest) = named.split_once(';').ok_or_else(wrong)?;
                let uri = uri.replace("%3B", ";").replace("%3b", ";").replace("%25", "%");
                if uri.is_empty() || rest.starts_with("ns=") {
                    return Err(wrong());
                }
                (Some(uri), rest)
            }
            None => (None, text),
        };
        let id = NodeId::from_str(rest).map_err(|_| wrong())?;
        Ok(NodeName { place: Place::Node { namespace, id }, text: text.to_owned() })
    }

    /// How it is found.
    pub(crate) fn place(&self) -> &Place {
        &self.place
    }
}

/// The node of a name at a server with these namespaces.
pub(crate) fn at(namespace: Option<&str>, id: &NodeId, namespaces: &[UAString]) -> Result<NodeId, String> {
    let Some(name) = namespace else { return Ok(id.clone()) };
    let place = namespaces.iter().position(|known| known.as_ref() == name);
    let number = place.and_then(|place| u16::try_from(place).ok());
    let number = number.ok_or_else(|| format!("the server has no namespace {name:?}"))?;
    Ok(NodeId { namespace: number, identifier: id.identifier.clone() })
}

impl std::fmt::Display for NodeName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_namespace_by_its_name_becomes_the_servers_number() {
        let namespaces = ["http://opcfoundation.org/UA/", "urn:server", "http://maker.example/ua"].map(UAString::from);
        let node = |text: &str, namespaces: &[UAString]| match NodeName::parse(text).unwrap().place {
            Place::Node { namespace, id } => at(namespace.as_deref(), &id, namespaces),
            Place::Axis(axis) => Err(format!("{axis:?}")),
        };
        assert_eq!(node("nsu=http://maker.example/ua;s=Axes.X", &namespaces), Ok(NodeId::new(2, "Axes.X")));
        assert_eq!(node("ns=2;s=Axes.X", &[]), Ok(NodeId::new(2, "Axes.X")));
        assert_eq!(node("i=2258", &[]), Ok(NodeId::new(0, 2258_u32)));
        let error = node("nsu=http://other;i=7", &namespaces).unwrap_err();
        assert!(error.contains("http://other"), "{error}");
    }

    #[test]
    fn an_axis_has_a_name_and_its_interface_may_have_one() {
        let axis = |text: &str| match NodeName::parse(text).unwrap().place {
            Place::Axis(AxisName { interface, axis, measures }) => (interface, axis, measures),
            Place::Node { .. } => panic!("{text} is no node"),
        };
        assert_eq!(axis("opc40502:X"), (None, "X".to_owned(), Measures::Direct));
        assert_eq!(axis("opc40502-indirect:Mill/1/X"), (Some("Mill/1".to_owned()), "X".to_owned(), Measures::Indirect));
        for text in ["opc40502:", "opc40502:/X", "opc40502:Mill/", "opc40502-indirect:"] {
            assert!(NodeName::parse(text).unwrap_err().contains("names no axis"), "{text}");
        }
    }

    #[test]
    fn what_names_no_node_is_refused() {
        for text in
            ["", "X", "ns=2", "ns=99999;s=X", "ns=2;q=1", "ns=2;i=x", "nsu=;s=X", "nsu=http://a;ns=2;s=X", "nsu=a"]
        {
            assert!(NodeName::parse(text).is_err(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_name_or_refused(text in ".*") {
            if let Ok(node) = NodeName::parse(&text) {
                prop_assert_eq!(node.to_string(), text);
            }
        }
    }
}
