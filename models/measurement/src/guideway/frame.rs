//! Direction of motion, and the rotation that brings it on the axis.
//!
//! Place in the flow: between the check of the points and the solution. The direction is the least-squares slope of the
//! targets' points against indicated position, each target about its own mean.

use super::check::Run;
use super::{Guideway, GuidewayError, GuidewayFrame, GuidewayOptions};
use nalgebra::{Rotation3, Unit, Vector3};
use std::collections::BTreeMap;
use std::ops::Range;

/// Motion over indicated motion that still is a machine's error and no unit.
const RATIO: Range<f64> = 0.9..1.1;
/// Angle off the axis (rad) from which a given frame is not the machine's.
const OFF_AXIS_RAD: f64 = 0.05;

/// Part of U of the error of position that the cosine of a tilted motion may reach: in quadrature it makes U 3 % larger.
const PART_OF_U: f64 = 0.25;
/// Error of position (m) that no instrument for such points shows, however well synthetic ones agree.
const RESOLVED_M: f64 = 1e-7;
/// Coverage of U.
const COVERAGE: f64 = 2.0;

pub(super) fn machine_from_points(runs: &[Run], options: &GuidewayOptions) -> Result<Rotation3<f64>, GuidewayError> {
    let slope = slope(runs);
    let ratio = slope.norm();
    if !RATIO.contains(&ratio) {
        return Err(GuidewayError::Unit { ratio });
    }
    let unit = options.axis.unit();
    let angle = slope.angle(&unit);
    match options.frame {
        GuidewayFrame::Given if angle < OFF_AXIS_RAD => Ok(Rotation3::identity()),
        GuidewayFrame::Given => {
            Err(GuidewayError::Direction { axis: options.axis.name(), angle_deg: angle.to_degrees() })
        }
        GuidewayFrame::AlongMotion => Ok(smallest(&slope, &unit)),
    }
}

/// Refuses a given frame in which the motion is so far off the axis that the error of position is too short: of a travel L
/// the axis sees L·cos θ, L·θ²/2 less.
pub(super) fn along_enough(runs: &[Run], solved: &Guideway) -> Result<(), GuidewayError> {
    if solved.options.frame == GuidewayFrame::AlongMotion {
        return Ok(());
    }
    let axis = solved.options.axis;
    let angle = slope(runs).angle(&axis.unit());
    // 1 − cos θ without the loss of digits.
    let shorter = 2.0 * (angle / 2.0).sin().powi(2);
    let first_m = solved.positions.first().map_or(0.0, |position| position.position_m);
    for position in solved.positions.iter().rev() {
        let Some(u) = Guideway::u(position) else { continue };
        let expanded_m = COVERAGE * u[axis.index()];
        let cosine_m = (position.position_m - first_m) * shorter;
        if cosine_m > (PART_OF_U * expanded_m).max(RESOLVED_M) {
            return Err(GuidewayError::Cosine {
                error: axis.error_names()[axis.index()].clone(),
                axis: axis.name(),
                angle_deg: angle.to_degrees(),
                position_mm: position.position_m * 1e3,
                cosine_um: cosine_m * 1e6,
                expanded_um: expanded_m * 1e6,
            });
        }
    }
    Ok(())
}

/// Points per indicated position, 1 for a perfect axis.
fn slope(runs: &[Run]) -> Vector3<f64> {
    let mut tracks: BTreeMap<&str, Vec<(f64, Vector3<f64>)>> = BTreeMap::new();
    for run in runs {
        for (name, seen) in &run.targets {
            tracks.entry(name).or_default().push((run.position_m + seen.beyond_m, seen.point_m));
        }
    }
    let (mut products, mut squares) = (Vector3::zeros(), 0.0);
    for track in tracks.values() {
        let count = track.len() as f64;
        let mean = track.iter().map(|(s, _)| s).sum::<f64>() / count;
        // Points about one of them, so that large coordinates lose no digits.
        let origin_m = track[0].1;
        products += track.iter().map(|(s, p)| (p - origin_m) * (s - mean)).sum::<Vector3<f64>>();
        squares += track.iter().map(|(s, _)| (s - mean).powi(2)).sum::<f64>();
    }
    products / squares
}

/// The smallest rotation that turns one direction into another; half a turn about a direction across, where they are opposite.
fn smallest(from: &Vector3<f64>, to: &Vector3<f64>) -> Rotation3<f64> {
    Rotation3::rotation_between(from, to).unwrap_or_else(|| {
        let across = to.cross(&Vector3::ith(to.iamin(), 1.0));
        Rotation3::from_axis_angle(&Unit::new_normalize(across), std::f64::consts::PI)
    })
}
