//! Points by position, and what of them can be used.
//!
//! Place in the flow: before everything else in [`super::Guideway::new`]. All criteria but that of one position are ratios, so that no
//! unit enters.

use super::{GuidewayError, TargetPoint};
use nalgebra::{DMatrix, Matrix3, Vector3};
use std::collections::BTreeMap;

/// Indicated positions this close are one (m): displays round, and an axis stands still only nearly while its targets are read.
const ONE_POSITION_M: f64 = 1e-6;
/// Extent of the targets across their line, relative to that along it, below which they count as on a line: the rotation
/// about it would be a thousand times less certain than the others.
const ON_A_LINE: f64 = 1e-3;
/// Distance of two targets, relative to the extent of all, below which they are one.
const ONE_PLACE: f64 = 1e-9;
/// Change of a distance, relative to the extent, beyond which the table is not rigid but the points are wrong.
const NOT_RIGID: f64 = 1e-2;

/// A target's point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// Its place among the points, from 0.
    pub(super) place: usize,
    /// Its own indicated position less that of its run (m).
    pub(super) beyond_m: f64,
    pub(super) point_m: Vector3<f64>,
    pub(super) covariance_m2: Option<Matrix3<f64>>,
}

/// Targets at one position, by name.
pub(super) struct Run<'a> {
    pub(super) position_m: f64,
    pub(super) targets: BTreeMap<&'a str, Seen>,
}

impl Run<'_> {
    pub(super) fn position_mm(&self) -> f64 {
        self.position_m * 1e3
    }
}

/// Runs by ascending position; the first holds the reference of all others.
pub(super) fn by_position(points: &[TargetPoint]) -> Result<Vec<Run<'_>>, GuidewayError> {
    for (k, point) in points.iter().enumerate() {
        if !(point.position_m.is_finite() && point.point_m.iter().all(|v| v.is_finite())) {
            return Err(GuidewayError::NotFinite(k + 1));
        }
        if point.covariance_m2.is_some_and(|c| c.iter().any(|v| !v.is_finite()) || c.cholesky().is_none()) {
            return Err(GuidewayError::Covariance(k + 1));
        }
    }
    let runs: Vec<Run> = at_one_position(points).iter().map(|places| run(points, places)).collect::<Result<_, _>>()?;
    if runs.len() < 2 {
        return Err(GuidewayError::OnePosition(runs.len()));
    }
    for run in &runs {
        layout(&runs[0], run)?;
    }
    Ok(runs)
}

/// Places of the points of each position, ascending.
fn at_one_position(points: &[TargetPoint]) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|a, b| points[*a].position_m.total_cmp(&points[*b].position_m).then(a.cmp(b)));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for k in order {
        let is_of = |group: &&mut Vec<usize>| points[k].position_m - points[group[0]].position_m <= ONE_POSITION_M;
        match groups.last_mut().filter(is_of) {
            Some(group) => group.push(k),
            None => groups.push(vec![k]),
        }
    }
    groups.iter_mut().for_each(|group| group.sort_unstable());
    groups
}

fn run<'a>(points: &'a [TargetPoint], places: &[usize]) -> Result<Run<'a>, GuidewayError> {
    let first_m = points[places[0]].position_m;
    // About the first, so that equal positions stay as they are to the last digit; −0 and 0 are one.
    let beyond = places.iter().map(|k| points[*k].position_m - first_m).sum::<f64>() / places.len() as f64;
    let position_m = first_m + beyond + 0.0;
    let mut targets: BTreeMap<&str, Seen> = BTreeMap::new();
    for k in places {
        let TargetPoint { position_m: own_m, target, point_m, covariance_m2 } = &points[*k];
        let seen = Seen { place: *k, beyond_m: own_m - position_m, point_m: *point_m, covariance_m2: *covariance_m2 };
        if let Some(earlier) = targets.insert(target, seen) {
            let (target, position_mm) = (target.clone(), position_m * 1e3);
            return Err(GuidewayError::Twice { target, position_mm, first: earlier.place + 1, second: k + 1 });
        }
    }
    Ok(Run { position_m, targets })
}

/// Targets of a run that the lowest position has too.
pub(super) fn common<'a>(lowest: &'a Run, run: &'a Run) -> impl Iterator<Item = (&'a str, Seen, Seen)> {
    run.targets.iter().filter_map(|(name, seen)| lowest.targets.get(name).map(|first| (*name, *first, *seen)))
}

fn layout(lowest: &Run, run: &Run) -> Result<(), GuidewayError> {
    let pairs: Vec<(&str, Seen, Seen)> = common(lowest, run).collect();
    let position_mm = run.position_mm();
    if pairs.len() < 3 {
        return Err(GuidewayError::TooFew { position_mm, count: pairs.len() });
    }
    let points: Vec<Vector3<f64>> = pairs.iter().map(|(_, _, seen)| seen.point_m).collect();
    let (_, extent_m) = spread(&points);
    for (i, (first, first_start, first_here)) in pairs.iter().enumerate() {
        for (second, second_start, second_here) in &pairs[i + 1..] {
            let here_m = (second_here.point_m - first_here.point_m).norm();
            if here_m <= ONE_PLACE * extent_m {
                return Err(GuidewayError::Coincident { first: (*first).into(), second: (*second).into() });
            }
            let change_m = here_m - (second_start.point_m - first_start.point_m).norm();
            if change_m.abs() > NOT_RIGID * extent_m {
                let (first, second) = ((*first).to_owned(), (*second).to_owned());
                return Err(GuidewayError::NotRigid { first, second, position_mm, change_um: change_m * 1e6 });
            }
        }
    }
    spread_enough(&points, position_mm)
}

/// Refuses fewer than three points, and points on a line.
pub(super) fn spread_enough(points_m: &[Vector3<f64>], position_mm: f64) -> Result<(), GuidewayError> {
    if points_m.len() < 3 {
        return Err(GuidewayError::TooFew { position_mm, count: points_m.len() });
    }
    let (ratio, _) = spread(points_m);
    if ratio > ON_A_LINE { Ok(()) } else { Err(GuidewayError::Collinear { position_mm, ratio }) }
}

/// Second over first singular value of points about their centroid, and the first (root sum of squares, m).
pub(super) fn spread(points_m: &[Vector3<f64>]) -> (f64, f64) {
    let centroid_m = points_m.iter().sum::<Vector3<f64>>() / points_m.len().max(1) as f64;
    let values =
        DMatrix::from_fn(points_m.len().max(3), 3, |i, d| points_m.get(i).map_or(0.0, |p| p[d] - centroid_m[d]))
            .singular_values();
    let mut values: Vec<f64> = values.iter().copied().collect();
    values.sort_by(|a, b| b.total_cmp(a));
    (if values[0] > 0.0 { values[1] / values[0] } else { 0.0 }, values[0])
}
