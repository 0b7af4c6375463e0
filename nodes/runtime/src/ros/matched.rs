//! Who has found whom: the readers elsewhere that each writer of a node is connected to.
//!
//! Place in the flow: followed on the node's own thread, in place of the spinner of the DDS library. That one subscribes
//! `/clock` as another type than it has in ROS 2, which makes every tool of the system refuse the topic.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;

use futures::StreamExt;
use ros2_client::dds::rustdds::{DomainParticipant, DomainParticipantStatusEvent, GUID, StatusEvented};

use crate::lock::lock;

/// Readers by the writer that they are connected to.
#[derive(Debug, Default)]
pub(super) struct Matched(Mutex<BTreeMap<GUID, BTreeSet<GUID>>>);

impl Matched {
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
        lock(&self.0).get(&writer).into_iter().flatten().copied().collect()
    }

    fn note(&self, event: DomainParticipantStatusEvent) {
        match event {
            DomainParticipantStatusEvent::RemoteReaderMatched { local_writer, remote_reader } => {
                lock(&self.0).entry(local_writer).or_default().insert(remote_reader);
            }
            DomainParticipantStatusEvent::ReaderLost { guid, .. } => {
                for readers in lock(&self.0).values_mut() {
                    readers.remove(&guid);
                }
            }
            _ => {}
        }
    }
}
