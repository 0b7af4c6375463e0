//! A recorded bag as a campaign.
//!
//! Place in the flow: every command that reads a campaign takes a bag for one. Its readings are joined by the rules of the live
//! diagnosis and by its code, so that a recorded run gives offline what the diagnosis of that run saw. What is left out is
//! counted.

use crate::step::{ReadingBuffer, is_fresh};
use crate::topics;
use abbe_measurement::campaign::Campaign;
use abbe_msgs::bag::{BagError, messages};
use abbe_msgs::{Message, ScaleReading, TracerReading};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use thiserror::Error;

/// How the readings of a bag become a campaign: as the live diagnosis makes one of what it hears.
#[derive(Debug, Clone, PartialEq)]
pub struct JoinSettings {
    /// Stamps this close are the same instant (s).
    pub match_within_s: f64,
    /// Age from which a covariate is stale, and so missing (s).
    pub max_covariate_age_s: f64,
    /// Namespace of the machine in the bag; needed where several machines share its frame.
    pub namespace: Option<String>,
}

impl Default for JoinSettings {
    /// The figures of the shipped launch files.
    fn default() -> JoinSettings {
        JoinSettings { match_within_s: 0.0005, max_covariate_age_s: 10.0, namespace: None }
    }
}

/// A bag as a campaign.
#[derive(Debug, Clone, PartialEq)]
pub struct CampaignFromBag {
    /// The campaign; times are seconds since its first reading, or those that all readings carry as `time_s`.
    pub campaign: Campaign,
    /// What of the bag is not in it, each in words with its number; empty where everything is.
    pub left_out: Vec<String>,
    /// Stamps of the first and the last scale reading (ns), as their clock counts.
    pub stamps_ns: Option<[i64; 2]>,
}

/// Joins the scale and tracer readings of a machine, whose frame is `frame_id`, by the rules of the live diagnosis
/// ([`ReadingBuffer`]), in the order in which they were recorded.
///
/// # Errors
/// When the bag cannot be read to its end, holds no readings of this machine, or those of several, or none of them belong
/// together.
pub fn campaign_from_bag(
    path: &Path,
    frame_id: &str,
    join: &JoinSettings,
) -> Result<CampaignFromBag, BagCampaignError> {
    let topics = Topics::choose(path, frame_id, join.namespace.as_deref())?;
    let JoinSettings { match_within_s, max_covariate_age_s, .. } = *join;
    let mut buffer = ReadingBuffer::with_capacity(frame_id, match_within_s, max_covariate_age_s, usize::MAX);
    let (mut tracers, mut stale, mut elsewhere) = (0_usize, 0_usize, topics.other_messages);
    let mut stamps_ns: Option<[i64; 2]> = None;
    for message in messages(path)? {
        let message = message?;
        if message.topic() == topics.scale {
            let reading: ScaleReading = message.decode()?;
            if reading.frame_id.as_str() != frame_id {
                elsewhere += 1;
                continue;
            }
            let stamp_ns = reading.stamp.to_nanos();
            stamps_ns =
                Some(stamps_ns.map_or([stamp_ns; 2], |[first, last]| [first.min(stamp_ns), last.max(stamp_ns)]));
            stale += usize::from(reading.covariates.iter().any(|c| !is_fresh(c.age_s, max_covariate_age_s)));
            buffer.scale(&reading);
        } else if message.topic() == topics.tracer {
            tracers += 1;
            buffer.tracer(&message.decode()?);
        }
    }
    buffer.finish();
    let campaign = buffer.campaign(None);
    let joined = campaign.readings.len();
    if joined == 0 {
        return Err(BagCampaignError::NothingJoined { bag: path.display().to_string(), tracers, match_within_s });
    }
    let (dropped, unusable) = (buffer.dropped() as usize, buffer.unusable() as usize);
    let doubled = buffer.len() - joined;
    let waiting = tracers.saturating_sub(joined + dropped + unusable + doubled);
    let counts = [
        (waiting, format!("tracer readings have no scale reading within {} ms of their stamp", match_within_s * 1e3)),
        (unusable, "tracer readings are not usable (no number, another frame, a stamp that does not follow, or two tracers under one name)".into()),
        (dropped, "tracer readings are from before their tracer started again, or its clock was set back".into()),
        (doubled, "tracer readings repeat an instant of their station".into()),
        (
            stale,
            format!(
                "scale readings have covariates older than {max_covariate_age_s} s, or from after the reading, which are missing"
            ),
        ),
        (elsewhere, "readings are of another frame or namespace".into()),
    ];
    let left_out = counts.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    Ok(CampaignFromBag { campaign, left_out: left_out.collect(), stamps_ns })
}

