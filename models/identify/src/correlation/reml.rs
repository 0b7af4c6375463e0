//! Parameters of the correlation by restricted maximum likelihood, beside everything that the fit explains.
//!
//! Place in the flow: a linear fit and the orders in which its noise may be correlated; the likeliest order and its
//! [`Correlation`] out, or nothing where white noise does as well. Each value of the likelihood is one normal matrix of the
//! whitened rows, so that a fit whose columns could take up the correlation is charged for it.

use super::{Correlation, Sequence, Whitener};
use crate::linear::log_determinant;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::solvers::{Llt, Solve};
use faer::{Accum, Mat, MatRef, Par, Side};

/// Largest share of the variance that is not white: less than half a per cent is below what any data tell.
const MOST: f64 = 0.995;
/// Lengths that are told apart, in units of the usual step: shorter is white, longer an offset.
const LENGTHS: (f64, f64) = (0.2, 1e4);
/// First look: a share, and a length in units of the usual step, at which shorter and longer correlations show too.
const LOOK: (f64, f64) = (0.1, 5.0);
/// Twice the log likelihood that the first look must gain for the search to begin.
const LOOK_GAIN: f64 = 2.0;
/// Starts of the search: lengths in units of the usual step, and the share.
const STARTS: ([f64; 2], f64) = ([1.5, 15.0], 0.4);
/// Twice the log likelihood that two parameters and the choice among a few orders must gain: one in some hundreds of white
/// data sets does by chance.
const SHOWN: f64 = 14.0;
/// Twice the log likelihood that one parameter more (an offset of each group) must gain.
const ONE_MORE: f64 = 8.0;
/// Twice the log likelihood by which orders differ that are not told apart.
const EQUAL: f64 = 0.5;
/// Step aside from a start, distance at which a point counts half, and reach of a plane through points, in the logarithms
/// that are searched.
const ASIDE: f64 = 0.5;
const NEAR: f64 = 0.3;
const REACH: f64 = 1.5;
/// What a point beyond costs.
const BEYOND: f64 = 1e3;
/// Steps along such planes at most, and twice the log likelihood to which the last must tell what comes.
const MOST_FOLLOWED: usize = 5;
const FOLLOWED: f64 = 0.3;
/// Evaluations of one search at most, and the change of twice the log likelihood that ends it.
const MOST_EVALUATIONS: usize = 60;
const SETTLED: f64 = 0.02;
/// Share of the residuals' square that rounding leaves of data without any noise.
const ROUNDING: f64 = 1e-24;

/// A linear fit, of whose noise the correlation is asked.
#[derive(Debug, Clone, Copy)]
pub struct Fitted<'a> {
    /// Rows × parameters, divided by the declared uncertainty, not by weights.
    pub design: MatRef<'a, f64>,
    /// What a fit by these columns with white noise left, in the same rows.
    pub residuals: &'a [f64],
    /// Robust weights; rows without weight do not take part.
    pub weights: &'a [f64],
    /// Precision of the parameters' prior for unit noise, whose factor is found with the fit.
    pub prior: MatRef<'a, f64>,
    /// Directions of the parameters without a prior.
    pub improper: usize,
}

/// What the data say of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Which of the orders offered it goes by.
    pub sequence: usize,
    /// Its parameters.
    pub correlation: Correlation,
    /// Gain of twice the restricted log likelihood over white noise.
    pub gain: f64,
}

/// A value of the restricted likelihood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Restricted {
    /// −2 log, up to a constant.
    pub minus_two_log: f64,
    /// Variance of a row for which it is best.
    pub noise_factor: f64,
}

