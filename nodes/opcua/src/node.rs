//! Names of nodes as launch files write them: `ns=2;s=Axes.X`, or with the namespace by its name, `nsu=http://maker/ua;s=Axes.X`.
//!
//! Place in the flow: read when a launch file is checked; the namespace by its name becomes the server's number for it when a session begins, because
//! servers number their namespaces as they like.

use opcua::types::{NodeId, UAString};
use std::str::FromStr;

/// Longest name of a node.
const LONGEST: usize = 4096;

/// The name of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeName {
    /// Namespace by its name.
    namespace: Option<String>,
    id: NodeId,
    text: String,
}

impl NodeName {
    /// Reads a name.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn parse(text: &str) -> Result<NodeName, String> {
        let wrong = || {
            format!(
                "{text:?} names no node; write it like \"ns=2;s=Axes.X\", \"ns=3;i=1007\" or \"nsu=http://maker.example/ua;s=Axes.X\""
            )
        };
        if text.len() > LONGEST {
            return Err(format!("a name of a node has {LONGEST} characters at most"));
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
        Ok(NodeName { namespace, id, text: text.to_owned() })
    }

    /// The node at a server with these namespaces.
    pub(crate) fn at(&self, namespaces: &[UAString]) -> Result<NodeId, String> {
        let Some(name) = &self.namespace else { return Ok(self.id.clone()) };
        let place = namespaces.iter().position(|known| known.as_ref() == name);
        let number = place.and_then(|place| u16::try_from(place).ok());
        let number = number.ok_or_else(|| format!("the server has no namespace {name:?}"))?;
        Ok(NodeId { namespace: number, identifier: self.id.identifier.clone() })
    }
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
        let node = NodeName::parse("nsu=http://maker.example/ua;s=Axes.X").unwrap();
        assert_eq!(node.at(&namespaces), Ok(NodeId::new(2, "Axes.X")));
        assert_eq!(NodeName::parse("ns=2;s=Axes.X").unwrap().at(&[]), Ok(NodeId::new(2, "Axes.X")));
        assert_eq!(NodeName::parse("i=2258").unwrap().at(&[]), Ok(NodeId::new(0, 2258_u32)));
        let error = NodeName::parse("nsu=http://other;i=7").unwrap().at(&namespaces).unwrap_err();
        assert!(error.contains("http://other"), "{error}");
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
