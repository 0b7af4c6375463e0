//! Who has found whom: the readers elsewhere that each writer of a node is connected to.
//!
//! Place in the flow: followed on the node's own thread, in place of the spinner of the DDS library. That one subscribes
//! `/clock` as another type than it has in ROS 2, which makes every tool of the system refuse the topic.

use std::collections::{BTreeMap, BTreeSet};
use std::future::poll_fn;
use std::sync::Mutex;
use std::task::Poll;
use std::thread;
use std::time::{Duration, Instant};

use futures::StreamExt;
use ros2_client::dds::rustdds::{DomainParticipant, DomainParticipantStatusEvent, GUID, StatusEvented};

use super::first_call;
use crate::lock::lock;

/// A participant announces itself 0.1 s after it was made; at this age those who were there before know it.
const KNOWN_AFTER: Duration = Duration::from_millis(400);
/// The same after somebody new has been found.
const CAUGHT_UP_AFTER: Duration = Duration::from_millis(300);
/// Longest wait of one endpoint, in a graph where somebody new is found all the time.
const LONGEST_WAIT: Duration = Duration::from_millis(600);
/// How often it is looked who was found.
const LOOK_UP: Duration = Duration::from_millis(5);
/// Age until which those whom the participant finds count as having been there before.
const THERE_BEFORE: Duration = Duration::from_secs(1);
/// Longest wait for the endpoints of one of them, from when it was found: a program may have none.
const LISTED_WITHIN: Duration = Duration::from_secs(2);
/// Time in which the rest of a list comes.
const LIST_COMES: Duration = Duration::from_millis(50);
/// Longest wait for the reader of a caller: it may be gone.
const CALLER_COMES: Duration = Duration::from_millis(500);
/// Who loses endpoints that are announced while it catches up (RTPS 2.5, section 9.3.1.4).
const FAST_DDS: [u8; 2] = [0x01, 0x0f];

/// Readers by the writer that they are connected to, and when a participant was found.
pub(super) struct Matched {
    participant: DomainParticipant,
    readers: Mutex<BTreeMap<GUID, BTreeSet<GUID>>>,
    since: Instant,
    /// When a participant of Fast DDS was found last.
    found_at: Mutex<Option<Instant>>,
    /// Participants of Fast DDS that were there before and have not told of their endpoints, and when each was found.
    unlisted: Mutex<BTreeMap<GUID, Instant>>,
    /// When the last of these told.
    listed_at: Mutex<Option<Instant>>,
    /// Participants of Fast DDS.
    of_fast_dds: Mutex<BTreeSet<GUID>>,
    /// Only who has keys is heard.
    is_secured: bool,
    /// Held from when an event is taken until it is noted: of a reader that is lost and comes back, the last one counts.
    taking: Mutex<()>,
}

impl Matched {
    /// Of a participant made just now.
    pub(super) fn new(participant: DomainParticipant, is_secured: bool) -> Self {
        Self {
            participant,
            readers: Mutex::default(),
            since: Instant::now(),
            found_at: Mutex::default(),
            unlisted: Mutex::default(),
            listed_at: Mutex::default(),
            of_fast_dds: Mutex::default(),
            is_secured,
            taking: Mutex::default(),
        }
    }

    /// Waits until nobody is catching up with what the participant has announced before.
    ///
    /// Fast DDS (2.14, and later) loses announcements of endpoints that come out of order from two participants at once, if
    /// they carry no time, as the library's do: what waits for its predecessor is sorted by time between participants, and
    /// what stands in the wrong place is acknowledged and never looked at. The library sends a new announcement to
    /// participants that still lack earlier ones, so no endpoint is made while there are such.
    ///
    /// The other way round a second goes by: Fast DDS says once what it has, which comes before the library knows whom to take
    /// it from; what the library asks then with number 1 is no question to Fast DDS, where that is number 0, and it says so again
    /// at its next heartbeat, a second later. A program that was there before would find an endpoint of ours within
    /// milliseconds and send to it, or wait for what it sends, while its own is not known here: hundreds of samples at 1 kHz.
    /// So no endpoint is made before those who were there have told of theirs.
    pub(super) fn await_calm(&self) {
        let began = Instant::now();
        loop {
            self.take_in();
            let is_caught_up = lock(&self.found_at).is_none_or(|at| at.elapsed() >= CAUGHT_UP_AFTER);
            let is_calm = is_caught_up && self.since.elapsed() >= KNOWN_AFTER || began.elapsed() >= LONGEST_WAIT;
            if is_calm && self.are_listed() {
                return;
            }
            thread::sleep(LOOK_UP);
        }
    }

