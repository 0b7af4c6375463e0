//! A variance of the tip that depends on where a machine stands: of a motion whose size is known, and whose course is not.
//!
//! Place in the flow: a diagnosis finds that scales, angles or bows change with something that it cannot name; [`mod@crate::correct`] adds
//! what they may do at a place. Readings in m, machine frame; variances in m².
//!
//! ```text
//! var_d(p) = φ(p)ᵀ S_d φ(p),   φ = (1, x, y, z, x², xy, xz, y², yz, z²),   p: reading from the middle, over half the span
//! ```

use crate::model_error::ModelError;
use crate::packed::packed;

/// Products of up to two coordinates.
pub const FORMS: usize = 10;
/// Rounding of a variance that is none, as a share of the largest.
const ROUNDING: f64 = 1e-9;

/// Variance along X, Y and Z at every place.
#[derive(Debug, Clone, PartialEq)]
pub struct VarianceByPlace {
    /// Reading at the middle (m).
    pub middle_m: [f64; 3],
    /// From there to the ends (m), above zero.
    pub half_span_m: [f64; 3],
    /// Covariances of the forms along X, Y and Z (m²): packed lower triangles, row by row.
    pub packed_m2: [Vec<f64>; 3],
}

impl VarianceByPlace {
    /// All forms at a reading (m).
    pub fn forms(middle_m: [f64; 3], half_span_m: [f64; 3], reading_m: [f64; 3]) -> [f64; FORMS] {
        let [x, y, z] = std::array::from_fn(|d| (reading_m[d] - middle_m[d]) / half_span_m[d]);
        [1.0, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z]
    }

    /// Variance along X, Y and Z at a reading (m), in m².
    pub fn at_m2(&self, reading_m: [f64; 3]) -> [f64; 3] {
        let forms = Self::forms(self.middle_m, self.half_span_m, reading_m);
        std::array::from_fn(|d| {
            let mut packed = self.packed_m2[d].iter();
            let mut sum = 0.0;
            for (row, a) in forms.iter().enumerate() {
                for (column, b) in forms[..=row].iter().enumerate() {
                    let twice = if column < row { 2.0 } else { 1.0 };
                    sum += twice * a * b * packed.next().copied().unwrap_or(0.0);
                }
            }
            sum.max(0.0)
        })
    }

    /// A share of it, or a multiple.
    #[must_use]
    pub fn scaled(&self, by: f64) -> VarianceByPlace {
        let packed_m2 = std::array::from_fn(|d| self.packed_m2[d].iter().map(|m2| by * m2).collect());
        VarianceByPlace { packed_m2, ..self.clone() }
    }

    /// The sum with another variance about the same middle, of independent motions; `None` where the middle or the span is another.
    pub fn with(&self, other: &VarianceByPlace) -> Option<VarianceByPlace> {
        let is_alike = self.middle_m == other.middle_m && self.half_span_m == other.half_span_m;
        let sum = |d: usize| self.packed_m2[d].iter().zip(&other.packed_m2[d]).map(|(a, b)| a + b).collect();
        is_alike.then(|| VarianceByPlace { packed_m2: std::array::from_fn(sum), ..self.clone() })
    }

    /// Refuses what is no variance.
    pub(crate) fn check(&self) -> Result<(), ModelError> {
        let refused = |what| Err(ModelError::ByPlace { what });
        let all = || self.packed_m2.iter().flatten().chain(&self.middle_m).chain(&self.half_span_m);
        if !all().all(|value| value.is_finite()) {
            return refused("a number is not finite");
        }
        if !self.half_span_m.iter().all(|half| *half > 0.0) {
            return refused("a span is not above zero");
        }
        if self.packed_m2.iter().any(|packed| packed.len() != FORMS * (FORMS + 1) / 2) {
            return refused("a covariance does not hold 55 numbers");
        }
        if !self.packed_m2.iter().all(|packed| is_covariance(packed)) {
            return refused("a covariance is none: somewhere it says a variance below zero");
        }
        Ok(())
    }
}

/// Whether no combination of the forms has a variance below zero, but for rounding.
fn is_covariance(values: &[f64]) -> bool {
    let at = |a: usize, b: usize| values[packed(a, b)];
    let whole = nalgebra::SMatrix::<f64, FORMS, FORMS>::from_fn(at);
    let values = whole.symmetric_eigenvalues();
    values.min() >= -ROUNDING * values.max().max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a = 2 µm·x + 1 µm·z² along Y, once known and once in doubt.
    fn example() -> VarianceByPlace {
        let mut packed_m2 = [vec![0.0; 55], vec![0.0; 55], vec![0.0; 55]];
        packed_m2[1][packed(1, 1)] = 4e-12;
        packed_m2[1][packed(9, 1)] = 2e-12;
        packed_m2[1][packed(9, 9)] = 1e-12;
        VarianceByPlace { middle_m: [0.5, 0.0, 1.0], half_span_m: [0.5, 1.0, 2.0], packed_m2 }
    }

    #[test]
    fn a_motion_along_y_is_seen_where_it_acts() {
        let by_place = example();
        by_place.check().unwrap();
        assert_eq!(by_place.at_m2([0.5, 0.3, 1.0]), [0.0; 3]);
        // x = 1, z = 1: 2 + 1 µm. x = −1, z = 1: −2 + 1 µm.
        let [x, y, z] = by_place.at_m2([1.0, -7.0, 3.0]);
        assert!(x == 0.0 && z == 0.0 && (y - 9e-12).abs() < 1e-24);
        assert!((by_place.at_m2([0.0, 0.0, 3.0])[1] - 1e-12).abs() < 1e-24);
    }

    #[test]
    fn independent_motions_about_one_middle_add_up() {
        let (one, at_m) = (example(), [0.9, -0.4, 2.2]);
        let both = one.with(&one).unwrap();
        assert_eq!(both.at_m2(at_m), one.at_m2(at_m).map(|m2| 2.0 * m2));
        assert_eq!(one.with(&VarianceByPlace { middle_m: [0.5, 0.0, 1.1], ..one.clone() }), None);
    }

    #[test]
    fn what_is_no_variance_is_refused() {
        let refused = |change: fn(&mut VarianceByPlace)| {
            let mut by_place = example();
            change(&mut by_place);
            by_place.check().unwrap_err().to_string()
        };
        assert!(refused(|v| v.packed_m2[1][2] = 0.5e-12).contains("below zero"));
        assert!(refused(|v| v.packed_m2[0][0] = f64::NAN).contains("finite"));
        assert!(refused(|v| v.half_span_m[2] = 0.0).contains("span"));
        assert!(refused(|v| v.packed_m2[2].truncate(54)).contains("55"));
    }
}
