//! What centres can be used, and whether the result can be.
//!
//! Place in the flow: before and after the fit of [`super::ProbePose`].

use super::{ProbePose, ProbePoseError, ProbePoseModel, SphereCentre, solve};

/// Angles closer than this are one pose (rad).
pub(super) const SAME_RAD: f64 = 1e-6;
/// Lengths of R_p beyond which the reading is no distance in metres: a probe's scale is off by parts in a thousand.
const BEAM: std::ops::Range<f64> = 0.8..1.25;
/// How much better another sense of an axis must fit before it counts as the right one.
const SENSE: f64 = 20.0;

pub(super) fn centres(centres: &[SphereCentre]) -> Result<(), ProbePoseError> {
    for (k, centre) in centres.iter().enumerate() {
        let [x, y, z] = centre.centre_m;
        if ![centre.a_rad, centre.c_rad, centre.distance_m, x, y, z].iter().all(|value| value.is_finite()) {
            return Err(ProbePoseError::NotFinite(k + 1));
        }
        if centre.u_m.is_some_and(|u| !(u.is_finite() && u > 0.0)) {
            return Err(ProbePoseError::Uncertainty(k + 1));
        }
        if let Some(first) = centres[..k].iter().position(|other| other == centre) {
            return Err(ProbePoseError::Duplicate { first: first + 1, second: k + 1 });
        }
    }
    Ok(())
}

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

/// Refuses angles that fit far better with the other sign.
pub(super) fn senses(centres: &[SphereCentre], pose: &ProbePose) -> Result<(), ProbePoseError> {
    if pose.degrees_of_freedom == 0 {
        return Ok(());
    }
    let best = [("A", -1.0, 1.0), ("C", 1.0, -1.0), ("A and C", -1.0, -1.0)].into_iter().filter_map(|(axis, a, c)| {
        let turn = |centre: &SphereCentre| SphereCentre { a_rad: a * centre.a_rad, c_rad: c * centre.c_rad, ..*centre };
        let turned: Vec<SphereCentre> = centres.iter().map(turn).collect();
        // Without freedom or rank the other sense says nothing.
        let other = solve::fit(&turned, ProbePoseModel::NINE).ok()?;
        Some((axis, pose.rms_m() / other.rms_m()))
    });
    match best.max_by(|a, b| a.1.total_cmp(&b.1)) {
        Some((axis, ratio)) if ratio > SENSE => Err(ProbePoseError::Sense { axis, ratio }),
        _ => Ok(()),
    }
}

pub(super) fn beam(pose: &ProbePose) -> Result<(), ProbePoseError> {
    let length = pose.direction.norm();
    if BEAM.contains(&length) { Ok(()) } else { Err(ProbePoseError::Beam { length }) }
}
