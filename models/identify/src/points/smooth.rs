//! Positions fitted with smooth functions, whose bend between and beside the points stands in the uncertainty.
//!
//! Place in the flow: beside [`super::fit_points_of_best_degree`], and as [`crate::identify`] does it from ranges: cubic splines,
//! each with a penalty on its curvature that the data choose ([`crate::smoothing`]). A polynomial whose degree is chosen takes
//! for granted that the errors are of that degree: on a grid of five places a smooth error departs from it between the places by
//! ten times what its covariance says, and in much noise by what the higher degrees would have held. A penalised spline has both
//! in its covariance. Start and robust weights come from the polynomials.

use super::certificate::{Certificate, widening};
use super::fit::{fit_points_of_best_degree, within};
use super::levenberg_marquardt::Descent;
use super::loss::Loss;
use super::outcome::{FittedPoints, Minimised, finish};
use super::plate::{fit_plates_of_best_degree, seen_of};
use super::poses::Plates;
use super::problem::Problem;
use super::{MeasuredPoint, Method, PointOptions, PointProgress, PointsError, error};
use crate::observability::Observability;
use crate::smoothing::{self, Smoothness, Solution};
use crate::solve::{MAX_REFINEMENTS, SATURATED, SETTLED, WEIGHING_PASSES, finer_kind};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::layout::{Layout, centre_of};
use abbe_geometry::machine::Machine;
use faer::Mat;
use std::ops::RangeInclusive;

/// Degrees of the polynomials that give start and weights.
const START_DEGREES: RangeInclusive<usize> = 1..=8;
/// Degree by which it is decided what a plate shows of an error: a bow.
const BOW: usize = 2;
/// Distance, in robust standard deviations, from which a point is a gross error: of normal ones, one in 10¹³.
const GROSS: f64 = 8.0;
/// Intervals of a spline where the machine file names none.
const INTERVALS: usize = 9;
/// Passes at most, and those in which the smoothness is chosen.
const MOST_PASSES: usize = 40;
const SMOOTHING_PASSES: usize = 8;

