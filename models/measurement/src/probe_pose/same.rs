//! Which centres are of one pose.
//!
//! Place in the flow: the fit, its checks and its table take repeated centres together. Angles in rad.

use super::SphereCentre;

/// Angles closer than this are one pose (rad): a head comes back to some thousandths of a degree, and its angles are given as indicated.
/// Each centre keeps its own angles in the fit.
pub(super) const SAME_RAD: f64 = 0.01 / DEGREE;
/// Angles closer than this that are not one pose were perhaps meant to be (rad).
const NEAR_RAD: f64 = 0.1 / DEGREE;
const DEGREE: f64 = 180.0 / std::f64::consts::PI;

/// Centres at the same angles, by index, in the order of their first centre.
pub fn poses(centres: &[SphereCentre]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, centre) in centres.iter().enumerate() {
        let same = |group: &Vec<usize>| is_within(&centres[group[0]], centre, SAME_RAD);
        match groups.iter().position(same) {
            Some(k) => groups[k].push(i),
            None => groups.push(vec![i]),
        }
    }
    groups
}

/// Poses that nearly coincide and count as two, each by the index of its first centre.
pub fn near_poses(centres: &[SphereCentre]) -> Vec<[usize; 2]> {
    let firsts: Vec<usize> = poses(centres).iter().map(|group| group[0]).collect();
    let mut near = Vec::new();
    for (k, second) in firsts.iter().enumerate() {
        let beside = firsts[..k].iter().filter(|first| is_within(&centres[**first], &centres[*second], NEAR_RAD));
        near.extend(beside.map(|first| [*first, *second]));
    }
    near
}

/// Mean angles A and C of a pose (rad).
pub(super) fn angles_rad(centres: &[SphereCentre], group: &[usize]) -> [f64; 2] {
    let first = &centres[group[0]];
    // About the first, so that equal angles stay as they are to the last digit.
    let mean = |of: fn(&SphereCentre) -> f64| {
        of(first) + group.iter().map(|k| of(&centres[*k]) - of(first)).sum::<f64>() / group.len() as f64
    };
    [mean(|c| c.a_rad), mean(|c| c.c_rad)]
}

/// The centres with the mean angles of their poses.
pub(super) fn at_mean_angles(centres: &[SphereCentre]) -> Vec<SphereCentre> {
    let mut changed = centres.to_vec();
    for group in poses(centres) {
        let [a_rad, c_rad] = angles_rad(centres, &group);
        group.iter().for_each(|k| (changed[*k].a_rad, changed[*k].c_rad) = (a_rad, c_rad));
    }
    changed
}

fn is_within(first: &SphereCentre, second: &SphereCentre, limit_rad: f64) -> bool {
    (first.a_rad - second.a_rad).abs() < limit_rad && (first.c_rad - second.c_rad).abs() < limit_rad
}
