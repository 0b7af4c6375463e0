//! Time or position? What passes while rows are taken, beside where they were taken.
//!
//! Place in the flow: the study of vectors asks here before it names a drift. A raster that goes through a plate row by row has
//! the time as a function of the position: then a machine that is out of square and one that warms up leave the same vectors.
//! Named is the error of position, which stays; the drift stands beside it as a rival. Columns over the standard uncertainty,
//! three rows a vector.

use super::quantities::{POSITION, TIME};
use super::shape::{HIGHEST, Quantity};
use faer::Mat;

/// What passes by itself: the beginnings of its names.
const PASSING: [&str; 4] = [TIME, "temp_", "pressure_", "humidity_"];
/// Degree of the polynomials of position, and most of them for a component.
const DEGREE: usize = HIGHEST;
const MOST: usize = 20;

/// Whether a quantity passes by itself while rows are taken, instead of being set with the position.
pub(super) fn passes(name: &str) -> bool {
    PASSING.iter().any(|own| name.starts_with(own))
}

/// Polynomials of the position (m) on these components: of the highest degree of which there are three vectors a term.
pub(super) fn of_position(quantities: &[Quantity], components: &[usize], sigma_m: &[[f64; 3]]) -> Mat<f64> {
    let own: Vec<&Quantity> = quantities.iter().filter(|quantity| POSITION.contains(&quantity.name.as_str())).collect();
    let count = sigma_m.len();
    let terms = (0..=DEGREE)
        .map(|degree| exponents(own.len(), degree))
        .take_while(|terms| terms.len() <= MOST.min(count / 3))
        .last()
        .unwrap_or_default();
    let mut columns = Mat::zeros(3 * count, components.len() * terms.len());
    for (j, term) in terms.iter().enumerate() {
        for k in 0..count {
            let value: f64 = term.iter().zip(&own).map(|(power, quantity)| quantity.powers[*power][k]).product();
            for (place, d) in components.iter().enumerate() {
                columns[(3 * k + d, place * terms.len() + j)] = value / sigma_m[k][*d];
            }
        }
    }
    columns
}

/// Polynomials of each position by itself (m) on these components.
pub(super) fn of_each_position(quantities: &[Quantity], components: &[usize], sigma_m: &[[f64; 3]]) -> Mat<f64> {
    let own: Vec<&Quantity> = quantities.iter().filter(|quantity| POSITION.contains(&quantity.name.as_str())).collect();
    let degree = HIGHEST.min(sigma_m.len() / 3 / own.len().max(1));
    let mut columns = Mat::zeros(3 * sigma_m.len(), components.len() * own.len() * degree);
    for (place, d) in components.iter().enumerate() {
        for (q, quantity) in own.iter().enumerate() {
            for power in 1..=degree {
                let j = (place * own.len() + q) * degree + power - 1;
                for (k, sigma_m) in sigma_m.iter().enumerate() {
                    columns[(3 * k + d, j)] = quantity.powers[power][k] / sigma_m[*d];
                }
            }
        }
    }
    columns
}

/// Exponents of all products of total degree 1 to `degree` of so many quantities.
fn exponents(quantities: usize, degree: usize) -> Vec<Vec<usize>> {
    let mut all = vec![Vec::new()];
    for _ in 0..quantities {
        let longer = |term: &Vec<usize>| {
            let left = degree - term.iter().sum::<usize>();
            (0..=left).map(|power| [term.as_slice(), &[power]].concat()).collect::<Vec<_>>()
        };
        all = all.iter().flat_map(longer).collect();
    }
    all.retain(|term| term.iter().sum::<usize>() > 0);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(side: usize) -> ([Quantity; 2], Vec<[f64; 3]>) {
        let quantity = |name: &str, of: fn(usize, usize) -> usize| {
            let values: Vec<f64> = (0..side * side).map(|k| of(k, side) as f64).collect();
            Quantity::new(name, values, (0.0, (side - 1) as f64))
        };
        ([quantity("x_m", |k, n| k % n), quantity("y_m", |k, n| k / n)], vec![[1.0; 3]; side * side])
    }

    #[test]
    fn polynomials_are_as_many_as_the_vectors_carry() {
        for (side, terms) in [(3, 2), (4, 5), (6, 9), (9, 14)] {
            let (quantities, sigma_m) = grid(side);
            assert_eq!(of_position(&quantities, &[0], &sigma_m).ncols(), terms, "{side}");
            assert_eq!(of_position(&quantities, &[0, 1], &sigma_m).ncols(), 2 * terms, "{side}");
        }
    }
}
