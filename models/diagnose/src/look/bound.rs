//! What pairs of quantities can explain at most, told by some of the rows in a fraction of the time.
//!
//! Place in the flow: [`super::look`] looks closely only at pairs that may be among the best. With the model's columns J free, what is
//! left of columns C is the least of |C − J B|² over all B, and some of the rows leave no more of it than all do:
//!
//! ```text
//! reduction of χ² = gᵀ left⁻¹ g ≤ gᵀ left(some rows)⁻¹ g,   g = Cᵀr of all rows
//! ```
//!
//! Where a direction is not told by some of the rows as surely as [`LEFT`] asks for, there is no bound. Columns that depend on others
//! (the third power of a side of approach) or that the model contains add nothing, and are left out. At least as many directions are
//! tested as columns are left then (eigenvalues of a part of a matrix interlace those of the whole). Whitened rows; no units.

use super::products::{Over, Products};
use super::{DEGREE, MIXED, TOGETHER, forms_of};
use crate::candidates::Round;
use crate::linear::{Linear, Projected, column, factor_above};
use crate::paired::add;
use crate::score::{LEFT, evidence_of, gain_of};
use faer::Mat;
use faer::linalg::solvers::Solve;

/// Rows for each column of the model: enough for a bound of some times what noise explains.
const ROWS_PER_COLUMN: usize = 3;
/// Share of the rows from which a bound costs too much beside what it saves.
const MOST: f64 = 0.5;
/// Step, in shares of a turn, that spreads rows evenly whatever repeats in a campaign: the golden ratio.
const STEP: f64 = 0.618_033_988_749_894_9;
/// Share of a column's information that is left of one that the model contains: the negligible prior of its columns, and rounding.
const ABSENT: f64 = 1e-7;

/// Some of the rows, and the fit of them.
pub(super) struct Part {
    fit: Linear,
    rows: Vec<usize>,
}

impl Part {
    /// `None` where most rows would be needed.
    pub(super) fn of(round: &Round) -> Option<Part> {
        let used: Vec<usize> = (0..round.rows.len()).filter(|k| round.rows.whitening[*k] > 0.0).collect();
        let share = (ROWS_PER_COLUMN * round.free.jacobian().ncols()) as f64 / used.len().max(1) as f64;
        if share > MOST {
            return None;
        }
        let is_one = |place: usize| (place as f64 * STEP).fract() < share;
        let rows: Vec<usize> =
            used.into_iter().enumerate().filter(|(place, _)| is_one(*place)).map(|(_, k)| k).collect();
        Some(Part { fit: round.free.part(&rows).ok()?, rows })
    }
}

/// What the columns of one act are made of.
pub(super) struct Pairs<'a> {
    pub(super) round: &'a Round<'a>,
    pub(super) powers: &'a [Mat<f64>],
    pub(super) weights: &'a [f64],
    /// What each quantity does alone, over all rows.
    pub(super) own: &'a Products,
    pub(super) trials: usize,
}

