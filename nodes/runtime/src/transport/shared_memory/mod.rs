//! The transport between processes of one host: iceoryx2, without copying through the kernel.
//!
//! Place in the flow: between the nodes that correct. A publisher writes each sample once into
//! memory that all subscribers read, and wakes them by an event; the wake-up by the kernel is the
//! whole latency (tens of µs).
//!
//! Limits: all nodes run under one user (files have mode 0600). Safe overflow is always on: a
//! subscriber that stops reading, or is killed, loses its oldest samples and never holds up the
//! publisher. Every file of a run carries its [`RunId`]; [`cleanup()`] removes them.

mod cleanup;
mod ledger;
mod publisher;
mod subscriber;

use std::num::NonZeroUsize;
use std::sync::Arc;

use abbe_msgs::Message;
use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder, NodeCreationFailure};
use iceoryx2::prelude::{FileName, LogLevel, Path, SemanticString, SignalHandlingMode, ZeroCopySend};
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::ipc_threadsafe::Service;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use iceoryx2::service::service_name::ServiceName;

use super::{TransportError, TransportKind};
use crate::RunId;

pub use cleanup::{CleanupError, cleanup, cleanup_by_the_last, remove_leftovers};
pub use publisher::SharedMemoryPublisher;
pub use subscriber::SharedMemorySubscriber;

/// Where Linux keeps POSIX shared-memory objects.
const SHARED_MEMORY_FOLDER: &str = "/dev/shm";

/// Publishers one topic can have at a time.
pub const MAX_PUBLISHERS: usize = 8;
/// Subscribers one topic can have at a time.
pub const MAX_SUBSCRIBERS: usize = 16;
/// Processes that can take part in one topic at a time.
pub const MAX_NODES: usize = 32;
/// Samples a subscriber holds while it copies one out.
const MAX_BORROWED: usize = 2;
/// How often a service is opened where signals interrupt it: more than a person sends, and no loop without an end.
const MAX_ATTEMPTS: usize = 100;
/// Samples a publisher fills at a time.
const MAX_LOANED: usize = 1;

/// Who sent a sample, and its number among those of that sender: the user header of iceoryx2.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("abbe/SampleOrigin/v1")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub(crate) struct SampleOrigin {
    /// The sender, where the sample came over DDS; all zero for the publisher of the topic itself.
    pub(crate) source: [u8; 16],
    /// Counted from 0 by the publisher, as DDS says for others.
    pub(crate) number: u64,
}

type SampleService<M> = publish_subscribe::PortFactory<Service, M, SampleOrigin>;
type EventService = event::PortFactory<Service>;

/// This process in the shared memory of one run. Clones share it.
#[derive(Debug, Clone)]
pub struct SharedMemory {
    node: Arc<Node<Service>>,
    run: RunId,
    depth: NonZeroUsize,
    /// Name under which subscribers note how far they have come; none for those that nobody starts again.
    remembered_as: Option<Arc<str>>,
}

impl SharedMemory {
    /// Joins the run. What nodes of the run that were killed left behind is removed on the way.
    /// `depth` is how many samples a subscriber can be behind; it must be the same in all nodes.
    ///
    /// # Errors
    /// When the files of the run cannot be made.
    pub fn join(run: &RunId, depth: NonZeroUsize) -> Result<Self, TransportError> {
        // Its warnings about every dead peer would drown the node's own log.
        iceoryx2::prelude::set_log_level_from_env_or(LogLevel::Error);
        let config = config(run)?;
        let create = || {
            NodeBuilder::new()
                .config(&config)
                // Signals are handled by `Shutdown`.
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .create::<Service>()
        };
        let node = again_when(overtaken, create)
            .map_err(|error| open_error(format!("{error:?} for the files of run {run}")))?;
        Ok(Self { node: Arc::new(node), run: run.clone(), depth, remembered_as: None })
    }

    /// Subscribers opened from now on count what was sent since an earlier process of `node`, an absolute name, took its
    /// last sample.
    #[must_use]
    pub fn remembering(self, node: &str) -> Self {
        Self { remembered_as: Some(node.into()), ..self }
    }

