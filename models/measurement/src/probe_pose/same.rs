//! Which centres are of one pose.
//!
//! Place in the flow: the fit, its checks and its table take repeated centres together. Angles in rad.

use super::SphereCentre;

/// Angles closer than this are one pose (rad).
pub(super) const SAME_RAD: f64 = 1e-6;

/// Centres at the same angles, by index, in the order of their first centre.
pub fn poses(centres: &[SphereCentre]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, centre) in centres.iter().enumerate() {
        let same = |group: &Vec<usize>| {
            let first = &centres[group[0]];
            (first.a_rad - centre.a_rad).abs() < SAME_RAD && (first.c_rad - centre.c_rad).abs() < SAME_RAD
        };
        match groups.iter().position(same) {
            Some(k) => groups[k].push(i),
            None => groups.push(vec![i]),
        }
    }
    groups
}