impl Pairs<'_> {
    /// The most evidence that each pair can have in any form, given with the quantities of it that count alone; infinite without a bound.
    pub(super) fn at_most(&self, part: &Part, pairs: &[((usize, usize), Vec<usize>)]) -> Vec<f64> {
        let over = Over { round: self.round, part: Some((&part.fit, &part.rows)) };
        let courses: Vec<Course> = self.powers.iter().map(Course::of).collect();
        let own = Products::of_each(over, self.powers, self.weights);
        let absent = self.absent();
        let mut all = Vec::with_capacity(pairs.len());
        for batch in pairs.chunks(TOGETHER) {
            let of_batch: Vec<(usize, usize)> = batch.iter().map(|(pair, _)| *pair).collect();
            let mixed = Products::of_pairs(over, self.powers, self.weights, &of_batch);
            for (place, ((a, b), quantities)) in batch.iter().enumerate() {
                let group = mixed.with(place, &own, quantities);
                let runs = std::iter::once(mixed.squares(place)).chain(quantities.iter().map(|q| own.squares(*q)));
                let squares: Vec<f64> = runs.flatten().copied().collect();
                let [alone, together] = new_ones((*a, *b), quantities, &courses, &absent);
                let of_form = |form: Vec<usize>| {
                    let new = if form.iter().all(|k| *k < MIXED.len()) { &alone } else { &together };
                    let members: Vec<usize> = form.into_iter().filter(|k| new.contains(k)).collect();
                    let squares: Vec<f64> = members.iter().map(|k| squares[*k]).collect();
                    self.evidence_at_most(&group.pick(&members), &squares)
                };
                all.push(forms_of(quantities.len()).into_iter().map(of_form).fold(f64::NEG_INFINITY, f64::max));
            }
        }
        all
    }

    /// What the model contains, of the constant (degree 0) and of what quantities do alone: quantity and degree.
    fn absent(&self) -> Vec<(usize, usize)> {
        let is_absent = |group: &Projected, k: usize| group.left[(k, k)] <= ABSENT * group.alone[(k, k)];
        let mut constant = self.weights.to_vec();
        self.round.rows.whiten(&mut constant);
        let mut absent = Vec::new();
        if is_absent(&self.round.free.project(column(&constant).as_ref()), 0) {
            absent.push((0, 0));
        }
        for quantity in 0..self.powers.len() {
            let alone = self.own.of(quantity);
            absent.extend((0..DEGREE).filter(|k| is_absent(&alone, *k)).map(|k| (quantity, k + 1)));
        }
        absent
    }

    /// The most evidence of these columns, of which |C|² over all rows is known; infinite without a bound.
    fn evidence_at_most(&self, group: &Projected, squares: &[f64]) -> f64 {
        if squares.is_empty() {
            return f64::NEG_INFINITY;
        }
        let fit = &self.round.free;
        match reduction_at_most(group, squares) {
            Some(reduction) if reduction < fit.chi2() => {
                let gain = gain_of(reduction, fit.chi2(), fit.degrees());
                evidence_of(gain, squares.len(), (self.round.used, self.trials))
            }
            _ => f64::INFINITY,
        }
    }
}

/// The largest reduction of χ² by columns of which some rows tell what is left, and all rows the gradient and |C|².
fn reduction_at_most(group: &Projected, squares: &[f64]) -> Option<f64> {
    let count = squares.len();
    let scale: Vec<f64> = squares.iter().map(|square| square.sqrt().recip()).collect();
    let left = Mat::from_fn(count, count, |i, j| group.left[(i, j)] * scale[i] * scale[j]);
    let factor = factor_above(&left, LEFT)?;
    let gradient: Vec<f64> = group.gradient.iter().zip(&scale).map(|(g, s)| g * s).collect();
    let estimate = factor.solve(column(&gradient));
    Some(gradient.iter().enumerate().map(|(k, g)| g * estimate[(k, 0)]).sum())
}

/// Polynomials of one quantity (degrees 0 … DEGREE) as vectors that depend on each other as the polynomials do: their values where the
/// quantity was set to a few, else directions of their own.
struct Course(Vec<Vec<f64>>);

impl Course {
    fn of(powers: &Mat<f64>) -> Course {
        let mut levels: Vec<usize> = Vec::new();
        for k in 0..powers.nrows() {
            if levels.len() <= DEGREE && !levels.iter().any(|other| powers[(*other, 0)] == powers[(k, 0)]) {
                levels.push(k);
            }
        }
        let value = |degree: usize, k: usize| if degree == 0 { 1.0 } else { powers[(k, degree - 1)] };
        let vector = |degree: usize| match levels.len() > DEGREE {
            true => (0..=DEGREE).map(|other| f64::from(u8::from(other == degree))).collect(),
            false => levels.iter().map(|k| value(degree, *k)).collect(),
        };
        Course((0..=DEGREE).map(vector).collect())
    }

    /// The product of a polynomial of this quantity and one of another.
    fn times(&self, degree: usize, other: &Course, other_degree: usize) -> Vec<f64> {
        self.0[degree].iter().flat_map(|a| other.0[other_degree].iter().map(move |b| a * b)).collect()
    }
}

