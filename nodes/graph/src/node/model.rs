//! The model of a running node: the one at the start, and every better one that takes its place.
//!
//! Place in the flow: the geometric, the residual and the monitor node open it once; it brings them each new version of
//! the file that the launch file names, offers `~/reload_model`, and tells on `/diagnostics` which model is in use. What
//! kind of file it is only matters to how it is loaded.

use super::{NodeContext, NodeError, NodeSummary};
use crate::feed::{Feed, FeedStatus};
use crate::launch::NodeName;
use crate::step::OwnedField;
use crate::topics;
use abbe_files::{FileError, LoadedResidual, ModelFile, Place, ResidualFile};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::MachineModel;
use abbe_msgs::standard::DiagnosticStatus;
use abbe_msgs::{COVARIATE_CAPACITY, COVARIATE_NAME_CAPACITY, Sha256};
use abbe_runtime::gateway::{GatewayNode, GatewayService};
use abbe_runtime::ros::Diagnostics;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// A model ready to correct, and its hash.
pub(super) type LoadedModel = (Arc<MachineModel>, Sha256);

/// New versions of the model file; none where the launch file names no model.
pub(super) type ModelFeed = ArtifactFeed<Arc<MachineModel>>;

/// New versions of the residual model file; none where the launch file names none.
pub(super) type ResidualFeed = ArtifactFeed<OwnedField>;

/// Words for one kind of file.
#[derive(Debug, Clone, Copy)]
struct Words {
    /// What it is called, on `/diagnostics` too.
    name: &'static str,
    /// Key of the launch file.
    key: &'static str,
    /// Whether a node without such a file does not do its work.
    is_needed: bool,
}

const MODEL: Words = Words { name: "model", key: "model", is_needed: true };
const RESIDUAL: Words = Words { name: "residual model", key: "residual_model", is_needed: false };

/// What a file holds at the start, if one is named, and the feed of what it will hold.
type Opened<T> = (Option<(T, Sha256)>, ArtifactFeed<T>);

/// What speaks against each file that was loaded, by its hash.
type SaidAgainst = Arc<Mutex<BTreeMap<Sha256, String>>>;

/// New versions of a file that a node corrects with.
pub(super) struct ArtifactFeed<T> {
    words: Words,
    said_against: SaidAgainst,
    feed: Option<Feed<T>>,
    _service: Option<GatewayService>,
}

impl ModelFeed {
    /// Loads the model that the launch file names, and watches it.
    pub(super) fn open(context: &NodeContext) -> Result<(Option<LoadedModel>, ModelFeed), NodeError> {
        let machine = context.machine.machine.clone();
        let said_against = SaidAgainst::default();
        let of_loading = Arc::clone(&said_against);
        let load = move |path: &Path| load(path, &machine, &of_loading);
        let (first, feed) = ArtifactFeed::of_file(context, MODEL, context.launch.model.as_deref(), load)?;
        Ok((first, ArtifactFeed { said_against, ..feed }))
    }
}

impl ResidualFeed {
    /// Loads the residual model that the launch file names, and watches it.
    pub(super) fn open(context: &NodeContext) -> Result<(Option<OwnedField>, ResidualFeed), NodeError> {
        let machine = context.machine.machine.name.clone();
        let supply = Supply::of(context);
        let load = move |path: &Path| load_residual(path, &machine, &supply);
        let (first, feed) = ArtifactFeed::of_file(context, RESIDUAL, context.launch.residual_model.as_deref(), load)?;
        Ok((first.map(|(field, _)| field), feed))
    }
}

