//! Calls of services that wait for the node's answer.
//!
//! Place in the flow: in the gateway, between the threads that serve and the loop that hears the node.

use std::collections::{BTreeMap, BTreeSet};
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
    callers: BTreeMap<u64, Waiter>,
    /// Services that are being closed; nobody who calls them waits any more.
    closing: BTreeSet<u32>,
    /// Whether the gateway leaves.
    is_over: bool,
}

struct Waiter {
    service: u32,
    since: Instant,
    caller: Caller,
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
            if waiting.is_over || waiting.closing.contains(&service) {
                let outcome = if waiting.is_over { silence() } else { closed() };
                drop(waiting);
                return caller(outcome);
            }
            waiting.next += 1;
            let call = waiting.next;
            waiting.callers.insert(call, Waiter { service, since: Instant::now(), caller });
            call
        };
        if self.channel.send(&FromGateway::Call(call, service, asked)).is_err() {
            self.answer(call, Err("the node does not answer; try again".to_owned()));
        }
    }

    pub(super) fn answer(&self, call: u64, outcome: TriggerOutcome) {
        let caller = lock(&self.waiting).callers.remove(&call);
        if let Some(Waiter { caller, .. }) = caller {
            caller(outcome);
        }
    }

    /// Closes a service by `close`, which waits for the service's thread. That thread may wait for an answer of the node,
    /// which only the gateway's loop hands on, and the loop is in `close`: so whoever waits is answered first, and who
    /// calls meanwhile at once.
    pub(super) fn close(&self, service: u32, close: impl FnOnce()) {
        let unanswered: Vec<Waiter> = {
            let mut waiting = lock(&self.waiting);
            waiting.closing.insert(service);
            waiting.callers.extract_if(.., |_, waiter| waiter.service == service).map(|(_, waiter)| waiter).collect()
        };
        unanswered.into_iter().for_each(|waiter| (waiter.caller)(closed()));
        close();
        lock(&self.waiting).closing.remove(&service);
    }

    /// Who was asked too long ago is not waited for any more.
    pub(super) fn give_up_who_waits_too_long(&self) {
        lock(&self.waiting).callers.retain(|_, waiter| waiter.since.elapsed() < ANSWER_WITHIN);
    }

    /// Nobody is waited for any more, of those who call from now on neither: the gateway leaves.
    pub(super) fn clear(&self) {
        let mut waiting = lock(&self.waiting);
        waiting.is_over = true;
        waiting.callers.clear();
    }
}

fn closed() -> TriggerOutcome {
    Err("the node closes this service, since it is being cleaned up or stops; call again once it is configured"
        .to_owned())
}

fn silence() -> TriggerOutcome {
    Err("the node is stopping, or does not answer".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::{Receiver, TryRecvError, channel};
    use std::thread;

    /// Longer than a loaded machine needs.
    const PATIENCE: Duration = Duration::from_secs(20);

    /// A thread that hands over one call after the other, as that of a service does while requests come: what it is
    /// answered, and how it ends.
    fn serving(calls: &Calls, service: u32) -> (Receiver<TriggerOutcome>, impl FnOnce() + Send + use<>) {
        let ((said, answers), (stop, stopped)) = (channel(), channel::<()>());
        let calls = calls.clone();
        let serve = move || {
            while stopped.try_recv() == Err(TryRecvError::Empty) {
                said.send(calls.ask_and_wait(service, Asked::Trigger)).unwrap();
            }
        };
        let thread = thread::spawn(serve);
        let end = move || {
            drop(stop);
            thread.join().unwrap();
        };
        (answers, end)
    }

    #[test]
    fn regress_a_service_with_a_call_under_way_is_closed_and_its_caller_hears_why() {
        // Nobody reads the other end: a node that is busy with its own cleanup.
        let (channel_of_gateway, _node) = Channel::pair().unwrap();
        let calls = Calls::new(&Arc::new(channel_of_gateway));
        let (answers, end) = serving(&calls, 3);
        let (other_answers, other_end) = serving(&calls, 4);
        while lock(&calls.waiting).callers.len() < 2 {
            thread::yield_now();
        }
        let (say, closed) = channel();
        let closing = calls.clone();
        thread::spawn(move || {
            closing.close(3, end);
            say.send(()).unwrap();
        });
        closed.recv_timeout(PATIENCE).expect("the gateway's loop hangs");
        let first = answers.recv().unwrap().unwrap_err();
        assert!(first.contains("it is being cleaned up or stops"), "{first}");
        assert!(other_answers.try_recv().is_err(), "the caller of another service still waits");
        calls.clear();
        let left = other_answers.recv_timeout(PATIENCE).expect("a caller waits for a gateway that leaves");
        assert!(left.unwrap_err().contains("stopping"));
        other_end();
    }
}
