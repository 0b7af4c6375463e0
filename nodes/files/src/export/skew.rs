//! Skew of three axes as printers take it: one number a plane.
//!
//! Place in the flow: under [`super::klipper_skew`] and [`super::reprap_skew`]. The error of a tip over the volume that was measured in,
//! the shear of X by Y, X by Z and Y by Z out: error of X is xy·y + xz·z, error of Y is yz·z, beside a shift and a turn of everything, which are no
//! error. Squareness alone is not it: where an angular error grows along its axis, its lever shears the volume as well, above all on a moving
//! table. Least squares over a product grid: a_ij = Σ e_i (r_j − r̄_j) / Σ (r_j − r̄_j)², shear ij = a_ij + a_ji.
//!
//! Factors that do not make the error smaller are refused, and what is left is that of the factors as they are written, applied as the
//! firmware applies them.

use super::volume::grid_m;
use super::{About, Format, fixed, geometric_error_m, of_places, refused};
use crate::error::FileError;
use abbe_geometry::Vector3;
use abbe_geometry::axis::Axis;
use abbe_measurement::alignment::aligned_residuals_m;

/// Shear by plane (rad): error of the first axis by the second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Skew {
    pub(super) xy: f64,
    pub(super) xz: f64,
    pub(super) yz: f64,
}

/// What such a number cannot hold.
pub(super) const ONLY: &str =
    "the shear of the volume alone: positioning, straightness, all else of rotations, and reversal are NOT in it";
/// Nodes of each axis at which the error is looked at.
const NODES: usize = 9;

/// The skew of a model for a tip at this offset (m, ram frame), and in words what is left with it. `moved` is where the firmware goes for a
/// place, `written` a shear as it is after it was written.
///
/// # Errors
/// A model in which nothing shows squareness: its zeros would pass for a measurement. Factors that take nothing away.
pub(super) fn skew(
    format: &Format,
    about: &About,
    offset_m: [f64; 3],
    written: impl Fn(f64) -> f64,
    moved: impl Fn(&Skew, Vector3<f64>) -> Vector3<f64>,
) -> Result<(Skew, String), FileError> {
    if about.of_places.is_empty() && !about.machine.squareness.iter().any(|entry| about.is_identified(&entry.name)) {
        let problem = "the model holds no squareness of its axes that was identified".to_owned();
        let remedy = "identify the machine from a tracer campaign or from points, or show its squareness by residual vectors or a plate";
        return Err(refused(format, problem, remedy));
    }
    let measured_m = measured_m(format, about)?;
    let places_m = grid_m(&measured_m, NODES);
    let effects = of_places(&about.model);
    let error_m = |place_m: Vector3<f64>| geometric_error_m(&about.model, &effects, place_m.into(), offset_m);
    let before_m: Vec<Vector3<f64>> = places_m.iter().map(|place_m| error_m(*place_m)).collect();
    let slope = |of: Axis, by: Axis| slope(&places_m, &before_m, of.index(), by.index());
    let shear = |a: Axis, b: Axis| written(slope(a, b) + slope(b, a));
    let skew = Skew { xy: shear(Axis::X, Axis::Y), xz: shear(Axis::X, Axis::Z), yz: shear(Axis::Y, Axis::Z) };
    let left_m = |place_m: &Vector3<f64>| {
        let reading_m = moved(&skew, *place_m);
        error_m(reading_m) + (reading_m - place_m)
    };
    let after_m: Vec<Vector3<f64>> = places_m.iter().map(left_m).collect();
    let rms_um = |errors_m: &[Vector3<f64>]| Ok::<f64, FileError>(rms_m(format, &places_m, errors_m)? * 1e6);
    let (before_um, after_um) = (rms_um(&before_m)?, rms_um(&after_m)?);
    if after_um >= before_um {
        let problem = format!(
            "no factor makes the error over the volume smaller: {before_um:.3} um rms before, {after_um:.3} um after"
        );
        let remedy = "leave the firmware without them, or correct with abbe correct";
        return Err(refused(format, problem, remedy));
    }
    let mm = |values_m: [f64; 3]| values_m.map(|m| fixed(m * 1e3, 4)).join(" ");
    let words = format!(
        "error of a tip at {} mm (ram frame) over readings X Y Z from {} to {} mm, free of a shift and a turn of everything: {} um rms \
         before, {} um rms after these factors as the firmware applies them",
        mm(offset_m),
        mm(measured_m.map(|(lower_m, _)| lower_m)),
        mm(measured_m.map(|(_, upper_m)| upper_m)),
        fixed(before_um, 3),
        fixed(after_um, 3)
    );
    Ok((skew, words))
}

/// The part of each stroke that was measured (m).
fn measured_m(format: &Format, about: &About) -> Result<[(f64, f64); 3], FileError> {
    let seen_m = about.model.parts().identified.reading_m;
    let measured_m = Axis::ALL.map(|axis| {
        let (stroke_m, seen_m) = (about.machine.stroke_m[axis.index()], seen_m[axis.index()]);
        (stroke_m.0.max(seen_m.0), stroke_m.1.min(seen_m.1))
    });
    match Axis::ALL.into_iter().find(|axis| measured_m[axis.index()].0 >= measured_m[axis.index()].1) {
        Some(axis) => {
            let problem =
                format!("the model was identified at one place of the stroke of {}, or at none", axis.letter());
            Err(refused(
                format,
                problem,
                "a shear is one of a volume: measure at two places of each axis at least, a plate at two heights",
            ))
        }
        None => Ok(measured_m),
    }
}

/// Slope of a component of the error by a coordinate, by least squares.
fn slope(places_m: &[Vector3<f64>], errors_m: &[Vector3<f64>], of: usize, by: usize) -> f64 {
    let middle_m = places_m.iter().sum::<Vector3<f64>>() / places_m.len() as f64;
    let arms_m = || places_m.iter().map(|place_m| place_m[by] - middle_m[by]);
    arms_m().zip(errors_m).map(|(arm_m, error_m)| arm_m * error_m[of]).sum::<f64>()
        / arms_m().map(|arm_m| arm_m * arm_m).sum::<f64>()
}

/// Root mean square of the errors at these places after their best shift and turn (m).
fn rms_m(format: &Format, places_m: &[Vector3<f64>], errors_m: &[Vector3<f64>]) -> Result<f64, FileError> {
    let moved_m: Vec<Vector3<f64>> =
        places_m.iter().zip(errors_m).map(|(place_m, error_m)| place_m + error_m).collect();
    let left_m = aligned_residuals_m(&moved_m, places_m)
        .map_err(|error| refused(format, error.to_string(), "measure in a volume, along all three axes"))?;
    Ok((left_m.iter().map(Vector3::norm_squared).sum::<f64>() / left_m.len() as f64).sqrt())
}
