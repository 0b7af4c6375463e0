//! What a gateway makes of samples and of the machine for everybody else: standard messages beside the own ones.
//!
//! Place in the flow: a node says which it wants when it opens a topic; its gateway makes them of the samples that pass, so
//! that they cost the correcting thread nothing. What has no samples (the description of the machine, frames that stand
//! still) is a [`Standing`] message, which whoever joins later gets as well. Metres, in the frame that the header names.

use std::time::{Duration, Instant};

use abbe_msgs::standard::{
    Clock, ColorRgba, Header, JointState, Marker, MarkerArray, Point, PointStamped, Pose, Text, TfMessage,
    TransformStamped, Vector3,
};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Message, RosType, ScaleReading};
use serde::{Deserialize, Serialize};

use crate::ros::{RosError, RosNode, TopicEnd, Writer, latched_qos, offered_qos, overridden};

/// Time between two pictures of the error: more than an eye takes in.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// How many times larger than it is an error is drawn: 10 µm become 100 mm.
const MAGNIFIED: f64 = 10_000.0;
const GREEN: ColorRgba = ColorRgba { r: 0.1, g: 0.7, b: 0.2, a: 1.0 };
const AMBER: ColorRgba = ColorRgba { r: 0.9, g: 0.6, b: 0.0, a: 1.0 };
const RED: ColorRgba = ColorRgba { r: 0.8, g: 0.1, b: 0.1, a: 1.0 };
const GREY: ColorRgba = ColorRgba { r: 0.5, g: 0.5, b: 0.5, a: 0.6 };

/// A standard message made of each sample of a topic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Companion {
    /// Its topic.
    pub topic: String,
    /// What it is.
    pub content: Content,
}

/// What a [`Companion`] is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Content {
    /// `sensor_msgs/JointState` of a scale reading, with the names of X, Y, Z.
    JointState([String; 3]),
    /// `rosgraph_msgs/Clock`: the stamp of a scale reading as the time of the graph.
    Clock,
    /// `geometry_msgs/PointStamped` of a valid corrected coordinate.
    Point,
    /// `tf2_msgs/TFMessage` of a corrected coordinate: the moving parts of the machine, tip, and where the tip really is.
    Frames(Frames),
    /// `visualization_msgs/MarkerArray` of a corrected coordinate: working volume, error vector, and both in words.
    Markers(Volume),
}

/// The frames of a machine that move.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Frames {
    /// The machine frame; samples of another one are of another machine.
    pub frame_id: String,
    /// From the workpiece to the ram, each standing in the one before it: name, and the axis (0, 1, 2) that moves it.
    pub links: Vec<(String, usize)>,
    /// Tip or reflector as the machine indicates it, in the last of these.
    pub tip: String,
    /// Where tip or reflector really is, in the machine frame.
    pub actual: String,
}

/// The working volume of a machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Volume {
    /// The machine frame.
    pub frame_id: String,
    /// Lower and upper end of travel of X, Y, Z (m).
    pub stroke_m: [(f64, f64); 3],
}

/// A message that stands: whoever joins later gets it as well.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Standing {
    /// `std_msgs/String`.
    Text(String),
    /// `tf2_msgs/TFMessage`: frames that do not move.
    Frames(Vec<TransformStamped>),
}

/// Makes the standard message beside a sample and publishes it.
pub(super) type Beside<M> = Box<dyn FnMut(&M) -> Result<(), String> + Send>;

/// Samples that standard messages are made of.
pub(super) trait Companionable: Message {
    /// What makes and publishes one.
    fn beside(node: &RosNode, companion: &Companion) -> Result<Beside<Self>, RosError> {
        let _ = node;
        Err(not_of(&companion.topic, Self::ROS_TYPE))
    }
}

impl Companionable for abbe_msgs::TracerReading {}

impl Companionable for abbe_msgs::RangeResidual {}