impl Fitted<'_> {
    /// −2 log of the restricted likelihood with the noise factor at its best, up to a constant; `None` where the parameters are
    /// not determined.
    pub fn minus_two_log_likelihood(&self, whitener: Option<&Whitener>) -> Option<f64> {
        self.restricted(whitener).map(|restricted| restricted.minus_two_log)
    }

    /// The restricted likelihood with the noise factor at its best, and that factor; `None` where the parameters are not
    /// determined.
    pub fn restricted(&self, whitener: Option<&Whitener>) -> Option<Restricted> {
        let (mut design, mut observed) = (self.design.to_owned(), self.residuals.to_vec());
        let of_whitener = match whitener {
            Some(whitener) => {
                let left_out: Vec<usize> = (0..observed.len()).filter(|k| self.weights[*k] <= 0.0).collect();
                let clear = |column: &mut [f64]| left_out.iter().for_each(|k| column[*k] = 0.0);
                whitener.apply_to_columns(&mut design);
                (0..design.ncols()).for_each(|j| clear(design.col_as_slice_mut(j)));
                whitener.apply(&mut observed);
                clear(&mut observed);
                whitener.log_determinant()
            }
            None => {
                let roots: Vec<f64> = self.weights.iter().map(|w| w.sqrt()).collect();
                let weigh = |column: &mut [f64]| column.iter_mut().zip(&roots).for_each(|(v, root)| *v *= root);
                (0..design.ncols()).for_each(|j| weigh(design.col_as_slice_mut(j)));
                weigh(&mut observed);
                -self.weights.iter().filter(|w| **w > 0.0).map(|w| w.ln()).sum::<f64>()
            }
        };
        let used = self.weights.iter().filter(|w| **w > 0.0).count();
        let mut normal = self.prior.to_owned();
        let half = BlockStructure::TriangularLower;
        let (left, right) = (design.transpose(), design.as_ref());
        let full = BlockStructure::Rectangular;
        triangular::matmul(normal.as_mut(), half, Accum::Add, left, full, right, full, 1.0, Par::Seq);
        let before: f64 = self.residuals.iter().map(|r| r * r).sum();
        let observed = Mat::from_fn(observed.len(), 1, |k, _| observed[k]);
        let gradient = design.transpose() * &observed;
        let factor = Llt::new(normal.as_ref(), Side::Lower).ok()?;
        let explained = (gradient.transpose() * factor.solve(&gradient))[(0, 0)];
        let square = (observed.squared_norm_l2() - explained).max(ROUNDING * before).max(f64::MIN_POSITIVE);
        let degrees = used.saturating_sub(self.improper).max(1) as f64;
        let minus_two_log = degrees * square.ln() + log_determinant(&factor) + of_whitener;
        minus_two_log.is_finite().then_some(Restricted { minus_two_log, noise_factor: square / degrees })
    }

    /// Whether any correlation shows at first sight, at the price of two values of the likelihood: where not, there is no need to
    /// search. A small part of the rows is enough.
    pub fn hints_at_correlation(&self, sequence: &Sequence) -> bool {
        let Some(unit) = sequence.usual_step() else { return false };
        let look = Correlation { share: LOOK.0, length: LOOK.1 * unit, group_share: 0.0 };
        self.minus_two_log_likelihood(None).is_some_and(|white| self.of(sequence, &look) < white - LOOK_GAIN)
    }

    /// The correlation of the noise by one of these orders, where it is shown.
    ///
    /// Orders are compared, and the search is led, by the likelihood that the residuals would have if no parameter had been
    /// fitted to them, which takes no matrix; what the parameters add to it changes slowly and is followed as it goes.
    pub fn correlation(&self, sequences: &[Sequence]) -> Option<Found> {
        let steps: Vec<Option<f64>> = sequences.iter().map(Sequence::usual_step).collect();
        let white = self.minus_two_log_likelihood(None)?;
        let alone = self.alone();
        let (sequence, start) = alone.best_start(sequences, &steps)?;
        let unit = steps[sequence]?;
        let (mut best, mut value) = self.follow(&alone, &sequences[sequence], &start, unit);
        let half = Correlation { share: 0.7 * best.share, group_share: 0.3 * best.share, ..best };
        let with_offset = alone.minimum(&sequences[sequence], &half, unit);
        if best.group_share == 0.0 && with_offset.1 < alone.of(&sequences[sequence], &start) - ONE_MORE {
            let (richer, reached) = self.follow(&alone, &sequences[sequence], &with_offset.0, unit);
            if reached < value - ONE_MORE {
                (best, value) = (richer, reached);
            }
        }
        (value < white - SHOWN).then_some(Found { sequence, correlation: best, gain: white - value })
    }

    fn of(&self, sequence: &Sequence, correlation: &Correlation) -> f64 {
        let whitener = Whitener::new(sequence, correlation, self.weights);
        self.minus_two_log_likelihood(Some(&whitener)).unwrap_or(f64::INFINITY)
    }

    /// The residuals of the white fit as if nothing had been fitted to them.
    fn alone(&self) -> Alone<'_> {
        let used = self.weights.iter().filter(|w| **w > 0.0).count();
        let degrees = used.saturating_sub(self.improper).max(1) as f64;
        Alone { residuals: self.residuals, weights: self.weights, degrees }
    }

    /// Search from `start`: the likelihood of the residuals alone plus a plane through what the fit adds to it at the points
    /// visited, until the plane tells what comes.
    fn follow(&self, alone: &Alone, sequence: &Sequence, start: &Correlation, unit: f64) -> (Correlation, f64) {
        let exact = |point: &[f64]| self.of(sequence, &unpacked(point, unit));
        let cheap = |point: &[f64]| alone.of(sequence, &unpacked(point, unit));
        let first = packed(start, unit);
        let size = first.len();
        let mut known = vec![(first.clone(), exact(&first))];
        for k in 0..size {
            let mut corner = first.clone();
            corner[k] += ASIDE;
            let value = exact(&corner);
            known.push((corner, value));
        }
        for _ in 0..MOST_FOLLOWED {
            let Some(least) = known.iter().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(point, _)| point.clone()) else {
                break;
            };
            let added: Vec<Sample> = known.iter().map(|(point, value)| (point.clone(), value - cheap(point))).collect();
            let Some(plane) = Plane::through(&added, &least) else { break };
            let far =
                |point: &[f64]| point.iter().zip(&least).map(|(p, l)| ((p - l).abs() - REACH).max(0.0)).sum::<f64>();
            let (next, promised) = minimum(&least, &|p: &[f64]| cheap(p) + plane.at(p) + BEYOND * far(p));
            let reached = exact(&next);
            known.push((next, reached));
            if (reached - promised).abs() < FOLLOWED {
                break;
            }
        }
        let best = known.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
        best.map_or((*start, f64::INFINITY), |(point, value)| (unpacked(&point, unit), value))
    }
}

