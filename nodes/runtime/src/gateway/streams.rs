//! The streams of a gateway: samples from shared memory to DDS, and from DDS to shared memory, a thread each.
//!
//! Place in the flow: in the gateway's process, between its node's end of a link and the network. What cannot keep up
//! loses the oldest on the link, counted; the node never notices.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use abbe_msgs::standard::{Float64, FluidPressure, JointState, PointStamped, Range, RelativeHumidity, Temperature};
use abbe_msgs::{CorrectedCoordinates, Message, RangeResidual, RosType, ScaleReading, TracerReading};

use super::companion::{Beside, Companion, Companionable};
use super::foreign::{Foreign, ForeignMessage, Makes};
use super::protocol::{Endpoint, Progress, PublicationBeat, SubscriptionBeat};
use crate::lock::lock;
use crate::ros::{RosError, RosNode, TopicEnd, Writer, offered_qos, overridden};
use crate::transport::dds::DdsSubscriber;
use crate::transport::shared_memory::{SharedMemory, SharedMemoryPublisher, SharedMemorySubscriber};
use crate::transport::{Subscribe, TransportError};

/// How long a stream sleeps at most before it looks whether to end.
const LOOK_UP: Duration = Duration::from_millis(50);

/// A stream that runs. Dropping it ends it; what is on the link still goes out.
pub(super) struct Stream {
    shared: Arc<Shared>,
    /// Absolute name of the topic that samples are published on.
    published_on: Option<String>,
    /// The same of one that they are taken from.
    taken_from: Option<String>,
    readers: Option<Readers>,
    thread: Option<JoinHandle<()>>,
}

/// Subscribers of a publication elsewhere, and how often those who lagged lost their oldest samples.
type Readers = Box<dyn Fn() -> (usize, u64) + Send>;

#[derive(Default)]
struct Shared {
    ending: AtomicBool,
    progress: Mutex<Progress>,
    refused: Mutex<SubscriptionBeat>,
}

/// What a stream works with.
pub(super) struct World<'a> {
    pub(super) node: &'a RosNode,
    pub(super) memory: &'a SharedMemory,
}

impl Stream {
    /// Opens the stream of an endpoint; none for a service or a standing message.
    pub(super) fn open(world: &World, endpoint: &Endpoint) -> Result<Option<Stream>, TransportError> {
        match endpoint {
            Endpoint::Publication { link, ros_type, topic, companions } => {
                let out = Out { link, topic: topic.as_deref(), companions };
                match ros_type.as_str() {
                    ScaleReading::ROS_TYPE => publication::<ScaleReading>(world, out).map(Some),
                    CorrectedCoordinates::ROS_TYPE => publication::<CorrectedCoordinates>(world, out).map(Some),
                    TracerReading::ROS_TYPE => publication::<TracerReading>(world, out).map(Some),
                    RangeResidual::ROS_TYPE => publication::<RangeResidual>(world, out).map(Some),
                    other => Err(unknown(link, other)),
                }
            }
            Endpoint::Subscription { link, topic, foreign: Some(foreign), .. } => {
                Stream::of_foreign(world, link, topic, foreign).map(Some)
            }
            Endpoint::Subscription { link, ros_type, topic, foreign: None } => match ros_type.as_str() {
                ScaleReading::ROS_TYPE => subscription::<ScaleReading>(world, link, topic).map(Some),
                CorrectedCoordinates::ROS_TYPE => subscription::<CorrectedCoordinates>(world, link, topic).map(Some),
                TracerReading::ROS_TYPE => subscription::<TracerReading>(world, link, topic).map(Some),
                RangeResidual::ROS_TYPE => subscription::<RangeResidual>(world, link, topic).map(Some),
                other => Err(unknown(topic, other)),
            },
            Endpoint::Service(_) | Endpoint::Standing(..) | Endpoint::Lifecycle(..) => Ok(None),
        }
    }