impl Companionable for ScaleReading {
    fn beside(node: &RosNode, Companion { topic, content }: &Companion) -> Result<Beside<Self>, RosError> {
        match content {
            Content::JointState(axes) => {
                let (publisher, axes) = (writer::<JointState>(node, topic)?, axes.clone());
                Ok(Box::new(move |reading| {
                    publisher.publish(JointState::from_scales(reading, axes.each_ref().map(String::as_str)))
                }))
            }
            Content::Clock => {
                let publisher = writer::<Clock>(node, topic)?;
                Ok(Box::new(move |reading| publisher.publish(Clock { clock: reading.stamp.into() })))
            }
            _ => Err(not_of(topic, Self::ROS_TYPE)),
        }
    }
}

impl Companionable for CorrectedCoordinates {
    fn beside(node: &RosNode, Companion { topic, content }: &Companion) -> Result<Beside<Self>, RosError> {
        match content {
            Content::Point => {
                let publisher = writer::<PointStamped>(node, topic)?;
                Ok(Box::new(move |corrected| {
                    let point = PointStamped::from_corrected(corrected);
                    point.map_or(Ok(()), |point| publisher.publish(point))
                }))
            }
            Content::Frames(frames) => {
                let (publisher, frames) = (writer::<TfMessage>(node, topic)?, frames.clone());
                Ok(Box::new(move |corrected| {
                    let frames = frames.at(corrected);
                    frames.map_or(Ok(()), |transforms| publisher.publish(TfMessage { transforms }))
                }))
            }
            Content::Markers(volume) => {
                let (publisher, volume) = (writer::<MarkerArray>(node, topic)?, volume.clone());
                let mut looked: Option<Instant> = None;
                Ok(Box::new(move |corrected| {
                    if looked.is_some_and(|looked| looked.elapsed() < LOOK_EVERY) {
                        return Ok(());
                    }
                    looked = Some(Instant::now());
                    publisher.publish(MarkerArray { markers: volume.markers(corrected) })
                }))
            }
            _ => Err(not_of(topic, Self::ROS_TYPE)),
        }
    }
}

fn not_of(topic: &str, ros_type: &str) -> RosError {
    RosError::Gateway { reason: format!("{topic} is not made of {ros_type}") }
}

/// A writer of standard messages, with what the node's parameters say of its quality of service.
fn writer<R: RosType>(node: &RosNode, topic: &str) -> Result<Writer<R>, RosError> {
    node.writer(topic, &overridden(node, topic, TopicEnd::Publisher, offered_qos(super::COMPANION_DEPTH)))
}

/// A standing message, which is there as long as what is returned is held.
pub(super) fn stand(node: &RosNode, topic: &str, content: &Standing) -> Result<Box<dyn Send>, RosError> {
    let failed = |reason| RosError::Gateway { reason: format!("{topic} cannot be published: {reason}") };
    match content {
        Standing::Text(data) => {
            let publisher = node.writer::<Text>(topic, &latched_qos())?;
            publisher.publish(Text { data: data.clone() }).map_err(failed)?;
            Ok(Box::new(publisher))
        }
        Standing::Frames(transforms) => {
            let publisher = node.writer::<TfMessage>(topic, &latched_qos())?;
            publisher.publish(TfMessage { transforms: transforms.clone() }).map_err(failed)?;
            Ok(Box::new(publisher))
        }
    }
}

/// Whether the axes stand where a sample says: one of another machine, of several mixed ones, or without a position
/// tells nothing of this one.
fn tells_of_axes(corrected: &CorrectedCoordinates, frame_id: &str) -> bool {
    let is_of_another = matches!(corrected.status, CorrectionStatus::OtherFrame | CorrectionStatus::SeveralSources);
    let numbers = corrected.reading_m.iter().chain(&corrected.offset_m);
    !is_of_another && corrected.frame_id.as_str() == frame_id && numbers.copied().all(f64::is_finite)
}

