//! Names in Zenoh as rmw_zenoh gives them: of topics, and of the tokens by which it knows who is there.
//!
//! Place in the flow: made as an endpoint opens; tokens of others are read in `graph`.
//!
//! | what | key expression |
//! |---|---|
//! | topic | `<domain>/<topic>/<type>/<hash>` |
//! | node | `@ros2_lv/<domain>/<session>/<node>/<node>/NN/<enclave>/<namespace>/<name>` |
//! | publisher, subscriber | `@ros2_lv/<domain>/<session>/<node>/<endpoint>/MP or MS/<enclave>/<namespace>/<name>/<topic>/<type>/<hash>/<qos>` |
//!
//! In a token each `/` of a name is `%`. The type is as in DDS: `abbe_msgs::msg::dds_::ScaleReading_`.
//!
//! Source: ros2/rmw_zenoh, `docs/design.md`; quality of service in the order reliability, durability, history and depth,
//! deadline, lifespan, liveliness, with the numbers of `rmw/types.h`, left out where they are the default.

use std::num::NonZeroUsize;

use abbe_msgs::type_description;

use crate::ros::NodeIdentity;

const SPACE: &str = "@ros2_lv";
/// Longest token that is read.
const LONGEST: usize = 1024;
/// In rmw: reliable 1, best effort 2; volatile 2; keep last 1.
const RELIABLE: u8 = 1;
const BEST_EFFORT: u8 = 2;

/// Which end of a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    Publisher,
    Subscriber,
}

impl End {
    fn name(self) -> &'static str {
        match self {
            End::Publisher => "MP",
            End::Subscriber => "MS",
        }
    }
}

/// A topic with its type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct TopicKey {
    topic: String,
    kind: String,
    hash: String,
}

impl TopicKey {
    /// Of `topic`, an absolute name, and the full name of a type; nothing where the type has no description.
    pub(super) fn new(topic: &str, ros_type: &str) -> Option<Self> {
        let (package, name) = ros_type.split_once("/msg/")?;
        let kind = format!("{package}::msg::dds_::{name}_");
        Some(Self { topic: topic.to_owned(), kind, hash: type_description::hash(ros_type)? })
    }

    /// What samples are sent under.
    pub(super) fn of_samples(&self, domain_id: u16) -> String {
        let Self { topic, kind, hash } = self;
        format!("{domain_id}/{}/{kind}/{hash}", topic.trim_matches('/'))
    }
}

/// A node of a session, which has one.
#[derive(Debug, Clone)]
pub(super) struct NodeKey {
    domain_id: u16,
    session: String,
    name: String,
}

impl NodeKey {
    pub(super) fn new(domain_id: u16, session: &str, identity: &NodeIdentity) -> Self {
        let name = format!("{}/{}", mangled(&identity.namespace), identity.name);
        Self { domain_id, session: session.to_owned(), name }
    }

    /// Its own token.
    pub(super) fn token(&self) -> String {
        let Self { domain_id, session, name } = self;
        format!("{SPACE}/{domain_id}/{session}/0/0/NN/%/{name}")
    }

    /// The token of one of its endpoints, of a stream that is offered as reliable and asked for as best effort.
    pub(super) fn endpoint_token(&self, number: u64, end: End, topic: &TopicKey, depth: NonZeroUsize) -> String {
        let Self { domain_id, session, name } = self;
        let TopicKey { topic, kind, hash } = topic;
        let reliability = if end == End::Publisher { RELIABLE } else { BEST_EFFORT };
        let (end, topic) = (end.name(), mangled(topic));
        format!(
            "{SPACE}/{domain_id}/{session}/0/{number}/{end}/%/{name}/{topic}/{kind}/{hash}/{reliability}:2:1,{depth}:,:,:,,"
        )
    }
}

/// All tokens of a domain.
pub(super) fn all_tokens(domain_id: u16) -> String {
    format!("{SPACE}/{domain_id}/**")
}

/// An endpoint that a token tells of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Endpoint {
    pub(super) session: String,
    pub(super) end: End,
    pub(super) topic: TopicKey,
}

impl Endpoint {
    /// Nothing for tokens of nodes and services, and what is no token.
    pub(super) fn of_token(token: &str) -> Option<Self> {
        if token.len() > LONGEST {
            return None;
        }
        let parts: Vec<&str> = token.split('/').collect();
        let [SPACE, _, session, _, _, end, _, _, _, topic, kind, hash, _] = parts[..] else { return None };
        let end = [End::Publisher, End::Subscriber].into_iter().find(|one| one.name() == end)?;
        let topic = TopicKey { topic: topic.replace('%', "/"), kind: kind.to_owned(), hash: hash.to_owned() };
        Some(Self { session: session.to_owned(), end, topic })
    }
}

fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

#[cfg(test)]
mod tests {
    use super::*;

    const TYPE: &str = "std_msgs/msg/String";
    const DIGITS: &str = "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";

    fn key() -> TopicKey {
        TopicKey::new("/chatter", TYPE).unwrap()
    }

    fn node(namespace: &str) -> NodeKey {
        NodeKey::new(0, "aac3178e146ba6f1fc6e6a4085e77f21", &NodeIdentity::new(namespace, "listener").unwrap())
    }

    #[test]
    fn val_rmw_zenoh_a_topic_and_a_node_have_the_names_of_its_documents() {
        // The examples of its design document, with the hash that ROS 2 Jazzy ships for std_msgs/msg/String.
        assert_eq!(key().of_samples(0), format!("0/chatter/std_msgs::msg::dds_::String_/RIHS01_{DIGITS}"));
        assert_eq!(node("/").token(), "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener");
        let depth = NonZeroUsize::new(4096).unwrap();
        let expected = format!(
            "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MS/%/%cmm%a/listener/%chatter/std_msgs::msg::dds_::String_/\
             RIHS01_{DIGITS}/2:2:1,4096:,:,:,,"
        );
        assert_eq!(node("/cmm/a").endpoint_token(10, End::Subscriber, &key(), depth), expected);
    }

    #[test]
    fn tokens_of_endpoints_are_read_and_all_else_is_none() {
        let depth = NonZeroUsize::MIN;
        for end in [End::Publisher, End::Subscriber] {
            let found = Endpoint::of_token(&node("/cmm").endpoint_token(3, end, &key(), depth)).unwrap();
            assert_eq!((found.end, found.topic, found.session.len()), (end, key(), 32));
        }
        for other in [node("/").token(), String::new(), "a/".repeat(600), "@ros2_lv/0".to_owned()] {
            assert_eq!(Endpoint::of_token(&other), None);
        }
        assert_eq!(TopicKey::new("/chatter", "abbe_msgs/msg/Nothing"), None);
    }
}