/// Columns of a pair that depend neither on what the model contains nor on others of no higher degree: among the mixed products alone, and
/// among these with what quantities do alone.
fn new_ones(
    (a, b): (usize, usize),
    quantities: &[usize],
    courses: &[Course],
    absent: &[(usize, usize)],
) -> [Vec<usize>; 2] {
    let product = |i: usize, j: usize| courses[a].times(i, &courses[b], j);
    let alone = |q: usize, degree: usize| if q == a { product(degree, 0) } else { product(0, degree) };
    let mut contained = Vec::new();
    let of_pair = absent.iter().filter(|(q, degree)| *degree == 0 || *q == a || *q == b);
    of_pair.for_each(|(q, degree)| add(&mut contained, alone(*q, *degree)));
    let mixed = MIXED.iter().enumerate().map(|(k, (i, j))| (i + j, k, product(*i, *j)));
    let own = quantities.iter().flat_map(|q| (1..=DEGREE).map(move |degree| (degree, alone(*q, degree))));
    let own = own.enumerate().map(|(k, (degree, vector))| (degree, MIXED.len() + k, vector));
    let mut all: Vec<(usize, usize, Vec<f64>)> = mixed.chain(own).collect();
    all.sort_by_key(|(degree, k, _)| (*degree, *k));
    [MIXED.len(), all.len()].map(|count| {
        let mut before = contained.clone();
        let mut is_new = |vector: &Vec<f64>| {
            let known = before.len();
            add(&mut before, vector.clone());
            before.len() > known
        };
        all.iter().filter(|(_, k, _)| *k < count).filter(|(_, _, vector)| is_new(vector)).map(|(_, k, _)| *k).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::score;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const ROWS: usize = 240;

    /// Whatever the columns and the noise, and closely where most rows are looked at.
    #[test]
    fn some_rows_bound_what_all_explain() {
        for seed in 0..40 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut of = |columns: usize| Mat::from_fn(ROWS, columns, |_, _| random.random::<f64>() - 0.5);
            let (model, group, noise) = (of(9), of(3), of(1));
            // A third of the seeds show the group.
            let size = f64::from(u8::from(seed % 3 == 0));
            let observed: Vec<f64> = (0..ROWS).map(|k| noise[(k, 0)] + size * group[(k, 1)]).collect();
            let (fit, _) = Linear::least_squares(model, &observed).unwrap();
            let all = fit.project(group.as_ref());
            let reduction = score(&all, fit.chi2(), fit.degrees()).reduction;
            let squares: Vec<f64> = (0..3).map(|k| all.alone[(k, k)]).collect();
            let bound = |rows: Vec<usize>| {
                let part = Mat::from_fn(rows.len(), 3, |i, j| group[(rows[i], j)]);
                let left = fit.part(&rows).unwrap().project(part.as_ref()).left;
                reduction_at_most(&Projected { left, ..all.clone() }, &squares).unwrap()
            };
            let third = bound((0..ROWS).filter(|k| k % 3 == 1).collect());
            assert!(third > reduction, "{seed}: {third} {reduction}");
            let most = bound((0..ROWS).filter(|k| k % 20 > 0).collect());
            assert!(most > reduction && most < 1.4 * reduction, "{seed}: {most} {reduction}");
        }
    }

    /// A side is −1, 0 or 1: its third power is the first, its fourth the second. Beside a free quantity, with the constant in the model.
    #[test]
    fn columns_that_depend_on_others_add_nothing() {
        let course = |values: &[f64]| Course::of(&super::super::legendre(values));
        let courses = [course(&[-1.0, 0.0, 1.0, 0.0, -1.0]), course(&[-1.0, -0.3, 0.1, 0.2, 0.7, 1.0])];
        let [mixed, all] = new_ones((0, 1), &[0, 1], &courses, &[(0, 0)]);
        // Of the products, side³ times the other is dropped; alone, P_3 and P_4 of the side; side² q is new beside q.
        assert_eq!(mixed, [0, 1, 2, 4, 5]);
        assert_eq!(all, [6, 10, 0, 7, 11, 1, 2, 12, 4, 5, 13]);
        // Where the constant is not in the model, the fourth power of a side is another column.
        let [_, free] = new_ones((0, 1), &[0, 1], &courses, &[]);
        assert!(free.contains(&9) && !free.contains(&8), "{free:?}");
    }
}
