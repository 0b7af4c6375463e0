//! Poses of a plate: which vectors belong to one, what they span, and how the plate was turned between them.
//!
//! Place in the flow: the study of vectors asks here for its base columns. Where a plate lies on the table is unknown, so
//! each pose has a rigid motion of its own; without a column of poses all vectors are one. Turns of the plate come from
//! its named points: in the plane they span, by the turn and shift that fit them best. SI.

use super::ResidualVector;
use crate::error::DiagnoseError;
use crate::study::candidate::PoseRows;
use crate::study::smooth::range;
use abbe_geometry::{Axis, Matrix3, Vector3};
use std::collections::BTreeMap;

/// Unknowns of a pose: shift and turn.
pub(super) const RIGID: usize = 6;
/// Points that two poses must share for the turn between them.
const SHARED: usize = 3;
/// Vectors that a pose needs: three say no more than where it lies.
const FEWEST: usize = 4;
/// Share of the plate's extent by which a point may miss its place: far above any error of a machine, far below a wrong name.
const MISSES: f64 = 0.01;
/// Turn from which two poses tell the plate's form from the machine's (rad).
const TURNED_RAD: f64 = 0.1;

/// Vectors of one pose.
#[derive(Debug, Clone)]
pub(super) struct Pose {
    pub(super) name: Option<String>,
    pub(super) members: Vec<usize>,
    pub(super) centre_m: Vector3<f64>,
    /// Axes along which its vectors differ.
    spanned: [bool; 3],
}

/// All poses.
#[derive(Debug, Clone)]
pub(super) struct Poses {
    pub(super) list: Vec<Pose>,
    /// Pose of each vector.
    pub(super) of: Vec<usize>,
    /// Axes along which the vectors of some pose differ.
    pub(super) spanned: [bool; 3],
}

impl Poses {
    pub(super) fn new(vectors: &[ResidualVector]) -> Result<Poses, DiagnoseError> {
        if let Some(k) = vectors.iter().position(|vector| vector.pose.is_some() != vectors[0].pose.is_some()) {
            return Err(data(format!("vector {} differs from the first in having a pose", k + 1), "name every pose"));
        }
        let mut groups: BTreeMap<Option<&String>, Vec<usize>> = BTreeMap::new();
        vectors.iter().enumerate().for_each(|(k, vector)| groups.entry(vector.pose.as_ref()).or_default().push(k));
        let pose = |(name, members): (Option<&String>, Vec<usize>)| {
            let sum = members.iter().map(|k| Vector3::from(vectors[*k].position_m)).sum::<Vector3<f64>>();
            let spans = |axis: Axis| {
                let along: Vec<f64> = members.iter().map(|k| vectors[*k].position_m[axis.index()]).collect();
                !vectors[0].position_lacks[axis.index()] && range(&along).is_some()
            };
            let (centre_m, spanned) = (sum / members.len() as f64, Axis::ALL.map(spans));
            Pose { name: name.cloned(), centre_m, spanned, members }
        };
        let list: Vec<Pose> = groups.into_iter().map(pose).collect();
        if let Some(pose) = list.iter().find(|pose| pose.name.is_some() && pose.members.len() < FEWEST) {
            let name = pose.name.clone().unwrap_or_default();
            let problem = format!("pose {name} holds {} vectors, at least {FEWEST} are needed", pose.members.len());
            return Err(data(
                problem,
                "a pose is one placing of a plate: rename the column where it means something else",
            ));
        }
        let mut of = vec![0; vectors.len()];
        list.iter().enumerate().for_each(|(k, pose)| pose.members.iter().for_each(|member| of[*member] = k));
        let spanned = Axis::ALL.map(|axis| list.iter().any(|pose| pose.spanned[axis.index()]));
        Ok(Poses { list, of, spanned })
    }

    /// Name and rows of each pose, where there are several: three rows a vector.
    pub(super) fn rows(&self) -> Vec<PoseRows> {
        let rows = |pose: &Pose| pose.members.iter().flat_map(|k| 3 * k..3 * k + 3).collect();
        let one = |pose: &Pose| Some((pose.name.clone()?, rows(pose)));
        self.list.iter().filter_map(one).collect()
    }

    /// Whether the vectors are those of a plate or plane, whose scales and squareness are named.
    pub(super) fn is_plate(&self) -> bool {
        self.list.iter().any(|pose| pose.name.is_some()) || self.spanned.contains(&false)
    }

