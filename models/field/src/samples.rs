//! Error vectors at measured values of any inputs: positions, joints, temperatures, time.
//!
//! Place in the flow: what kriging is fitted to and residual models are made of. A point is a row of numbers, one an input, in the
//! unit that the input's name ends with; errors are actual − indicated (m). A [`MeasuredField`] is the case of three inputs,
//! [`POSITION`], and comes over unchanged. Points may be measured again at the same values: what differs then is noise.

use crate::error::{FieldError, LEAST_POINTS, MOST_INPUTS};
use crate::measured::MeasuredField;
use nalgebra::Vector3;

/// Names of the position's inputs.
pub const POSITION: [&str; 3] = ["x_m", "y_m", "z_m"];

/// Error vectors at values of inputs, checked once.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    names: Vec<String>,
    /// Values, point after point.
    at: Vec<f64>,
    errors_m: Vec<Vector3<f64>>,
    u_m: Option<Vec<Vector3<f64>>>,
    /// The input along which points of a plane do not differ.
    normal: Option<usize>,
}

impl Samples {
    /// Errors (m) at points `at`, one number for each name, point after point; standard uncertainties (m, k = 1) where known.
    ///
    /// # Errors
    /// Lists that do not fit each other, too few points, numbers that are none, an input that is the same everywhere.
    pub fn new(
        names: Vec<String>,
        at: Vec<f64>,
        errors_m: Vec<Vector3<f64>>,
        u_m: Option<Vec<Vector3<f64>>>,
    ) -> Result<Samples, FieldError> {
        Samples { names, at, errors_m, u_m, normal: None }.checked()
    }

    fn checked(self) -> Result<Samples, FieldError> {
        let size = self.names.len();
        if size == 0 || size > MOST_INPUTS {
            return Err(FieldError::InputCount(size));
        }
        if let Some(twice) = self.names.iter().enumerate().find(|(k, name)| self.names[..*k].contains(name)) {
            return Err(FieldError::InputTwice(twice.1.clone()));
        }
        let points = self.at.len() / size;
        let lengths = |values: usize, what| Err(FieldError::Lengths { points, values, what });
        if self.errors_m.len() != points || self.at.len() != points * size {
            return lengths(self.errors_m.len(), "errors");
        }
        if self.u_m.as_ref().is_some_and(|u_m| u_m.len() != points) {
            return lengths(self.u_m.as_ref().map_or(0, Vec::len), "uncertainties");
        }
        if points < LEAST_POINTS {
            return Err(FieldError::TooFew(points));
        }
        self.check_numbers()?;
        let (low, high) = self.range();
        match (0..size).find(|d| low[*d] == high[*d] && self.normal != Some(*d)) {
            Some(same) => Err(FieldError::Constant(self.names[same].clone())),
            None => Ok(self),
        }
    }

    fn check_numbers(&self) -> Result<(), FieldError> {
        for (index, (point, error)) in self.points().zip(&self.errors_m).enumerate() {
            if !point.iter().all(|value| value.is_finite()) {
                return Err(FieldError::NotFinite { index, what: "an input" });
            }
            if !error.iter().all(|value| value.is_finite()) {
                return Err(FieldError::NotFinite { index, what: "the error" });
            }
        }
        let is_good = |u: &Vector3<f64>| u.iter().all(|v| v.is_finite() && *v > 0.0);
        match self.u_m.iter().flatten().position(|u| !is_good(u)) {
            Some(index) => Err(FieldError::Uncertainty(index)),
            None => Ok(()),
        }
    }

    /// Names of the inputs, the unit as suffix.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Inputs of a point.
    pub fn size(&self) -> usize {
        self.names.len()
    }

    /// Whether x, y and z are inputs, then the first three.
    pub fn has_position(&self) -> bool {
        is_position(self.names.get(..3).unwrap_or_default())
    }

    /// Whether they are all there is.
    pub fn is_position_alone(&self) -> bool {
        is_position(&self.names)
    }

    /// Number of points, never 0.
    pub fn count(&self) -> usize {
        self.errors_m.len()
    }

    /// A point, which must be one of them.
    pub fn point(&self, index: usize) -> &[f64] {
        &self.at[index * self.size()..(index + 1) * self.size()]
    }

    /// All points.
    pub fn points(&self) -> impl ExactSizeIterator<Item = &[f64]> + Clone {
        self.at.chunks_exact(self.size())
    }

    /// First three inputs of each point, the position where there is one; 0 where there are fewer.
    pub fn places(&self) -> Vec<Vector3<f64>> {
        self.points().map(place_of).collect()
    }

    /// Error at each point, actual − indicated (m).
    pub fn errors_m(&self) -> &[Vector3<f64>] {
        &self.errors_m
    }

    /// Standard uncertainty of each error (m, k = 1), where it is known.
    pub fn u_m(&self) -> Option<&[Vector3<f64>]> {
        self.u_m.as_deref()
    }

    /// The input along which points of a plane do not differ.
    pub fn normal(&self) -> Option<usize> {
        self.normal
    }

