//! What centres can be used, and whether the result can be.
//!
//! Place in the flow: before and after the fit of [`super::ProbePose`].

use super::{ProbePose, ProbePoseError, ProbePoseModel, SphereCentre, solve};

/// Lengths of R_p beyond which the reading is no distance in metres: a probe's scale is off by parts in a thousand.
const BEAM: std::ops::Range<f64> = 0.8..1.25;
/// How much better another reading of the columns must fit before it counts as the right one.
const BETTER: f64 = 20.0;
/// Residual (rms) over the lever from the A axis to the beam's end that no head has: the worst published is a fifth of it.
const NO_HEAD: f64 = 0.02;

/// Levers from the A axis to the beam's end that heads have (m): beyond, metres or micrometres were written for millimetres.
const LEVER_M: std::ops::RangeInclusive<f64> = 5e-3..=10.0;

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

/// Refuses centres that fit far better when the columns are read in another way, and those that fit in no way.
pub(super) fn readings(centres: &[SphereCentre], pose: &ProbePose) -> Result<(), ProbePoseError> {
    if pose.degrees_of_freedom == 0 {
        return Ok(());
    }
    let rms_m = |changed: &[SphereCentre]| {
        // Without freedom or rank another reading says nothing.
        let other = solve::fit(changed, ProbePoseModel::NINE).ok()?;
        Some(other.rms_m().max(f64::MIN_POSITIVE))
    };
    let others = mistakes().into_iter().filter_map(|(mistake, mended)| {
        let changed: Vec<SphereCentre> = centres.iter().map(mended).collect();
        Some((mistake, pose.rms_m() / rms_m(&changed)?))
    });
    let mut better: Vec<(&'static str, f64)> = others.filter(|(_, ratio)| *ratio > BETTER).collect();
    better.sort_by(|a, b| b.1.total_cmp(&a.1));
    if let Some((_, ratio)) = better.first().copied() {
        // Those that fit about as well as the best are as likely.
        let mistakes =
            better.into_iter().filter(|(_, other)| *other > ratio / BETTER).map(|(mistake, _)| mistake).collect();
        return Err(ProbePoseError::Misread { mistakes, ratio });
    }
    let lever_m = lever_m(centres, pose);
    match pose.rms_m() > NO_HEAD * lever_m {
        true => Err(ProbePoseError::NoHead { rms_mm: pose.rms_m() * 1e3, lever_mm: lever_m * 1e3 }),
        false => Ok(()),
    }
}

/// From the A axis to the beam's end at the largest distance.
fn lever_m(centres: &[SphereCentre], pose: &ProbePose) -> f64 {
    let distance_m = centres.iter().map(|centre| centre.distance_m.abs()).fold(0.0, f64::max);
    pose.zero_m.norm() + distance_m * pose.direction.norm()
}

/// Refuses a head of a size that none has: the fit itself is the same in any unit.
pub(super) fn size(centres: &[SphereCentre], pose: &ProbePose) -> Result<(), ProbePoseError> {
    let lever_m = lever_m(centres, pose);
    if LEVER_M.contains(&lever_m) { Ok(()) } else { Err(ProbePoseError::Size { lever_mm: lever_m * 1e3 }) }
}

type Mended = fn(&SphereCentre) -> SphereCentre;

/// Ways in which columns are mixed up, and what undoes them.
fn mistakes() -> [(&'static str, Mended); 10] {
    [
        ("with A turned the other way: change the sign of a_deg", |c| SphereCentre { a_rad: -c.a_rad, ..*c }),
        ("with C turned the other way: change the sign of c_deg", |c| SphereCentre { c_rad: -c.c_rad, ..*c }),
        ("with A and C turned the other way: change the signs of a_deg and c_deg", |c| SphereCentre {
            a_rad: -c.a_rad,
            c_rad: -c.c_rad,
            ..*c
        }),
        ("with A and C exchanged: exchange the columns a_deg and c_deg", |c| exchanged(c, 1.0, 1.0)),
        ("with A and C exchanged and A turned the other way", |c| exchanged(c, -1.0, 1.0)),
        ("with A and C exchanged and C turned the other way", |c| exchanged(c, 1.0, -1.0)),
        ("with angles in radians: convert a_deg and c_deg", |c| SphereCentre {
            a_rad: c.a_rad.to_degrees(),
            c_rad: c.c_rad.to_degrees(),
            ..*c
        }),
        ("with x_mm and y_mm exchanged", |c| with_centre(c, [1, 0, 2])),
        ("with x_mm and z_mm exchanged", |c| with_centre(c, [2, 1, 0])),
        ("with y_mm and z_mm exchanged", |c| with_centre(c, [0, 2, 1])),
    ]
}

fn exchanged(centre: &SphereCentre, a: f64, c: f64) -> SphereCentre {
    SphereCentre { a_rad: a * centre.c_rad, c_rad: c * centre.a_rad, ..*centre }
}

fn with_centre(centre: &SphereCentre, order: [usize; 3]) -> SphereCentre {
    SphereCentre { centre_m: order.map(|d| centre.centre_m[d]), ..*centre }
}

pub(super) fn beam(pose: &ProbePose) -> Result<(), ProbePoseError> {
    let length = pose.direction.norm();
    if BEAM.contains(&length) { Ok(()) } else { Err(ProbePoseError::Beam { length }) }
}
