//! Whether DDS works, proved from end to end, and whether the threads of its library live.
//!
//! Place in the flow: asked by the gateway's loop. A heartbeat is published on a hidden topic of the node and read again
//! from the network by a reader of the same participant: queue, socket, and the library's event loop are on its way. A
//! library that has silently left its loops (an interrupted `poll` makes it do so) ends that, and its threads are gone.
//!
//! A heartbeat that has never come back proves nothing: there are networks on which a participant does not hear itself.
//! Then only the threads are watched, and `/diagnostics` says so.

use std::collections::VecDeque;
use std::fs;
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

use abbe_msgs::RosType;
use ros2_client::Subscription;
use serde::{Deserialize, Serialize};

use super::introduction::Introduced;
use crate::ros::{RosError, RosNode, Writer, stream_qos};

/// Time between heartbeats.
const BEAT_EVERY: Duration = Duration::from_millis(250);
/// Time without one coming back after which DDS counts as dead. Only time in which this process itself ran counts.
pub(super) const DEAD_AFTER: Duration = Duration::from_secs(3);
/// Longest step of that time: when this process was stopped, or found no processor, that says nothing of DDS.
const LONGEST_STEP: Duration = Duration::from_millis(100);
/// Heartbeats remembered on their way.
const UNDER_WAY: usize = 64;
/// Time between introductions, and how long one holds.
const INTRODUCE_EVERY: Duration = Duration::from_secs(10);
const INTRODUCED_FOR: Duration = Duration::from_secs(60);
/// What the names of the library's threads begin with, as far as the kernel keeps them.
const THREADS: &str = "RustDDS";
const DEPTH: NonZeroUsize = NonZeroUsize::MIN.saturating_add(15);

/// `std_msgs/msg/UInt64`: which gateway, and which of its heartbeats.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Beat {
    data: u64,
}

impl RosType for Beat {
    const ROS_TYPE: &'static str = "std_msgs/msg/UInt64";
}

/// What was found wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Dead(pub(super) String);

/// The heartbeat through DDS. `S` is what is remembered with each.
pub(super) struct Heartbeat<S> {
    publisher: Writer<Beat>,
    subscription: Subscription<Beat>,
    introduced: Introduced,
    introductions: u32,
    introduced_at: Option<Instant>,
    /// Tells this gateway's heartbeats from those of another one under the same name.
    mark: u32,
    next: u32,
    under_way: VecDeque<(u32, S)>,
    sent_at: Option<Instant>,
    looked_at: Instant,
    silent_for: Duration,
    is_proved: bool,
    threads: Vec<String>,
}

impl<S> Heartbeat<S> {
    pub(super) fn open(node: &RosNode) -> Result<Self, RosError> {
        let name = node.resolve("~/_gateway/heartbeat")?;
        let mark = std::process::id();
        Ok(Self {
            publisher: node.writer(&name, &stream_qos(DEPTH))?,
            subscription: node.raw_subscription(&name, &stream_qos(DEPTH))?,
            introduced: node.introduced(),
            introductions: 0,
            introduced_at: None,
            mark,
            next: 0,
            under_way: VecDeque::with_capacity(UNDER_WAY),
            sent_at: None,
            looked_at: Instant::now(),
            silent_for: Duration::ZERO,
            is_proved: false,
            threads: library_threads(),
        })
    }

    /// Whether a heartbeat has come back at all.
    pub(super) fn is_proved(&self) -> bool {
        self.is_proved
    }

    /// Sends a heartbeat where one is due, with what `state` gives; takes those that have come back and returns the
    /// state of the newest.
    ///
    /// # Errors
    /// When DDS is dead.
    pub(super) fn turn(&mut self, state: impl FnOnce() -> S) -> Result<Option<S>, Dead> {
        let step = self.looked_at.elapsed();
        self.looked_at = Instant::now();
        self.silent_for += step.min(LONGEST_STEP);
        self.introduce();
        if self.sent_at.is_none_or(|at| at.elapsed() >= BEAT_EVERY) {
            self.look_at_threads()?;
            self.send(state());
        }
        let back = self.take();
        if back.is_some() {
            (self.silent_for, self.is_proved) = (Duration::ZERO, true);
        } else if self.is_proved && self.silent_for > DEAD_AFTER {
            return Err(Dead(format!("no heartbeat has come back through DDS for {DEAD_AFTER:?}")));
        }
        Ok(back)
    }

    fn send(&mut self, state: S) {
        self.sent_at = Some(Instant::now());
        let beat = Beat { data: u64::from(self.mark) << 32 | u64::from(self.next) };
        // One that cannot be sent does not come back, and that is what counts.
        if let Err(error) = self.publisher.publish(beat) {
            tracing::debug!(%error, "a heartbeat could not be sent");
        }
        if self.under_way.len() == UNDER_WAY {
            self.under_way.pop_front();
        }
        self.under_way.push_back((self.next, state));
        self.next = self.next.wrapping_add(1);
    }

    fn take(&mut self) -> Option<S> {
        let mut newest = None;
        // What others write there is no heartbeat of ours.
        while let Ok(Some((beat, _))) = self.subscription.take() {
            let number = beat.data as u32;
            if beat.data >> 32 == u64::from(self.mark)
                && let Some(place) = self.under_way.iter().position(|(one, _)| *one == number)
            {
                newest = self.under_way.drain(..=place).next_back().map(|(_, state)| state);
            }
        }
        newest
    }

    /// Where the network does not bring a participant its own announcement, it gets it from here.
    fn introduce(&mut self) {
        if self.introduced_at.is_some_and(|at| at.elapsed() < INTRODUCE_EVERY) {
            return;
        }
        self.introduced_at = Some(Instant::now());
        self.introductions += 1;
        if let Err(error) = self.introduced.introduce(self.introductions, INTRODUCED_FOR) {
            tracing::debug!(%error, "the participant could not be introduced to itself");
        }
    }

    fn look_at_threads(&self) -> Result<(), Dead> {
        let gone = self.threads.iter().filter(|thread| !is_of_library(thread)).count();
        if gone > 0 {
            return Err(Dead(format!("{gone} of {} threads of the DDS library have ended", self.threads.len())));
        }
        Ok(())
    }
}

/// Numbers of the library's threads in this process; nothing where the kernel does not tell.
fn library_threads() -> Vec<String> {
    let Ok(threads) = fs::read_dir("/proc/self/task") else { return Vec::new() };
    let numbers = threads.filter_map(|thread| thread.ok()?.file_name().into_string().ok());
    numbers.filter(|thread| is_of_library(thread)).collect()
}

/// Whether this thread of the process lives and is the library's.
fn is_of_library(thread: &str) -> bool {
    let name = fs::read_to_string(format!("/proc/self/task/{thread}/comm"));
    name.is_ok_and(|name| name.starts_with(THREADS))
}
