//! Shapes of a residual without any chain: smooth in one or two quantities, or once or twice a turn of an angle.
//!
//! Place in the flow: candidates of the study of vectors that say what the residual depends on, not why.

use crate::study::smooth::legendre;

/// A quantity that varies.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Quantity {
    pub(super) name: String,
    /// One for each vector.
    pub(super) values: Vec<f64>,
    pub(super) range: (f64, f64),
    /// Number of different values.
    pub(super) levels: usize,
}

impl Quantity {
    /// Radians in one unit, where the name says that it is an angle.
    pub(super) fn rad_per_unit(&self) -> Option<f64> {
        if self.name.ends_with("_deg") { Some(1f64.to_radians()) } else { self.name.ends_with("_rad").then_some(1.0) }
    }
}

/// How one component of the residual depends on quantities, by their index.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Shape {
    /// Legendre polynomials 1 … degree of one quantity.
    One { quantity: usize, degree: usize },
    /// The product of two quantities.
    Product { first: usize, second: usize },
    /// Products of Legendre polynomials of total degree 1 … degree of two quantities.
    Two { first: usize, second: usize, degree: usize },
    /// Sine and cosine of an angle times a whole number.
    Turn { quantity: usize, times: u32 },
}

impl Shape {
    /// All shapes worth testing.
    pub(super) fn all(quantities: &[Quantity], in_pairs: usize) -> Vec<Shape> {
        let mut shapes = Vec::new();
        for (k, quantity) in quantities.iter().enumerate() {
            let degrees = [1, 2, 4].into_iter().filter(|degree| *degree < quantity.levels);
            shapes.extend(degrees.map(|degree| Shape::One { quantity: k, degree }));
            if quantity.rad_per_unit().is_some() {
                shapes.extend([1, 2].map(|times| Shape::Turn { quantity: k, times }));
            }
        }
        for first in 0..in_pairs.min(quantities.len()) {
            for second in first + 1..in_pairs.min(quantities.len()) {
                shapes.push(Shape::Product { first, second });
                shapes.extend([2, 3].map(|degree| Shape::Two { first, second, degree }));
            }
        }
        shapes
    }

    /// Quantities that it depends on.
    pub(super) fn quantities(self) -> Vec<usize> {
        match self {
            Shape::One { quantity, .. } | Shape::Turn { quantity, .. } => vec![quantity],
            Shape::Product { first, second } | Shape::Two { first, second, .. } => vec![first, second],
        }
    }

    /// In words, and the formula.
    pub(super) fn words(self, quantities: &[Quantity]) -> (String, &'static str) {
        let name = |k: usize| quantities[k].name.as_str();
        match self {
            Shape::One { quantity, degree } => {
                (format!("smooth in {}, degree {degree}", name(quantity)), "e = sum c_k P_k(p), Legendre")
            }
            Shape::Product { first, second } => {
                (format!("product of {} and {}", name(first), name(second)), "e = c P_1(p) P_1(q)")
            }
            Shape::Two { first, second, degree } => (
                format!("smooth in {} and {}, degree {degree}", name(first), name(second)),
                "e = sum c_ij P_i(p) P_j(q), Legendre",
            ),
            Shape::Turn { quantity, times } => {
                (format!("{times} a turn of {}", name(quantity)), "e = s sin(n p) + c cos(n p)")
            }
        }
    }

    /// Names of the parameters.
    pub(super) fn parameters(self) -> Vec<String> {
        match self {
            Shape::One { degree, .. } => (1..=degree).map(|k| format!("c_{k}")).collect(),
            Shape::Product { .. } => vec!["c_1_1".to_owned()],
            Shape::Two { degree, .. } => terms(degree).map(|(i, j)| format!("c_{i}_{j}")).collect(),
            Shape::Turn { .. } => vec!["sine".to_owned(), "cosine".to_owned()],
        }
    }

    /// Columns of one vector.
    pub(super) fn columns(self, quantities: &[Quantity], vector: usize) -> Vec<f64> {
        let powers = |k: usize, degree: usize| legendre(quantities[k].values[vector], quantities[k].range, degree);
        match self {
            Shape::One { quantity, degree } => powers(quantity, degree).split_off(1),
            Shape::Product { first, second } => vec![powers(first, 1)[1] * powers(second, 1)[1]],
            Shape::Two { first, second, degree } => {
                let (p, q) = (powers(first, degree), powers(second, degree));
                terms(degree).map(|(i, j)| p[i] * q[j]).collect()
            }
            Shape::Turn { quantity, times } => {
                let unit = quantities[quantity].rad_per_unit().unwrap_or(1.0);
                let (sine, cosine) = (quantities[quantity].values[vector] * unit * f64::from(times)).sin_cos();
                vec![sine, cosine]
            }
        }
    }
}

/// Exponents of total degree 1 … degree.
fn terms(degree: usize) -> impl Iterator<Item = (usize, usize)> {
    (1..=degree).flat_map(|total| (0..=total).map(move |j| (total - j, j)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_many_as_parameters_and_follow_the_formula() {
        let quantity = |name: &str, values: [f64; 3]| Quantity {
            name: name.into(),
            values: values.into(),
            range: (0.0, 90.0),
            levels: 3,
        };
        let quantities = [quantity("j_deg", [0.0, 45.0, 90.0]), quantity("temp_c", [90.0, 45.0, 0.0])];
        for shape in Shape::all(&quantities, 2) {
            assert_eq!(shape.columns(&quantities, 1).len(), shape.parameters().len(), "{shape:?}");
        }
        assert_eq!(Shape::Product { first: 0, second: 1 }.columns(&quantities, 0), [-1.0]);
        assert_eq!(Shape::One { quantity: 0, degree: 2 }.columns(&quantities, 2), [1.0, 1.0]);
        let once = Shape::Turn { quantity: 0, times: 1 }.columns(&quantities, 2);
        assert!((once[0] - 1.0).abs() < 1e-15 && once[1].abs() < 1e-15);
    }
}
