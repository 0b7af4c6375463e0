//! `/clock` for a node that goes by it.
//!
//! Place in the flow: a thread of the gateway, where the node has `use_sim_time`. The newest time goes to the node over
//! their socket; what finds that full is followed by a newer one. The gateway goes by it as well, where it stamps by arrival.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use abbe_msgs::standard::Clock as ClockMessage;
use ros2_client::Subscription;

use super::protocol::{Channel, FromGateway};
use crate::ros::{CLOCK_TOPIC, Clock, RosError, RosNode, nanos_of, stream_qos};

/// How often it is looked whether time has gone on.
const LOOK_EVERY: Duration = Duration::from_millis(2);
/// Only the newest counts.
const DEPTH: std::num::NonZeroUsize = std::num::NonZeroUsize::MIN;

/// Reads `/clock` until it is dropped.
pub(super) struct ClockReader {
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl ClockReader {
    /// `shown` is the clock of this process.
    pub(super) fn open(node: &RosNode, to_node: Arc<Channel>, shown: Clock) -> Result<Self, RosError> {
        let clock = node.raw_subscription::<ClockMessage>(&node.resolve(CLOCK_TOPIC)?, &stream_qos(DEPTH))?;
        let ending = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&ending);
        let read = move || {
            let mut refused = 0_u64;
            while !ends.load(Ordering::Relaxed) {
                if let Some(nanos) = newest(&clock, &mut refused) {
                    shown.set(nanos);
                    // A node that does not read gets the next one.
                    let _ = to_node.send(&FromGateway::Clock(nanos));
                }
                thread::sleep(LOOK_EVERY);
            }
        };
        let thread = thread::Builder::new().name("clock".into()).spawn(read);
        let thread = Some(thread.map_err(|source| RosError::Thread { what: "/clock", source })?);
        Ok(Self { ending, thread })
    }
}

/// The last time of those that have come.
fn newest(clock: &Subscription<ClockMessage>, refused: &mut u64) -> Option<i64> {
    let mut newest = None;
    loop {
        match clock.take() {
            Ok(Some((message, _))) => newest = Some(nanos_of(message)),
            Ok(None) => return newest,
            Err(error) => {
                *refused += 1;
                if refused.is_power_of_two() {
                    tracing::warn!(refused = *refused, %error, "what came on /clock is no time");
                }
                return newest;
            }
        }
    }
}

impl Drop for ClockReader {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the thread of /clock panicked");
        }
    }
}
