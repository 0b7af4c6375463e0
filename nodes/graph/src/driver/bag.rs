//! Driver: a recorded bag; and a bag as a campaign.
//!
//! Place in the flow: `kind = "bag"` in a launch configuration replays what was recorded, message by message;
//! `abbe identify` reads a bag as a campaign by joining scale and tracer readings of the same instant.

use super::{DriverError, ScaleDriver, TracerDriver};
use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};
use abbe_msgs::bag::{Messages, messages};
use abbe_msgs::{Message, ScaleReading, Stamp, TracerReading};
use std::collections::BTreeMap;
use std::path::Path;

/// Messages of one topic of a bag.
pub(super) struct BagTopic {
    messages: Messages,
    topic: String,
}

impl BagTopic {
    fn next_message<M: Message>(&mut self) -> Result<Option<M>, DriverError> {
        for message in self.messages.by_ref() {
            let message = message?;
            if message.topic() == self.topic {
                return Ok(Some(message.decode()?));
            }
        }
        Ok(None)
    }
}

fn open(path: &Path, topic: &str) -> Result<BagTopic, DriverError> {
    Ok(BagTopic { messages: messages(path)?, topic: topic.to_owned() })
}

pub(super) fn open_scale(path: &Path, topic: &str) -> Result<BagTopic, DriverError> {
    open(path, topic)
}

pub(super) fn open_tracer(path: &Path, topic: &str) -> Result<BagTopic, DriverError> {
    open(path, topic)
}

impl ScaleDriver for BagTopic {
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError> {
        self.next_message()
    }
}

impl TracerDriver for BagTopic {
    fn next_reading(&mut self) -> Result<Option<TracerReading>, DriverError> {
        self.next_message()
    }
}

/// A bag as a campaign, and the frame it was recorded in.
#[derive(Debug, Clone, PartialEq)]
pub struct CampaignFromBag {
    /// The campaign; times are seconds since its first reading.
    pub campaign: Campaign,
    /// Frame of the scale readings.
    pub frame_id: String,
}

/// Joins scale and tracer readings of the same stamp.
pub fn campaign_from_bag(path: &Path) -> Result<CampaignFromBag, DriverError> {
    let mut scales: BTreeMap<Stamp, ScaleReading> = BTreeMap::new();
    let mut tracers: Vec<TracerReading> = Vec::new();
    for message in messages(path)? {
        let message = message?;
        if message.ros_type() == ScaleReading::ROS_TYPE {
            let reading: ScaleReading = message.decode()?;
            scales.insert(reading.stamp, reading);
        } else if message.ros_type() == TracerReading::ROS_TYPE {
            tracers.push(message.decode()?);
        }
    }
    let missing =
        |ros_type| DriverError::NoMessages { bag: path.display().to_string(), ros_type, topic: String::new() };
    let Some(first) = scales.keys().next().copied() else { return Err(missing(ScaleReading::ROS_TYPE)) };
    if tracers.is_empty() {
        return Err(missing(TracerReading::ROS_TYPE));
    }
    let frame_id = scales[&first].frame_id.to_string();
    let mut join = Join { campaign: Campaign::default(), start: first.to_seconds() };
    for tracer in &tracers {
        let scale = scales.get(&tracer.stamp).ok_or_else(|| DriverError::Unmatched {
            bag: path.display().to_string(),
            sequence: tracer.sequence,
            stamp_s: tracer.stamp.to_seconds(),
        })?;
        join.push(scale, tracer);
    }
    Ok(CampaignFromBag { campaign: join.campaign, frame_id })
}

struct Join {
    campaign: Campaign,
    start: f64,
}

impl Join {
    fn push(&mut self, scale: &ScaleReading, tracer: &TracerReading) {
        let station = index_of(&mut self.campaign.stations, tracer.station.as_str());
        let line = index_of(&mut self.campaign.lines, tracer.line.as_str());
        let row = self.campaign.readings.len();
        self.campaign.readings.push(RangeReading {
            station,
            line,
            time_s: tracer.stamp.to_seconds() - self.start,
            reading_m: scale.reading_m,
            offset_m: scale.offset_m,
            length_m: tracer.length_m,
        });
        for entry in &scale.covariates {
            let name = entry.name.as_str();
            if self.campaign.covariate(name).is_none() {
                self.campaign.covariates.push(Covariate { name: name.to_owned(), values: vec![None; row] });
            }
        }
        for covariate in &mut self.campaign.covariates {
            covariate.values.push(scale.covariates.get(&covariate.name).map(|entry| entry.value));
        }
    }
}

/// Place of a name, added when it is new. The last name is the likeliest, so it is looked for from the end.
fn index_of(names: &mut Vec<String>, name: &str) -> u32 {
    match names.iter().rposition(|known| known == name) {
        Some(index) => index as u32,
        None => {
            names.push(name.to_owned());
            names.len() as u32 - 1
        }
    }
}
