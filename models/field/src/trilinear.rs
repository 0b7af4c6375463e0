//! Trilinear interpolation between the corners of a box.
//!
//! Place in the flow: measured errors on a lattice in, the error at any point whose cell has eight measured corners out.
//! Source: Chen 2020 eq. 20. Beyond the lattice the outermost cell is continued, and the estimate says so. A lattice with
//! nodes missing gives larger boxes; where there is none, or no lattice, there is no answer.

use crate::cells::{Cells, Enclosure};
use crate::interpolator::{Estimate, Interpolator, Unanswered};
use crate::measured::MeasuredField;
use nalgebra::Vector3;

/// A field by trilinear interpolation.
#[derive(Debug, Clone, PartialEq)]
pub struct Trilinear {
    cells: Cells,
    errors_m: Vec<Vector3<f64>>,
}

impl Trilinear {
    /// Interpolates the measured errors.
    pub fn new(field: &MeasuredField) -> Trilinear {
        Trilinear { cells: Cells::of(field), errors_m: field.errors_m().to_vec() }
    }
}

impl Interpolator for Trilinear {
    fn at(&self, point_m: &Vector3<f64>) -> Result<Estimate, Unanswered> {
        let around = self.cells.around(point_m).map_err(|_| Unanswered::NotFinite)?;
        if around.enclosure != Enclosure::Hexahedron {
            return Err(Unanswered::NoHexahedron);
        }
        let points_m = self.cells.points_m();
        let (lower, upper) = (points_m[around.vertices[0]], points_m[around.vertices[7]]);
        // Across a plane there is no way to go, and the corners on either side are the same.
        let share = Vector3::from_fn(|d, _| match upper[d] - lower[d] {
            0.0 => 0.0,
            extent_m => (point_m[d] - lower[d]) / extent_m,
        });
        let error_m = blend(around.vertices.map(|k| self.errors_m[k]), &share);
        Ok(Estimate { error_m, u_m: None, region: around.region })
    }
}

/// Mean of eight corners (x fastest, lower first) weighted by the share of the way from lower to upper on each axis.
pub(crate) fn blend(corners: [Vector3<f64>; 8], share: &Vector3<f64>) -> Vector3<f64> {
    let weight =
        |k: usize| -> f64 { (0..3).map(|d| if k >> d & 1 == 1 { share[d] } else { 1.0 - share[d] }).product() };
    corners.iter().enumerate().map(|(k, corner)| corner * weight(k)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measured::tests::lattice;

    /// A trilinear function (m): what the method must meet everywhere.
    fn truth(p: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(1.0 + p.x * p.y * p.z, p.x - 2.0 * p.y * p.z, 3.0 * p.z + p.x * p.y) * 1e-6
    }

    fn of(points: Vec<Vector3<f64>>) -> Trilinear {
        let errors = points.iter().map(truth).collect();
        Trilinear::new(&MeasuredField::new(points, errors, None).unwrap())
    }

    #[test]
    fn a_trilinear_field_is_met_inside_beyond_and_over_missing_nodes() {
        let all = lattice([5, 4, 4], 0.1);
        let missing: Vec<_> = all.iter().enumerate().filter(|(k, _)| k % 9 != 4).map(|(_, p)| *p).collect();
        for field in [of(all), of(missing)] {
            let mut answered = 0;
            for k in 0..200 {
                let k = f64::from(k);
                let target = Vector3::new(0.5 + (k * 0.7).sin(), 0.5 + (k * 1.3).cos(), 0.5 + (k * 0.37).sin()) * 0.25;
                match field.at(&target) {
                    Ok(found) => {
                        assert!((found.error_m - truth(&target)).norm() < 1e-18, "{target}");
                        answered += 1;
                    }
                    Err(why) => assert_eq!(why, Unanswered::NoHexahedron),
                }
            }
            assert!(answered > 100, "{answered}");
        }
    }

    #[test]
    fn a_scatter_and_a_point_that_is_none_have_no_answer() {
        let scatter = (0..40).map(f64::from).map(|k| Vector3::new(k.sin(), (k * 1.7).cos(), (k * 0.3).sin())).collect();
        assert_eq!(of(scatter).at(&Vector3::new(0.1, 0.1, 0.1)), Err(Unanswered::NoHexahedron));
        let field = of(lattice([2, 2, 2], 0.1));
        assert_eq!(field.at(&Vector3::new(0.0, 0.0, f64::NAN)), Err(Unanswered::NotFinite));
    }
}
