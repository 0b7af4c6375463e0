//! Messages that have arrived and are not taken yet.
//!
//! Place in the flow: filled on the library's thread, which never waits here; emptied on that of the subscriber. When it is
//! full, the oldest goes: its number is missing then, which the subscriber counts as for one that was lost on the way.

use std::collections::VecDeque;
use std::num::NonZeroUsize;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

use super::attachment::Attachment;
use crate::lock::lock;
use crate::transport::shared_memory::SampleOrigin;

/// Longest message that is kept: more than ten times the longest sample.
const LONGEST: usize = 64 * 1024;

/// A message as it came, or why it is none.
pub(super) type Arrived = Result<(SampleOrigin, Vec<u8>), String>;

/// Judges what arrived before its bytes are copied; `attachment` and `bytes` are asked for one after the other.
pub(super) fn arrived(attachment: Option<&[u8]>, length: usize, bytes: impl FnOnce() -> Vec<u8>) -> Arrived {
    let attachment = attachment.ok_or("it has no attachment of rmw_zenoh, which would say its number")?;
    let attachment = Attachment::from_bytes(attachment).ok_or("its attachment is none of rmw_zenoh")?;
    if length > LONGEST {
        return Err(format!("it has {length} bytes, more than any sample"));
    }
    let origin = SampleOrigin { source: attachment.gid, number: attachment.number.unsigned_abs() };
    Ok((origin, bytes()))
}

/// A bounded queue of what has arrived.
#[derive(Debug)]
pub(super) struct Inbox {
    depth: usize,
    queue: Mutex<Queue>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Queue {
    arrived: VecDeque<Arrived>,
    /// Given up without a number that would be missing.
    given_up: u64,
}

impl Inbox {
    pub(super) fn new(depth: NonZeroUsize) -> Self {
        Self { depth: depth.get(), queue: Mutex::default(), changed: Condvar::new() }
    }

    pub(super) fn push(&self, one: Arrived) {
        let mut queue = lock(&self.queue);
        if queue.arrived.len() >= self.depth {
            let oldest = queue.arrived.pop_front();
            queue.given_up += u64::from(oldest.is_some_and(|oldest| oldest.is_err()));
        }
        queue.arrived.push_back(one);
        drop(queue);
        self.changed.notify_one();
    }

    pub(super) fn pop(&self) -> Option<Arrived> {
        lock(&self.queue).arrived.pop_front()
    }

    /// Waits until there is something, at most `timeout`.
    pub(super) fn wait(&self, timeout: Duration) {
        let waited = self.changed.wait_timeout_while(lock(&self.queue), timeout, |queue| queue.arrived.is_empty());
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }

    /// Messages without a number that were given up.
    pub(super) fn given_up(&self) -> u64 {
        lock(&self.queue).given_up
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(number: i64) -> Arrived {
        let attachment = Attachment { number, sent_ns: 0, gid: [1; 16] }.to_bytes();
        arrived(Some(&attachment), 1, || vec![7])
    }

    #[test]
    fn the_oldest_goes_and_what_has_no_number_is_counted() {
        let inbox = Inbox::new(NonZeroUsize::new(2).unwrap());
        inbox.push(arrived(None, 1, Vec::new));
        (1..=3).for_each(|number| inbox.push(numbered(number)));
        let taken: Vec<u64> = std::iter::from_fn(|| inbox.pop()).map(|one| one.unwrap().0.number).collect();
        assert_eq!((taken, inbox.given_up()), (vec![2, 3], 1));
        inbox.wait(Duration::from_millis(1));
        assert!(inbox.pop().is_none());
    }

    #[test]
    fn what_is_no_message_of_rmw_zenoh_or_too_long_is_refused_before_it_is_copied() {
        let never = || panic!("copied");
        let attachment = Attachment { number: 1, sent_ns: 0, gid: [1; 16] }.to_bytes();
        let refused = |attachment: Option<&[u8]>, length| arrived(attachment, length, never).unwrap_err();
        assert!(refused(None, 8).contains("no attachment"));
        assert!(refused(Some(&[1, 2, 3]), 8).contains("none of rmw_zenoh"));
        assert!(refused(Some(&attachment), 1 << 30).contains("more than any sample"));
    }
}
