//! The streams of a gateway: samples from shared memory to DDS or Zenoh, and from there to shared memory, a thread each.
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
use crate::ros::{Clock, RosError, RosNode, TopicEnd, Writer, offered_qos, overridden};
use crate::transport::dds::DdsSubscriber;
use crate::transport::shared_memory::{SampleOrigin, SharedMemory, SharedMemoryPublisher, SharedMemorySubscriber};
use crate::transport::zenoh::{ZenohSession, ZenohSubscriber};
use crate::transport::{Subscribe, TransportError, TransportKind};

/// How long a stream sleeps at most before it looks whether to end.
const LOOK_UP: Duration = Duration::from_millis(50);

/// A stream that runs. Dropping it ends it; what is on the link still goes out.
pub(super) struct Stream {
    shared: Arc<Shared>,
    /// Absolute name of the topic that samples are published on over DDS.
    published_on: Option<String>,
    /// The same of one that they are taken from.
    taken_from: Option<String>,
    /// Other publishers of the topic, where it is not over DDS.
    others: Option<Others>,
    readers: Option<Readers>,
    thread: Option<JoinHandle<()>>,
}

/// Subscribers of a publication elsewhere, and how often those who lagged lost their oldest samples.
type Readers = Box<dyn Fn() -> (usize, u64) + Send>;

/// Publishers of a topic elsewhere.
type Others = Box<dyn Fn() -> usize + Send>;

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
    /// Opens the session over Zenoh, or gives the one that is open.
    pub(super) zenoh: &'a dyn Fn() -> Result<ZenohSession, TransportError>,
    /// The time that the node goes by.
    pub(super) clock: &'a Clock,
}