impl<T: Send + 'static> ArtifactFeed<T> {
    fn of_file(
        context: &NodeContext,
        words: Words,
        path: Option<&Path>,
        load: impl FnMut(&Path) -> Result<(T, Sha256), FileError> + Send + 'static,
    ) -> Result<Opened<T>, NodeError> {
        let Some(path) = path else {
            let service = Self::serve(context, words, None)?;
            return Ok((
                None,
                ArtifactFeed { words, said_against: SaidAgainst::default(), feed: None, _service: service },
            ));
        };
        let (first, feed) = Feed::open(&context.base.join(path), load)?;
        let service = Self::serve(context, words, Some(&feed))?;
        let said_against = SaidAgainst::default();
        Ok((Some(first), ArtifactFeed { words, said_against, feed: Some(feed), _service: service }))
    }

    fn serve(context: &NodeContext, words: Words, feed: Option<&Feed<T>>) -> Result<Option<GatewayService>, NodeError> {
        let reload = feed.map(Feed::reload);
        let Words { name, key, .. } = words;
        let handler = move || match &reload {
            Some(reload) => reload.load().map(|sha256| format!("{name} {} is in use from now on", sha256.to_hex())),
            None => Err(format!("the launch file names no {name}; add the key {key} and start the node again")),
        };
        let serve = |node: &GatewayNode| node.trigger_service(topics::RELOAD_MODEL, handler);
        Ok(context.commanded().map(serve).transpose()?)
    }

    /// Has another file used from now on, where it can be; any thread may ask.
    pub(super) fn changer(&self) -> impl Fn(&Path) -> Result<(), String> + Send + use<T> {
        let Words { name, key, .. } = self.words;
        let reload = self.feed.as_ref().map(Feed::reload);
        move |path| match &reload {
            Some(reload) => reload.load_from(path).map(drop),
            None => Err(format!("the launch file names no {name}; add the key {key} and start the node again")),
        }
    }

    /// The newest model that has become ready since the last call. Never waits.
    pub(super) fn newest(&self) -> Option<(T, Sha256)> {
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
    pub(super) fn report(&self, health: &Diagnostics, in_use: Sha256) {
        let said_against = self.said_against.lock().unwrap_or_else(PoisonError::into_inner).get(&in_use).cloned();
        self.report_with(health, in_use, said_against.as_deref());
    }

    /// The same, where the node itself has something to `warn` of.
    pub(super) fn report_with(&self, health: &Diagnostics, in_use: Sha256, warning: Option<&str>) {
        let FeedStatus { loaded, refused, problem, path } = self.status();
        let name = self.words.name;
        let (level, message) = match (&problem, warning) {
            (Some(problem), _) => (DiagnosticStatus::WARN, format!("refused a new {name}: {problem}")),
            (None, Some(warning)) => (DiagnosticStatus::WARN, warning.to_owned()),
            (None, None) if in_use.is_none() && self.words.is_needed => (DiagnosticStatus::WARN, format!("no {name}")),
            (None, None) if in_use.is_none() => (DiagnosticStatus::OK, format!("no {name}: samples pass as they are")),
            (None, None) => (DiagnosticStatus::OK, format!("{name} in use")),
        };
        let file = self.feed.as_ref().map_or("none".to_owned(), |_| path.display().to_string());
        let sha256 = if in_use.is_none() { "none".to_owned() } else { in_use.to_hex() };
        let figures = [
            (format!("{name} sha256"), sha256),
            (format!("{name}s loaded"), loaded.to_string()),
            (format!("{name}s refused"), refused.to_string()),
            (format!("{name} file"), file),
        ];
        let figures = figures.iter().map(|(key, value)| (key.as_str(), value.clone()));
        health.report(name, level, &message, figures);
    }

    /// Counts for the node's summary.
    pub(super) fn figures(&self, summary: &mut NodeSummary) {
        let status = self.status();
        let name = self.words.name.replace(' ', "_");
        summary.figures.insert(format!("{name}s_loaded"), status.loaded as f64);
        summary.figures.insert(format!("{name}s_refused"), status.refused as f64);
    }
}

