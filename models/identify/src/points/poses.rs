//! Poses of plates: which points belong to which, and what was measured of them.
//!
//! Place in the flow: read from files, then [`super::plate`] fits and [`super::problem`] has a frame for each.

use super::PointsError;
use abbe_geometry::Axis;
use std::collections::BTreeMap;

/// Points that a pose needs: three say no more than where it lies.
const FEWEST: usize = 4;

/// Poses of plates, and what was measured of their points.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plates {
    /// Pose of each point.
    of: Vec<usize>,
    /// Names of the poses.
    names: Vec<String>,
    /// Axis across which no position was measured: the component of `actual_m` there means nothing but must be constant.
    lacks: Option<Axis>,
}

impl Plates {
    /// Plates by the name of the pose of each point; `lacks` is the axis across which positions were not measured.
    ///
    /// # Errors
    /// A pose of fewer than four points.
    pub fn new(poses: &[String], lacks: Option<Axis>) -> Result<Plates, PointsError> {
        let mut numbers: BTreeMap<&String, usize> = BTreeMap::new();
        poses.iter().for_each(|name| *numbers.entry(name).or_default() += 1);
        if numbers.values().any(|count| *count < FEWEST) {
            return Err(PointsError::Choice(
                "a pose holds fewer than four points; a pose is one placing of a plate, with all its points",
            ));
        }
        let names: Vec<String> = numbers.into_keys().cloned().collect();
        let of = poses.iter().map(|name| names.iter().position(|own| own == name).unwrap_or(0)).collect();
        Ok(Plates { of, names, lacks })
    }

    /// Points of a volume in one frame.
    pub(super) fn volume(points: usize) -> Plates {
        Plates { of: vec![0; points], names: vec![String::new()], lacks: None }
    }

    /// Number of poses.
    pub fn poses(&self) -> usize {
        self.names.len()
    }

    /// Whether positions were measured in the plane only.
    pub fn is_in_plane(&self) -> bool {
        self.lacks.is_some()
    }

    /// Pose of a point.
    pub(super) fn pose(&self, point: usize) -> usize {
        self.of[point]
    }

    /// Points of a pose.
    pub(super) fn members(&self, pose: usize) -> impl Iterator<Item = usize> {
        (0..self.of.len()).filter(move |k| self.of[*k] == pose)
    }

    pub(super) fn lacks(&self) -> Option<usize> {
        self.lacks.map(Axis::index)
    }
}
