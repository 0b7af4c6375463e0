//! Honest error of pose and table: on centres that neither saw.
//!
//! Place in the flow: judges a calibration. A pose left out says what a pose without an entry would suffer; a centre left out
//! whose pose keeps an entry says what the table is worth when the same pose is measured again. Metres, machine frame.

use super::same::{angles_rad, poses};
use super::{Compensation, CompensationTable, ProbePose, ProbePoseError, ProbePoseModel, SphereCentre};
use nalgebra::Vector3;

/// A pose predicted by a calibration on all others.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOutPose {
    /// Indicated A (rad).
    pub a_rad: f64,
    /// Indicated C (rad).
    pub c_rad: f64,
    /// S0 of the others less where this pose puts it, mean over its centres (m); `None` where the others do not determine
    /// the unknowns.
    pub error_m: Option<Vector3<f64>>,
    /// What the others' table says of the pose.
    pub compensation: Option<Compensation>,
    /// The error less that compensation (m), where there is one.
    pub compensated_m: Option<Vector3<f64>>,
}

/// A centre predicted by a calibration on all others.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOutCentre {
    /// S0 of the others less where this centre puts it (m).
    pub error_m: Vector3<f64>,
    /// The error less the compensation of its pose by the others (m).
    pub compensated_m: Vector3<f64>,
}

/// Leaves one pose out at a time; all its centres go.
///
/// # Errors
/// As [`ProbePose::fit`] on all centres, or where no pose can be spared.
pub fn leave_one_pose_out(centres: &[SphereCentre], model: ProbePoseModel) -> Result<Vec<LeftOutPose>, ProbePoseError> {
    ProbePose::fit(centres, model)?;
    let left_out = |group: &Vec<usize>| {
        let others: Vec<SphereCentre> = without(centres, group);
        let [a_rad, c_rad] = angles_rad(centres, group);
        let Ok(pose) = ProbePose::fit(&others, model) else {
            return LeftOutPose { a_rad, c_rad, error_m: None, compensation: None, compensated_m: None };
        };
        let own: Vec<Vector3<f64>> = group.iter().map(|i| pose.centre_m - pose.seen_m(&centres[*i])).collect();
        let error_m = own.iter().sum::<Vector3<f64>>() / own.len() as f64;
        let compensation = CompensationTable::new(&pose, &others).at(a_rad, c_rad);
        LeftOutPose {
            a_rad,
            c_rad,
            error_m: Some(error_m),
            compensation: Some(compensation),
            compensated_m: compensation.delta_m().map(|delta_m| error_m - delta_m),
        }
    };
    let list: Vec<LeftOutPose> = poses(centres).iter().map(left_out).collect();
    if list.iter().all(|pose| pose.error_m.is_none()) { Err(ProbePoseError::NothingLeftOut) } else { Ok(list) }
}

/// Leaves one centre out at a time, of poses that have others; in the order of the centres, `None` where that is impossible.
///
/// # Errors
/// As [`ProbePose::fit`] on all centres.
pub fn leave_one_centre_out(
    centres: &[SphereCentre],
    model: ProbePoseModel,
) -> Result<Vec<Option<LeftOutCentre>>, ProbePoseError> {
    ProbePose::fit(centres, model)?;
    let left_out = |(k, centre): (usize, &SphereCentre)| {
        let others = without(centres, &[k]);
        let pose = ProbePose::fit(&others, model).ok()?;
        let error_m = pose.centre_m - pose.seen_m(centre);
        match CompensationTable::new(&pose, &others).at(centre.a_rad, centre.c_rad) {
            Compensation::Tabulated { delta_m } => Some(LeftOutCentre { error_m, compensated_m: error_m - delta_m }),
            Compensation::Interpolated { .. } | Compensation::Outside => None,
        }
    };
    Ok(centres.iter().enumerate().map(left_out).collect())
}

fn without(centres: &[SphereCentre], left_out: &[usize]) -> Vec<SphereCentre> {
    centres.iter().enumerate().filter(|(k, _)| !left_out.contains(k)).map(|(_, centre)| *centre).collect()
}