    /// Removes what killed nodes of the run left behind, so that their places become free. Takes
    /// milliseconds: for the launcher, not for the correcting thread.
    pub fn remove_dead_nodes(&self) {
        let state = self.node.try_cleanup_dead_nodes();
        if state.failed_cleanups > 0 {
            tracing::warn!(nodes = state.failed_cleanups, "could not clean up dead nodes");
        }
    }

    /// A publisher on `topic`.
    ///
    /// # Errors
    /// When the topic carries another type or another version of it, or has no room.
    pub fn publisher<M: Message>(&self, topic: &str) -> Result<SharedMemoryPublisher<M>, TransportError> {
        SharedMemoryPublisher::open(self, topic)
    }

    /// A subscriber on `topic`.
    ///
    /// # Errors
    /// As [`SharedMemory::publisher`].
    pub fn subscriber<M: Message>(&self, topic: &str) -> Result<SharedMemorySubscriber<M>, TransportError> {
        SharedMemorySubscriber::open(self, topic, topic)
    }

    /// A subscriber on `link` that counts what it missed as being about `topic`.
    pub(crate) fn link_subscriber<M: Message>(
        &self,
        link: &str,
        topic: &str,
    ) -> Result<SharedMemorySubscriber<M>, TransportError> {
        SharedMemorySubscriber::open(self, link, topic)
    }

    /// Samples that a subscriber can be behind.
    pub(crate) fn depth(&self) -> NonZeroUsize {
        self.depth
    }

    fn services<M: Message>(
        &self,
        topic: &str,
        what: &'static str,
    ) -> Result<(SampleService<M>, EventService), TransportError> {
        let endpoint = |reason: String| endpoint_error(topic, what, reason);
        let name = ServiceName::new(topic).map_err(|error| endpoint(format!("{error:?}")))?;
        let samples = || {
            self.node
                .service_builder(&name)
                .publish_subscribe::<M>()
                .user_header::<SampleOrigin>()
                .enable_safe_overflow(true)
                .subscriber_max_buffer_size(self.depth.get())
                .subscriber_max_borrowed_samples(MAX_BORROWED)
                .history_size(0)
                .max_publishers(MAX_PUBLISHERS)
                .max_subscribers(MAX_SUBSCRIBERS)
                .max_nodes(MAX_NODES)
                .open_or_create()
        };
        let events = || {
            self.node
                .service_builder(&name)
                .event()
                .max_notifiers(MAX_PUBLISHERS)
                .max_listeners(MAX_SUBSCRIBERS)
                .max_nodes(MAX_NODES)
                .open_or_create()
        };
        let samples =
            again_when(samples_interrupted, samples).map_err(|error| service_error::<M>(topic, what, error))?;
        let events = again_when(events_interrupted, events).map_err(|error| endpoint(format!("{error:?}")))?;
        Ok((samples, events))
    }
}

/// Does `open` once more for as long as it was `interrupted`: iceoryx2 gives up where a signal ends one of its short
/// sleeps, and a Ctrl-C while nodes start would look like a fault of theirs. The caller asks for the signal afterwards.
fn again_when<T, E>(interrupted: impl Fn(&E) -> bool, mut open: impl FnMut() -> Result<T, E>) -> Result<T, E> {
    let mut opened = open();
    for _ in 1..MAX_ATTEMPTS {
        if !opened.as_ref().is_err_and(&interrupted) {
            break;
        }
        opened = open();
    }
    opened
}

/// Another process took what this one had just made for the remains of a dead node, between the making of a file and its lock.
fn overtaken(error: &NodeCreationFailure) -> bool {
    matches!(error, NodeCreationFailure::InternalError | NodeCreationFailure::SystemCorrupted)
}

fn samples_interrupted(error: &PublishSubscribeOpenOrCreateError) -> bool {
    use PublishSubscribeOpenOrCreateError as Error;
    matches!(
        error,
        Error::PublishSubscribeOpenError(PublishSubscribeOpenError::Interrupt)
            | Error::PublishSubscribeCreateError(PublishSubscribeCreateError::Interrupt)
    )
}

