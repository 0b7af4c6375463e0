//! Who has found whom: the readers elsewhere that each writer of a node is connected to.
//!
//! Place in the flow: followed on the node's own thread, in place of the spinner of the DDS library. That one subscribes
//! `/clock` as another type than it has in ROS 2, which makes every tool of the system refuse the topic.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;
use std::thread;
use std::time::{Duration, Instant};

use futures::StreamExt;
use ros2_client::dds::rustdds::{DomainParticipant, DomainParticipantStatusEvent, GUID, StatusEvented};

use crate::lock::lock;

/// A participant announces itself 0.1 s after it was made; at this age those who were there before know it.
const KNOWN_AFTER: Duration = Duration::from_millis(400);
/// The same after somebody new has been found.
const CAUGHT_UP_AFTER: Duration = Duration::from_millis(300);
/// Longest wait of one endpoint, in a graph where somebody new is found all the time.
const LONGEST_WAIT: Duration = Duration::from_millis(600);
/// How often it is looked who was found.
const LOOK_UP: Duration = Duration::from_millis(5);
/// Who loses endpoints that are announced while it catches up (RTPS 2.5, section 9.3.1.4).
const FAST_DDS: [u8; 2] = [0x01, 0x0f];

/// Readers by the writer that they are connected to, and when a participant was found.
#[derive(Debug)]
pub(super) struct Matched {
    readers: Mutex<BTreeMap<GUID, BTreeSet<GUID>>>,
    since: Instant,
    /// When a participant of Fast DDS was found last.
    found_at: Mutex<Option<Instant>>,
}

impl Matched {
    /// Of a participant made just now.
    pub(super) fn new() -> Self {
        Self { readers: Mutex::default(), since: Instant::now(), found_at: Mutex::default() }
    }

    /// Waits until nobody is catching up with what the participant has announced before.
    ///
    /// Fast DDS (2.14, and later) loses announcements of endpoints that come out of order from two participants at once, if
    /// they carry no time, as the library's do: what waits for its predecessor is sorted by time between participants, and
    /// what stands in the wrong place is acknowledged and never looked at. The library sends a new announcement to
    /// participants that still lack earlier ones, so no endpoint is made while there are such.
    pub(super) fn await_calm(&self, participant: &DomainParticipant) {
        let (listener, began) = (participant.status_listener(), Instant::now());
        while began.elapsed() < LONGEST_WAIT {
            std::iter::from_fn(|| listener.try_recv_status()).for_each(|event| self.note(event));
            let is_caught_up = lock(&self.found_at).is_none_or(|at| at.elapsed() >= CAUGHT_UP_AFTER);
            if is_caught_up && self.since.elapsed() >= KNOWN_AFTER {
                return;
            }
            thread::sleep(LOOK_UP);
        }
    }

    /// Follows what the participant finds and loses, for ever.
    pub(super) async fn follow(&self, participant: &DomainParticipant) {
        let listener = participant.status_listener();
        let mut events = listener.as_async_status_stream();
        while let Some(event) = events.next().await {
            self.note(event);
        }
    }

    /// Readers that this writer is connected to.
    pub(super) fn readers(&self, writer: GUID) -> Vec<GUID> {
        lock(&self.readers).get(&writer).into_iter().flatten().copied().collect()
    }

    fn note(&self, event: DomainParticipantStatusEvent) {
        match event {
            DomainParticipantStatusEvent::ParticipantDiscovered { dpd } if dpd.vendor_id.vendor_id == FAST_DDS => {
                *lock(&self.found_at) = Some(Instant::now());
            }
            DomainParticipantStatusEvent::RemoteReaderMatched { local_writer, remote_reader } => {
                lock(&self.readers).entry(local_writer).or_default().insert(remote_reader);
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
