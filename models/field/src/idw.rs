//! Inverse distance weighting.
//!
//! Place in the flow: measured errors in, at any point their mean weighted by distance^(−exponent) out. Source: Chen 2020
//! eq. 12-13, exponent 2; the reference points are the eight of the smallest enclosing hexahedron, the k nearest, or all
//! within a radius (its section 2.2). It meets the measured errors exactly and never leaves their range, so it flattens
//! slopes and cannot extrapolate them.

use crate::cells::Cells;
use crate::hull::Region;
use crate::interpolator::{Estimate, Interpolator, Unanswered, finite};
use crate::measured::MeasuredField;
use nalgebra::Vector3;
use thiserror::Error;

/// Exponent of the distance in Chen 2020.
pub const EXPONENT: f64 = 2.0;

/// Which measured points count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reference {
    /// The eight around the target, see [`Cells`].
    Hexahedron,
    /// So many nearest ones.
    Nearest(usize),
    /// All within a radius.
    Within {
        /// Radius (m).
        radius_m: f64,
    },
}

/// Settings that make no weighting; the text says what to do.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum IdwError {
    /// No number of neighbours.
    #[error("{count} nearest of {points} points cannot be taken; ask for 1 to {points}")]
    Count {
        /// Asked for.
        count: usize,
        /// Points there are.
        points: usize,
    },
    /// No radius.
    #[error("the radius {} mm is not above zero", radius_m * 1e3)]
    Radius {
        /// Asked for (m).
        radius_m: f64,
    },
    /// No exponent.
    #[error("the exponent {0} is not above zero")]
    Exponent(f64),
}

/// A field by inverse distance weighting.
#[derive(Debug, Clone, PartialEq)]
pub struct Idw {
    cells: Cells,
    errors_m: Vec<Vector3<f64>>,
    reference: Reference,
    exponent: f64,
}

impl Idw {
    /// Weights the measured errors by distance^(−`exponent`).
    pub fn new(field: &MeasuredField, reference: Reference, exponent: f64) -> Result<Idw, IdwError> {
        let points = field.points_m().len();
        match reference {
            Reference::Nearest(count) if count == 0 || count > points => return Err(IdwError::Count { count, points }),
            Reference::Within { radius_m } if !(radius_m.is_finite() && radius_m > 0.0) => {
                return Err(IdwError::Radius { radius_m });
            }
            _ => {}
        }
        if !(exponent.is_finite() && exponent > 0.0) {
            return Err(IdwError::Exponent(exponent));
        }
        Ok(Idw { cells: Cells::of(field), errors_m: field.errors_m().to_vec(), reference, exponent })
    }

    fn square(&self, index: usize, point_m: &Vector3<f64>) -> f64 {
        (self.cells.points_m()[index] - point_m).norm_squared()
    }

    /// The measured points that count, and where the target lies.
    fn references(&self, point_m: &Vector3<f64>) -> Result<(Vec<usize>, Region), Unanswered> {
        let all = 0..self.errors_m.len();
        let chosen = match self.reference {
            Reference::Hexahedron => {
                let around = self.cells.around(point_m).map_err(|_| Unanswered::NotFinite)?;
                return Ok((around.vertices.to_vec(), around.region));
            }
            Reference::Nearest(count) => {
                let mut order: Vec<usize> = all.collect();
                let by_distance =
                    |a: &usize, b: &usize| self.square(*a, point_m).total_cmp(&self.square(*b, point_m)).then(a.cmp(b));
                order.select_nth_unstable_by(count - 1, by_distance);
                order.truncate(count);
                order.sort_unstable(); // one order of summation, whatever the selection left
                order
            }
            Reference::Within { radius_m } => {
                let near: Vec<usize> = all.filter(|k| self.square(*k, point_m) <= radius_m * radius_m).collect();
                if near.is_empty() {
                    return Err(Unanswered::NoPointWithin { radius_m });
                }
                near
            }
        };
        Ok((chosen, self.cells.region(point_m)))
    }
}

