//! Shapes of a residual without any chain: smooth in one or two quantities, or once or twice a turn of an angle.
//!
//! Place in the flow: candidates of the study of vectors that say what the residual depends on, not why.

use crate::study::smooth::{legendre, levels};
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

/// Highest degree of a polynomial.
pub(super) const HIGHEST: usize = 4;
/// Turns of an angle that are tried.
const TURNS: [u32; 2] = [1, 2];

/// A quantity that varies, with its functions at all vectors: the candidates are made of them in every step.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Quantity {
    pub(super) name: String,
    /// One for each vector.
    pub(super) values: Vec<f64>,
    pub(super) range: (f64, f64),
    /// Number of different values.
    pub(super) levels: usize,
    /// P_0 … P_4 of the share of the range, one for each vector.
    pub(super) powers: Vec<Vec<f64>>,
    /// Sine and cosine of so many turns, where it is an angle.
    turns: Vec<[Vec<f64>; 2]>,
}

impl Quantity {
    pub(super) fn new(name: &str, values: Vec<f64>, range: (f64, f64)) -> Quantity {
        let rows: Vec<Vec<f64>> = values.iter().map(|value| legendre(*value, range, HIGHEST)).collect();
        let powers = (0..=HIGHEST).map(|k| rows.iter().map(|row| row[k]).collect()).collect();
        let levels = levels(&values);
        let mut quantity = Quantity { name: name.to_owned(), values, range, levels, powers, turns: Vec::new() };
        if let Some(unit) = quantity.rad_per_unit() {
            let angle = |value: &f64, times: u32| value * unit * f64::from(times);
            let of = |times: u32| {
                let angles = || quantity.values.iter().map(move |value| angle(value, times));
                [angles().map(f64::sin).collect(), angles().map(f64::cos).collect()]
            };
            quantity.turns = TURNS.map(of).to_vec();
        }
        quantity
    }

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
    /// All shapes worth testing, of two quantities where these are a pair.
    pub(super) fn all(quantities: &[Quantity], is_pair: impl Fn(usize, usize) -> bool) -> Vec<Shape> {
        let mut shapes = Vec::new();
        for (k, quantity) in quantities.iter().enumerate() {
            let degrees = [1, 2, 4].into_iter().filter(|degree| *degree < quantity.levels);
            shapes.extend(degrees.map(|degree| Shape::One { quantity: k, degree }));
            if quantity.rad_per_unit().is_some() {
                shapes.extend(TURNS.map(|times| Shape::Turn { quantity: k, times }));
            }
        }
        for first in 0..quantities.len() {
            for second in (first + 1..quantities.len()).filter(|second| is_pair(first, *second)) {
                shapes.push(Shape::Product { first, second });
                shapes.extend([2, 3].map(|degree| Shape::Two { first, second, degree }));
            }
        }
        shapes
    }

    /// Whether it goes straight with one quantity.
    pub(super) fn is_straight(self) -> bool {
        matches!(self, Shape::One { degree: 1, .. })
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
        let rows = self.columns(quantities, &(0..count).collect::<Vec<usize>>());
        let lines =
            Mat::from_fn(count, 1 + straight.len(), |i, j| if j == 0 { 1.0 } else { rows[(i, straight[j - 1])] });
        let others = Mat::from_fn(count, kept.len(), |i, j| rows[(i, kept[j])]);
        let normal = lines.transpose() * &lines;
        match Llt::new(normal.as_ref(), Side::Lower) {
            Ok(factor) => factor.solve(lines.transpose() * others),
            Err(_) => Mat::zeros(lines.ncols(), kept.len()),
        }
    }

