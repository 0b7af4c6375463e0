//! The recorder node: every topic it has an edge from, into one rosbag2-readable bag.
//!
//! Place in the flow: beside the correcting path. The log time of a message is its stamp, so a recording says when
//! things were measured and replay depends on nothing else.

use super::{LOOK_UP, NodeContext, NodeError, NodeSummary, take};
use crate::launch::NodeName;
use crate::record::log_time_ns;
use abbe_msgs::bag::BagWriter;
use abbe_msgs::{CorrectedCoordinates, Message, RangeResidual, ScaleReading, TracerReading};
use abbe_runtime::Subscribe;
use std::time::Duration;

pub(super) fn run(context: &NodeContext) -> Result<NodeSummary, NodeError> {
    let part = "a bag to record to";
    let path = context.launch.record.as_ref().ok_or(NodeError::Incomplete { node: context.name.name(), part })?;
    let mut writer = BagWriter::create(context.base.join(path))?;
    let mut summary = NodeSummary { node: context.name.name().to_owned(), ..NodeSummary::default() };
    let mut scale = Track::<ScaleReading>::open(context, NodeName::Scale)?;
    let mut tracer = Track::<TracerReading>::open(context, NodeName::Tracer)?;
    let mut geometric = Track::<CorrectedCoordinates>::open(context, NodeName::Geometric)?;
    let mut residual = Track::<CorrectedCoordinates>::open(context, NodeName::Residual)?;
    let mut monitor = Track::<RangeResidual>::open(context, NodeName::Monitor)?;
    loop {
        let stopping = context.shutdown.requested();
        let before = summary.received;
        scale.drain(&mut writer, &mut summary)?;
        tracer.drain(&mut writer, &mut summary)?;
        geometric.drain(&mut writer, &mut summary)?;
        residual.drain(&mut writer, &mut summary)?;
        monitor.drain(&mut writer, &mut summary)?;
        if summary.received == before {
            if stopping {
                break;
            }
            context.shutdown.sleep(LOOK_UP.min(Duration::from_millis(5)));
        }
    }
    summary.lost = scale.lost() + tracer.lost() + geometric.lost() + residual.lost() + monitor.lost();
    writer.finish()?;
    Ok(summary)
}

/// One recorded topic.
struct Track<M: Message> {
    topic: String,
    subscriber: Option<Box<dyn Subscribe<M>>>,
}

impl<M: Message> Track<M> {
    fn open(context: &NodeContext, from: NodeName) -> Result<Track<M>, NodeError> {
        let topic = format!("/{}/{}", context.launch.namespace.trim_matches('/'), from.topic().unwrap_or_default());
        let recorded = context.launch.takes_over(context.name.name(), from).is_some();
        let subscriber = if recorded { Some(context.subscriber(from)?) } else { None };
        Ok(Track { topic, subscriber })
    }

    fn drain(&mut self, writer: &mut BagWriter, summary: &mut NodeSummary) -> Result<(), NodeError> {
        let Some(subscriber) = self.subscriber.as_mut() else { return Ok(()) };
        while let Some(sample) = take(subscriber.as_mut(), Duration::ZERO, summary)? {
            writer.write(&self.topic, &sample, log_time_ns(&sample)?)?;
            summary.sent += 1;
        }
        Ok(())
    }

    fn lost(&self) -> u64 {
        self.subscriber.as_ref().map_or(0, |s| s.lost())
    }
}