impl Interpolator for Idw {
    fn at(&self, point_m: &Vector3<f64>) -> Result<Estimate, Unanswered> {
        finite(point_m)?;
        let (chosen, region) = self.references(point_m)?;
        let (mut sum, mut weights) = (Vector3::zeros(), 0.0);
        for index in chosen {
            let square = self.square(index, point_m);
            if square == 0.0 {
                return Ok(Estimate { error_m: self.errors_m[index], u_m: None, region });
            }
            let weight = square.powf(-0.5 * self.exponent);
            sum += self.errors_m[index] * weight;
            weights += weight;
        }
        Ok(Estimate { error_m: sum / weights, u_m: None, region })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measured::tests::lattice;

    /// A lattice whose error is linear (m).
    fn field() -> MeasuredField {
        let points = lattice([4, 4, 4], 0.1);
        let errors = points.iter().map(|p| Vector3::new(p.x, 2.0 * p.y - p.z, 1.0) * 1e-6).collect();
        MeasuredField::new(points, errors, None).unwrap()
    }

    #[test]
    fn two_points_are_weighted_by_their_square_distances() {
        // Nearest two of a point a quarter of the way: weights 1/0.025² and 1/0.075², so 0.9 and 0.1.
        let idw = Idw::new(&field(), Reference::Nearest(2), EXPONENT).unwrap();
        let found = idw.at(&Vector3::new(0.125, 0.1, 0.1)).unwrap();
        assert!((found.error_m.x - (0.9 * 0.1e-6 + 0.1 * 0.2e-6)).abs() < 1e-18);
        let steep = Idw::new(&field(), Reference::Nearest(2), 4.0).unwrap();
        let found = steep.at(&Vector3::new(0.125, 0.1, 0.1)).unwrap();
        assert!((found.error_m.x - (81.0 * 0.1e-6 + 0.2e-6) / 82.0).abs() < 1e-18);
    }

    #[test]
    fn measured_points_get_their_measured_error() {
        let references = [Reference::Hexahedron, Reference::Nearest(8), Reference::Within { radius_m: 0.15 }];
        for reference in references {
            let idw = Idw::new(&field(), reference, EXPONENT).unwrap();
            for (point, error) in field().points_m().iter().zip(field().errors_m()) {
                assert_eq!(idw.at(point).unwrap().error_m, *error);
            }
        }
    }

    #[test]
    fn the_middle_of_a_cell_gets_the_mean_of_its_corners() {
        let middle = Vector3::new(0.15, 0.05, 0.25);
        for reference in [Reference::Hexahedron, Reference::Nearest(8), Reference::Within { radius_m: 0.087 }] {
            let found = Idw::new(&field(), reference, EXPONENT).unwrap().at(&middle).unwrap();
            assert!((found.error_m - Vector3::new(0.15, -0.15, 1.0) * 1e-6).norm() < 1e-18, "{reference:?}");
            assert!(found.region.is_inside());
        }
    }

    #[test]
    fn the_eight_of_the_hexahedron_are_not_the_nearest_eight() {
        // Close to a corner of a flat cell the next layer is nearer than the far corners.
        let points: Vec<_> =
            lattice([4, 4, 4], 0.1).iter().map(|p| p.component_mul(&Vector3::new(1.0, 1.0, 0.1))).collect();
        let errors = (0..64).map(|k| Vector3::repeat(f64::from(k) * 1e-6)).collect();
        let field = MeasuredField::new(points, errors, None).unwrap();
        let at = |reference| {
            let idw = Idw::new(&field, reference, EXPONENT).unwrap();
            idw.at(&Vector3::new(0.13, 0.13, 0.011)).unwrap().error_m.x
        };
        assert!((at(Reference::Hexahedron) - at(Reference::Nearest(8))).abs() > 1e-7);
    }

    #[test]
    fn where_nothing_is_near_there_is_no_answer_and_beyond_the_points_it_is_marked() {
        let idw = Idw::new(&field(), Reference::Within { radius_m: 0.05 }, EXPONENT).unwrap();
        let none = Unanswered::NoPointWithin { radius_m: 0.05 };
        assert_eq!(idw.at(&Vector3::new(0.15, 0.15, 0.15)), Err(none));
        assert_eq!(idw.at(&Vector3::new(0.1, f64::NAN, 0.1)), Err(Unanswered::NotFinite));
        let beyond = Idw::new(&field(), Reference::Nearest(4), EXPONENT).unwrap().at(&Vector3::new(0.4, 0.1, 0.1));
        assert!(!beyond.unwrap().region.is_inside());
    }

    #[test]
    fn settings_that_make_no_weighting_are_refused() {
        let refused = |reference, exponent| Idw::new(&field(), reference, exponent).unwrap_err();
        assert_eq!(refused(Reference::Nearest(0), 2.0), IdwError::Count { count: 0, points: 64 });
        assert_eq!(refused(Reference::Nearest(65), 2.0), IdwError::Count { count: 65, points: 64 });
        assert_eq!(refused(Reference::Within { radius_m: 0.0 }, 2.0), IdwError::Radius { radius_m: 0.0 });
        assert_eq!(refused(Reference::Hexahedron, -2.0), IdwError::Exponent(-2.0));
        assert!(matches!(refused(Reference::Hexahedron, f64::NAN), IdwError::Exponent(_)));
    }
}
