//! Sessions over Zenoh for the laws: a router of the test's own, and nodes that meet through it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

use abbe_runtime::ros::{Domain, NodeIdentity};
use abbe_runtime::transport::zenoh::ZenohSession;

/// Where the router of a test is; tests that cannot have a network of their own have different domains.
fn router_at(domain: Domain) -> String {
    format!("tcp/127.0.0.1:{}", 17_000 + domain.id())
}

/// `ZENOH_CONFIG_OVERRIDE` of a node.
pub(crate) fn meets_the_router(domain: Domain) -> String {
    format!("connect/endpoints=[\"{}\"];listen/endpoints=[\"tcp/127.0.0.1:0\"]", router_at(domain))
}

pub(crate) fn router(domain: Domain) -> ZenohSession {
    let at = router_at(domain);
    let pairs = format!("mode=\"router\";connect/endpoints=[];listen/endpoints=[\"{at}\"]");
    open(&NodeIdentity::new("/", "router").unwrap(), domain, &pairs)
}

pub(crate) fn session(identity: &NodeIdentity, domain: Domain) -> ZenohSession {
    open(identity, domain, &meets_the_router(domain))
}

#[cfg(feature = "zenoh")]
fn open(identity: &NodeIdentity, domain: Domain, pairs: &str) -> ZenohSession {
    let config = abbe_runtime::transport::zenoh::ZenohConfig::new(None, Some(pairs)).unwrap();
    ZenohSession::open(identity, domain, config).unwrap()
}

#[cfg(not(feature = "zenoh"))]
fn open(_: &NodeIdentity, _: Domain, _: &str) -> ZenohSession {
    panic!("built without Zenoh")
}
