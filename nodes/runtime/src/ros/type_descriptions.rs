//! `~/get_type_description`: what the messages of a node are made of, for programs that do not know their types.
//!
//! Place in the flow: served on the node's own thread, beside the parameters. As with rclcpp it answers for the types that
//! the node publishes or takes, and refuses all others. The DDS library sends no hash with its endpoints, so that a
//! program which learnt of the topic from them knows none: a request without a hash is answered as well.
//!
//! Source: REP 2016; `type_description_interfaces/srv/GetTypeDescription` of ROS 2 Jazzy.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};

use abbe_msgs::type_description::{TypeDescription, TypeSource};
use ros2_client::Node;
use serde::{Deserialize, Serialize};

use super::RosError;
use super::matched::Matched;
use super::names::NodeIdentity;
use super::service::Service;
use crate::lock::lock;

const PACKAGE: &str = "type_description_interfaces";
const NAME: &str = "get_type_description";

#[derive(Debug, Serialize, Deserialize)]
struct Request {
    type_name: String,
    type_hash: String,
    include_type_sources: bool,
}

#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
struct Reply {
    successful: bool,
    failure_reason: String,
    type_description: TypeDescription,
    type_sources: Vec<TypeSource>,
    /// Keys and values; there is nothing more to tell.
    extra_information: Vec<(String, String)>,
}

/// The types of the messages that a node publishes or takes. Clones share them.
#[derive(Debug, Clone, Default)]
pub(super) struct Types(Arc<Mutex<BTreeSet<&'static str>>>);

impl Types {
    pub(super) fn add(&self, ros_type: &'static str) {
        lock(&self.0).insert(ros_type);
    }

    /// The answer to a request, or why there is none.
    fn described(&self, request: &Request) -> Result<Reply, String> {
        let Request { type_name, type_hash, include_type_sources } = request;
        if !lock(&self.0).contains(type_name.as_str()) {
            return Err(format!("this node neither publishes nor takes messages of type '{type_name}'"));
        }
        let description =
            TypeDescription::of(type_name).ok_or_else(|| format!("this node has no description of '{type_name}'"))?;
        let hash = description.hash();
        if !type_hash.is_empty() && *type_hash != hash {
            return Err(format!("'{type_name}' of this node has the hash {hash}, not '{type_hash}'"));
        }
        let type_sources = if *include_type_sources { description.sources() } else { Vec::new() };
        Ok(Reply { successful: true, type_description: description, type_sources, ..Reply::default() })
    }
}

/// The open service.
pub(super) struct TypeDescriptions {
    types: Types,
    service: Service<Request, Reply>,
}

impl TypeDescriptions {
    pub(super) fn open(
        node: &mut Node,
        matched: &Arc<Matched>,
        identity: &NodeIdentity,
        types: Types,
    ) -> Result<Self, RosError> {
        let name = format!("{}/{NAME}", identity.qualified());
        let service = Service::open(node, matched, &name, PACKAGE, "GetTypeDescription")?;
        Ok(Self { types, service })
    }

    /// Answers requests, for ever.
    pub(super) async fn serve(self) {
        let refused = |failure_reason| Reply { failure_reason, ..Reply::default() };
        self.service.serve(async |request| self.types.described(&request).unwrap_or_else(refused)).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const USED: &str = "abbe_msgs/msg/CorrectedCoordinates";

    fn asked(type_name: &str, type_hash: &str, include_type_sources: bool) -> Result<Reply, String> {
        let types = Types::default();
        types.add(USED);
        types.described(&Request {
            type_name: type_name.to_owned(),
            type_hash: type_hash.to_owned(),
            include_type_sources,
        })
    }

    #[test]
    fn a_type_is_described_by_name_and_hash_and_its_files_come_where_they_are_wanted() {
        let hash = abbe_msgs::type_description::hash(USED).unwrap();
        let reply = asked(USED, &hash, true).unwrap();
        assert_eq!(reply.type_description.hash(), hash);
        assert_eq!(reply.type_sources.len(), 3, "with Header and Time");
        assert_eq!(asked(USED, &hash, false).unwrap(), Reply { type_sources: Vec::new(), ..reply });
        assert_eq!(asked(USED, "", false).unwrap(), asked(USED, &hash, false).unwrap());
    }

    #[test]
    fn types_of_others_and_wrong_hashes_are_refused_in_words() {
        let other = asked("abbe_msgs/msg/ScaleReading", "", false).unwrap_err();
        assert!(other.contains("ScaleReading") && other.contains("neither publishes nor takes"), "{other}");
        let wrong = asked(USED, "RIHS01_00", false).unwrap_err();
        assert!(wrong.contains("has the hash RIHS01_") && wrong.contains("not 'RIHS01_00'"), "{wrong}");
    }
}