fn events_interrupted(error: &EventOpenOrCreateError) -> bool {
    use EventOpenOrCreateError as Error;
    matches!(
        error,
        Error::EventOpenError(EventOpenError::Interrupt) | Error::EventCreateError(EventCreateError::Interrupt)
    )
}

fn service_error<M: Message>(
    topic: &str,
    what: &'static str,
    error: PublishSubscribeOpenOrCreateError,
) -> TransportError {
    match error {
        PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(PublishSubscribeOpenError::IncompatibleTypes) => {
            TransportError::OtherType { topic: topic.to_owned(), expected: M::ROS_TYPE }
        }
        other => endpoint_error(topic, what, format!("{other:?}")),
    }
}

fn endpoint_error(topic: &str, what: &'static str, reason: String) -> TransportError {
    TransportError::Endpoint { topic: topic.to_owned(), what, kind: TransportKind::SharedMemory, reason }
}

fn open_error(reason: String) -> TransportError {
    TransportError::Open { kind: TransportKind::SharedMemory, reason }
}

/// What the names of all shared-memory objects of the run begin with. A run's name has no
/// underscore, so no prefix is the beginning of another.
fn prefix(run: &RunId) -> String {
    format!("abbe_{run}_")
}

/// A file in memory that belongs to the run, and goes with it. Topics have no dots, so that it is none of theirs.
pub(crate) fn object_path(run: &RunId, name: &str) -> std::path::PathBuf {
    std::path::PathBuf::from(SHARED_MEMORY_FOLDER).join(format!("{}{name}", prefix(run)))
}

/// The folder of the run's management files. Not from TMPDIR: nodes started from different shells
/// must find each other, and sockets inside need a short path.
fn root(run: &RunId) -> String {
    format!("/tmp/abbe_{run}")
}

fn config(run: &RunId) -> Result<Config, TransportError> {
    let mut config = Config::default();
    let root = Path::new(root(run).as_bytes()).map_err(|error| open_error(format!("{error:?}")))?;
    config.global.set_root_path(&root);
    config.global.prefix = FileName::new(prefix(run).as_bytes()).map_err(|error| open_error(format!("{error:?}")))?;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;
    use std::sync::Barrier;
    use std::thread;

    use super::{MAX_ATTEMPTS, SharedMemory, again_when, cleanup};
    use crate::RunId;

    #[test]
    fn nodes_that_join_a_new_run_at_the_same_moment_all_get_in() {
        const NODES: usize = 8;
        for _ in 0..10 {
            let (run, barrier) = (RunId::unique(), Barrier::new(NODES));
            let join = || {
                barrier.wait();
                let joined = SharedMemory::join(&run, NonZeroUsize::MIN);
                barrier.wait();
                joined.map(drop)
            };
            let joined: Vec<_> = thread::scope(|scope| {
                let nodes: Vec<_> = (0..NODES).map(|_| scope.spawn(join)).collect();
                nodes.into_iter().map(|node| node.join().unwrap()).collect()
            });
            cleanup(&run).unwrap();
            assert!(joined.iter().all(Result::is_ok), "{joined:?}");
        }
    }

    #[test]
    fn regress_a_signal_while_a_service_opens_is_no_fault_of_it() {
        let mut attempts = 0;
        let opened = again_when(
            |error: &&str| *error == "interrupted",
            || {
                attempts += 1;
                if attempts < 4 { Err("interrupted") } else { Ok(attempts) }
            },
        );
        assert_eq!(opened, Ok(4));
        assert_eq!(again_when(|_: &&str| false, || Err::<(), _>("refused")), Err("refused"));
    }

    #[test]
    fn interruptions_without_an_end_are_an_error() {
        let mut attempts = 0;
        let opened = again_when(
            |_: &&str| true,
            || {
                attempts += 1;
                Err::<(), _>("interrupted")
            },
        );
        assert_eq!((opened, attempts), (Err("interrupted"), MAX_ATTEMPTS));
    }
}