    /// Least and largest value of each input.
    pub fn range(&self) -> (Vec<f64>, Vec<f64>) {
        corners(self.size(), self.points())
    }

    /// The same points with other errors (m).
    ///
    /// # Errors
    /// As [`Samples::new`].
    pub fn with_errors(&self, errors_m: Vec<Vector3<f64>>) -> Result<Samples, FieldError> {
        Samples { errors_m, ..self.clone() }.checked()
    }

    /// The points at these indices; indices must be those of points.
    ///
    /// # Errors
    /// As [`Samples::new`].
    pub fn part(&self, indices: &[usize]) -> Result<Samples, FieldError> {
        let pick = |list: &[Vector3<f64>]| indices.iter().filter_map(|k| list.get(*k)).copied().collect::<Vec<_>>();
        let at = indices.iter().flat_map(|k| self.point(*k)).copied().collect();
        let (errors_m, u_m) = (pick(&self.errors_m), self.u_m.as_deref().map(pick));
        Samples { names: self.names.clone(), at, errors_m, u_m, normal: self.normal }.checked()
    }

    /// As a field of positions, where these are all there is.
    ///
    /// # Errors
    /// Points that make none: on a line, measured twice; `None` where there are other inputs.
    pub fn field(&self) -> Option<Result<MeasuredField, FieldError>> {
        let (errors_m, u_m) = (self.errors_m.clone(), self.u_m.clone());
        self.is_position_alone().then(|| match self.normal {
            Some(_) => MeasuredField::volume_or_plane(self.places(), errors_m, u_m),
            None => MeasuredField::new(self.places(), errors_m, u_m),
        })
    }
}

impl From<&MeasuredField> for Samples {
    fn from(field: &MeasuredField) -> Samples {
        Samples {
            names: POSITION.map(str::to_owned).to_vec(),
            at: field.points_m().iter().flat_map(|p| [p.x, p.y, p.z]).collect(),
            errors_m: field.errors_m().to_vec(),
            u_m: field.u_m().map(<[Vector3<f64>]>::to_vec),
            normal: field.plane().map(|plane| plane.normal),
        }
    }
}

fn is_position(names: &[String]) -> bool {
    names.len() == 3 && names.iter().zip(POSITION).all(|(name, axis)| name == axis)
}

/// First three numbers of a point; 0 where there are fewer.
pub fn place_of(point: &[f64]) -> Vector3<f64> {
    Vector3::from_fn(|d, _| point.get(d).copied().unwrap_or(0.0))
}

/// Least and largest value of each of `size` inputs; infinite the wrong way round without points.
pub fn corners<'a>(size: usize, points: impl Iterator<Item = &'a [f64]>) -> (Vec<f64>, Vec<f64>) {
    let (mut low, mut high) = (vec![f64::INFINITY; size], vec![f64::NEG_INFINITY; size]);
    for point in points {
        for (d, value) in point.iter().enumerate() {
            low[d] = low[d].min(*value);
            high[d] = high[d].max(*value);
        }
    }
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(names: &[&str], at: impl Fn(usize) -> Vec<f64>) -> Result<Samples, FieldError> {
        let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        Samples::new(names, (0..10).flat_map(at).collect(), vec![Vector3::repeat(1e-6); 10], None)
    }

    #[test]
    fn a_field_comes_over_and_back() {
        let points: Vec<_> =
            (0..27).map(|k| Vector3::new((k % 3) as f64, (k / 3 % 3) as f64, (k / 9) as f64)).collect();
        let field = MeasuredField::new(points.clone(), vec![Vector3::repeat(1e-6); 27], None).unwrap();
        let samples = Samples::from(&field);
        assert!(samples.is_position_alone() && samples.has_position());
        assert_eq!((samples.places(), samples.field().unwrap().unwrap()), (points, field));
        assert_eq!(samples.part(&[0, 1, 3, 4, 9, 10, 12, 13]).unwrap().point(5), [1.0, 0.0, 1.0]);
    }

    #[test]
    fn what_makes_no_samples_is_refused_by_the_name_of_the_input() {
        let row = |k: usize| vec![k as f64, (k * k) as f64];
        assert!(samples(&["q1_deg", "temp_c"], row).is_ok());
        let refused = |names: &[&str], at: &dyn Fn(usize) -> Vec<f64>| samples(names, at).unwrap_err().to_string();
        assert!(refused(&["q1_deg", "temp_c"], &|k| vec![k as f64, 20.0]).contains("temp_c"));
        assert!(refused(&["q1_deg", "q1_deg"], &row).contains("q1_deg"));
        assert!(refused(&[], &|_| vec![]).contains("0 inputs"));
        assert!(refused(&["q1_deg", "temp_c"], &|k| vec![k as f64, f64::NAN]).contains("point 0"));
        assert!(refused(&["q1_deg"], &row).contains("10 errors"));
        assert!(samples(&["q1_deg", "temp_c"], row).unwrap().part(&[0, 1, 2]).is_err());
    }
}