/// The topics of one machine in a bag.
struct Topics {
    scale: String,
    tracer: String,
    /// Scale and tracer readings on other topics.
    other_messages: usize,
}

/// A topic of readings.
#[derive(Default)]
struct Found {
    messages: usize,
    frames: BTreeSet<String>,
}

impl Topics {
    fn choose(path: &Path, frame_id: &str, namespace: Option<&str>) -> Result<Topics, BagCampaignError> {
        let bag = path.display().to_string();
        let (mut scales, mut tracers) = (BTreeMap::<String, Found>::new(), BTreeMap::<String, Found>::new());
        for message in messages(path)? {
            let message = message?;
            let (found, frame) = if message.ros_type() == ScaleReading::ROS_TYPE {
                (&mut scales, message.decode::<ScaleReading>()?.frame_id.to_string())
            } else if message.ros_type() == TracerReading::ROS_TYPE {
                (&mut tracers, message.decode::<TracerReading>()?.frame_id.to_string())
            } else {
                continue;
            };
            let topic = found.entry(message.topic().to_owned()).or_default();
            topic.messages += 1;
            topic.frames.insert(frame);
        }
        let missing = |ros_type| BagCampaignError::NoMessages { bag: bag.clone(), ros_type };
        for (found, ros_type) in [(&scales, ScaleReading::ROS_TYPE), (&tracers, TracerReading::ROS_TYPE)] {
            if found.is_empty() {
                return Err(missing(ros_type));
            }
        }
        let in_namespace = |topic: &str, name: &str| {
            namespace.is_none_or(|wanted| topic.trim_matches('/') == format!("{}/{name}", wanted.trim_matches('/')))
        };
        let own = |(topic, found): &(&String, &Found)| {
            found.frames.contains(frame_id) && in_namespace(topic, topics::SCALE_READING)
        };
        let own: Vec<&String> = scales.iter().filter(own).map(|(topic, _)| topic).collect();
        let scale = match own.as_slice() {
            [only] => (*only).clone(),
            [] => {
                let frames: BTreeSet<&str> = scales.values().flat_map(|f| &f.frames).map(String::as_str).collect();
                let frames = frames.into_iter().collect::<Vec<_>>().join(", ");
                return Err(BagCampaignError::OtherMachine { bag, frame_id: frame_id.to_owned(), frames });
            }
            several => {
                let topics = several.iter().map(|topic| topic.as_str()).collect::<Vec<_>>().join(", ");
                return Err(BagCampaignError::SeveralMachines { bag, topics });
            }
        };
        // The tracer of the same namespace; the only one there is, where names tell nothing.
        let beside =
            scale.strip_suffix(topics::SCALE_READING).map(|space| format!("{space}{}", topics::TRACER_READING));
        let tracer = match (beside.filter(|topic| tracers.contains_key(topic)), tracers.len()) {
            (Some(topic), _) => topic,
            (None, 1) => tracers.keys().next().cloned().unwrap_or_default(),
            (None, _) => {
                let topics = tracers.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
                return Err(BagCampaignError::SeveralMachines { bag, topics });
            }
        };
        let others = scales.iter().chain(&tracers).filter(|(topic, _)| **topic != scale && **topic != tracer);
        let other_messages = others.map(|(_, found)| found.messages).sum();
        Ok(Topics { scale, tracer, other_messages })
    }
}

/// Why a bag is no campaign of this machine.
#[derive(Debug, Error)]
pub enum BagCampaignError {
    /// The bag cannot be read.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// The bag holds no such message.
    #[error("bag {bag}: no message of type {ros_type}; record the scale and tracer topics")]
    NoMessages {
        /// The bag.
        bag: String,
        /// Type looked for.
        ros_type: &'static str,
    },
    /// No tracer reading has a scale reading.
    #[error(
        "bag {bag}: none of {tracers} tracer readings has a usable scale reading within {} ms of its stamp; latch both \
         together, or allow more with --match-within-s",
        match_within_s * 1e3
    )]
    NothingJoined {
        /// The bag.
        bag: String,
        /// Tracer readings.
        tracers: usize,
        /// Tolerance (s).
        match_within_s: f64,
    },
    /// The bag holds no readings of this machine.
    #[error(
        "bag {bag}: recorded in frame {frames:?}, but the machine has frame {frame_id:?}, and --namespace must be that of its \
         topics where it is given; this bag is of another machine"
    )]
    OtherMachine {
        /// The bag.
        bag: String,
        /// Frame of the machine.
        frame_id: String,
        /// Frames of the scale readings.
        frames: String,
    },
    /// The bag holds readings on several topics, any of which may be meant.
    #[error("bag {bag}: any of these topics may be meant: {topics}; name one machine with --namespace")]
    SeveralMachines {
        /// The bag.
        bag: String,
        /// The topics.
        topics: String,
    },
}
