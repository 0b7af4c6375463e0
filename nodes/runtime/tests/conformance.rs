//! One suite for every transport (Zenoh where this is built with it): what `abbe_runtime::transport` promises, held against each.
//!
//! `laws` are written against the two traits alone; `conformance!` instantiates each for each
//! transport. Publishers and subscribers are nodes of their own, as in real life.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

#[path = "common/mod.rs"]
mod common;
#[path = "conformance/laws.rs"]
mod laws;
#[path = "conformance/zenoh.rs"]
mod zenoh;

use std::num::NonZeroUsize;
use std::process::Command;
use std::sync::{Arc, OnceLock};

use abbe_msgs::ScaleReading;
use abbe_runtime::gateway::{GatewayNode, GatewayOptions, serve};
use abbe_runtime::ros::{Domain, NodeIdentity, NodeOptions, ParameterTable, RosNode, StaticPeers};
use abbe_runtime::transport::in_process::InProcess;
use abbe_runtime::transport::shared_memory::cleanup;
use abbe_runtime::transport::zenoh::ZenohSession;
use abbe_runtime::{Edges, EdgesConfig, Publish, RunId, Subscribe, TransportKind};
use common::peer::{ROLE, role};

/// One transport with one topic, where a law can open as many ends as it needs.
pub(crate) struct World {
    kind: TransportKind,
    /// Whether each node has a gateway to DDS, in place of a participant.
    gateways: bool,
    in_process: InProcess,
    run: RunId,
    domain: Domain,
    /// What the sessions of nodes meet through.
    _router: Option<ZenohSession>,
}

impl World {
    fn new(kind: TransportKind, domain: Domain) -> Self {
        let _router = (kind == TransportKind::Zenoh).then(|| zenoh::router(domain));
        Self { kind, gateways: false, in_process: InProcess::default(), run: RunId::unique(), domain, _router }
    }

    fn publisher(&self) -> Box<dyn Publish<ScaleReading>> {
        let edges = self.edges(4096);
        edges.publisher("scale/reading", &[self.kind]).unwrap()
    }

    fn subscriber(&self) -> Box<dyn Subscribe<ScaleReading>> {
        self.edges(4096).subscriber("scale/reading", self.kind).unwrap()
    }

    /// Both ends with room for `depth` samples.
    fn edges(&self, depth: usize) -> Edges {
        let identity = NodeIdentity::new("/cmm", "test").unwrap();
        let mut config = EdgesConfig::new(identity.clone());
        config.depth = NonZeroUsize::new(depth).unwrap();
        match self.kind {
            TransportKind::InProcess => config.in_process = Some(self.in_process.clone()),
            TransportKind::SharedMemory => config.run = Some(self.run.clone()),
            TransportKind::Dds | TransportKind::Zenoh if self.gateways => {
                config.gateway = Some(gateway(identity, self.domain, config.depth));
            }
            TransportKind::Dds => config.ros = Some(node(identity, self.domain)),
            TransportKind::Zenoh => config.zenoh = Some(zenoh::session(&identity, self.domain)),
        }
        Edges::open(config).unwrap()
    }
}

fn node(identity: NodeIdentity, domain: Domain) -> RosNode {
    let options = NodeOptions {
        identity,
        domain,
        remaps: Vec::new(),
        parameters: ParameterTable::default(),
        enclave: None,
        peers: StaticPeers::default(),
    };
    RosNode::start(options).unwrap()
}

impl Drop for World {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            cleanup(&self.run).unwrap();
        }
    }
}

fn check(kind: TransportKind, test: &str, law: fn(&World)) {
    match kind {
        TransportKind::Dds | TransportKind::Zenoh => common::network::in_own_network(test, |domain| {
            law(&World::new(kind, domain));
        }),
        _ => law(&World::new(kind, Domain::default())),
    }
}

/// The same law with a gateway, a process of its own, between each end and DDS or Zenoh.
fn check_behind_gateways(kind: TransportKind, test: &str, law: fn(&World)) {
    if role().is_some() {
        return serve().unwrap();
    }
    TEST.set(test.to_owned()).unwrap_or_default();
    common::network::in_own_network(test, |domain| {
        let mut world = World::new(kind, domain);
        world.gateways = true;
        law(&world);
    });
}

/// The test of this process, which its gateways start again.
static TEST: OnceLock<String> = OnceLock::new();

fn gateway(identity: NodeIdentity, domain: Domain, depth: NonZeroUsize) -> GatewayNode {
    let command = move || {
        let mut command = Command::new(std::env::current_exe().unwrap());
        let test = TEST.get().unwrap();
        command.args([test, "--exact", "--nocapture", "--test-threads=1"]).env(ROLE, "gateway");
        command.env("ZENOH_CONFIG_OVERRIDE", zenoh::meets_the_router(domain));
        command
    };
    let node = NodeOptions {
        identity,
        domain,
        remaps: Vec::new(),
        parameters: ParameterTable::default(),
        enclave: None,
        peers: StaticPeers::default(),
    };
    GatewayNode::start(GatewayOptions {
        on_change: None,
        rosout: false,
        node,
        run: None,
        depth,
        memory_limit_bytes: 1 << 30,
        hardware_id: "cmm".to_owned(),
        command: Arc::new(command),
    })
    .unwrap()
}

macro_rules! conformance {
    (@gateways $name:ident, $kind:expr) => {
        mod $name {
            conformance!(@behind $name, $kind,
                order_is_kept_and_content_is_identical_to_the_bit,
                who_joins_late_gets_what_is_sent_from_then_on,
                a_publisher_that_starts_again_is_heard_again,
                a_burst_of_2000_arrives_whole,
                overflow_is_counted_and_never_blocks,
                two_publishers_are_both_heard,
                waiting_ends_in_time_and_takes_nothing,
                the_publisher_knows_its_subscribers,
            );
        }
    };
    (@behind $name:ident, $kind:expr, $($law:ident,)*) => {
        $(#[test]
        fn $law() {
            let test = concat!(stringify!($name), "::", stringify!($law));
            super::check_behind_gateways($kind, test, super::laws::$law);
        })*
    };
    ($($transport:ident: $kind:expr;)*) => {
        $(mod $transport {
            conformance!(@laws $transport, $kind,
                order_is_kept_and_content_is_identical_to_the_bit,
                who_joins_late_gets_what_is_sent_from_then_on,
                a_publisher_that_starts_again_is_heard_again,
                a_subscriber_that_goes_leaves_the_others_untouched,
                a_burst_of_2000_arrives_whole,
                overflow_is_counted_and_never_blocks,
                two_subscribers_both_get_everything,
                two_publishers_are_both_heard,
                waiting_ends_in_time_and_takes_nothing,
                the_publisher_knows_its_subscribers,
            );
        })*
    };
    (@laws $transport:ident, $kind:expr, $($law:ident,)*) => {
        $(#[test]
        fn $law() {
            let test = concat!(stringify!($transport), "::", stringify!($law));
            super::check($kind, test, super::laws::$law);
        })*
    };
}

conformance! {
    in_process: abbe_runtime::TransportKind::InProcess;
    shared_memory: abbe_runtime::TransportKind::SharedMemory;
    dds: abbe_runtime::TransportKind::Dds;
}

#[cfg(feature = "zenoh")]
conformance! {
    over_zenoh: abbe_runtime::TransportKind::Zenoh;
}

conformance! { @gateways dds_behind_gateways, abbe_runtime::TransportKind::Dds }

#[cfg(feature = "zenoh")]
conformance! { @gateways zenoh_behind_gateways, abbe_runtime::TransportKind::Zenoh }
