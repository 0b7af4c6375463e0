//! Programs of others on DDS: a user's node, what comes to it, readings that it feeds to a graph, `/diagnostics`.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use abbe_msgs::standard::{DiagnosticArray, DiagnosticStatus};
use abbe_msgs::{CorrectedCoordinates, Message, ScaleReading, ros};
use abbe_runtime::Subscribe;
use abbe_runtime::ros::{
    Domain, NodeIdentity, NodeOptions, ParameterTable, QueuedPublisher, RosNode, StaticPeers, diagnostics_qos,
    stream_qos,
};
use abbe_runtime::transport::dds::DdsSubscriber;
use ros2_client::dds::rustdds::DomainParticipantBuilder;

use super::files::Bench;
use super::graph::{DDS, LaunchText, MEMORY, topic};
use super::program::{Started, abbe_in, wait_until};

/// Longest that anything here takes on a loaded machine.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);

/// What comes over DDS at a user's, counted on a thread of its own until this is dropped.
pub(crate) struct OverDds {
    received: Arc<AtomicUsize>,
    /// The longest wait between two of them since it was asked for last (ns).
    longest_gap_ns: Arc<AtomicU64>,
    running: Arc<AtomicBool>,
    thread: Option<thread::JoinHandle<()>>,
}

impl OverDds {
    pub(crate) fn of(node: &RosNode, topic: &str) -> OverDds {
        let mut subscriber = DdsSubscriber::<CorrectedCoordinates>::open(node, topic, DEPTH).unwrap();
        let (received, running) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(true)));
        let (count, goes_on) = (Arc::clone(&received), Arc::clone(&running));
        let longest_gap_ns = Arc::new(AtomicU64::new(0));
        let longest = Arc::clone(&longest_gap_ns);
        let thread = thread::spawn(move || {
            let mut last = None::<Instant>;
            while goes_on.load(Ordering::Relaxed) {
                let taken = subscriber.take_within(Duration::from_millis(20)).unwrap();
                count.fetch_add(usize::from(taken.is_some()), Ordering::Relaxed);
                // A wait counts while it goes on, too.
                let gap = last.map_or(Duration::ZERO, |last| last.elapsed());
                longest.fetch_max(u64::try_from(gap.as_nanos()).unwrap(), Ordering::Relaxed);
                last = if taken.is_some() { Some(Instant::now()) } else { last };
            }
        });
        OverDds { received, longest_gap_ns, running, thread: Some(thread) }
    }

    /// The longest wait between two samples since this was asked last.
    pub(crate) fn longest_gap(&self) -> Duration {
        Duration::from_nanos(self.longest_gap_ns.swap(0, Ordering::Relaxed))
    }

    /// How long it takes until a hundred more samples have come.
    #[track_caller]
    pub(crate) fn flows_within(&self, limit: Duration, after: &str) -> Duration {
        let (since, before) = (Instant::now(), self.received.load(Ordering::Relaxed));
        wait_until(&format!("samples flow over DDS after {after}"), limit, || {
            self.received.load(Ordering::Relaxed) >= before + 100
        });
        since.elapsed()
    }
}

impl Drop for OverDds {
    fn drop(&mut self) {
        self.running.store(false, Ordering::Relaxed);
        self.thread.take().map(thread::JoinHandle::join);
    }
}

/// A node of a user who sends and takes over DDS.
pub(crate) fn user_node(domain: Domain) -> RosNode {
    let identity = NodeIdentity::new("/", "test_user").unwrap();
    RosNode::start(NodeOptions {
        identity,
        domain,
        remaps: Vec::new(),
        parameters: ParameterTable::default(),
        enclave: None,
        peers: StaticPeers::default(),
    })
    .unwrap()
}

/// The correcting nodes, fed by a user over DDS.
pub(crate) struct Fed {
    pub(crate) graph: Started,
    pub(crate) node: RosNode,
    pub(crate) readings: QueuedPublisher<ros::ScaleReading>,
    pub(crate) corrected: DdsSubscriber<CorrectedCoordinates>,
}

