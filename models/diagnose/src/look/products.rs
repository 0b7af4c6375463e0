//! Columns of one act with what projection takes of them, and the Gram matrices of groups among them.
//!
//! Place in the flow: [`super::look`] tests each pair of quantities in several forms. All forms of a pair are made of the
//! same few columns, so these are multiplied once and the forms pick from the result. Whitened rows; no units.

use super::{DEGREE, MIXED};
use crate::candidates::Round;
use crate::linear::{Linear, Projected, picked};
use abbe_identify::dot;
use faer::{Mat, MatRef};

/// Columns in runs of equal length, one run a quantity or a pair.
pub(super) struct Products {
    run: usize,
    columns: Mat<f64>,
    /// LᵀJᵀC of the fit.
    taken: Mat<f64>,
    /// Cᵀr of all rows.
    gradient: Vec<f64>,
    /// |C|² of all rows, column by column.
    squares: Vec<f64>,
}

/// A round, and which of its rows columns are multiplied over: all, or those of a fit of some.
#[derive(Clone, Copy)]
pub(super) struct Over<'a> {
    pub(super) round: &'a Round<'a>,
    pub(super) part: Option<(&'a Linear, &'a [usize])>,
}

impl Products {
    /// Polynomials of each quantity (rows × degrees), times the weights.
    pub(super) fn of_each(over: Over, powers: &[Mat<f64>], weights: &[f64]) -> Products {
        let fill = |c: usize, column: &mut [f64]| {
            let power = powers[c / DEGREE].col_as_slice(c % DEGREE);
            column.iter_mut().zip(weights).zip(power).for_each(|((value, w), p)| *value = w * p);
        };
        Products::new(over, DEGREE, (weights.len(), DEGREE * powers.len()), fill)
    }

    /// Mixed products of the polynomials of these pairs of quantities, times the weights.
    pub(super) fn of_pairs(over: Over, powers: &[Mat<f64>], weights: &[f64], pairs: &[(usize, usize)]) -> Products {
        let fill = |c: usize, column: &mut [f64]| {
            let ((a, b), (i, j)) = (pairs[c / MIXED.len()], MIXED[c % MIXED.len()]);
            let (first, second) = (powers[a].col_as_slice(i - 1), powers[b].col_as_slice(j - 1));
            let factors = weights.iter().zip(first).zip(second);
            column.iter_mut().zip(factors).for_each(|(value, ((w, p), q))| *value = w * p * q);
        };
        Products::new(over, MIXED.len(), (weights.len(), MIXED.len() * pairs.len()), fill)
    }

    fn new(over: Over, run: usize, (rows, count): (usize, usize), fill: impl Fn(usize, &mut [f64])) -> Products {
        let Over { round, part } = over;
        let mut columns = Mat::zeros(rows, count);
        for c in 0..count {
            let column = columns.col_as_slice_mut(c);
            fill(c, column);
            round.rows.whiten(column);
        }
        let gradient = round.free.gradient(columns.as_ref());
        let squares = (0..count).map(|c| dot(columns.col_as_slice(c), columns.col_as_slice(c))).collect();
        let (fit, columns) = match part {
            None => (&*round.free, columns),
            Some((fit, rows)) => (fit, picked(columns.as_ref(), rows)),
        };
        Products { run, taken: fit.taken(columns.as_ref()), columns, gradient, squares }
    }

    /// |C|² of all rows of one run.
    pub(super) fn squares(&self, place: usize) -> &[f64] {
        &self.squares[place * self.run..(place + 1) * self.run]
    }

    /// What the columns of one run tell.
    pub(super) fn of(&self, place: usize) -> Projected {
        Group { parts: vec![self.part(place)] }.projected()
    }

    /// What the columns of one run tell together with those of other runs, in this order.
    pub(super) fn with(&self, place: usize, others: &Products, runs: &[usize]) -> Projected {
        let others = runs.iter().map(|run| others.part(*run));
        Group { parts: std::iter::once(self.part(place)).chain(others).collect() }.projected()
    }

    fn part(&self, place: usize) -> Part<'_> {
        let (first, count) = (place * self.run, self.run);
        Part {
            columns: self.columns.as_ref().subcols(first, count),
            taken: self.taken.as_ref().subcols(first, count),
            gradient: &self.gradient[first..first + count],
        }
    }
}

/// One run.
struct Part<'a> {
    columns: MatRef<'a, f64>,
    taken: MatRef<'a, f64>,
    gradient: &'a [f64],
}

/// Runs that are looked at together.
struct Group<'a> {
    parts: Vec<Part<'a>>,
}

impl Group<'_> {
    fn projected(&self) -> Projected {
        let alone = self.gram(|part| part.columns);
        let left = &alone - self.gram(|part| part.taken);
        Projected { gradient: self.parts.iter().flat_map(|part| part.gradient).copied().collect(), alone, left }
    }

    /// Gram matrix of all columns, block by block.
    fn gram(&self, of: impl for<'a> Fn(&'a Part<'a>) -> MatRef<'a, f64>) -> Mat<f64> {
        let total = self.parts.iter().map(|part| part.gradient.len()).sum();
        let mut gram = Mat::zeros(total, total);
        let mut row = 0;
        for (k, part) in self.parts.iter().enumerate() {
            let mut column = row;
            for other in &self.parts[k..] {
                let block = of(part).transpose() * of(other);
                for j in 0..block.ncols() {
                    for i in 0..block.nrows() {
                        gram[(row + i, column + j)] = block[(i, j)];
                        gram[(column + j, row + i)] = block[(i, j)];
                    }
                }
                column += other.gradient.len();
            }
            row += part.gradient.len();
        }
        gram
    }
}
