//! Values of parameters that change while a node runs.
//!
//! Place in the flow: between the thread that answers `set_parameters` and the loop of a node. A loop that is at work
//! registers what puts new values to use; while there is none, they are kept for when the node is configured.

use super::parameters::apply;
use crate::launch::{Launch, NodeName};
use abbe_runtime::gateway::OnChange;
use abbe_runtime::ros::{ParameterValue, TriggerOutcome};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// New values since the start, and who puts them to use. Clones share them.
#[derive(Clone, Default)]
pub(crate) struct Changes(Arc<Mutex<Inner>>);

#[derive(Default)]
struct Inner {
    values: BTreeMap<String, ParameterValue>,
    user: Option<OnChange>,
}

/// Puts new values to use as long as this is held.
pub(super) struct InUse(Changes);

impl Changes {
    /// From now on, `user` puts new values to use: all, or none.
    pub(super) fn put_to_use(
        &self,
        user: impl FnMut(&[(String, ParameterValue)]) -> TriggerOutcome + Send + 'static,
    ) -> InUse {
        self.lock().user = Some(Box::new(user));
        InUse(self.clone())
    }

    /// Takes new values, which are of the right type and in range.
    pub(super) fn take(&self, values: &[(String, ParameterValue)]) -> TriggerOutcome {
        let mut inner = self.lock();
        let said = match &mut inner.user {
            Some(user) => user(values)?,
            None => "kept for when the node is configured".to_owned(),
        };
        inner.values.extend(values.iter().cloned());
        for (name, value) in values {
            tracing::info!(parameter = name, ?value, "changed");
        }
        Ok(said)
    }

    /// The launch file as it is with all new values.
    pub(super) fn apply(&self, launch: &mut Launch, node: NodeName) {
        apply(self.lock().values.iter().map(|(name, value)| (name.as_str(), value)), launch, node);
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for InUse {
    fn drop(&mut self) {
        self.0.lock().user = None;
    }
}