/// Residuals whose correlation is asked as if nothing had been fitted to them.
struct Alone<'a> {
    residuals: &'a [f64],
    weights: &'a [f64],
    degrees: f64,
}

impl Alone<'_> {
    fn of(&self, sequence: &Sequence, correlation: &Correlation) -> f64 {
        let whitener = Whitener::new(sequence, correlation, self.weights);
        let mut residuals = self.residuals.to_vec();
        whitener.apply(&mut residuals);
        let square: f64 = residuals.iter().zip(self.weights).filter(|(_, w)| **w > 0.0).map(|(r, _)| r * r).sum();
        self.degrees * square.max(f64::MIN_POSITIVE).ln() + whitener.log_determinant()
    }

    fn minimum(&self, sequence: &Sequence, start: &Correlation, unit: f64) -> (Correlation, f64) {
        let (point, value) = minimum(&packed(start, unit), &|p: &[f64]| self.of(sequence, &unpacked(p, unit)));
        (unpacked(&point, unit), value)
    }

    /// The likeliest order and its parameters; of equals the one offered first.
    fn best_start(&self, sequences: &[Sequence], steps: &[Option<f64>]) -> Option<(usize, Correlation)> {
        let mut best: Option<(f64, usize, Correlation)> = None;
        for (k, (sequence, unit)) in sequences.iter().zip(steps).enumerate() {
            let Some(unit) = *unit else { continue };
            // Another order begins where the best one ended, in its own unit.
            let start = |length: f64| Correlation { share: STARTS.1, length: length * unit, group_share: 0.0 };
            let starts = match best.as_ref().and_then(|(_, k, found)| Some((found, steps[*k]?))) {
                Some((found, other)) => vec![Correlation { length: found.length / other * unit, ..*found }],
                None => STARTS.0.map(start).to_vec(),
            };
            for start in starts {
                let (found, value) = self.minimum(sequence, &start, unit);
                if best.is_none_or(|(least, _, _)| value < least - EQUAL) {
                    best = Some((value, k, found));
                }
            }
        }
        best.map(|(_, k, found)| (k, found))
    }
}

/// A point and the value of the likelihood there.
type Sample = (Vec<f64>, f64);

/// A plane through the points nearest to one of them.
struct Plane {
    at: Vec<f64>,
    value: f64,
    slopes: Vec<f64>,
}