impl Stream {
    /// Opens the stream of an endpoint; none for a service or a standing message.
    pub(super) fn open(world: &World, endpoint: &Endpoint) -> Result<Option<Stream>, TransportError> {
        match endpoint {
            Endpoint::Publication { link, ros_type, topic, over, companions } => {
                let out = Out { link, topic: topic.as_deref(), over: *over, companions };
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
            Endpoint::Subscription { link, ros_type, topic, over, foreign: None } => match ros_type.as_str() {
                ScaleReading::ROS_TYPE => subscription::<ScaleReading>(world, link, topic, *over).map(Some),
                CorrectedCoordinates::ROS_TYPE => {
                    subscription::<CorrectedCoordinates>(world, link, topic, *over).map(Some)
                }
                TracerReading::ROS_TYPE => subscription::<TracerReading>(world, link, topic, *over).map(Some),
                RangeResidual::ROS_TYPE => subscription::<RangeResidual>(world, link, topic, *over).map(Some),
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
        let others = self.others_on(self.published_on.as_ref(), elsewhere);
        PublicationBeat { subscribers, others, given_up, now: self.progress(), proved }
    }

    /// What a subscription had to refuse, and how many publish its topic.
    pub(super) fn subscription(&self, elsewhere: &[String]) -> SubscriptionBeat {
        let publishers = self.others_on(self.taken_from.as_ref(), elsewhere);
        SubscriptionBeat { publishers, ..lock(&self.shared.refused).clone() }
    }

    fn others_on(&self, over_dds: Option<&String>, elsewhere: &[String]) -> usize {
        let published = || elsewhere.iter().filter(|topic| Some(*topic) == over_dds).count();
        self.others.as_ref().map_or_else(published, |others| others())
    }

    fn start(run: impl FnOnce(&Shared) + Send + 'static) -> Result<Stream, TransportError> {
        let shared = Arc::new(Shared::default());
        let its = Arc::clone(&shared);
        let thread = thread::Builder::new()
            .name("stream".into())
            .spawn(move || run(&its))
            .map_err(|source| RosError::Thread { what: "a stream", source })?;
        let thread = Some(thread);
        Ok(Stream { shared, published_on: None, taken_from: None, others: None, readers: None, thread })
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

/// Where a publication's samples come from, and under which names they go out over what.
struct Out<'a> {
    link: &'a str,
    topic: Option<&'a str>,
    over: TransportKind,
    companions: &'a [Companion],
}

/// How messages of a topic are published, and who else has to do with it.
struct Sending<R> {
    publish: Publishing<R>,
    readers: Readers,
    others: Option<Others>,
}

/// Publishes a message, or says why it cannot.
type Publishing<R> = Box<dyn Fn(R) -> Result<(), String> + Send>;

fn sending<R: RosType>(world: &World, topic: &str, over: TransportKind) -> Result<Sending<R>, TransportError> {
    let depth = world.memory.depth();
    if over == TransportKind::Zenoh {
        let session = (world.zenoh)()?;
        let writer = Arc::new(session.writer::<R>(topic, depth)?);
        let (its, topic) = (Arc::clone(&writer), topic.to_owned());
        return Ok(Sending {
            publish: Box::new(move |message| writer.publish(&message)),
            readers: Box::new(move || (its.subscribers(), 0)),
            others: Some(Box::new(move || session.publishers_elsewhere(&topic, R::ROS_TYPE))),
        });
    }
    let writer = Arc::new(writer::<R>(world.node, topic, depth)?);
    let (its, node) = (Arc::clone(&writer), world.node.clone());
    Ok(Sending {
        publish: Box::new(move |message| writer.publish(message)),
        readers: Box::new(move || (node.subscribers(&its), its.given_up())),
        others: None,
    })
}

fn publication<M: Companionable>(world: &World, out: Out) -> Result<Stream, TransportError> {
    let mut link = world.memory.subscriber::<M>(out.link)?;
    let sending = out.topic.map(|topic| sending::<M::Ros>(world, topic, out.over)).transpose()?;
    let companions = out.companions.iter().map(|companion| M::beside(world.node, companion));
    let mut companions = companions.collect::<Result<Vec<_>, _>>()?;
    let (publisher, readers, others) = match sending {
        Some(Sending { publish, readers, others }) => (Some(publish), Some(readers), others),
        None => (None, None, None),
    };
    let mut stream = Stream::start(move |shared| {
        let mut failed = 0;
        while let Some(sample) = next(&mut link, shared) {
            let (published, beside) = publish(&sample, publisher.as_ref(), &mut companions);
            failed += u64::from(published.is_err());
            for error in [published, beside].into_iter().filter_map(Result::err) {
                tracing::warn!(error, "could not publish");
            }
            note(shared, &link, failed);
        }
    })?;
    (stream.readers, stream.others) = (readers, others);
    stream.published_on = out.topic.filter(|_| out.over == TransportKind::Dds).map(str::to_owned);
    Ok(stream)
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
    publisher: Option<&Publishing<M::Ros>>,
    companions: &mut [Beside<M>],
) -> (Result<(), String>, Result<(), String>) {
    let published = publisher.map_or(Ok(()), |publish| publish(sample.to_ros()));
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

/// Samples that come with their origin, over whichever transport.
trait Arrives<M>: Send {
    fn take_with_origin(&mut self, timeout: Duration) -> Result<Option<(M, SampleOrigin)>, TransportError>;
}

impl<M: Message, R: RosType> Arrives<M> for DdsSubscriber<M, R> {
    fn take_with_origin(&mut self, timeout: Duration) -> Result<Option<(M, SampleOrigin)>, TransportError> {
        DdsSubscriber::take_with_origin(self, timeout)
    }
}

impl<M: Message> Arrives<M> for ZenohSubscriber<M> {
    fn take_with_origin(&mut self, timeout: Duration) -> Result<Option<(M, SampleOrigin)>, TransportError> {
        ZenohSubscriber::take_with_origin(self, timeout)
    }
}

fn subscription<M: Message>(
    world: &World,
    link: &str,
    topic: &str,
    over: TransportKind,
) -> Result<Stream, TransportError> {
    let depth = world.memory.depth();
    if over == TransportKind::Zenoh {
        let session = (world.zenoh)()?;
        let mut stream = taking(world, link, session.subscriber::<M>(topic, depth)?)?;
        let topic = topic.to_owned();
        stream.others = Some(Box::new(move || session.publishers_elsewhere(&topic, M::ROS_TYPE)));
        return Ok(stream);
    }
    over_dds(taking(world, link, DdsSubscriber::<M>::open(world.node, topic, depth)?)?, topic)
}

fn of_others<M: Message, R: Makes<M>>(
    world: &World,
    link: &str,
    topic: &str,
    foreign: &Foreign,
) -> Result<Stream, TransportError> {
    let (foreign, clock) = (foreign.clone(), world.clock.clone());
    let convert = move |message: R| foreign.made_of(&message, &clock);
    let samples = DdsSubscriber::converting(world.node, topic, world.memory.depth(), Box::new(convert))?;
    over_dds(taking(world, link, samples)?, topic)
}

fn over_dds(mut stream: Stream, topic: &str) -> Result<Stream, TransportError> {
    stream.taken_from = Some(topic.to_owned());
    Ok(stream)
}

fn taking<M: Message>(
    world: &World,
    link: &str,
    mut samples: impl Arrives<M> + 'static,
) -> Result<Stream, TransportError> {
    let mut link: SharedMemoryPublisher<M> = world.memory.publisher(link)?;
    Stream::start(move |shared| {
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
                    tracing::error!(%error, "cannot receive");
                    thread::sleep(LOOK_UP);
                }
            }
        }
    })
}