    /// What has a name of its own, in words.
    pub(super) fn words(&self, has_machine: bool) -> &'static str {
        match (self.is_plate(), has_machine) {
            (true, true) => {
                "Of the 21 errors of a chain, those that show in the plane are fitted one by one, as polynomials of a position up to the \
                 fourth degree."
            }
            (true, false) => {
                "Of the 21 errors of a chain, scales and squareness in the plane have names here; what the others leave shows \
                 as dependence on position."
            }
            (false, true) => {
                "The 21 errors of a chain are not all fitted here: those that show are, one by one, as polynomials of a position up to the \
                 fourth degree."
            }
            (false, false) => {
                "The 21 errors of a chain are not fitted here: what they leave shows as dependence on position."
            }
        }
    }

    /// Axes that are spanned.
    pub(super) fn axes(&self) -> Vec<Axis> {
        Axis::ALL.into_iter().filter(|axis| self.spanned[axis.index()]).collect()
    }

    /// Position of a vector about the centre of its pose (m); along axes in which the pose has one position there is no arm, not one of
    /// what rounding makes of it.
    pub(super) fn arm_m(&self, vectors: &[ResidualVector], k: usize) -> Vector3<f64> {
        let pose = &self.list[self.of[k]];
        Vector3::from_fn(|d, _| if pose.spanned[d] { vectors[k].position_m[d] - pose.centre_m[d] } else { 0.0 })
    }

    /// Vectors of each named point, with the turn of the plate in each pose relative to the first; nothing where no points
    /// are named, where there is one pose, or where the plate was never turned.
    pub(super) fn turns(&self, vectors: &[ResidualVector]) -> Result<Option<Turns>, DiagnoseError> {
        let named = vectors.iter().filter(|vector| vector.point.is_some()).count();
        if named == 0 || self.list.len() < 2 {
            return Ok(None);
        }
        if named < vectors.len() {
            let problem = format!("{named} of {} vectors name their point on the plate", vectors.len());
            return Err(data(problem, "name the point in every row, or leave the column out"));
        }
        let axes = self.axes();
        let [a, b] = axes[..] else {
            let problem = "the plate's own form can be told in a plane along two axes of the machine only".to_owned();
            return Err(data(problem, "leave the column point out: the plate is then taken as it was calibrated"));
        };
        let plane = (a.index(), b.index());
        let mut points: BTreeMap<&String, Vec<usize>> = BTreeMap::new();
        for (k, vector) in vectors.iter().enumerate() {
            let Some(name) = &vector.point else { continue };
            points.entry(name).or_default().push(k);
        }
        let mut turns = vec![Matrix3::identity()];
        let mut is_turned = false;
        for pose in 1..self.list.len() {
            let (turn, angle_rad, is_over) = self.turn(vectors, &points, pose, plane)?;
            is_turned |= is_over || angle_rad.abs() > TURNED_RAD;
            turns.push(turn);
        }
        let points = points.into_iter().map(|(name, members)| (name.clone(), members)).collect();
        Ok(is_turned.then_some(Turns { points, turns, plane }))
    }

    /// Turn of one pose relative to the first, its angle, and whether the plate was turned over.
    fn turn(
        &self,
        vectors: &[ResidualVector],
        points: &BTreeMap<&String, Vec<usize>>,
        pose: usize,
        (a, b): (usize, usize),
    ) -> Result<(Matrix3<f64>, f64, bool), DiagnoseError> {
        let mean_in = |members: &[usize], pose: usize| {
            let own: Vec<&usize> = members.iter().filter(|k| self.of[**k] == pose).collect();
            let sum = own.iter().map(|k| Vector3::from(vectors[**k].position_m)).sum::<Vector3<f64>>();
            (!own.is_empty()).then(|| (sum[a] / own.len() as f64, sum[b] / own.len() as f64))
        };
        let shared: Vec<_> =
            points.values().filter_map(|members| Some((mean_in(members, 0)?, mean_in(members, pose)?))).collect();
        let names = || {
            let name = |k: usize| self.list[k].name.clone().unwrap_or_default();
            (name(0), name(pose))
        };
        if shared.len() < SHARED {
            let (first, other) = names();
            let problem = format!("poses {first} and {other} share {} points, {SHARED} are needed", shared.len());
            return Err(data(problem, "measure the same points of the plate in every pose, and name them alike"));
        }
        let fits = [1.0, -1.0].map(|sign| fit(&shared, sign));
        let is_over = fits[1].1 < fits[0].1;
        let (angle_rad, misses_m, extent_m) = fits[usize::from(is_over)];
        if misses_m > MISSES * extent_m {
            let (first, other) = names();
            let problem = format!(
                "the points of pose {other} are not where those of pose {first} have them: they miss by {:.3} mm",
                misses_m * 1e3
            );
            return Err(data(problem, "correct the names of the points"));
        }
        let sign = if is_over { -1.0 } else { 1.0 };
        let (sine, cosine) = angle_rad.sin_cos();
        let mut turn = Matrix3::identity() * sign;
        (turn[(a, a)], turn[(b, a)]) = (cosine, sine);
        (turn[(a, b)], turn[(b, b)]) = (-sine * sign, cosine * sign);
        Ok((turn, angle_rad, is_over))
    }
}