impl Plane {
    /// By least squares over all points, near ones counting more.
    fn through(points: &[Sample], about: &[f64]) -> Option<Plane> {
        let size = about.len();
        let weight = |point: &[f64]| {
            let square: f64 = point.iter().zip(about).map(|(p, a)| (p - a).powi(2)).sum();
            1.0 / (NEAR * NEAR + square)
        };
        let column = |point: &[f64], k: usize| if k == 0 { 1.0 } else { point[k - 1] - about[k - 1] };
        let sum = |of: &dyn Fn(&Sample) -> f64| points.iter().map(|p| weight(&p.0) * of(p)).sum::<f64>();
        let normal = Mat::from_fn(size + 1, size + 1, |i, j| sum(&|p| column(&p.0, i) * column(&p.0, j)));
        let right = Mat::from_fn(size + 1, 1, |i, _| sum(&|p| column(&p.0, i) * p.1));
        let solved = Llt::new(normal.as_ref(), Side::Lower).ok()?.solve(&right);
        let slopes = (0..size).map(|k| solved[(k + 1, 0)]).collect();
        Some(Plane { at: about.to_vec(), value: solved[(0, 0)], slopes })
    }

    fn at(&self, point: &[f64]) -> f64 {
        let along = point.iter().zip(&self.at).zip(&self.slopes).map(|((p, a), slope)| slope * (p - a)).sum::<f64>();
        self.value + along
    }
}

/// Unbounded coordinates of the parameters.
fn packed(correlation: &Correlation, unit: f64) -> Vec<f64> {
    let logit = |share: f64| {
        let share = share.clamp(1e-4, 1.0 - 1e-4);
        (share / (1.0 - share)).ln()
    };
    let total = correlation.share + correlation.group_share;
    let mut point = vec![logit(total / MOST), (correlation.length / unit).ln()];
    if correlation.group_share > 0.0 {
        point.push(logit(correlation.group_share / total));
    }
    point
}

fn unpacked(point: &[f64], unit: f64) -> Correlation {
    let share = |x: f64| 1.0 / (1.0 + (-x).exp());
    let total = MOST * share(point[0]);
    let group_share = point.get(2).map_or(0.0, |x| total * share(*x));
    let length = unit * point[1].clamp(LENGTHS.0.ln(), LENGTHS.1.ln()).exp();
    Correlation { share: total - group_share, length, group_share }
}

/// Least value of a function of a few unbounded coordinates and where it lies (Nelder & Mead 1965).
fn minimum(start: &[f64], of: &dyn Fn(&[f64]) -> f64) -> (Vec<f64>, f64) {
    let size = start.len();
    let mut simplex: Vec<Sample> = vec![(start.to_vec(), of(start))];
    for k in 0..size {
        let mut corner = start.to_vec();
        corner[k] += 0.7;
        let value = of(&corner);
        simplex.push((corner, value));
    }
    let mut evaluations = size + 1;
    while evaluations < MOST_EVALUATIONS {
        simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
        if simplex[size].1 - simplex[0].1 < SETTLED {
            break;
        }
        let centre: Vec<f64> =
            (0..size).map(|k| simplex[..size].iter().map(|(p, _)| p[k]).sum::<f64>() / size as f64).collect();
        let worst = simplex[size].clone();
        let mut at = |by: f64| {
            evaluations += 1;
            let point: Vec<f64> = centre.iter().zip(&worst.0).map(|(c, w)| c + by * (c - w)).collect();
            let value = of(&point);
            (point, value)
        };
        let reflected = at(1.0);
        let mut next = reflected.clone();
        if reflected.1 < simplex[0].1 {
            let further = at(2.0);
            next = if further.1 < reflected.1 { further } else { next };
        } else if reflected.1 >= simplex[size - 1].1 {
            let within = at(if reflected.1 < worst.1 { 0.5 } else { -0.5 });
            next = if within.1 < reflected.1 { within } else { next };
        }
        if next.1 < worst.1 {
            simplex[size] = next;
        } else {
            let best = simplex[0].0.clone();
            for (point, value) in &mut simplex[1..] {
                point.iter_mut().zip(&best).for_each(|(p, b)| *p = 0.5 * (*p + b));
                *value = of(point);
            }
            evaluations += size;
        }
    }
    simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (point, value) = simplex.swap_remove(0);
    (point, value)
}
