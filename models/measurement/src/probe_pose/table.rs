//! Compensation table: how far each pose puts the sphere from its common centre.
//!
//! Place in the flow: calibrated pose and the centres it came from in, table out; δ is added to a point measured in that pose
//! (m, machine frame). δ(θA, θC) = S0 − S0^(k), averaged over the distances of a pose (Zhang 2016, eq. 13 and table 3). The
//! paper measures only in the poses of its table, and says nothing of others. Between them this table interpolates by
//! inverse squared angle of turn (Shepard 1968), and says so; outside the poses it gives nothing.

use super::design::head_in_machine;
use super::same::{SAME_RAD, angles_rad, poses};
use super::{ProbePose, SphereCentre};
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::{PI, TAU};

/// Turn between two poses (rad) below which they are one orientation of the head.
const ONE_ORIENTATION_RAD: f64 = 1e-6;
/// Rounding of directions of a point that lies on the edge between two poses (rad).
const ON_THE_EDGE_RAD: f64 = 1e-9;

/// One pose of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct TableEntry {
    /// Indicated A, mean over its centres (rad).
    pub a_rad: f64,
    /// Indicated C, mean over its centres (rad).
    pub c_rad: f64,
    /// δ (m, machine frame): to be added.
    pub delta_m: Vector3<f64>,
    /// Centres it is the mean of.
    pub centres: usize,
    /// Largest distance of a centre's own δ from the mean (m); `None` of a single centre.
    pub spread_m: Option<f64>,
}

/// δ by pose.
#[derive(Debug, Clone, PartialEq)]
pub struct CompensationTable {
    /// In the order in which the poses were measured.
    pub entries: Vec<TableEntry>,
}

/// What the table says of a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Compensation {
    /// The pose is in the table.
    Tabulated {
        /// δ (m, machine frame).
        delta_m: Vector3<f64>,
    },
    /// The pose lies between those of the table; how good that is, only leaving poses out tells.
    Interpolated {
        /// δ (m, machine frame).
        delta_m: Vector3<f64>,
    },
    /// The pose lies outside those of the table, which says nothing of it.
    Outside,
}

impl Compensation {
    /// δ (m, machine frame), if there is one.
    pub fn delta_m(&self) -> Option<Vector3<f64>> {
        match self {
            Compensation::Tabulated { delta_m } | Compensation::Interpolated { delta_m } => Some(*delta_m),
            Compensation::Outside => None,
        }
    }
}

impl CompensationTable {
    /// The table of a calibrated pose, from centres that need not be those it was fitted to.
    pub fn new(pose: &ProbePose, centres: &[SphereCentre]) -> CompensationTable {
        let entry = |group: &Vec<usize>| {
            let own: Vec<Vector3<f64>> = group.iter().map(|i| pose.centre_m - pose.seen_m(&centres[*i])).collect();
            let delta_m = own.iter().sum::<Vector3<f64>>() / own.len() as f64;
            let spread = own.iter().map(|delta| (delta - delta_m).norm()).fold(0.0, f64::max);
            let [a_rad, c_rad] = angles_rad(centres, group);
            TableEntry { a_rad, c_rad, delta_m, centres: own.len(), spread_m: (own.len() > 1).then_some(spread) }
        };
        CompensationTable { entries: poses(centres).iter().map(entry).collect() }
    }

    /// δ at indicated angles (rad).
    pub fn at(&self, a_rad: f64, c_rad: f64) -> Compensation {
        let off = |e: &TableEntry| (e.a_rad - a_rad).abs().max((e.c_rad - c_rad).abs());
        let nearest = self.entries.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        if let Some(entry) = nearest.filter(|entry| off(entry) < SAME_RAD) {
            return Compensation::Tabulated { delta_m: entry.delta_m };
        }
        let corners: Vec<[f64; 2]> = self.entries.iter().map(|e| [e.a_rad, e.c_rad]).collect();
        if !is_between([a_rad, c_rad], &corners) {
            return Compensation::Outside;
        }
        let head = head_in_machine(a_rad, c_rad);
        let (mut sum, mut total) = (Vector3::zeros(), 0.0);
        for entry in &self.entries {
            let turn = Rotation3::from_matrix_unchecked(head.transpose() * head_in_machine(entry.a_rad, entry.c_rad));
            // Two sets of angles can be one orientation of the head (A = 0 at C and C + 360°).
            let weight = turn.angle().max(ONE_ORIENTATION_RAD).powi(-2);
            sum += entry.delta_m * weight;
            total += weight;
        }
        Compensation::Interpolated { delta_m: sum / total }
    }
}

/// Whether a point lies in the convex hull of others, in the plane of A and C: seen from outside, all of them are within
/// 180°.
fn is_between(point: [f64; 2], corners: &[[f64; 2]]) -> bool {
    let mut directions: Vec<f64> = corners.iter().map(|c| (c[1] - point[1]).atan2(c[0] - point[0])).collect();
    directions.sort_by(f64::total_cmp);
    let gap = |k: usize| match directions.get(k + 1) {
        Some(next) => next - directions[k],
        None => directions[0] + TAU - directions[k],
    };
    let widest = (0..directions.len()).map(gap).fold(0.0, f64::max);
    directions.len() > 1 && widest < PI + ON_THE_EDGE_RAD
}