impl Fed {
    /// Starts them and waits until they answer; `probe` finds that out.
    pub(crate) fn start(bench: &Bench, domain: Domain, probe: &ScaleReading) -> Fed {
        let launch = LaunchText::default().nodes(&["geometric", "residual"]).edge("scale", "geometric", DDS);
        let launch = launch.edge("geometric", "residual", MEMORY).edge("residual", "*", DDS);
        let graph = Started::start(abbe_in(domain, ["launch", &launch.write(bench)]));
        let (node, depth) = (user_node(domain), DEPTH);
        let readings = publisher_of_readings(&node);
        let corrected = DdsSubscriber::<CorrectedCoordinates>::open(&node, &topic("corrected"), depth).unwrap();
        let mut fed = Fed { graph, node, readings, corrected };
        let deadline = Instant::now() + PATIENCE;
        let probe = ScaleReading { sequence: u64::MAX, ..*probe };
        while fed.corrected.take_within(Duration::from_millis(20)).unwrap().is_none() {
            assert!(Instant::now() < deadline, "the graph did not answer");
            fed.readings.publish(probe.to_ros());
        }
        fed
    }

    /// Sends a reading a millisecond.
    pub(crate) fn send(&self, readings: impl IntoIterator<Item = ScaleReading>) {
        for reading in readings {
            self.readings.publish(reading.to_ros());
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// The next answers, without those to the probes.
    pub(crate) fn take(&mut self, count: usize) -> Vec<CorrectedCoordinates> {
        let mut taken = Vec::new();
        while taken.len() < count {
            let sample = self.corrected.take_within(PATIENCE).unwrap().expect("the stream ended");
            taken.extend(Some(sample).filter(|sample| sample.sequence != u64::MAX));
        }
        taken
    }
}

pub(crate) const DEPTH: NonZeroUsize = NonZeroUsize::MIN.saturating_add(4095);

pub(crate) fn publisher_of_readings(node: &RosNode) -> QueuedPublisher<ros::ScaleReading> {
    node.publisher::<ros::ScaleReading>(&topic("scale/reading"), &stream_qos(DEPTH), DEPTH).unwrap()
}

/// A listener to `/diagnostics` by others.
pub(crate) struct Listener {
    events: ros2_client::Subscription<DiagnosticArray>,
    _node: ros2_client::Node,
}

impl Listener {
    pub(crate) fn on_diagnostics(domain: Domain) -> Listener {
        let networks = [std::net::Ipv4Addr::LOCALHOST];
        let participant = DomainParticipantBuilder::new(domain.id()).with_only_networks(networks).build().unwrap();
        let context = ros2_client::Context::from_domain_participant(participant).unwrap();
        let name = ros2_client::NodeName::new("/", "listener").unwrap();
        let mut node = context.new_node(name, ros2_client::NodeOptions::new()).unwrap();
        let kind = ros2_client::MessageTypeName::new("diagnostic_msgs", "DiagnosticArray");
        let name = ros2_client::Name::parse("/diagnostics").unwrap();
        let topic = node.create_topic(&name, kind, &diagnostics_qos()).unwrap();
        let events = node.create_subscription::<DiagnosticArray>(&topic, Some(diagnostics_qos())).unwrap();
        Listener { events, _node: node }
    }

    /// What has come since the last call of one component, as `node: component`.
    pub(crate) fn news(&self, component: &str) -> Vec<DiagnosticStatus> {
        let mut news = Vec::new();
        while let Some((array, _)) = self.events.take().unwrap() {
            news.extend(array.status.into_iter().filter(|status| status.name.ends_with(component)));
        }
        news
    }

    /// Waits until warnings of a component have said all of this.
    #[track_caller]
    pub(crate) fn hears_warnings(&self, component: &str, words: &[&str]) {
        self.hears(component, DiagnosticStatus::WARN, words);
    }

    /// The same of reports of this level.
    #[track_caller]
    pub(crate) fn hears(&self, component: &str, level: u8, words: &[&str]) {
        let (deadline, mut warned) = (Instant::now() + PATIENCE, String::new());
        while !words.iter().all(|part| warned.contains(part)) {
            assert!(Instant::now() < deadline, "no level {level} of {words:?}: {warned}");
            let warnings = self.news(component).into_iter().filter(|status| status.level == level);
            warnings.for_each(|status| warned += &status.message);
            thread::sleep(Duration::from_millis(20));
        }
    }
}
