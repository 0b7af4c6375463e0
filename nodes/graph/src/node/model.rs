//! The model of a running node: the one at the start, and every better one that takes its place.
//!
//! Place in the flow: the geometric and the monitor node open it once; it brings them each new version of the file that
//! the launch file names, offers `~/reload_model`, and tells on `/diagnostics` which model is in use. The residual
//! node's artifact can come by the same [`Feed`] and the same service.

use super::{NodeContext, NodeError, NodeSummary};
use crate::feed::{Feed, FeedStatus};
use crate::topics;
use abbe_files::{FileError, ModelFile};
use abbe_geometry::model::MachineModel;
use abbe_msgs::Sha256;
use abbe_msgs::standard::DiagnosticStatus;
use abbe_runtime::ros::{Diagnostics, RosNode, TriggerService};
use std::path::Path;
use std::sync::Arc;

/// A model ready to correct, and its hash.
pub(super) type LoadedModel = (Arc<MachineModel>, Sha256);

/// New versions of the model file; none where the launch file names no model.
pub(super) struct ModelFeed {
    feed: Option<Feed<Arc<MachineModel>>>,
    _service: Option<TriggerService>,
}

impl ModelFeed {
    /// Loads the model that the launch file names, and watches it.
    pub(super) fn open(context: &NodeContext) -> Result<(Option<LoadedModel>, ModelFeed), NodeError> {
        let Some(path) = &context.launch.model else {
            return Ok((None, ModelFeed { feed: None, _service: Self::serve(context, None)? }));
        };
        let machine = context.machine.machine.name.clone();
        let load = move |path: &Path| load(path, &machine);
        let (first, feed) = Feed::open(&context.base.join(path), load)?;
        let service = Self::serve(context, Some(&feed))?;
        Ok((Some(first), ModelFeed { feed: Some(feed), _service: service }))
    }

    fn serve(
        context: &NodeContext,
        feed: Option<&Feed<Arc<MachineModel>>>,
    ) -> Result<Option<TriggerService>, NodeError> {
        let reload = feed.map(Feed::reload);
        let handler = move || match &reload {
            Some(reload) => reload.load().map(|sha256| format!("model {} is in use from now on", sha256.to_hex())),
            None => Err("the launch file names no model; add the key model and start the node again".to_owned()),
        };
        let serve = |node: &RosNode| node.trigger_service(topics::RELOAD_MODEL, handler);
        Ok(context.ros.as_ref().map(serve).transpose()?)
    }

    /// The newest model that has become ready since the last call. Never waits.
    pub(super) fn newest(&self) -> Option<LoadedModel> {
        self.feed.as_ref().and_then(Feed::newest)
    }

    /// Has the file looked at now. Does not wait.
    pub(super) fn look_now(&self) {
        if let Some(feed) = &self.feed {
            feed.look_now();
        }
    }

    fn status(&self) -> FeedStatus {
        self.feed.as_ref().map(Feed::status).unwrap_or_default()
    }

    /// Tells which model is in use, and why a newer one is not.
    pub(super) fn report(&self, health: &Diagnostics, in_use: Sha256) -> Result<(), NodeError> {
        let FeedStatus { loaded, refused, problem } = self.status();
        let (level, message) = match &problem {
            Some(problem) => (DiagnosticStatus::WARN, format!("refused a new model: {problem}")),
            None if in_use.is_none() => (DiagnosticStatus::WARN, "no model".to_owned()),
            None => (DiagnosticStatus::OK, "model in use".to_owned()),
        };
        let file = self.feed.as_ref().map_or("none".to_owned(), |feed| feed.path().display().to_string());
        let sha256 = if in_use.is_none() { "none".to_owned() } else { in_use.to_hex() };
        let figures = [
            ("model sha256", sha256),
            ("models loaded", loaded.to_string()),
            ("models refused", refused.to_string()),
            ("model file", file),
        ];
        Ok(health.report("model", level, &message, figures)?)
    }

    /// Counts for the node's summary.
    pub(super) fn figures(&self, summary: &mut NodeSummary) {
        let status = self.status();
        summary.figures.insert("models_loaded".to_owned(), status.loaded as f64);
        summary.figures.insert("models_refused".to_owned(), status.refused as f64);
    }
}

fn load(path: &Path, machine: &str) -> Result<LoadedModel, FileError> {
    let (file, sha256) = ModelFile::load_for(path, machine)?;
    Ok((Arc::new(file.model), Sha256::from_bytes(sha256)))
}