    /// Whether those who were there before have told of their endpoints.
    fn are_listed(&self) -> bool {
        let mut unlisted = lock(&self.unlisted);
        if unlisted.is_empty() {
            return lock(&self.listed_at).is_none_or(|at| at.elapsed() >= LIST_COMES);
        }
        let (writers, readers) = (self.participant.discovered_writers(), self.participant.discovered_readers());
        let has_told = |guid: &GUID| {
            writers.iter().any(|writer| writer.writer_proxy.remote_writer_guid.prefix == guid.prefix)
                && readers.iter().any(|reader| reader.reader_proxy.remote_reader_guid.prefix == guid.prefix)
        };
        unlisted.retain(|guid, found_at| found_at.elapsed() < LISTED_WITHIN && !has_told(guid));
        if unlisted.is_empty() {
            *lock(&self.listed_at) = Some(Instant::now());
        }
        false
    }

    /// Follows what the participant finds and loses, for ever.
    pub(super) async fn follow(&self) {
        let listener = self.participant.status_listener();
        let mut events = listener.as_async_status_stream();
        poll_fn(|context| {
            let _taking = lock(&self.taking);
            loop {
                match events.poll_next_unpin(context) {
                    Poll::Ready(Some(event)) => self.note(event),
                    Poll::Ready(None) => return Poll::Ready(()),
                    Poll::Pending => return Poll::Pending,
                }
            }
        })
        .await;
    }

    /// What the participant has found and lost until now.
    fn take_in(&self) {
        let listener = self.participant.status_listener();
        let _taking = lock(&self.taking);
        std::iter::from_fn(|| listener.try_recv_status()).for_each(|event| self.note(event));
    }

    /// Readers that this writer is connected to.
    pub(super) fn readers(&self, writer: GUID) -> Vec<GUID> {
        lock(&self.readers).get(&writer).into_iter().flatten().copied().collect()
    }

    /// Waits until the reader of a caller for the replies of `topic` is connected, and tells whether it came to be.
    ///
    /// A program calls as soon as it has found both ends of a service. Its request may come before this node has taken
    /// in its reader, and what is written until then never reaches it: nothing is kept for late readers of replies.
    pub(super) fn await_reader(&self, caller: GUID, topic: &str) -> bool {
        let began = Instant::now();
        loop {
            self.take_in();
            if self.has_reader(caller, topic) {
                return true;
            }
            if began.elapsed() >= CALLER_COMES {
                return false;
            }
            thread::sleep(LOOK_UP);
        }
    }

    /// Whether the reader of a caller for the replies of `topic` is connected to a writer of this node. Fast DDS names that
    /// reader; others name the writer of the request, beside which any reader of that topic is taken to be it.
    fn has_reader(&self, caller: GUID, topic: &str) -> bool {
        if caller.entity_id.entity_kind.is_reader() {
            return lock(&self.readers).values().any(|all| all.contains(&caller));
        }
        let readers = self.participant.discovered_readers().into_iter();
        let mut of_caller = readers.filter(|reader| reader.reader_proxy.remote_reader_guid.prefix == caller.prefix);
        let connected = lock(&self.readers);
        of_caller.any(|reader| {
            let guid = reader.reader_proxy.remote_reader_guid;
            reader.subscription_topic_data.topic_name == topic && connected.values().any(|all| all.contains(&guid))
        })
    }

    fn is_of_fast_dds(&self, endpoint: GUID) -> bool {
        lock(&self.of_fast_dds).iter().any(|participant| participant.prefix == endpoint.prefix)
    }

    fn note(&self, event: DomainParticipantStatusEvent) {
        match event {
            DomainParticipantStatusEvent::ParticipantDiscovered { dpd } if dpd.vendor_id.vendor_id == FAST_DDS => {
                let now = Instant::now();
                lock(&self.of_fast_dds).insert(dpd.guid);
                *lock(&self.found_at) = Some(now);
                if self.since.elapsed() < THERE_BEFORE {
                    lock(&self.unlisted).entry(dpd.guid).or_insert(now);
                }
            }
            DomainParticipantStatusEvent::ParticipantLost { id, .. } => {
                lock(&self.unlisted).retain(|guid, _| guid.prefix != id);
                lock(&self.of_fast_dds).retain(|guid| guid.prefix != id);
                lock(&self.readers).values_mut().for_each(|readers| readers.retain(|guid| guid.prefix != id));
            }
            DomainParticipantStatusEvent::RemoteReaderMatched { local_writer, remote_reader } => {
                lock(&self.readers).entry(local_writer).or_default().insert(remote_reader);
            }
            DomainParticipantStatusEvent::RemoteWriterMatched { local_reader, remote_writer }
                if !self.is_secured && self.is_of_fast_dds(remote_writer) =>
            {
                first_call::ask_again(&self.participant, local_reader, remote_writer);
            }
            DomainParticipantStatusEvent::ReaderLost { guid, .. } => {
                for readers in lock(&self.readers).values_mut() {
                    readers.remove(&guid);
                }
            }
            _ => {}
        }
    }
}
