//! Size, smoothness and noise of the residual field that make the ranges likeliest.
//!
//! Place in the flow: before [`crate::ranges`] estimates. Pattern search (Hooke & Jeeves 1961) in logarithms: each number
//! in turn up or down by a factor, smaller factors when nothing helps. No randomness, no derivatives; some hundred
//! evaluations on a thinned campaign.

use crate::ResidualError;
use crate::evidence::{Factored, FieldPrior};
use crate::problem::Problem;

/// First and last factor of a step.
const FIRST_STEP: f64 = 2.0;
const LAST_STEP: f64 = 1.15;
/// Amplitudes a search may reach (m): a nanometre, a tenth of a millimetre.
const AMPLITUDES_M: [f64; 2] = [1e-9, 1e-4];
/// Lengths a search may reach, as a share of the volume's extent.
const LENGTHS: [f64; 2] = [0.05, 4.0];
/// Length a search starts from.
const FIRST_LENGTH: f64 = 0.4;
/// Noise over declared noise that a search may reach.
const NOISES: [f64; 2] = [0.2, 30.0];

/// Numbers of a prior, for a search in each of them: amplitudes, lengths, noise.
const NUMBERS: usize = 7;

fn numbers(prior: &FieldPrior) -> [f64; NUMBERS] {
    let ([ax, ay, az], [lx, ly, lz]) = (prior.amplitude_m, prior.length_m);
    [ax, ay, az, lx, ly, lz, prior.noise]
}

fn prior_of([ax, ay, az, lx, ly, lz, noise]: [f64; NUMBERS]) -> FieldPrior {
    FieldPrior { amplitude_m: [ax, ay, az], length_m: [lx, ly, lz], noise }
}

/// A prior that makes these rows likely, and the best one without any field; `observe` sees the number of evaluations and
/// returns false to stop.
pub(crate) fn search(
    problem: &Problem,
    observe: &mut dyn FnMut(usize) -> bool,
) -> Result<(FieldPrior, FieldPrior), ResidualError> {
    let extent = extent_m(problem);
    let limits: [[f64; 2]; NUMBERS] = std::array::from_fn(|k| match k {
        0..3 => AMPLITUDES_M,
        3..6 => LENGTHS.map(|share| share * extent[k - 3]),
        _ => NOISES,
    });
    let noise = problem.residuals.iter().map(|l| l * l).sum::<f64>() / problem.len() as f64;
    let in_metres = problem.residuals.iter().zip(&problem.whitening).map(|(l, w)| (l / w).powi(2)).sum::<f64>();
    let size_m = (in_metres / problem.len() as f64).sqrt().clamp(AMPLITUDES_M[0], AMPLITUDES_M[1]);
    let length_m = extent.map(|e| FIRST_LENGTH * e);
    let mut evaluations = Evaluations { problem, observe, count: 0 };
    let none = FieldPrior { amplitude_m: [0.0; 3], length_m, noise: noise.sqrt().clamp(NOISES[0], NOISES[1]) };
    let none = evaluations.descend(none, &limits, &[6])?;
    let start = FieldPrior { amplitude_m: [size_m; 3], length_m, noise: none.noise.min(1.0) };
    let field = evaluations.descend(start, &limits, &[0, 1, 2, 3, 4, 5, 6])?;
    Ok((field, none))
}

struct Evaluations<'a> {
    problem: &'a Problem,
    observe: &'a mut dyn FnMut(usize) -> bool,
    count: usize,
}

impl Evaluations<'_> {
    fn at(&mut self, prior: &FieldPrior) -> Result<f64, ResidualError> {
        self.count += 1;
        if !(self.observe)(self.count) {
            return Err(ResidualError::Stopped);
        }
        Ok(Factored::new(self.problem, prior)?.minus_two_log_likelihood)
    }

    /// Lowest −2 ln L that steps in the `free` numbers lead to.
    fn descend(
        &mut self,
        start: FieldPrior,
        limits: &[[f64; 2]; NUMBERS],
        free: &[usize],
    ) -> Result<FieldPrior, ResidualError> {
        let mut best = numbers(&start);
        let mut lowest = self.at(&start)?;
        let mut step = FIRST_STEP;
        while step >= LAST_STEP {
            let mut helped = false;
            for k in free {
                for factor in [step, 1.0 / step] {
                    let mut tried = best;
                    tried[*k] = (tried[*k] * factor).clamp(limits[*k][0], limits[*k][1]);
                    if tried[*k] == best[*k] {
                        continue;
                    }
                    let value = self.at(&prior_of(tried))?;
                    if value < lowest {
                        (best, lowest, helped) = (tried, value, true);
                        break;
                    }
                }
            }
            if !helped {
                step = step.sqrt();
            }
        }
        Ok(prior_of(best))
    }
}

/// Extent of the points along each axis (m), at least a tenth of the largest.
fn extent_m(problem: &Problem) -> [f64; 3] {
    let along = |d: usize| {
        let values = problem.points_m.iter().map(|p| p[d]);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        high - low
    };
    let extent = [along(0), along(1), along(2)];
    let most = extent.iter().fold(f64::MIN_POSITIVE, |a, b| a.max(*b));
    extent.map(|e| e.max(0.1 * most))
}
