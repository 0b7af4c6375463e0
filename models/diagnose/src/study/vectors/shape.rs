//! Shapes of a residual without any chain: smooth in one or two quantities, or once or twice a turn of an angle.
//!
//! Place in the flow: candidates of the study of vectors that say what the residual depends on, not why.

use crate::study::smooth::legendre;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

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

    /// The shape without the straight lines in those quantities whose straight line has a name of its own.
    pub(super) fn bent(self, quantities: &[Quantity], is_named: impl Fn(usize) -> bool) -> Bent {
        let straight: Vec<usize> = match self {
            Shape::One { quantity, .. } => [quantity].into_iter().filter(|k| is_named(*k)).map(|_| 0).collect(),
            Shape::Two { first, second, .. } => {
                [first, second].into_iter().enumerate().filter(|(_, k)| is_named(*k)).map(|(place, _)| place).collect()
            }
            Shape::Product { .. } | Shape::Turn { .. } => Vec::new(),
        };
        let kept: Vec<usize> = (0..self.parameters().len()).filter(|k| !straight.contains(k)).collect();
        let count = quantities.first().map_or(0, |quantity| quantity.values.len());
        let less = if straight.is_empty() {
            Mat::zeros(0, kept.len())
        } else {
            self.less(quantities, &straight, &kept, count)
        };
        Bent { shape: self, kept, straight, less }
    }

    /// Constant and straight lines that the other functions hold at the vectors, by least squares.
    fn less(self, quantities: &[Quantity], straight: &[usize], kept: &[usize], count: usize) -> Mat<f64> {
        let rows: Vec<Vec<f64>> = (0..count).map(|k| self.columns(quantities, k)).collect();
        let lines = Mat::from_fn(count, 1 + straight.len(), |i, j| if j == 0 { 1.0 } else { rows[i][straight[j - 1]] });
        let others = Mat::from_fn(count, kept.len(), |i, j| rows[i][kept[j]]);
        let normal = lines.transpose() * &lines;
        match Llt::new(normal.as_ref(), Side::Lower) {
            Ok(factor) => factor.solve(lines.transpose() * others),
            Err(_) => Mat::zeros(lines.ncols(), kept.len()),
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

/// A shape of which the straight lines that have names were taken out: what is left is at right angles to them, so that a
/// name gets all of its line and the shape none of it.
#[derive(Debug, Clone)]
pub(super) struct Bent {
    pub(super) shape: Shape,
    /// Parameters of the shape that are left.
    pub(super) kept: Vec<usize>,
    /// Those that are straight lines with a name.
    straight: Vec<usize>,
    /// Constant and straight lines (rows) that were taken out of each one left.
    less: Mat<f64>,
}

impl Bent {
    /// Whether anything was taken out.
    pub(super) fn is_less(&self) -> bool {
        !self.straight.is_empty()
    }

    /// Columns of one vector.
    pub(super) fn columns(&self, quantities: &[Quantity], vector: usize) -> Vec<f64> {
        let all = self.shape.columns(quantities, vector);
        let line = |i: usize| if i == 0 { 1.0 } else { all[self.straight[i - 1]] };
        let taken = |j: usize| (0..self.less.nrows()).map(|i| self.less[(i, j)] * line(i)).sum::<f64>();
        self.kept.iter().enumerate().map(|(j, k)| all[*k] - taken(j)).collect()
    }

    /// Parameters of the whole shape (rows) as combinations of those left; constants are part of the pose.
    pub(super) fn map(&self) -> Mat<f64> {
        let one = |i: usize, j: usize| match self.straight.iter().position(|line| *line == i) {
            Some(line) => -self.less[(line + 1, j)],
            None => f64::from(u8::from(self.kept[j] == i)),
        };
        Mat::from_fn(self.shape.parameters().len(), self.kept.len(), one)
    }
}

/// Exponents of total degree 1 … degree.
fn terms(degree: usize) -> impl Iterator<Item = (usize, usize)> {
    (1..=degree).flat_map(|total| (0..=total).map(move |j| (total - j, j)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was taken out and what is left make the whole, and what is left holds no straight line at the vectors.
    #[test]
    fn a_bent_shape_holds_no_straight_line() {
        let values: Vec<f64> = (0..12).map(|k| f64::from(k * k)).collect();
        let of = |name: &str, values: Vec<f64>| Quantity { name: name.into(), values, range: (0.0, 121.0), levels: 12 };
        let quantities = [of("x_m", values.clone()), of("y_m", values.into_iter().rev().collect())];
        for shape in [Shape::One { quantity: 0, degree: 4 }, Shape::Two { first: 0, second: 1, degree: 3 }] {
            let bent = shape.bent(&quantities, |_| true);
            let sum = |of: &dyn Fn(usize) -> f64| (0..12).map(of).sum::<f64>();
            for j in 0..bent.kept.len() {
                let column = |k: usize| bent.columns(&quantities, k)[j];
                assert!(sum(&column).abs() < 1e-9, "{shape:?} {j}");
                assert!(sum(&|k| column(k) * shape.columns(&quantities, k)[0]).abs() < 1e-9, "{shape:?} {j}");
            }
            let map = bent.map();
            let whole = |k: usize, j: usize| -> f64 {
                shape.columns(&quantities, k).iter().enumerate().map(|(i, value)| value * map[(i, j)]).sum()
            };
            for j in 0..bent.kept.len() {
                let constant = whole(0, j) - bent.columns(&quantities, 0)[j];
                assert!((whole(7, j) - bent.columns(&quantities, 7)[j] - constant).abs() < 1e-12);
            }
        }
        let plain = Shape::One { quantity: 0, degree: 2 }.bent(&quantities, |_| false);
        assert_eq!((plain.kept.len(), plain.is_less()), (2, false));
    }

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