    /// Samples of standard messages of others.
    fn of_foreign(world: &World, link: &str, topic: &str, foreign: &Foreign) -> Result<Stream, TransportError> {
        match &foreign.message {
            ForeignMessage::Joints(..) => of_others::<ScaleReading, JointState>(world, link, topic, foreign),
            ForeignMessage::Position(..) => of_others::<ScaleReading, PointStamped>(world, link, topic, foreign),
            ForeignMessage::Range(..) => of_others::<TracerReading, Range>(world, link, topic, foreign),
            ForeignMessage::Distance(..) => of_others::<TracerReading, PointStamped>(world, link, topic, foreign),
            ForeignMessage::Temperature(..) => of_others::<ScaleReading, Temperature>(world, link, topic, foreign),
            ForeignMessage::Pressure(..) => of_others::<ScaleReading, FluidPressure>(world, link, topic, foreign),
            ForeignMessage::Humidity(..) => of_others::<ScaleReading, RelativeHumidity>(world, link, topic, foreign),
            ForeignMessage::Number(..) => of_others::<ScaleReading, Float64>(world, link, topic, foreign),
        }
    }

    /// How far it has come.
    pub(super) fn progress(&self) -> Progress {
        *lock(&self.shared.progress)
    }

    /// Whether it has a topic over DDS.
    pub(super) fn has_topic(&self) -> bool {
        self.published_on.is_some() || self.taken_from.is_some()
    }

    /// How a publication stands, with the progress that was proved last, and the topics that others publish.
    pub(super) fn publication(&self, proved: Progress, elsewhere: &[String]) -> PublicationBeat {
        let (subscribers, given_up) = self.readers.as_ref().map_or((0, 0), |readers| readers());
        let others = elsewhere.iter().filter(|topic| Some(*topic) == self.published_on.as_ref()).count();
        PublicationBeat { subscribers, others, given_up, now: self.progress(), proved }
    }

    /// What a subscription had to refuse, and how many publish its topic.
    pub(super) fn subscription(&self, elsewhere: &[String]) -> SubscriptionBeat {
        let publishers = elsewhere.iter().filter(|topic| Some(*topic) == self.taken_from.as_ref()).count();
        SubscriptionBeat { publishers, ..lock(&self.shared.refused).clone() }
    }

    fn start(
        published_on: Option<&str>,
        readers: Option<Readers>,
        run: impl FnOnce(&Shared) + Send + 'static,
    ) -> Result<Stream, TransportError> {
        let shared = Arc::new(Shared::default());
        let its = Arc::clone(&shared);
        let thread = thread::Builder::new()
            .name("stream".into())
            .spawn(move || run(&its))
            .map_err(|source| RosError::Thread { what: "a stream", source })?;
        let published_on = published_on.map(str::to_owned);
        Ok(Stream { shared, published_on, taken_from: None, readers, thread: Some(thread) })
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.shared.ending.store(true, Ordering::Relaxed);
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the thread of a stream panicked");
        }
    }
}

fn unknown(topic: &str, ros_type: &str) -> TransportError {
    let reason = format!("a gateway knows no type {ros_type}");
    TransportError::Endpoint { topic: topic.to_owned(), what: "stream", kind: super::KIND, reason }
}

/// Where a publication's samples come from, and under which names they go out.
struct Out<'a> {
    link: &'a str,
    topic: Option<&'a str>,
    companions: &'a [Companion],
}

fn publication<M: Companionable>(world: &World, out: Out) -> Result<Stream, TransportError> {
    let mut link = world.memory.subscriber::<M>(out.link)?;
    let open = |topic| writer::<M::Ros>(world.node, topic, world.memory.depth());
    let publisher = out.topic.map(open).transpose()?.map(Arc::new);
    let companions = out.companions.iter().map(|companion| M::beside(world.node, companion));
    let mut companions = companions.collect::<Result<Vec<_>, _>>()?;
    let readers = publisher.clone().map(|publisher| {
        let node = world.node.clone();
        Box::new(move || (node.subscribers(&publisher), publisher.given_up())) as Readers
    });
    Stream::start(out.topic, readers, move |shared| {
        let mut failed = 0;
        while let Some(sample) = next(&mut link, shared) {
            let (published, others) = publish(&sample, publisher.as_deref(), &mut companions);
            failed += u64::from(published.is_err());
            for error in [published, others].into_iter().filter_map(Result::err) {
                tracing::warn!(error, "could not publish");
            }
            note(shared, &link, failed);
        }
    })
}