    /// Columns at these vectors, a row each.
    pub(super) fn columns(self, quantities: &[Quantity], vectors: &[usize]) -> Mat<f64> {
        let mut columns = Mat::zeros(vectors.len(), self.parameters().len());
        let mut fill = |j: usize, of: &[&[f64]]| {
            let own = columns.col_as_slice_mut(j).iter_mut().zip(vectors);
            match of {
                [p, q] => own.for_each(|(value, vector)| *value = p[*vector] * q[*vector]),
                _ => own.for_each(|(value, vector)| *value = of.iter().map(|p| p[*vector]).product()),
            }
        };
        match self {
            Shape::One { quantity, degree } => {
                (0..degree).for_each(|j| fill(j, &[&quantities[quantity].powers[j + 1]]));
            }
            Shape::Product { first, second } => fill(0, &[&quantities[first].powers[1], &quantities[second].powers[1]]),
            Shape::Two { first, second, degree } => {
                let (p, q) = (&quantities[first].powers, &quantities[second].powers);
                terms(degree).enumerate().for_each(|(column, (i, j))| fill(column, &[&p[i], &q[j]]));
            }
            Shape::Turn { quantity, times } => {
                let turn = TURNS.iter().zip(&quantities[quantity].turns).find(|(own, _)| **own == times);
                turn.iter().flat_map(|(_, turn)| *turn).enumerate().for_each(|(j, values)| fill(j, &[values]));
            }
        }
        columns
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

    /// Columns at these vectors, a row each.
    pub(super) fn columns(&self, quantities: &[Quantity], vectors: &[usize]) -> Mat<f64> {
        let all = self.shape.columns(quantities, vectors);
        if !self.is_less() {
            return all;
        }
        let line = |i: usize, row: usize| if i == 0 { 1.0 } else { all[(row, self.straight[i - 1])] };
        let taken =
            |row: usize, j: usize| (0..self.less.nrows()).map(|i| self.less[(i, j)] * line(i, row)).sum::<f64>();
        Mat::from_fn(vectors.len(), self.kept.len(), |row, j| all[(row, self.kept[j])] - taken(row, j))
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
        let of = |name: &str, values: Vec<f64>| Quantity::new(name, values, (0.0, 121.0));
        let all: Vec<usize> = (0..12).collect();
        let quantities = [of("x_m", values.clone()), of("y_m", values.into_iter().rev().collect())];
        for shape in [Shape::One { quantity: 0, degree: 4 }, Shape::Two { first: 0, second: 1, degree: 3 }] {
            let bent = shape.bent(&quantities, |_| true);
            let sum = |of: &dyn Fn(usize) -> f64| (0..12).map(of).sum::<f64>();
            let (own, straight) = (bent.columns(&quantities, &all), shape.columns(&quantities, &all));
            for j in 0..bent.kept.len() {
                assert!(sum(&|k| own[(k, j)]).abs() < 1e-9, "{shape:?} {j}");
                assert!(sum(&|k| own[(k, j)] * straight[(k, 0)]).abs() < 1e-9, "{shape:?} {j}");
            }
            let whole = straight * bent.map();
            for j in 0..bent.kept.len() {
                let constant = whole[(0, j)] - own[(0, j)];
                assert!((whole[(7, j)] - own[(7, j)] - constant).abs() < 1e-12);
            }
        }
        let plain = Shape::One { quantity: 0, degree: 2 }.bent(&quantities, |_| false);
        assert_eq!((plain.kept.len(), plain.is_less()), (2, false));
    }

    #[test]
    fn columns_are_as_many_as_parameters_and_follow_the_formula() {
        let quantity = |name: &str, values: [f64; 3]| Quantity::new(name, values.into(), (0.0, 90.0));
        let quantities = [quantity("j_deg", [0.0, 45.0, 90.0]), quantity("temp_c", [90.0, 45.0, 0.0])];
        for shape in Shape::all(&quantities, |_, _| true) {
            assert_eq!(shape.columns(&quantities, &[1]).ncols(), shape.parameters().len(), "{shape:?}");
        }
        let at = |shape: Shape, vector: usize| -> Vec<f64> {
            shape.columns(&quantities, &[vector]).row(0).iter().copied().collect()
        };
        assert_eq!(at(Shape::Product { first: 0, second: 1 }, 0), [-1.0]);
        assert_eq!(at(Shape::One { quantity: 0, degree: 2 }, 2), [1.0, 1.0]);
        let once = at(Shape::Turn { quantity: 0, times: 1 }, 2);
        assert!((once[0] - 1.0).abs() < 1e-15 && once[1].abs() < 1e-15);
    }
}