/// Fits smooth functions for every error that the machine file does not hold at zero, and the pose of the measuring frame.
///
/// # Errors
/// Points that are no measurement of this machine or cannot see its straight errors; a method that needs a fixed number of
/// coefficients; a fit that does not settle.
pub fn fit_points_smooth(
    machine: &Machine,
    points: &[MeasuredPoint],
    options: &PointOptions,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<FittedPoints, PointsError> {
    require_derivatives(options)?;
    let start = fit_points_of_best_degree(machine, points, START_DEGREES, options, observe)?;
    let plates = Plates::volume(points.len());
    let data = Data { points, plates: &plates, held: &[], loss: options.loss };
    data.fit(smooth(machine), start, observe)
}

/// The same of what plates support.
///
/// # Errors
/// Those of [`super::fit_plates`] and [`fit_points_smooth`].
pub fn fit_plates_smooth(
    machine: &Machine,
    points: &[MeasuredPoint],
    plates: &Plates,
    options: &PointOptions,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<FittedPoints, PointsError> {
    require_derivatives(options)?;
    let start = fit_plates_of_best_degree(machine, points, plates, START_DEGREES, options, observe)?;
    let (kept, not_seen, held) = seen_of(&super::fit::of_degree(machine, BOW), points, plates)?;
    let mut own = smooth(machine);
    own.kinds.iter_mut().zip(kept.kinds).filter(|(_, kept)| kept.is_none()).for_each(|(kind, _)| *kind = None);
    let data = Data { points, plates, held: &held, loss: options.loss };
    let fitted = data.fit(own, start, observe)?;
    Ok(FittedPoints { not_seen, ..fitted })
}

fn require_derivatives(options: &PointOptions) -> Result<(), PointsError> {
    match options.method {
        Method::LevenbergMarquardt => Ok(()),
        Method::Jade(_) => Err(PointsError::Choice(
            "JADE fits a fixed number of coefficients; choose polynomials or the machine file's functions",
        )),
    }
}

/// The machine with splines of as many intervals as its file names, else the usual number.
fn smooth(machine: &Machine) -> Machine {
    let spline = |kind: FunctionKind| match kind {
        FunctionKind::BSpline { .. } => kind,
        _ => FunctionKind::BSpline { intervals: INTERVALS },
    };
    let mut machine = machine.clone();
    machine.kinds = machine.kinds.map(|kind| kind.map(spline));
    machine
}

/// What is fitted to.
#[derive(Clone, Copy)]
struct Data<'a> {
    points: &'a [MeasuredPoint],
    plates: &'a Plates,
    /// Squareness angles that are held at zero, by their number.
    held: &'a [usize],
    loss: Loss,
}

/// Where the passes ended.
struct Settled {
    unknowns: Vec<f64>,
    solution: Solution,
    free: Vec<usize>,
    weights: Vec<f64>,
    scale: f64,
    largest_step: f64,
    steps: usize,
}

impl Settled {
    /// Whether the data use up nearly every coefficient on offer.
    fn lacks(&self, geometric: usize) -> bool {
        let own = self.free.iter().zip(&self.solution.effective).filter(|(index, _)| **index < geometric);
        let (offered, used) = own.fold((0.0, 0.0), |(offered, used), (_, effective)| (offered + 1.0, used + effective));
        used > SATURATED * offered
    }
}

impl Data<'_> {
    /// Fits, and tries finer splines while they are used up and the evidence is better on the same weights.
    fn fit(
        self,
        mut machine: Machine,
        start: FittedPoints,
        observe: &mut dyn FnMut(PointProgress) -> bool,
    ) -> Result<FittedPoints, PointsError> {
        let centre_m = centre_of(self.points.iter().map(|point| point.offset_m));
        let mut best = self.once(&machine, centre_m, start.weights.clone(), true, observe)?;
        for _ in 0..MAX_REFINEMENTS {
            if !best.lacks(Layout::new(&machine, centre_m)?.squareness().start) {
                break;
            }
            let mut finer = machine.clone();
            finer.kinds = finer.kinds.map(|kind| kind.map(finer_kind));
            let next = self.once(&finer, centre_m, best.weights.clone(), false, observe)?;
            if next.solution.minus_two_log_likelihood >= best.solution.minus_two_log_likelihood {
                break;
            }
            (machine, best) = (finer, next);
        }
        let layout = Layout::new(&machine, centre_m)?;
        let problem = self.problem(&machine, &layout)?;
        error::check_used(&best.weights, best.solution.effective.iter().sum::<f64>().ceil() as usize)?;
        finish(&problem, self.minimised(&problem, best, &start))
    }

    fn problem<'p>(&'p self, machine: &'p Machine, layout: &'p Layout) -> Result<Problem<'p>, PointsError> {
        let problem = Problem::of_plates(machine, layout, self.points, self.plates)?;
        let held: Vec<usize> = self.held.iter().map(|k| layout.squareness().start + k).collect();
        Ok(problem.holding(held))
    }

    /// Passes until the unknowns settle; weights follow the residuals where they may.
    fn once(
        &self,
        machine: &Machine,
        centre_m: [f64; 3],
        mut weights: Vec<f64>,
        weighs: bool,
        observe: &mut dyn FnMut(PointProgress) -> bool,
    ) -> Result<Settled, PointsError> {
        let layout = Layout::new(machine, centre_m)?;
        let problem = self.problem(machine, &layout)?;
        let free: Vec<usize> = (0..problem.unknowns()).filter(|k| !problem.held().contains(k)).collect();
        let mut smoothness = Smoothness::new(&layout);
        smoothness.priors =
            layout.ram_turn().zip(machine.u_ram_turn_rad).filter(|(index, _)| free.contains(index)).collect();
        let (mut unknowns, mut noise_factor) = (vec![0.0; problem.unknowns()], 1.0);
        let (mut largest_step, mut scale) = (f64::INFINITY, 1.0);
        for pass in 0..MOST_PASSES {
            let mut normal = problem.normal_of_points(&unknowns, &weights);
            normal.weight *= problem.dimensions() as f64;
            let chooses = pass < SMOOTHING_PASSES;
            let solution = smoothing::solve(&normal, &unknowns, &free, &mut smoothness, noise_factor, chooses)
                .map_err(|_| PointsError::Singular)?;
            if chooses {
                noise_factor = solution.noise_factor;
            }
            largest_step = solution.largest_step(&unknowns, &free);
            unknowns.clone_from(&solution.parameters);
            let effective: f64 = solution.effective.iter().sum();
            let found =
                if weighs { self.weighed(&problem, &unknowns, (&weights, effective)) } else { (weights.clone(), 1.0) };
            let objective = problem.objective(&unknowns, self.loss, found.1);
            if !observe(PointProgress { step: pass + 1, objective, spread: largest_step }) {
                return Err(PointsError::Stopped);
            }
            if largest_step < SETTLED && !chooses {
                return Ok(Settled { unknowns, solution, free, weights, scale, largest_step, steps: pass + 1 });
            }
            if pass < WEIGHING_PASSES {
                (weights, scale) = found;
            }
        }
        let remedy = "check the points for mixed-up offsets or readings";
        Err(PointsError::NotConverged { method: "smoothing", steps: MOST_PASSES, largest_step, remedy })
    }

    /// Weights of the loss at these unknowns, and the robust scale.
    fn weighed(&self, problem: &Problem, unknowns: &[f64], (before, effective): (&[f64], f64)) -> (Vec<f64>, f64) {
        match self.loss {
            Loss::Squares => (before.to_vec(), 1.0),
            Loss::Huber => {
                let scale = problem.scale(unknowns).max(f64::MIN_POSITIVE);
                let squares = problem.squares(unknowns);
                let mut weights = Loss::Huber.weights(&squares, unknowns.len(), scale);
                // What is that far off is no tail of the noise: it would still pull, and its square would widen all uncertainties.
                let is_gross = |square: f64| square.sqrt() > GROSS * scale;
                weights.iter_mut().zip(squares).filter(|(_, s)| is_gross(*s)).for_each(|(weight, _)| *weight = 0.0);
                (weights, scale)
            }
            Loss::Trimmed => {
                let used = before.iter().filter(|weight| **weight > 0.0).count();
                (within(problem, unknowns, effective / (3 * used.max(1)) as f64), 1.0)
            }
        }
    }

    fn minimised(&self, problem: &Problem, found: Settled, start: &FittedPoints) -> Minimised {
        let solution = &found.solution;
        // What the last step multiplies by again.
        let unscaled = 1.0 / widening(solution.noise_factor);
        let mut inverse = Mat::zeros(problem.unknowns(), problem.unknowns());
        for (i, row) in found.free.iter().enumerate() {
            for (j, column) in found.free.iter().enumerate() {
                inverse[(*row, *column)] = solution.covariance[(i, j)] * unscaled;
            }
        }
        let effective = solution.effective.iter().sum();
        let certificate =
            Certificate { inverse, chi2_per_dof: solution.noise_factor, largest_step: found.largest_step, effective };
        let objective = problem.objective(&found.unknowns, self.loss, found.scale);
        let seen =
            Observability { rank: problem.free(), unknowns: problem.free(), condition: start.evidence.condition };
        let descent = Descent {
            unknowns: found.unknowns,
            objective,
            scale: found.scale,
            weights: found.weights,
            steps: found.steps,
        };
        Minimised { descent, certificate, seen, search: (objective, found.steps, None) }
    }
}