impl Frames {
    /// Where they are; nothing where a sample does not tell.
    fn at(&self, corrected: &CorrectedCoordinates) -> Option<Vec<TransformStamped>> {
        if !tells_of_axes(corrected, &self.frame_id) {
            return None;
        }
        let stamp = corrected.stamp;
        let mut parent = self.frame_id.as_str();
        let mut frames = Vec::new();
        for (name, axis) in &self.links {
            let along = |d| if d == *axis { corrected.reading_m.get(d).copied().unwrap_or_default() } else { 0.0 };
            frames.push(TransformStamped::at(stamp, parent, name, [along(0), along(1), along(2)]));
            parent = name;
        }
        frames.push(TransformStamped::at(stamp, parent, &self.tip, corrected.offset_m));
        if let Some(actual_m) = corrected.corrected_point_in_machine_m() {
            frames.push(TransformStamped::at(stamp, &self.frame_id, &self.actual, actual_m));
        }
        Some(frames)
    }
}

impl Volume {
    fn markers(&self, corrected: &CorrectedCoordinates) -> Vec<Marker> {
        let blank =
            |ns: &str| Marker { ns: ns.to_owned(), ..Marker::new(Header::new(corrected.stamp, &self.frame_id)) };
        let edge_m = self.stroke_m.map(|(lower_m, upper_m)| upper_m - lower_m).into_iter().fold(0.0, f64::max);
        let thick = |share: f64| Vector3 { x: share * edge_m, y: 2.0 * share * edge_m, z: 0.0 };
        let volume = Marker {
            kind: Marker::LINE_LIST,
            scale: Vector3 { x: 0.002 * edge_m, ..Vector3::default() },
            color: GREY,
            points: self.edges(),
            ..blank("volume")
        };
        let at_m: [f64; 3] = std::array::from_fn(|d| corrected.reading_m[d] + corrected.offset_m[d]);
        let position = if tells_of_axes(corrected, &self.frame_id) { point(at_m) } else { Point::default() };
        let text = Marker {
            kind: Marker::TEXT_VIEW_FACING,
            pose: Pose { position, ..Pose::default() },
            scale: Vector3 { z: 0.03 * edge_m, ..Vector3::default() },
            ..blank("words")
        };
        let arrow = Marker { kind: Marker::ARROW, scale: thick(0.006), ..blank("error") };
        if corrected.corrected_point_in_machine_m().is_none() {
            let words = format!("not corrected: {}", corrected.status.name());
            return vec![
                volume,
                Marker { action: Marker::DELETE, ..arrow },
                Marker { text: words, color: RED, ..text },
            ];
        }
        let error_m: [f64; 3] = std::array::from_fn(|d| {
            corrected.geometric_correction_m[d] + corrected.effect_correction_m[d] + corrected.residual_correction_m[d]
        });
        let is_sound = corrected.status == CorrectionStatus::InVolume;
        let color = if is_sound { GREEN } else { AMBER };
        let ends = vec![point(at_m), point(std::array::from_fn(|d| at_m[d] + MAGNIFIED * error_m[d]))];
        let [x, y, z] = error_m.map(|error_m| error_m * 1e6);
        let words = format!("{}: error {x:+.1} {y:+.1} {z:+.1} µm, drawn × {MAGNIFIED}", corrected.status.name());
        vec![volume, Marker { points: ends, color, ..arrow }, Marker { text: words, color, ..text }]
    }

    /// The twelve edges, by their ends.
    fn edges(&self) -> Vec<Point> {
        let corner = |bits: usize| {
            let end = |d: usize| if bits >> d & 1 == 0 { self.stroke_m[d].0 } else { self.stroke_m[d].1 };
            point(std::array::from_fn(end))
        };
        let along = |bits: usize| (0..3).filter(move |d| bits >> d & 1 == 0).map(move |d| (bits, bits | 1 << d));
        (0..8).flat_map(along).flat_map(|(from, to)| [corner(from), corner(to)]).collect()
    }
}