/// The next sample of a link; none once the stream is to end and the link is empty.
fn next<M: Message>(link: &mut SharedMemorySubscriber<M>, shared: &Shared) -> Option<M> {
    loop {
        let ending = shared.ending.load(Ordering::Relaxed);
        match link.take_within(if ending { Duration::ZERO } else { LOOK_UP }) {
            Ok(Some(sample)) => return Some(sample),
            Ok(None) if ending => return None,
            Ok(None) => {}
            // The node sends what it took or made; over shared memory nothing is refused that it did not refuse.
            Err(error) if error.is_malformed_sample() => tracing::warn!(%error, "not published"),
            Err(error) => {
                tracing::error!(%error, "the link to the node fails");
                thread::sleep(LOOK_UP);
            }
        }
    }
}

fn publish<M: Message>(
    sample: &M,
    publisher: Option<&Writer<M::Ros>>,
    companions: &mut [Beside<M>],
) -> (Result<(), String>, Result<(), String>) {
    let published = publisher.map_or(Ok(()), |publisher| publisher.publish(sample.to_ros()));
    let others = companions.iter_mut().try_for_each(|beside| beside(sample));
    (published, others)
}

fn note<M: Message>(shared: &Shared, link: &SharedMemorySubscriber<M>, failed: u64) {
    let Some(next) = link.next_number() else { return };
    let mut progress = lock(&shared.progress);
    progress.first.get_or_insert(next.saturating_sub(1));
    (progress.next, progress.dropped) = (next, link.lost() + failed);
}

/// A writer of a stream, with what the node's parameters say of its quality of service.
fn writer<R: RosType>(node: &RosNode, topic: &str, depth: NonZeroUsize) -> Result<Writer<R>, RosError> {
    node.writer(topic, &overridden(node, topic, TopicEnd::Publisher, offered_qos(depth)))
}

fn subscription<M: Message>(world: &World, link: &str, topic: &str) -> Result<Stream, TransportError> {
    taking(world, link, topic, DdsSubscriber::<M>::open(world.node, topic, world.memory.depth())?)
}

fn of_others<M: Message, R: Makes<M>>(
    world: &World,
    link: &str,
    topic: &str,
    foreign: &Foreign,
) -> Result<Stream, TransportError> {
    let foreign = foreign.clone();
    let convert = move |message: R| foreign.made_of(&message);
    taking(world, link, topic, DdsSubscriber::converting(world.node, topic, world.memory.depth(), Box::new(convert))?)
}

fn taking<M: Message, R: RosType>(
    world: &World,
    link: &str,
    topic: &str,
    mut samples: DdsSubscriber<M, R>,
) -> Result<Stream, TransportError> {
    let mut link: SharedMemoryPublisher<M> = world.memory.publisher(link)?;
    let mut stream = Stream::start(None, None, move |shared| {
        while !shared.ending.load(Ordering::Relaxed) {
            match samples.take_with_origin(LOOK_UP) {
                Ok(Some((sample, origin))) => {
                    // One that finds no room is a gap in the numbers, which the node counts.
                    if let Err(error) = link.send_as(&sample, origin) {
                        tracing::warn!(%error, "not handed to the node");
                    }
                }
                Ok(None) => {}
                Err(error) if error.is_malformed_sample() => {
                    tracing::warn!(%error, "refused");
                    let mut refused = lock(&shared.refused);
                    refused.malformed += 1;
                    refused.last_reason = error.to_string();
                }
                Err(error) => {
                    tracing::error!(%error, "DDS fails to receive");
                    thread::sleep(LOOK_UP);
                }
            }
        }
    })?;
    stream.taken_from = Some(topic.to_owned());
    Ok(stream)
}