/// Points of a plate, and how it was turned.
#[derive(Debug, Clone)]
pub(super) struct Turns {
    /// Name and vectors of each point.
    pub(super) points: Vec<(String, Vec<usize>)>,
    /// Turn of the plate in each pose relative to the first.
    pub(super) turns: Vec<Matrix3<f64>>,
    /// The two axes of its plane.
    pub(super) plane: (usize, usize),
}

/// A place in the plane of a plate (m), and one point in two poses.
type Place = (f64, f64);
type Pair = (Place, Place);

/// Angle that turns the first of each pair, mirrored where `sign` is −1, onto the second; largest miss and extent (m).
fn fit(pairs: &[Pair], sign: f64) -> (f64, f64, f64) {
    let count = pairs.len() as f64;
    let sum = |(a, b): Place, own: Place| (a + own.0, b + own.1);
    let from = pairs.iter().map(|pair| pair.0).fold((0.0, 0.0), sum);
    let to = pairs.iter().map(|pair| pair.1).fold((0.0, 0.0), sum);
    let (from, to) = ((from.0 / count, from.1 / count), (to.0 / count, to.1 / count));
    let arms: Vec<_> =
        pairs.iter().map(|(p, q)| ((p.0 - from.0, sign * (p.1 - from.1)), (q.0 - to.0, q.1 - to.1))).collect();
    let along: f64 = arms.iter().map(|(p, q)| p.0 * q.0 + p.1 * q.1).sum();
    let across: f64 = arms.iter().map(|(p, q)| p.0 * q.1 - p.1 * q.0).sum();
    let angle_rad = across.atan2(along);
    let (sine, cosine) = angle_rad.sin_cos();
    let miss =
        |(p, q): &((f64, f64), (f64, f64))| (cosine * p.0 - sine * p.1 - q.0).hypot(sine * p.0 + cosine * p.1 - q.1);
    let misses_m = arms.iter().map(miss).fold(0.0, f64::max);
    (angle_rad, misses_m, arms.iter().map(|(p, _)| p.0.hypot(p.1)).fold(0.0, f64::max))
}

/// How the errors of a plate itself enter.
pub(super) fn calibration_words(is_calibrated: bool, is_unturned: bool) -> &'static str {
    match is_calibrated {
        _ if is_unturned => {
            "The poses are not turned against each other: the plate's own errors are in what was found and not in u, as in one pose."
        }
        true => {
            "The plate is taken as it was calibrated: u holds what its calibration leaves open, if its errors act together \
             in the worst way."
        }
        false => {
            "If these are points of a plate, its own errors are in what was found and not in u: give the uncertainty of its \
             calibration in u_plate_um, or turn it by 90 degrees and name poses and points."
        }
    }
}

pub(super) fn data(problem: String, remedy: &str) -> DiagnoseError {
    DiagnoseError::Data { problem, remedy: remedy.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_and_a_turning_over_are_found_and_told_apart() {
        let plate = [(0.0, 0.0), (0.3, 0.0), (0.0, 0.2), (0.1, 0.15)];
        for (angle, sign) in [(0.5_f64, 1.0), (-2.0, 1.0), (1.2, -1.0)] {
            let (sine, cosine) = angle.sin_cos();
            let moved =
                |p: &(f64, f64)| (cosine * p.0 - sine * sign * p.1 + 0.7, sine * p.0 + cosine * sign * p.1 - 0.1);
            let pairs: Vec<_> = plate.iter().map(|p| (*p, moved(p))).collect();
            let (found, misses, _) = fit(&pairs, sign);
            assert!((found - angle).abs() < 1e-12 && misses < 1e-12, "{found} {misses}");
            assert!(fit(&pairs, -sign).1 > 0.01);
        }
    }
}
