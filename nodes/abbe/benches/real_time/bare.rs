//! The rival: the same sample through two processes that hand it on with iceoryx2 alone.
//!
//! Place in the flow: beside the graph in the benchmark. A publish-subscribe service and an event a hop, as iceoryx2 is meant to be
//! used where nobody polls. The benchmark starts itself as the relays.

use super::{collect, realtime};
use abbe_msgs::ScaleReading;
use abbe_runtime::RunId;
use abbe_runtime::realtime::step_in;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{LogLevel, PortFactory as _, SignalHandlingMode};
use iceoryx2::service::ipc::Service;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::service_name::ServiceName;
use std::process::{Child, Command};
use std::time::Duration;

/// Word on the command line that makes a relay of this program.
pub(super) const RELAY: &str = "relay";
/// Relays, as many as the graph has nodes.
const RELAYS: usize = 2;
/// Sequence of the sample that ends a relay.
const END: u64 = u64::MAX;
/// Samples a subscriber can be behind, as in the graph.
const DEPTH: usize = 4096;
const LOOK_UP: Duration = Duration::from_millis(100);

/// The relays as processes.
pub(super) struct Relays {
    run: String,
    children: Vec<Child>,
}

impl Relays {
    pub(super) fn start(run: &RunId, in_real_time: bool) -> Relays {
        let program = std::env::current_exe().expect("path of the benchmark");
        let child = |part: usize| {
            let words = [RELAY, run.as_str(), &part.to_string(), &in_real_time.to_string()].map(str::to_owned);
            Command::new(&program).args(words).spawn().expect("relay starts")
        };
        Relays { run: run.to_string(), children: (0..RELAYS).map(child).collect() }
    }

    /// The sending end, before the first relay.
    pub(super) fn first(&self) -> Sender {
        Sender::open(&node(), &self.run, 0)
    }

    /// Whether every hop has its taker.
    pub(super) fn are_ready(&self, first: &Sender) -> bool {
        let node = node();
        let has_taker = |hop: usize| samples(&node, &self.run, hop).dynamic_config().number_of_subscribers() > 0;
        first.service.dynamic_config().number_of_subscribers() > 0 && (1..=RELAYS).all(has_taker)
    }

    /// Takes behind the last relay.
    pub(super) fn collect(&self, count: usize) -> Vec<(usize, std::time::Instant)> {
        let taker = Taker::open(&node(), &self.run, RELAYS);
        let _realtime = step_in().expect("real time");
        collect(count, || Some(taker.take()?.sequence))
    }

    /// Ends the relays.
    pub(super) fn end(mut self) {
        // Kept until they have ended: what was sent goes with its sender.
        let mut last = self.first();
        last.send(&ScaleReading { sequence: END, ..ScaleReading::default() });
        for child in &mut self.children {
            assert!(child.wait().expect("relay ends").success());
        }
    }
}

impl Drop for Relays {
    fn drop(&mut self) {
        for child in &mut self.children {
            // Most have ended.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// One relay: hands on from its hop to the next.
pub(super) fn relay(run: &str, part: usize, in_real_time: bool) {
    if in_real_time {
        realtime().begin().expect("real time");
    }
    let node = node();
    let (taker, mut sender) = (Taker::open(&node, run, part), Sender::open(&node, run, part + 1));
    let _realtime = step_in().expect("real time");
    loop {
        let Some(sample) = taker.take() else { continue };
        sender.send(&sample);
        if sample.sequence == END {
            break;
        }
    }
    // The next one finds what was sent before it goes.
    std::thread::sleep(LOOK_UP);
}

fn node() -> Node<Service> {
    iceoryx2::prelude::set_log_level_from_env_or(LogLevel::Error);
    NodeBuilder::new().signal_handling_mode(SignalHandlingMode::Disabled).create().expect("node")
}

fn name(run: &str, hop: usize) -> ServiceName {
    ServiceName::new(&format!("abbe-bench/{run}/{hop}")).expect("name")
}

fn samples(node: &Node<Service>, run: &str, hop: usize) -> PortFactory<Service, ScaleReading, ()> {
    let service = node.service_builder(&name(run, hop)).publish_subscribe::<ScaleReading>();
    service.subscriber_max_buffer_size(DEPTH).max_subscribers(2).max_publishers(2).open_or_create().expect("service")
}

/// The sending end of a hop.
pub(super) struct Sender {
    service: PortFactory<Service, ScaleReading, ()>,
    publisher: Publisher<Service, ScaleReading, ()>,
    wake: Notifier<Service>,
}

impl Sender {
    fn open(node: &Node<Service>, run: &str, hop: usize) -> Sender {
        let service = samples(node, run, hop);
        let events = node.service_builder(&name(run, hop)).event().open_or_create().expect("event");
        let publisher = service.publisher_builder().create().expect("publisher");
        Sender { service, publisher, wake: events.notifier_builder().create().expect("notifier") }
    }

    pub(super) fn send(&mut self, sample: &ScaleReading) {
        let loan = self.publisher.loan_uninit().expect("loan");
        loan.write_payload(*sample).send().expect("send");
        self.wake.notify().expect("notify");
    }
}

/// The taking end of a hop.
struct Taker {
    subscriber: Subscriber<Service, ScaleReading, ()>,
    wake: Listener<Service>,
}

impl Taker {
    fn open(node: &Node<Service>, run: &str, hop: usize) -> Taker {
        let service = samples(node, run, hop);
        let events = node.service_builder(&name(run, hop)).event().open_or_create().expect("event");
        let wake = events.listener_builder().create().expect("listener");
        let subscriber = service.subscriber_builder().buffer_size(DEPTH).create().expect("subscriber");
        Taker { subscriber, wake }
    }

    /// The next sample, or nothing after a while.
    fn take(&self) -> Option<ScaleReading> {
        let received = || self.subscriber.receive().expect("receive").map(|sample| *sample);
        received().or_else(|| {
            self.wake.timed_wait(|_| {}, LOOK_UP).expect("wait");
            received()
        })
    }
}
