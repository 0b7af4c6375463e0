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
    let own = positions(quantities);
    let terms = (0..=DEGREE)
        .map(|degree| exponents(own.len(), degree))
        .take_while(|terms| terms.len() <= MOST.min(sigma_m.len() / 3))
        .last()
        .unwrap_or_default();
    columns(&own, &terms, components, sigma_m)
}

/// Polynomials of each position by itself (m) on these components.
pub(super) fn of_each_position(quantities: &[Quantity], components: &[usize], sigma_m: &[[f64; 3]]) -> Mat<f64> {
    let own = positions(quantities);
    let degree = DEGREE.min(sigma_m.len() / 3 / own.len().max(1));
    let alone = |q: usize, power: usize| (0..own.len()).map(|k| if k == q { power } else { 0 }).collect();
    let terms: Vec<Vec<usize>> =
        (0..own.len()).flat_map(|q| (1..=degree).map(move |power| (q, power))).map(|(q, p)| alone(q, p)).collect();
    columns(&own, &terms, components, sigma_m)
}

/// Courses of each of these components in the time, and of the scale of its axis: what warms up while rows are taken in an order.
pub(super) fn of_the_time(quantities: &[Quantity], components: &[usize], sigma_m: &[[f64; 3]]) -> Mat<f64> {
    let named = |name: &str| quantities.iter().find(|quantity| quantity.name == name);
    let Some(time) = named(TIME) else { return Mat::zeros(3 * sigma_m.len(), 0) };
    let along = |d: usize| named(POSITION[d]).map(|own| &own.powers[1]);
    let of = |d: &usize| std::iter::once((*d, None)).chain(along(*d).map(|along| (*d, Some(along))));
    let functions: Vec<(usize, Option<&Vec<f64>>)> = components.iter().flat_map(of).collect();
    // A third of the rows at most, as for polynomials of position.
    let degree = DEGREE.min(components.len() * sigma_m.len() / 3 / functions.len().max(1));
    let mut columns = Mat::zeros(3 * sigma_m.len(), functions.len() * degree);
    for (place, (d, along)) in functions.into_iter().enumerate() {
        for (k, sigma_m) in sigma_m.iter().enumerate() {
            let arm = along.map_or(1.0, |along| along[k]);
            (0..DEGREE)
                .for_each(|j| columns[(3 * k + d, place * degree + j)] = arm * time.powers[j + 1][k] / sigma_m[d]);
        }
    }
    columns
}

fn positions(quantities: &[Quantity]) -> Vec<&Quantity> {
    quantities.iter().filter(|quantity| POSITION.contains(&quantity.name.as_str())).collect()
}

/// Products of powers, by their exponents, on these components.
fn columns(own: &[&Quantity], terms: &[Vec<usize>], components: &[usize], sigma_m: &[[f64; 3]]) -> Mat<f64> {
    let mut columns = Mat::zeros(3 * sigma_m.len(), components.len() * terms.len());
    for (j, term) in terms.iter().enumerate() {
        for (k, sigma_m) in sigma_m.iter().enumerate() {
            let value: f64 = term.iter().zip(own).map(|(power, quantity)| quantity.powers[*power][k]).product();
            for (place, d) in components.iter().enumerate() {
                columns[(3 * k + d, place * terms.len() + j)] = value / sigma_m[*d];
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