fn load(path: &Path, machine: &Machine, said_against: &SaidAgainst) -> Result<LoadedModel, FileError> {
    let (file, sha256) = ModelFile::load_for(path, machine)?;
    let doubts: Vec<String> = file.said_against().collect();
    if !doubts.is_empty() {
        let mut known = said_against.lock().unwrap_or_else(PoisonError::into_inner);
        known.insert(Sha256::from_bytes(sha256), doubts.join("; "));
    }
    Ok((Arc::new(file.model), Sha256::from_bytes(sha256)))
}

fn load_residual(path: &Path, machine: &str, supply: &Supply) -> Result<(OwnedField, Sha256), FileError> {
    let (file, owner, sha256) = ResidualFile::load_for(path, machine)?;
    if let Some((problem, remedy)) = supply.problem(file.model.covariates()) {
        let place = Place::file(&path.display().to_string()).key("predictor");
        return Err(FileError::content(place, problem, remedy));
    }
    let field = Arc::new(LoadedResidual::new(file.model, sha256));
    Ok((OwnedField { field, model_sha256: Sha256::from_bytes(owner.model_sha256) }, Sha256::from_bytes(sha256)))
}

/// What the scale readings of a launch file can bring to the residual node.
#[derive(Debug, Clone)]
struct Supply {
    has_edge: bool,
    /// All names that can come, where the launch file tells.
    names: Option<Vec<String>>,
}

impl Supply {
    fn of(context: &NodeContext) -> Supply {
        let edge = context.launch.takes_over(context.name.name(), NodeName::Scale);
        Supply { has_edge: edge.is_some(), names: context.launch.covariate_names() }
    }

    /// Why inputs of these names cannot come, and what to do; `None` where they can.
    fn problem(&self, inputs: &[String]) -> Option<(String, &'static str)> {
        if inputs.is_empty() {
            return None;
        }
        let needs = format!("the residual model needs {} beside the position", inputs.join(", "));
        if !self.has_edge {
            let remedy =
                "add an edge from scale to residual to the launch file, or train a model on the position alone";
            return Some((format!("{needs}, and no scale readings come to the residual node"), remedy));
        }
        let remedy = "train a model without that input";
        if inputs.len() > COVARIATE_CAPACITY {
            return Some((
                format!("{needs}, and a scale reading has room for {COVARIATE_CAPACITY} covariates"),
                remedy,
            ));
        }
        if let Some(long) = inputs.iter().find(|name| name.len() > COVARIATE_NAME_CAPACITY) {
            let problem =
                format!("{needs}, and no scale reading can name {long}: {COVARIATE_NAME_CAPACITY} bytes at most");
            return Some((problem, remedy));
        }
        let names = self.names.as_ref()?;
        let lacks = inputs.iter().find(|name| !names.contains(name))?;
        let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        let remedy = "let the driver or a sensor of the launch file log it, or train a model without that input";
        Some((
            format!("{needs}, and the scale readings of this launch file hold no {lacks}; they hold {known}"),
            remedy,
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_that_no_scale_reading_can_bring_are_named_with_a_way_out() {
        let supply = |has_edge, names: Option<&[&str]>| Supply {
            has_edge,
            names: names.map(|names| names.iter().map(|name| (*name).to_owned()).collect()),
        };
        let problem = |supply: Supply, name: &str| supply.problem(&[name.to_owned()]).map(|(problem, _)| problem);
        assert_eq!(supply(false, None).problem(&[]), None);
        assert!(problem(supply(false, None), "temp_air_c").unwrap().contains("no scale readings come"));
        assert_eq!(problem(supply(true, None), "temp_air_c"), None);
        assert!(problem(supply(true, None), &"q".repeat(33)).unwrap().contains("32 bytes"));
        assert_eq!(problem(supply(true, Some(&["temp_air_c"])), "temp_air_c"), None);
        let lacks = problem(supply(true, Some(&["temp_air_c"])), "q1_deg").unwrap();
        assert!(lacks.contains("hold no q1_deg") && lacks.contains("temp_air_c"), "{lacks}");
    }
}
