//! A service that does one thing and says whether it worked: `std_srvs/srv/Trigger`.
//!
//! Place in the flow: commands to a running node, such as loading the model again. The handler runs
//! on the service's thread; it hands its result to the correcting thread and does not wait for it.

use std::thread::{self, JoinHandle};

use futures::channel::oneshot;
use futures::future;
use serde::{Deserialize, Serialize};

use super::service::{EmptyRequest, Service};
use super::{RosError, RosNode};

/// What the handler did: `Ok` and `Err` both carry a sentence for the caller.
pub type TriggerOutcome = Result<String, String>;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct TriggerReply {
    pub(super) success: bool,
    pub(super) message: String,
}

/// A running service. Dropping it ends it.
pub struct TriggerService {
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
    // Last: the node leaves after its service.
    _node: RosNode,
}

impl TriggerService {
    pub(super) fn open(
        node: &RosNode,
        name: &str,
        mut handler: impl FnMut() -> TriggerOutcome + Send + 'static,
    ) -> Result<Self, RosError> {
        let name = node.resolve(name)?;
        let service: Service<EmptyRequest, TriggerReply> = node.service(&name, "std_srvs", "Trigger")?;
        let (stop, stopped) = oneshot::channel();
        let thread = thread::Builder::new()
            .name("ros-service".into())
            .spawn(move || {
                let serving = std::pin::pin!(service.serve(async move |_request| reply(handler())));
                futures::executor::block_on(future::select(serving, stopped));
            })
            .map_err(|source| RosError::Thread { what: "a service", source })?;
        Ok(Self { stop: Some(stop), thread: Some(thread), _node: node.clone() })
    }
}

fn reply(outcome: TriggerOutcome) -> TriggerReply {
    let success = outcome.is_ok();
    let message = outcome.unwrap_or_else(|reason| reason);
    TriggerReply { success, message }
}

impl Drop for TriggerService {
    fn drop(&mut self) {
        drop(self.stop.take());
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the handler of a service panicked");
        }
    }
}
