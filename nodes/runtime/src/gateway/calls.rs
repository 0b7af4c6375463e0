//! Calls of services that wait for the node's answer.
//!
//! Place in the flow: in the gateway, between the threads that serve and the loop that hears the node.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use futures::FutureExt;
use futures::channel::oneshot;
use futures::future::BoxFuture;

use super::protocol::{Asked, Channel, FromGateway};
use crate::lock::lock;
use crate::ros::TriggerOutcome;

/// Longest that a service waits for its node.
const ANSWER_WITHIN: Duration = Duration::from_secs(60);

/// Hands calls to the node. Clones share what waits.
#[derive(Clone)]
pub(super) struct Calls {
    channel: Arc<Channel>,
    waiting: Arc<Mutex<Waiting>>,
}

#[derive(Default)]
struct Waiting {
    next: u64,
    callers: BTreeMap<u64, (Instant, oneshot::Sender<TriggerOutcome>)>,
}

impl Calls {
    pub(super) fn new(channel: &Arc<Channel>) -> Calls {
        Calls { channel: Arc::clone(channel), waiting: Arc::default() }
    }

    /// Hands a call to the node; the outcome is its answer.
    pub(super) fn ask(&self, service: u32, asked: Asked) -> BoxFuture<'static, TriggerOutcome> {
        let (caller, answer) = oneshot::channel();
        let call = {
            let mut waiting = lock(&self.waiting);
            waiting.next += 1;
            let call = waiting.next;
            waiting.callers.insert(call, (Instant::now(), caller));
            call
        };
        if self.channel.send(&FromGateway::Call(call, service, asked)).is_err() {
            lock(&self.waiting).callers.remove(&call);
            return futures::future::ready(Err("the node does not answer; try again".to_owned())).boxed();
        }
        answer
            .map(|answer| answer.unwrap_or_else(|_| Err("the node is stopping, or does not answer".to_owned())))
            .boxed()
    }

    pub(super) fn answer(&self, call: u64, outcome: TriggerOutcome) {
        if let Some((_, caller)) = lock(&self.waiting).callers.remove(&call) {
            // Who asked may have given up.
            let _ = caller.send(outcome);
        }
    }

    /// Who was asked too long ago is not waited for any more.
    pub(super) fn give_up_who_waits_too_long(&self) {
        lock(&self.waiting).callers.retain(|_, (since, _)| since.elapsed() < ANSWER_WITHIN);
    }

    /// Nobody is waited for any more.
    pub(super) fn clear(&self) {
        lock(&self.waiting).callers.clear();
    }
}