fn point([x, y, z]: [f64; 3]) -> Point {
    Point { x, y, z }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_msgs::{Sha256, Stamp};

    const FRAME: &str = "bridge";

    fn sample() -> CorrectedCoordinates {
        CorrectedCoordinates {
            stamp: Stamp::new(7, 0).unwrap(),
            sequence: 1,
            reading_m: [0.1, 0.2, 0.3],
            offset_m: [0.0, 0.01, -0.12],
            geometric_correction_m: [2e-6, 0.0, 0.0],
            effect_correction_m: [0.0, -3e-6, 0.0],
            residual_correction_m: [0.0; 3],
            corrected_m: [0.100_002, 0.209_997, 0.18],
            covariance_m2: [0.0; 9],
            model_sha256: Sha256::of(b"model"),
            residual_model_sha256: Sha256::NONE,
            frame_id: abbe_msgs::Text::new(FRAME).unwrap(),
            corrected_valid: true,
            status: CorrectionStatus::InVolume,
        }
    }

    fn frames() -> Frames {
        let name = |part: &str| format!("{FRAME}/{part}");
        let links = vec![(name("bed"), 1), (name("x"), 0), (name("ram"), 2)];
        Frames { frame_id: FRAME.to_owned(), links, tip: name("tip"), actual: name("tip_actual") }
    }

    #[test]
    fn frames_lead_from_the_workpiece_to_the_tip_and_to_where_it_really_is() {
        let found = frames().at(&sample()).unwrap();
        let sum = found[..4].iter().fold([0.0; 3], |sum, frame| {
            let Vector3 { x, y, z } = frame.transform.translation;
            [sum[0] + x, sum[1] + y, sum[2] + z]
        });
        for (found, expected) in sum.into_iter().zip([0.1, 0.21, 0.18]) {
            assert!((found - expected).abs() < 1e-15);
        }
        let parents: Vec<_> = found.iter().map(|frame| frame.header.frame_id.as_str()).collect();
        assert_eq!(parents, ["bridge", "bridge/bed", "bridge/x", "bridge/ram", "bridge"]);
        assert_eq!(found[4].child_frame_id, "bridge/tip_actual");
        assert_eq!(found[4].transform.translation, Vector3 { x: 0.100_002, y: 0.209_997, z: 0.18 });
    }

    #[test]
    fn what_tells_nothing_of_this_machine_moves_nothing() {
        for (status, reading_m) in [
            (CorrectionStatus::OtherFrame, [0.1; 3]),
            (CorrectionStatus::SeveralSources, [0.1; 3]),
            (CorrectionStatus::Rejected, [0.1, f64::NAN, 0.1]),
        ] {
            let withheld = CorrectedCoordinates { reading_m, ..sample() }.withheld(status);
            assert_eq!(frames().at(&withheld), None, "{status:?}");
        }
        let other = CorrectedCoordinates { frame_id: abbe_msgs::Text::new("other").unwrap(), ..sample() };
        assert_eq!(frames().at(&other), None);
        // Not corrected, but the axes stand where they stand.
        assert_eq!(frames().at(&sample().withheld(CorrectionStatus::NoModel)).unwrap().len(), 4);
    }

    #[test]
    fn an_error_is_drawn_from_the_indicated_point_and_one_that_is_not_known_is_not_drawn() {
        let volume = Volume { frame_id: FRAME.to_owned(), stroke_m: [(0.0, 0.8), (0.0, 0.6), (-0.1, 0.5)] };
        let [edges, arrow, words] = <[Marker; 3]>::try_from(volume.markers(&sample())).unwrap();
        assert_eq!(edges.points.len(), 24);
        assert!(edges.points.iter().all(|point| [-0.1, 0.5].contains(&point.z)));
        let (from, to) = (arrow.points[0], arrow.points[1]);
        assert!((to.x - from.x - 0.02).abs() < 1e-12 && (to.y - from.y + 0.03).abs() < 1e-12, "{arrow:?}");
        assert!(words.text.contains("+2.0 -3.0 +0.0 µm"), "{}", words.text);
        let markers = volume.markers(&sample().withheld(CorrectionStatus::NoModel));
        assert_eq!((markers[1].action, markers[1].points.len()), (Marker::DELETE, 0));
        assert_eq!(markers[2].text, "not corrected: NO_MODEL");
    }
}
