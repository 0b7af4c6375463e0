//! Skew of three axes as printers take it: one number a plane.
//!
//! Place in the flow: under [`super::klipper_skew`] and [`super::reprap_skew`]. Squareness of the model (angles that turn the motion of
//! one axis about another) in, the shear of X by Y, X by Z and Y by Z out: error of X is xy·y + xz·z, error of Y is yz·z. A machine
//! whose Y axis is the straight one and X is tilted has the same shear in a frame that is turned: how everything stands
//! together is no error.

use super::{About, Format, refused, tilted_m};
use crate::error::FileError;
use abbe_geometry::axis::Axis;
use abbe_geometry::sampled::SampledErrors;

/// Shear by plane (rad): error of the first axis by the second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Skew {
    pub(super) xy: f64,
    pub(super) xz: f64,
    pub(super) yz: f64,
}

/// What such a number cannot hold.
pub(super) const ONLY: &str = "squareness alone: positioning, straightness, rotations and reversal are NOT in it";

/// The skew of a model.
///
/// # Errors
/// A model in which no squareness was identified: its zeros would pass for a measurement.
pub(super) fn skew(format: &Format, about: &About, errors: &SampledErrors) -> Result<Skew, FileError> {
    if !errors.squareness.iter().any(|(name, ..)| about.is_identified(name)) {
        let problem = "the model holds no squareness of its axes that was identified".to_owned();
        let remedy = "identify the machine from a tracer campaign or from points; what residual vectors or a plate show of squareness is an \
                      effect of the model, which abbe correct and a grid take into account";
        return Err(refused(format, problem, remedy));
    }
    // Both axes of a plane: a turn of one towards the other is the same shear as that of the other towards the one.
    let of = |a: Axis, b: Axis| tilted_m(about, errors, b, 1.0)[a.index()] + tilted_m(about, errors, a, 1.0)[b.index()];
    Ok(Skew { xy: of(Axis::X, Axis::Y), xz: of(Axis::X, Axis::Z), yz: of(Axis::Y, Axis::Z) })
}
