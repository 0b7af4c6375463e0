//! Calls of services that wait for the node's answer.
//!
//! Place in the flow: in the gateway, between the threads that serve and the loop that hears the node.

use std::collections::BTreeMap;
use std::sync::mpsc::sync_channel;
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

/// Who takes an answer; dropped where there is none.
type Caller = Box<dyn FnOnce(TriggerOutcome) + Send>;

#[derive(Default)]
struct Waiting {
    next: u64,
    callers: BTreeMap<u64, (Instant, Caller)>,
}

impl Calls {
    pub(super) fn new(channel: &Arc<Channel>) -> Calls {
        Calls { channel: Arc::clone(channel), waiting: Arc::default() }
    }

    /// Hands a call to the node; the outcome is its answer.
    pub(super) fn ask(&self, service: u32, asked: Asked) -> BoxFuture<'static, TriggerOutcome> {
        let (caller, answer) = oneshot::channel();
        // Who asked may have given up.
        self.hand_over(service, asked, Box::new(move |outcome| drop(caller.send(outcome))));
        answer.map(|answer| answer.unwrap_or_else(|_| silence())).boxed()
    }

    /// The same for a thread that has nothing else to do.
    pub(super) fn ask_and_wait(&self, service: u32, asked: Asked) -> TriggerOutcome {
        let (caller, answer) = sync_channel(1);
        self.hand_over(service, asked, Box::new(move |outcome| drop(caller.try_send(outcome))));
        answer.recv().unwrap_or_else(|_| silence())
    }

    fn hand_over(&self, service: u32, asked: Asked, caller: Caller) {
        let call = {
            let mut waiting = lock(&self.waiting);
            waiting.next += 1;
            let call = waiting.next;
            waiting.callers.insert(call, (Instant::now(), caller));
            call
        };
        if self.channel.send(&FromGateway::Call(call, service, asked)).is_err() {
            self.answer(call, Err("the node does not answer; try again".to_owned()));
        }
    }

    pub(super) fn answer(&self, call: u64, outcome: TriggerOutcome) {
        let caller = lock(&self.waiting).callers.remove(&call);
        if let Some((_, caller)) = caller {
            caller(outcome);
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

fn silence() -> TriggerOutcome {
    Err("the node is stopping, or does not answer".to_owned())
}
