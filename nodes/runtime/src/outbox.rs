//! Writing on a thread of its own, behind a bounded queue that gives up the oldest item.
//!
//! Place in the flow: between the correcting thread and DDS. [`Outbox::push`] only moves the item
//! into the queue, so that a writer that stalls (a reliable reader that died, a full socket) never
//! delays the caller; what the queue cannot hold is dropped, the oldest first, and counted.

use std::collections::VecDeque;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// How long a dropped outbox waits for its thread to write what is still queued.
const LINGER: Duration = Duration::from_millis(200);

/// What became of the items pushed so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct OutboxCounts {
    /// Items the writer took and wrote.
    pub written: u64,
    /// Items given up because the queue was full.
    pub dropped: u64,
    /// Items the writer failed to write.
    pub failed: u64,
}

/// A bounded queue with a thread that writes its items in order.
#[derive(Debug)]
pub struct Outbox<T> {
    shared: Arc<Shared<T>>,
    capacity: usize,
}

#[derive(Debug)]
struct Shared<T> {
    queue: Mutex<Queue<T>>,
    changed: Condvar,
    written: AtomicU64,
    dropped: AtomicU64,
    failed: AtomicU64,
}

#[derive(Debug)]
struct Queue<T> {
    items: VecDeque<T>,
    writer_waits: bool,
    closed: bool,
    finished: bool,
}

impl<T: Send + 'static> Outbox<T> {
    /// Starts the writing thread. `write` returns why an item could not be written; that is
    /// counted and logged (the 1st, 2nd, 4th, 8th … time), and the next item follows.
    ///
    /// # Errors
    /// When the operating system refuses the thread.
    pub fn spawn(
        name: &str,
        capacity: NonZeroUsize,
        write: impl FnMut(T) -> Result<(), String> + Send + 'static,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            queue: Mutex::new(Queue {
                // All memory now, so that push never allocates.
                items: VecDeque::with_capacity(capacity.get()),
                writer_waits: false,
                closed: false,
                finished: false,
            }),
            changed: Condvar::new(),
            written: AtomicU64::new(0),
            dropped: AtomicU64::new(0),
            failed: AtomicU64::new(0),
        });
        let writer = Arc::clone(&shared);
        let owner = name.to_owned();
        // Detached: Drop waits for `finished`, but no longer than LINGER for a stalled writer.
        thread::Builder::new().name("outbox".into()).spawn(move || writer.run(&owner, write))?;
        Ok(Self { shared, capacity: capacity.get() })
    }

    /// Hands the item to the writing thread. Never waits for it: when the queue is full, the oldest
    /// item is dropped and counted.
    pub fn push(&self, item: T) {
        let mut queue = self.shared.lock();
        if queue.items.len() >= self.capacity {
            queue.items.pop_front();
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
        queue.items.push_back(item);
        // Waking costs a system call; a writer that is busy looks again by itself.
        let wake = std::mem::take(&mut queue.writer_waits);
        drop(queue);
        if wake {
            self.shared.changed.notify_all();
        }
    }
}

impl<T> Outbox<T> {
    /// What became of the items so far.
    #[must_use]
    pub fn counts(&self) -> OutboxCounts {
        OutboxCounts {
            written: self.shared.written.load(Ordering::Relaxed),
            dropped: self.shared.dropped.load(Ordering::Relaxed),
            failed: self.shared.failed.load(Ordering::Relaxed),
        }
    }
}

impl<T> Shared<T> {
    fn lock(&self) -> MutexGuard<'_, Queue<T>> {
        // The queue is consistent between any two statements; a panic elsewhere does not spoil it.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn run(&self, owner: &str, mut write: impl FnMut(T) -> Result<(), String>) {
        while let Some(item) = self.next() {
            match write(item) {
                Ok(()) => {
                    self.written.fetch_add(1, Ordering::Relaxed);
                }
                Err(reason) => {
                    let failures = self.failed.fetch_add(1, Ordering::Relaxed) + 1;
                    if failures.is_power_of_two() {
                        tracing::warn!(owner, failures, reason, "could not publish");
                    }
                }
            }
        }
        drop(write); // The endpoint is gone before Drop of the outbox returns.
        self.lock().finished = true;
        self.changed.notify_all();
    }

    /// The next item, or nothing once the outbox is closed and empty.
    fn next(&self) -> Option<T> {
        let mut queue = self.lock();
        loop {
            if let Some(item) = queue.items.pop_front() {
                return Some(item);
            }
            if queue.closed {
                return None;
            }
            queue.writer_waits = true;
            queue = self.changed.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl<T> Drop for Outbox<T> {
    fn drop(&mut self) {
        let mut queue = self.shared.lock();
        queue.closed = true;
        self.shared.changed.notify_all();
        let waited = self.shared.changed.wait_timeout_while(queue, LINGER, |queue| !queue.finished);
        queue = waited.unwrap_or_else(PoisonError::into_inner).0;
        // A writer that stalls for longer gives up its items when it comes back.
        let unwritten = queue.items.len() as u64;
        queue.items.clear();
        self.shared.dropped.fetch_add(unwritten, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;
    use std::time::Instant;

    fn capacity(samples: usize) -> NonZeroUsize {
        NonZeroUsize::new(samples).unwrap()
    }

    #[test]
    fn items_are_written_in_order_before_drop_returns() {
        let (written, read) = mpsc::channel();
        let outbox = Outbox::spawn("test", capacity(1000), move |item: u32| {
            written.send(item).map_err(|error| error.to_string())
        })
        .unwrap();
        (0..1000).for_each(|item| outbox.push(item));
        drop(outbox);
        assert_eq!(read.try_iter().collect::<Vec<_>>(), (0..1000).collect::<Vec<_>>());
    }

    #[test]
    fn a_stalled_writer_never_delays_the_caller_and_the_oldest_go() {
        let (resume, stalled) = mpsc::channel::<()>();
        let (written, read) = mpsc::channel();
        let outbox = Outbox::spawn("test", capacity(10), move |item: u32| {
            let _ = stalled.recv_timeout(Duration::from_secs(20));
            written.send(item).map_err(|error| error.to_string())
        })
        .unwrap();
        outbox.push(0);
        while !outbox.shared.lock().items.is_empty() {
            thread::yield_now(); // until the writer holds item 0
        }
        let start = Instant::now();
        (1..=1000).for_each(|item| outbox.push(item));
        assert!(start.elapsed() < Duration::from_secs(1), "push waited for the writer");
        assert_eq!(outbox.counts().dropped, 990);
        drop(resume);
        drop(outbox);
        let expected: Vec<u32> = std::iter::once(0).chain(991..=1000).collect();
        assert_eq!(read.try_iter().collect::<Vec<_>>(), expected);
    }

    #[test]
    fn a_failed_item_is_counted_and_the_next_follows() {
        let outbox = Outbox::spawn("test", capacity(4), |item: u32| match item {
            1 => Err("refused".to_owned()),
            _ => Ok(()),
        })
        .unwrap();
        (0..3).for_each(|item| outbox.push(item));
        let deadline = Instant::now() + Duration::from_secs(5);
        while outbox.counts().written < 2 && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(1));
        }
        let expected = OutboxCounts { written: 2, dropped: 0, failed: 1 };
        assert_eq!(outbox.counts(), expected);
    }
}
