//! Which unknowns a plan of poses leaves open, and what would close them.
//!
//! Place in the flow: the answer of a fit whose design lacks rank.

use super::SphereCentre;
use super::design::head_in_machine;
use super::same::poses;
use nalgebra::{DVector, Vector3};
use std::fmt;
use thiserror::Error;

/// Distances closer than this are one distance (m).
const SAME_M: f64 = 1e-9;
/// Sine of the angle between turns (rad) below which they are about one axis.
const ONE_AXIS: f64 = 1e-3;
/// Share of a free combination from which an unknown takes part in it.
const TAKES_PART: f64 = 1e-6;

/// Unknowns that the poses do not determine.
#[derive(Debug, Clone, PartialEq, Error)]
pub struct Undetermined {
    /// Combinations of unknowns that are determined.
    pub rank: usize,
    /// Unknowns.
    pub unknowns: usize,
    /// Those that take part in an undetermined combination: `S0`, `R_p`, `T_p`, `axis offset`.
    pub open: Vec<&'static str>,
    /// Why.
    pub because: &'static str,
    /// What to measure.
    pub remedy: &'static str,
}

impl fmt::Display for Undetermined {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Undetermined { rank, unknowns, open, because, remedy } = self;
        let open = open.join(", ");
        write!(f, "the poses determine {rank} of {unknowns} unknowns, and not {open} apart: {because}; {remedy}")
    }
}

impl Undetermined {
    pub(super) fn new(centres: &[SphereCentre], unknowns: usize, rank: usize, free: &[DVector<f64>]) -> Undetermined {
        let (because, remedy) = cause(centres);
        Undetermined { rank, unknowns, open: open(centres, free), because, remedy }
    }
}

fn open(centres: &[SphereCentre], free: &[DVector<f64>]) -> Vec<&'static str> {
    let typical_m = centres.iter().map(|c| c.distance_m.abs()).fold(0.0, f64::max);
    let size = |vector: &DVector<f64>, from: usize, to: usize, scale: f64| -> f64 {
        (from..to.min(vector.len())).map(|k| (vector[k] * scale).powi(2)).sum::<f64>().sqrt()
    };
    // A direction counts by how far it moves the point.
    let parts = |vector: &DVector<f64>| {
        [size(vector, 0, 3, 1.0), size(vector, 3, 6, typical_m), size(vector, 6, 9, 1.0), size(vector, 9, 10, 1.0)]
    };
    let takes_part = |k: usize| {
        free.iter().any(|vector| {
            let parts = parts(vector);
            parts[k] > TAKES_PART * parts.iter().sum::<f64>()
        })
    };
    ["S0", "R_p", "T_p", "axis offset"]
        .into_iter()
        .enumerate()
        .filter(|(k, _)| takes_part(*k))
        .map(|(_, n)| n)
        .collect()
}

fn cause(centres: &[SphereCentre]) -> (&'static str, &'static str) {
    let groups = poses(centres);
    let first = centres.first().map_or(0.0, |c| c.distance_m);
    let one_distance = centres.iter().all(|c| (c.distance_m - first).abs() < SAME_M);
    match (groups.len(), one_distance) {
        (0, _) => ("there is no centre", "measure the sphere in three poses or more, at two distances"),
        (1, _) => (
            "all centres have one pose, where the probe's zero cannot be told from the sphere's centre",
            "turn A and C: three poses or more, with A angles of both signs",
        ),
        (_, true) => (
            "all centres have one distance, where beam direction and zero are one sum",
            "measure at two distances or more",
        ),
        _ if one_axis(centres, &groups) => (
            "all poses turn about one axis, along which the probe's zero cannot be told from the sphere's centre",
            "measure in three poses or more that turn both A and C",
        ),
        _ => (
            "the poses are too much alike",
            "measure at A angles of both signs with at least two C angles, and two distances",
        ),
    }
}

/// Whether the poses differ by turns about one axis of the head only.
fn one_axis(centres: &[SphereCentre], groups: &[Vec<usize>]) -> bool {
    let head = |group: &Vec<usize>| head_in_machine(centres[group[0]].a_rad, centres[group[0]].c_rad);
    let first = head(&groups[0]);
    let axis = |group: &Vec<usize>| -> Option<Vector3<f64>> {
        nalgebra::Rotation3::from_matrix(&(first.transpose() * head(group))).axis().map(|axis| axis.into_inner())
    };
    let axes: Vec<Vector3<f64>> = groups[1..].iter().filter_map(axis).collect();
    axes.windows(2).all(|pair| pair[0].cross(&pair[1]).norm() < ONE_AXIS)
}
