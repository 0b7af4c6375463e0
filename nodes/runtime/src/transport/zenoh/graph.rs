//! Publishers and subscribers that there are, by their liveliness tokens.
//!
//! Place in the flow: filled by the session as tokens come and go; asked by publishers and subscribers. Bounded, because
//! whoever is in the network may declare tokens.

use std::collections::BTreeMap;
use std::sync::Mutex;

use super::keys::{End, Endpoint, TopicKey};
use crate::lock::lock;

/// Endpoints that are remembered at most.
const REMEMBERED: usize = 16 * 1024;

/// The endpoints of a domain, by their tokens.
#[derive(Debug, Default)]
pub(super) struct Graph(Mutex<Seen>);

#[derive(Debug, Default)]
struct Seen {
    endpoints: BTreeMap<String, Endpoint>,
    is_full: bool,
}

impl Graph {
    /// A token has come.
    pub(super) fn add(&self, token: &str) {
        let Some(endpoint) = Endpoint::of_token(token) else { return };
        let mut seen = lock(&self.0);
        if seen.endpoints.len() < REMEMBERED {
            seen.endpoints.insert(token.to_owned(), endpoint);
        } else if !std::mem::replace(&mut seen.is_full, true) {
            tracing::warn!("more than {REMEMBERED} endpoints over Zenoh; those that come now are not counted");
        }
    }

    /// A token has gone.
    pub(super) fn remove(&self, token: &str) {
        lock(&self.0).endpoints.remove(token);
    }

    /// Subscribers of a topic.
    pub(super) fn subscribers(&self, topic: &TopicKey) -> usize {
        self.count(|one| one.end == End::Subscriber && one.topic == *topic)
    }

    /// Publishers of a topic in other sessions.
    pub(super) fn publishers(&self, topic: &TopicKey, own_session: &str) -> usize {
        self.count(|one| one.end == End::Publisher && one.topic == *topic && one.session != own_session)
    }

    fn count(&self, is_one: impl Fn(&Endpoint) -> bool) -> usize {
        lock(&self.0).endpoints.values().filter(|one| is_one(one)).count()
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    use super::*;
    use crate::ros::NodeIdentity;
    use crate::transport::zenoh::keys::NodeKey;

    #[test]
    fn who_comes_is_counted_until_it_goes_and_a_flood_of_tokens_is_bounded() {
        let topic = TopicKey::new("/cmm/corrected", "abbe_msgs/msg/CorrectedCoordinates").unwrap();
        let other = TopicKey::new("/cmm/scale/reading", "abbe_msgs/msg/ScaleReading").unwrap();
        let node = |session| NodeKey::new(0, session, &NodeIdentity::new("/cmm", "test").unwrap());
        let token = |session, number, end, topic| node(session).endpoint_token(number, end, topic, NonZeroUsize::MIN);
        let graph = Graph::default();
        let tokens = [token("a", 1, End::Publisher, &topic), token("b", 1, End::Subscriber, &topic)];
        tokens.iter().for_each(|token| graph.add(token));
        graph.add(&token("b", 2, End::Subscriber, &other));
        assert_eq!((graph.subscribers(&topic), graph.publishers(&topic, "a")), (1, 0));
        assert_eq!(graph.publishers(&topic, "b"), 1);
        tokens.iter().for_each(|token| graph.remove(token));
        assert_eq!((graph.subscribers(&topic), graph.publishers(&topic, "b")), (0, 0));
        for number in 0..2 * REMEMBERED as u64 {
            graph.add(&token("c", number, End::Subscriber, &topic));
        }
        assert!(graph.subscribers(&topic) <= REMEMBERED);
    }
}
