//! A DDS writer that no reader holds up: a full window gives up those who lag, and nobody waits.
//!
//! Place in the flow: under everything this crate publishes over DDS. Reliable readers elsewhere acknowledge what they
//! get, and the library lets a writer be ahead of the slowest of them by a window. Of a reader that was killed, stopped
//! or cut off no acknowledgement comes, and when the window is full the library takes no more samples for anybody. ROS 2
//! means something else by "reliable, keep last": the newest samples stay to be had, older ones are lost to who lags.
//!
//! So when the window is full, this writer acknowledges the older half of it in the name of the readers: to its own
//! participant, in one packet a reader after RTPS 2.5, sections 8.3.8.1 (ACKNACK) and 8.3.8.9 (INFO_SRC), from a socket of
//! ours to the port where the participant listens. The library takes an acknowledgement only where it leads a reader on,
//! so that readers who keep up do not notice. Who lags finds the lost samples gone, and what comes after them.

use std::net::{Ipv4Addr, UdpSocket};
use std::sync::Weak;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use abbe_msgs::RosType;
use ros2_client::dds::rustdds::{GUID, policy};
use ros2_client::{Publisher, WriteError};

use super::node::{Inner, RosNode};
use super::rtps::{self, ENDIANNESS, PREFIX};
use crate::gateway::Introduced;

/// Samples that a writer may be ahead of its slowest reliable reader.
pub(super) const WINDOW: u64 = 4096;
/// Of them, those that who lags may still ask for when the window is full.
const KEPT: u64 = WINDOW / 2;
/// How long one sample may wait for room. Without a reader that lags there is room at once.
const GIVE_UP_WITHIN: Duration = Duration::from_millis(10);
/// Time in which the library takes in what readers are said to have acknowledged.
const TAKEN_IN: Duration = Duration::from_micros(200);

const INFO_SRC: u8 = 0x0c;

/// What a writer's topic asks of the library: the window.
pub(super) fn limits() -> policy::ResourceLimits {
    let unlimited = -1;
    let max_samples = i32::try_from(WINDOW).unwrap_or(i32::MAX);
    policy::ResourceLimits { max_samples, max_instances: unlimited, max_samples_per_instance: unlimited }
}

/// Publishes messages; never waits for a reader.
pub(crate) struct Writer<R: RosType> {
    publisher: Publisher<R>,
    /// Absolute name of the topic.
    topic: String,
    // Weak: the node leaves the graph whoever still holds a writer.
    node: Weak<Inner>,
    /// The library numbers samples from 1, so this is the number of the last.
    published: AtomicU64,
    given_up: AtomicU64,
}

impl<R: RosType> Writer<R> {
    pub(super) fn new(publisher: Publisher<R>, topic: &str, node: Weak<Inner>) -> Self {
        let (published, given_up) = (AtomicU64::new(0), AtomicU64::new(0));
        Self { publisher, topic: topic.to_owned(), node, published, given_up }
    }

    pub(super) fn guid(&self) -> GUID {
        self.publisher.guid()
    }

    /// Publishes a message.
    ///
    /// # Errors
    /// When the library does not take it: it cannot be serialised, or the network takes nothing for a while.
    pub(crate) fn publish(&self, message: R) -> Result<(), String> {
        let (mut message, since) = (message, Instant::now());
        loop {
            match self.publisher.publish(message) {
                Ok(()) => {
                    self.published.fetch_add(1, Ordering::Relaxed);
                    return Ok(());
                }
                Err(WriteError::WouldBlock { data }) if since.elapsed() < GIVE_UP_WITHIN => {
                    message = data;
                    self.give_up_who_lags();
                    thread::sleep(TAKEN_IN);
                }
                Err(error) => return Err(error.to_string()),
            }
        }
    }

    /// How often the window was full, and who lagged lost the older half of it.
    pub(crate) fn given_up(&self) -> u64 {
        self.given_up.load(Ordering::Relaxed)
    }

    fn give_up_who_lags(&self) {
        let Some(node) = self.node.upgrade() else { return };
        let times = self.given_up.fetch_add(1, Ordering::Relaxed) + 1;
        let readers = RosNode::readers_of(&node, self.guid());
        if times.is_power_of_two() {
            let (topic, readers) = (&self.topic, readers.len());
            tracing::warn!(
                topic,
                readers,
                times,
                "a reliable reader does not acknowledge; it loses its oldest samples"
            );
        }
        let kept_from = self.published.load(Ordering::Relaxed).saturating_sub(KEPT) + 1;
        let writer = self.guid().to_bytes();
        let acknowledged = Acknowledged { to: RosNode::introduced_as(&node), writer, kept_from, count: times };
        if let Err(error) = readers.iter().try_for_each(|reader| acknowledged.send(*reader)) {
            tracing::warn!(%error, "readers that lag cannot be given up");
        }
    }
}

/// Everything before `kept_from`, said to be acknowledged.
struct Acknowledged {
    to: Introduced,
    writer: [u8; 16],
    kept_from: u64,
    count: u64,
}

impl Acknowledged {
    fn send(&self, reader: [u8; 16]) -> std::io::Result<()> {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
        socket.send_to(&self.packet(reader), (Ipv4Addr::LOCALHOST, self.to.data_port()))?;
        Ok(())
    }

    /// The head names the participant itself as the sender, so that it learns nothing wrong of where the reader is to be
    /// found; who speaks stands in the part after it.
    fn packet(&self, reader: [u8; 16]) -> Vec<u8> {
        let mut packet = rtps::head(&self.to.guid_prefix);
        packet.extend([INFO_SRC, ENDIANNESS, 20, 0, 0, 0, 0, 0]);
        packet.extend(rtps::speaker(&reader[..PREFIX]));
        // Readers count upwards from 1 or 0; this counts where none of them comes. Nothing is asked for again.
        let count = i32::MIN.wrapping_add(self.count as i32);
        packet.extend(rtps::acknack(&reader, &self.writer, self.kept_from, false, count));
        packet
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_acknowledgement_is_as_long_as_it_says_and_names_reader_writer_and_number() {
        let to = Introduced { guid_prefix: [7; 12], domain_id: 3, participant_id: 2 };
        let acknowledged = Acknowledged { to, writer: [9; 16], kept_from: (1 << 32) + 5, count: 1 };
        let packet = acknowledged.packet([4; 16]);
        assert_eq!(packet.len(), 20 + 4 + 20 + 4 + 24);
        assert_eq!(packet[8..20], [7; 12], "the participant speaks to itself");
        assert_eq!(packet[32..44], [4; 12], "in the reader's name");
        assert_eq!(packet[48..52], [4; 4]);
        assert_eq!(packet[52..56], [9; 4]);
        assert_eq!(packet[56..68], [1, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0]);
    }
}
