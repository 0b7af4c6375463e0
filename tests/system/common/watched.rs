//! A graph that a user watches while something happens to it: every sample over shared memory, its gaps, and DDS beside.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use abbe_msgs::CorrectedCoordinates;
use abbe_runtime::ros::Domain;
use abbe_runtime::{RunId, Subscribe};
use rustix::process::Signal;

use super::dds::{OverDds, user_node};
use super::files::Bench;
use super::graph::{DDS, MEMORY, files_of_run, long_recording, stream_of, topic, user};
use super::program::{Started, abbe_in, children, gateway_of, is_running, signal};

/// Longest until samples flow over DDS again.
pub(crate) const FLOWS_WITHIN: Duration = Duration::from_secs(15);
/// Longest delay that a fault may add: the limit the project promises.
pub(crate) const MAX_DELAY: Duration = Duration::from_millis(50);
/// Scale, geometric and residual node and this subscriber: each can be off the processor when a sample comes by.
pub(crate) const PROCESSES_ON_THE_WAY: u32 = 4;
/// Parts of a test whose gaps are told apart.
pub(crate) const PHASES: usize = 4;

/// What happens to a graph goes through this.
pub(crate) struct Watched<'a> {
    pub(crate) launcher: u32,
    pub(crate) over_dds: &'a OverDds,
    phase: &'a AtomicUsize,
}

impl Watched<'_> {
    /// From now on gaps count as those of another part, 0 to 3.
    pub(crate) fn begin(&self, phase: usize) {
        self.phase.store(phase, Ordering::Relaxed);
    }

    /// A process by its name: `launcher`, a node, or `gateway of` a node; none while it is not running.
    pub(crate) fn process(&self, name: &str) -> Option<u32> {
        let node_of = |node: &str| {
            let of_node = |(id, line): &(u32, String)| line.contains(&format!("node {node} ")) && is_running(*id);
            Some(children(self.launcher).into_iter().find(of_node)?.0)
        };
        match name.split_once(" of ") {
            Some((_, node)) => gateway_of(node_of(node)?),
            None if name == "launcher" => Some(self.launcher),
            None => node_of(name),
        }
    }
}

/// What the user saw.
#[derive(Debug)]
pub(crate) struct Seen {
    pub(crate) taken: u64,
    /// Numbers left out between the first and the last sample.
    pub(crate) missed: u64,
    /// The longest gap of each part.
    pub(crate) gaps: [Duration; PHASES],
    /// The longest delay of a thread that only sleeps, of each part.
    pub(crate) control: [Duration; PHASES],
    /// From the first sample to the last.
    pub(crate) lasted: Duration,
    pub(crate) errors: String,
    pub(crate) summaries: String,
}

/// The correcting chain, fed at 1 kHz for so many seconds at most, with these nodes on DDS as well; `happens` is what happens to
/// it. It ends well and leaves nothing, or the test fails.
pub(crate) fn watch(domain: Domain, seconds: u64, on_dds: &[&str], happens: impl FnOnce(&Watched)) -> Seen {
    let bench = Bench::identified(5);
    long_recording(&bench, 1000 * seconds);
    let file = stream_of(&bench, |launch| {
        on_dds.iter().fold(launch.edge("residual", "user", MEMORY), |launch, node| launch.edge(node, "*", DDS))
    });
    let run = RunId::unique();
    let graph = Started::start(abbe_in(domain, ["launch", &file, "--run", run.as_str()]));
    let mut subscriber = user::<CorrectedCoordinates>(&run, "corrected");
    let node = user_node(domain);
    let over_dds = OverDds::of(&node, &topic("corrected"));
    let (stop, phase) = (AtomicBool::new(false), AtomicUsize::new(0));
    let (taken, control) = thread::scope(|scope| {
        let stops = StopAtEnd(&stop);
        let taking = scope.spawn(|| take(subscriber.as_mut(), &phase, &stop));
        let control = scope.spawn(|| control(&phase, &stop));
        over_dds.flows_within(FLOWS_WITHIN, "the start");
        happens(&Watched { launcher: graph.id(), over_dds: &over_dds, phase: &phase });
        drop(stops);
        (taking.join().unwrap(), control.join().unwrap())
    });
    assert_eq!(subscriber.lost(), 0, "what the chain sent did not all come");
    drop((subscriber, over_dds, node));
    signal(graph.id(), Signal::INT);
    let ran = graph.finish();
    let errors = ran.errors.clone();
    let summaries = ran.ok();
    assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
    let Taken { taken, missed, gaps, lasted } = taken;
    Seen { taken, missed, gaps, control, lasted, errors, summaries }
}

/// Tells the threads of a test to stop, also where the test fails: it waits for them.
pub(crate) struct StopAtEnd<'a>(pub(crate) &'a AtomicBool);

impl Drop for StopAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[derive(Default)]
struct Taken {
    taken: u64,
    missed: u64,
    gaps: [Duration; PHASES],
    lasted: Duration,
}

/// Takes every sample, each at most once and in order.
fn take(subscriber: &mut dyn Subscribe<CorrectedCoordinates>, phase: &AtomicUsize, stop: &AtomicBool) -> Taken {
    let (mut seen, mut next, mut last) = (Taken::default(), 0, None::<Instant>);
    while !stop.load(Ordering::Relaxed) {
        let Some(sample) = subscriber.take_within(Duration::from_millis(20)).unwrap() else { continue };
        assert!(sample.sequence >= next, "sample {} came after {next}", sample.sequence);
        seen.missed += sample.sequence - next;
        (next, seen.taken) = (sample.sequence + 1, seen.taken + 1);
        let gap = last.replace(Instant::now()).map_or(Duration::ZERO, |last| last.elapsed());
        let now = phase.load(Ordering::Relaxed);
        seen.gaps[now] = seen.gaps[now].max(gap);
        seen.lasted += gap;
    }
    seen
}

/// The longest delay of a thread that only sleeps.
pub(crate) fn control(phase: &AtomicUsize, stop: &AtomicBool) -> [Duration; PHASES] {
    let mut longest = [Duration::ZERO; PHASES];
    while !stop.load(Ordering::Relaxed) {
        let (start, now) = (Instant::now(), phase.load(Ordering::Relaxed));
        thread::sleep(Duration::from_millis(1));
        longest[now] = longest[now].max(start.elapsed());
    }
    longest
}
