//! The machine as ROS 2 tools look at it: its description, and the frames that stand still.
//!
//! Place in the flow: the residual node, where it is in the ROS graph, hands them to its gateway once, and again when the
//! model file has other stations; on a thread of its own, beside the loop.

use super::{NodeContext, NodeError};
use crate::feed::Feed;
use crate::{scene, topics};
use abbe_files::{FileError, ModelFile};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::Station;
use abbe_msgs::Sha256;
use abbe_runtime::Shutdown;
use abbe_runtime::gateway::{GatewayNode, GatewayStanding, Standing};
use std::path::Path;
use std::thread;
use std::time::Duration;

/// How often it is looked whether there is a new model.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Stations of a model file.
type Stations = Vec<Station>;

/// What stands, as long as this is held.
pub(super) struct Scenery {
    _description: Option<GatewayStanding>,
}

/// Puts the scenery up.
pub(super) fn open(context: &NodeContext) -> Result<Scenery, NodeError> {
    let Some(node) = &context.ros else { return Ok(Scenery { _description: None }) };
    let machine = context.machine.machine.clone();
    let description = node.standing(topics::ROBOT_DESCRIPTION, Standing::Text(scene::urdf(&machine)))?;
    let opened = context.launch.model.as_ref().map(|path| {
        let of = machine.clone();
        Feed::open(&context.base.join(path), move |path: &Path| load(path, &of))
    });
    let (stations, feed) = match opened {
        Some(Ok(((stations, _), feed))) => (stations, Some(feed)),
        // The geometric node tells of a model that cannot be used; what is missing here are its stations.
        Some(Err(error)) => {
            tracing::warn!("no stations on {}: {error}", topics::STATIC_FRAMES);
            (Vec::new(), None)
        }
        None => (Vec::new(), None),
    };
    let frames = stand(node, &machine, &stations)?;
    let (node, shutdown) = (node.clone(), context.shutdown.clone());
    let following = move || follow(&node, &machine, feed.as_ref(), (stations, frames), &shutdown);
    thread::Builder::new().name("scenery".into()).spawn(following).map_err(NodeError::Thread)?;
    Ok(Scenery { _description: Some(description) })
}

fn load(path: &Path, machine: &Machine) -> Result<(Stations, Sha256), FileError> {
    let (file, sha256) = ModelFile::load_for(path, machine)?;
    Ok((file.model.parts().stations.clone(), Sha256::from_bytes(sha256)))
}

fn stand(node: &GatewayNode, machine: &Machine, stations: &[Station]) -> Result<GatewayStanding, NodeError> {
    Ok(node.standing(topics::STATIC_FRAMES, Standing::Frames(scene::standing_frames(machine, stations)))?)
}

/// Holds the frames until the node stops, and puts up those of each new model.
fn follow(
    node: &GatewayNode,
    machine: &Machine,
    feed: Option<&Feed<Stations>>,
    (mut stations, mut frames): (Stations, GatewayStanding),
    shutdown: &Shutdown,
) {
    while !shutdown.sleep_beside(LOOK_EVERY) {
        let Some((newest, _)) = feed.and_then(Feed::newest).filter(|(newest, _)| *newest != stations) else { continue };
        match stand(node, machine, &newest) {
            // Only now: who joins in between finds the old ones.
            Ok(new) => (stations, frames) = (newest, new),
            Err(error) => tracing::warn!("the stations of the new model are not shown: {error}"),
        }
    }
    drop(frames);
}
