//! Values of parameters that change while a node runs.
//!
//! Place in the flow: between the thread that answers `set_parameters` and the loop of a node. A loop that is at work
//! registers what puts new values to use; while there is none, they are kept for when the node is configured. What comes while it
//! is being configured, after the launch file was read with the values so far, is put to use when the loop registers.

use super::parameters::apply;
use super::told::say_parameters;
use crate::launch::{Launch, NodeName};
use abbe_runtime::gateway::OnChange;
use abbe_runtime::ros::{ParameterValue, TriggerOutcome};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Answer to who sets what the loop takes between two samples.
pub(super) const FROM_NOW_ON: &str = "in use from the next sample on";
/// Answer where the loop has ended.
pub(super) const STOPPING: &str = "the node is stopping";

/// New values since the start, and who puts them to use. Clones share them.
#[derive(Clone, Default)]
pub(crate) struct Changes(Arc<Mutex<Inner>>);

#[derive(Default)]
struct Inner {
    values: BTreeMap<String, ParameterValue>,
    /// Those of them that the launch file was read with.
    applied: BTreeMap<String, ParameterValue>,
    /// Those that came since then, while nobody could put them to use.
    kept: BTreeMap<String, ParameterValue>,
    user: Option<OnChange>,
    /// Whether a launcher hears of new values, and gives them to the process that may have to take this one's place.
    has_launcher: bool,
}

/// Puts new values to use as long as this is held.
pub(super) struct InUse(Changes);

impl Changes {
    /// Values that a process before this one was told.
    pub(super) fn new(values: BTreeMap<String, ParameterValue>, has_launcher: bool) -> Changes {
        Changes(Arc::new(Mutex::new(Inner { values, has_launcher, ..Inner::default() })))
    }

    /// From now on, `user` puts new values to use: all, or none. It gets at once what came since [`Changes::apply`]; where it cannot use
    /// that, it is given up aloud, and the node goes on with what it was configured with.
    pub(super) fn put_to_use(
        &self,
        mut user: impl FnMut(&[(String, ParameterValue)]) -> TriggerOutcome + Send + 'static,
    ) -> InUse {
        let mut inner = self.lock();
        let kept: Vec<_> = std::mem::take(&mut inner.kept).into_iter().collect();
        if !kept.is_empty()
            && let Err(problem) = user(&kept)
        {
            let names: Vec<&str> = kept.iter().map(|(name, _)| name.as_str()).collect();
            let names = names.join(", ");
            tracing::error!("what was set while the node was configured is not put to use ({names}): {problem}");
            inner.values = inner.applied.clone();
            if inner.has_launcher {
                say_parameters(&inner.values);
            }
        }
        inner.user = Some(Box::new(user));
        drop(inner);
        InUse(self.clone())
    }

    /// Takes new values, which are of the right type and in range.
    pub(super) fn take(&self, values: &[(String, ParameterValue)]) -> TriggerOutcome {
        let mut inner = self.lock();
        let said = match &mut inner.user {
            Some(user) => user(values)?,
            None => {
                inner.kept.extend(values.iter().cloned());
                "kept for when the node is configured".to_owned()
            }
        };
        inner.values.extend(values.iter().cloned());
        if inner.has_launcher {
            say_parameters(&inner.values);
        }
        for (name, value) in values {
            tracing::info!(parameter = name, ?value, "changed");
        }
        Ok(said)
    }

    /// The launch file as it is with all new values.
    pub(super) fn apply(&self, launch: &mut Launch, node: NodeName) {
        let mut inner = self.lock();
        inner.kept.clear();
        inner.applied = inner.values.clone();
        apply(inner.values.iter().map(|(name, value)| (name.as_str(), value)), launch, node);
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::{Path, PathBuf};
    use std::sync::mpsc::channel;

    fn launch() -> Launch {
        let text = include_str!("../../../../launch-config/bridge_xyz_virtual.toml");
        Launch::parse(text, Path::new("bridge_xyz_virtual.toml")).unwrap()
    }

    fn model(file: &str) -> Vec<(String, ParameterValue)> {
        vec![("model".to_owned(), ParameterValue::String(file.to_owned()))]
    }

    #[test]
    fn regress_what_is_set_while_a_node_is_configured_is_put_to_use() {
        let (changes, mut launch) = (Changes::default(), launch());
        changes.take(&model("before.json")).unwrap();
        changes.apply(&mut launch, NodeName::Geometric);
        assert_eq!(launch.model, Some(PathBuf::from("before.json")));
        // The model loads, and its service is open.
        assert!(changes.take(&model("b.json")).unwrap().contains("kept"));
        let (give, used) = channel();
        let user = move |values: &[(String, ParameterValue)]| {
            give.send(values.to_vec()).unwrap();
            Ok("in use".to_owned())
        };
        let in_use = changes.put_to_use(user);
        assert_eq!(used.try_iter().collect::<Vec<_>>(), [model("b.json")], "once, and not what was applied");
        changes.take(&model("c.json")).unwrap();
        assert_eq!(used.try_iter().collect::<Vec<_>>(), [model("c.json")]);
        // Cleaned up and configured again: nothing is left over.
        drop(in_use);
        changes.apply(&mut launch, NodeName::Geometric);
        assert_eq!(launch.model, Some(PathBuf::from("c.json")));
        let never = |values: &[(String, ParameterValue)]| Err(format!("{values:?}"));
        drop(changes.put_to_use(never));
        // What cannot be used is not there when the node is configured again.
        changes.take(&model("none.json")).unwrap();
        drop(changes.put_to_use(|_| Err("no such file".to_owned())));
        changes.apply(&mut launch, NodeName::Geometric);
        assert_eq!(launch.model, Some(PathBuf::from("c.json")));
    }
}
