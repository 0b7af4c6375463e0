//! A field measured in a plane: answers in it, and none beside it.
//!
//! Place in the flow: around any method where the points are those of a plate. Nothing was measured across the plane, so a
//! target beside it has no answer, whatever a method would make of it.

use crate::interpolator::{Estimate, Interpolator, Unanswered, finite};
use crate::measured::{MeasuredField, Plane};
use nalgebra::Vector3;

/// A method with the plane that its points lie in.
pub struct OnPlane<'a> {
    method: Box<dyn Interpolator + 'a>,
    plane: Option<Plane>,
}

impl<'a> OnPlane<'a> {
    /// The method, which was made of this field.
    pub fn new(field: &MeasuredField, method: Box<dyn Interpolator + 'a>) -> OnPlane<'a> {
        OnPlane { method, plane: field.plane() }
    }
}

impl Interpolator for OnPlane<'_> {
    fn at(&self, point_m: &Vector3<f64>) -> Result<Estimate, Unanswered> {
        let Some(plane) = self.plane else { return self.method.at(point_m) };
        finite(point_m)?;
        let within_m = plane.within(point_m).map_err(|distance_m| Unanswered::OffPlane { distance_m })?;
        self.method.at(&within_m)
    }
}
