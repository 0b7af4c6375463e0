//! Residual vectors as a bag: corrected coordinates whose residual part was measured.
//!
//! Place in the flow: `abbe residuals --out BAG` writes, `train` and `compare` read. One `abbe_msgs/CorrectedCoordinates` a
//! point on `/MACHINE/residual_vectors`: geometric and effect correction as the model gives them, `residual_correction_m`
//! the measured residual (actual − corrected), `corrected_m` the measured actual position, `covariance_m2` that of the
//! residual, zero where nobody knows it; `model_sha256` names the model. Everything that reads corrected coordinates
//! shows it.

use crate::pipeline::bag_sha256;
use abbe_diagnose::study::vectors::ResidualVector;
use abbe_files::ResidualOwner;
use abbe_geometry::Vector3;
use abbe_geometry::correct::Correction;
use abbe_msgs::bag::{BagWriter, messages};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Message, Sha256, Stamp, Text};
use abbe_residual_data::PointResidual;
use anyhow::{Context, bail, ensure};
use std::path::Path;

/// Name of the topic in the machine's namespace.
const TOPIC: &str = "residual_vectors";

/// A residual with what the bag says of its point.
pub(crate) struct BagPoint {
    pub(crate) point: PointResidual,
    pub(crate) reading_m: [f64; 3],
    pub(crate) offset_m: [f64; 3],
    pub(crate) correction: Correction,
    /// Time of the reading (s); its number where nobody logged it.
    pub(crate) time_s: f64,
}

/// Writes residual vectors as a bag.
pub(crate) fn write(path: &Path, points: &[BagPoint], owner: &ResidualOwner, frame_id: &str) -> anyhow::Result<()> {
    let mut writer = BagWriter::create(path)?;
    let topic = format!("/{}/{TOPIC}", owner.machine);
    for (sequence, bag_point) in (0..).zip(points) {
        let sample = sample(sequence, bag_point, owner, frame_id)?;
        let log_time_ns = u64::try_from(sample.stamp.to_nanos()).context("the time of a reading is before zero")?;
        writer.write(&topic, &sample, log_time_ns)?;
    }
    writer.finish()?;
    Ok(())
}

fn sample(
    sequence: u64,
    bag_point: &BagPoint,
    owner: &ResidualOwner,
    frame_id: &str,
) -> anyhow::Result<CorrectedCoordinates> {
    let BagPoint { point, reading_m, offset_m, correction, time_s } = bag_point;
    let covariance_m2 = point.covariance_m2.unwrap_or_default();
    Ok(CorrectedCoordinates {
        stamp: Stamp::from_seconds(*time_s)?,
        sequence,
        reading_m: *reading_m,
        offset_m: *offset_m,
        geometric_correction_m: correction.geometric_m.into(),
        effect_correction_m: correction.effects_m.into(),
        residual_correction_m: point.residual_m.into(),
        corrected_m: (point.point_m + point.residual_m).into(),
        covariance_m2: std::array::from_fn(|k| covariance_m2[(k / 3, k % 3)]),
        model_sha256: Sha256::from_bytes(owner.model_sha256),
        residual_model_sha256: Sha256::NONE,
        frame_id: Text::new(frame_id)?,
        corrected_valid: true,
        status: CorrectionStatus::InVolume,
    })
}

/// Residual vectors of a bag, the model they are of, and the hash of its bytes.
pub fn read(path: &Path) -> anyhow::Result<(Vec<ResidualVector>, ResidualOwner, [u8; 32])> {
    let name = path.display();
    let mut rows = Vec::new();
    let mut owner: Option<ResidualOwner> = None;
    for message in messages(path)? {
        let message = message?;
        let Some(namespace) = message.topic().strip_suffix(TOPIC) else { continue };
        ensure!(
            message.ros_type() == CorrectedCoordinates::ROS_TYPE,
            "{name}: {} is {}, not {}; give a bag that abbe residuals has written",
            message.topic(),
            message.ros_type(),
            CorrectedCoordinates::ROS_TYPE
        );
        let sample: CorrectedCoordinates = message.decode()?;
        let machine = namespace.trim_matches('/').to_owned();
        let own = ResidualOwner { machine, model_sha256: sample.model_sha256.to_bytes() };
        match &owner {
            Some(first) if *first != own => bail!("{name}: holds residuals of two models; give one bag a model"),
            _ => owner = Some(own),
        }
        rows.push(vector(&sample));
    }
    let owner = owner
        .with_context(|| format!("{name}: holds no residual vectors; give a bag that abbe residuals has written"))?;
    Ok((rows, owner, bag_sha256(path)?))
}

fn vector(sample: &CorrectedCoordinates) -> ResidualVector {
    let residual_m = Vector3::from(sample.residual_correction_m);
    let variances_m2 = [0, 4, 8].map(|k| sample.covariance_m2[k]);
    let u_m = variances_m2.iter().all(|v| *v > 0.0).then(|| variances_m2.map(f64::sqrt));
    ResidualVector {
        position_m: (Vector3::from(sample.corrected_m) - residual_m).into(),
        residual_m: residual_m.into(),
        u_m,
        time_s: Some(sample.stamp.to_nanos() as f64 * 1e-9),
        ..ResidualVector::default()
    }
}
