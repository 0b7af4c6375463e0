//! From measured positions to a model: checks, start, minimum, certificate.
//!
//! Place in the flow: the entry points of [`super`].

use super::certificate::{Certificate, certify};
use super::levenberg_marquardt::{Descent, descend, descend_at_scale};
use super::loss::Loss;
use super::outcome::{FittedPoints, Minimised, finish};
use super::problem::Problem;
use super::{MeasuredPoint, Method, PointOptions, PointProgress, PointsError, error, observable, search};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::layout::{Layout, centre_of};
use abbe_geometry::machine::Machine;
use std::ops::RangeInclusive;

/// Distance to the minimum, in standard uncertainties, up to which a point counts as it.
const AT_MINIMUM: f64 = 0.1;
/// Distance, in robust standard deviations, from which a point is an outlier after trimmed squares: one normal point in
/// 10⁵ lies beyond.
const CUT: f64 = 5.0;
/// Rounds in which outliers are decided again.
const REJECTIONS: usize = 20;
/// Share of the equations that a fit leaves free at the least, for the correction of the scale.
const LEAST_FREEDOM: f64 = 0.05;

/// Fits the machine's error functions, as its file names them, and the pose of the measuring frame.
///
/// After [`Loss::Trimmed`] the points beyond five robust deviations are rejected and the rest fitted by least squares, since
/// trimmed squares alone waste half of the data.
///
/// # Errors
/// Points that are no measurement of this machine or cannot see it; a search that did not reach a minimum.
pub fn fit_points(
    machine: &Machine,
    points: &[MeasuredPoint],
    options: &PointOptions,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<FittedPoints, PointsError> {
    error::check(machine, points)?;
    let layout = Layout::new(machine, centre_of(points.iter().map(|p| p.offset_m)))?;
    let unknowns = layout.len() + super::problem::FRAME;
    error::check_count(points.len(), options.loss, unknowns)?;
    error::check_positions(points)?;
    let problem = Problem::new(machine, &layout, points)?;
    fit_problem(&problem, options, observe)
}

/// From a problem to its minimum.
pub(super) fn fit_problem(
    problem: &Problem,
    options: &PointOptions,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<FittedPoints, PointsError> {
    let seen = observable::check(problem)?;
    let (descent, evaluations) = minimum(problem, options, observe)?;
    let certificate = certify(problem, &descent.unknowns, &descent.weights)?;
    if options.loss != Loss::Trimmed {
        require_minimum(options.method, &descent, &certificate)?;
    }
    let search = (descent.objective, descent.steps, evaluations);
    let (descent, certificate) = match options.loss {
        Loss::Trimmed => reweighted(problem, descent, observe)?,
        Loss::Squares | Loss::Huber => (descent, certificate),
    };
    finish(problem, Minimised { descent, certificate, seen, search })
}

/// The same with polynomials whose degree, one for all errors that the machine file does not hold at zero, has the
/// smallest Bayesian information criterion (Schwarz 1978) of those offered.
///
/// Degrees are compared by Levenberg-Marquardt; the chosen one is fitted as `options` ask.
///
/// # Errors
/// Those of [`fit_points`], where not even the lowest degree can be fitted.
pub fn fit_points_of_best_degree(
    machine: &Machine,
    points: &[MeasuredPoint],
    degrees: RangeInclusive<usize>,
    options: &PointOptions,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<FittedPoints, PointsError> {
    let quick = PointOptions { method: Method::LevenbergMarquardt, ..*options };
    let mut best: Option<(f64, usize)> = None;
    let lowest = *degrees.start();
    for degree in degrees {
        let fit = fit_points(&of_degree(machine, degree), points, &quick, observe);
        let bic = match fit {
            Ok(fit) => fit.evidence.bic,
            // A higher degree needs more points than a lower one: where one cannot be fitted, the next cannot either.
            Err(PointsError::TooFew { .. } | PointsError::RankDeficient { .. } | PointsError::Singular)
                if degree > lowest =>
            {
                break;
            }
            Err(problem) => return Err(problem),
        };
        if best.is_none_or(|(least, _)| bic < least) {
            best = Some((bic, degree));
        }
    }
    let (_, degree) = best.ok_or(PointsError::Choice("no degree was offered"))?;
    fit_points(&of_degree(machine, degree), points, options, observe)
}

/// The machine with polynomials of one degree for every error that it does not hold at zero.
pub(super) fn of_degree(machine: &Machine, degree: usize) -> Machine {
    let mut machine = machine.clone();
    machine.kinds = machine.kinds.map(|kind| kind.map(|_| FunctionKind::Polynomial { degree }));
    machine
}

/// Minimum of the objective, and how often it was evaluated where that was counted.
fn minimum(
    problem: &Problem,
    options: &PointOptions,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<(Descent, Option<usize>), PointsError> {
    let perfect = vec![0.0; problem.unknowns()];
    let squares = descend(problem, perfect, Loss::Squares, observe)?;
    match options.method {
        Method::LevenbergMarquardt => match options.loss {
            Loss::Squares => Ok((squares, None)),
            // Huber's loss is convex; from there half of the points are rightly told from the other.
            Loss::Huber => Ok((descend(problem, squares.unknowns, Loss::Huber, observe)?, None)),
            Loss::Trimmed => {
                let huber = descend(problem, squares.unknowns, Loss::Huber, observe)?;
                Ok((descend(problem, huber.unknowns, Loss::Trimmed, observe)?, None))
            }
        },
        Method::Jade(choices) => {
            let scale = match options.loss {
                Loss::Huber => descend(problem, squares.unknowns.clone(), Loss::Huber, observe)?.scale,
                Loss::Squares | Loss::Trimmed => 1.0,
            };
            let objective = (options.loss, scale);
            let (found, evaluations) = search::search(problem, &squares.unknowns, objective, &choices, observe)?;
            Ok((found, Some(evaluations)))
        }
    }
}

fn require_minimum(method: Method, descent: &Descent, certificate: &Certificate) -> Result<(), PointsError> {
    if certificate.largest_step <= AT_MINIMUM {
        return Ok(());
    }
    let (method, remedy) = match method {
        Method::LevenbergMarquardt => ("Levenberg-Marquardt", "check the points for mixed-up offsets or readings"),
        Method::Jade(_) => ("JADE", "allow more generations or more members, or use Levenberg-Marquardt"),
    };
    Err(PointsError::NotConverged { method, steps: descent.steps, largest_step: certificate.largest_step, remedy })
}

/// Least squares on what trimmed squares did not find to be outliers, decided again until the same points stay.
fn reweighted(
    problem: &Problem,
    trimmed: Descent,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<(Descent, Certificate), PointsError> {
    let fitted = super::loss::kept_points(problem.points.len(), trimmed.unknowns.len());
    let share = |fitted: usize| trimmed.unknowns.len() as f64 / (3 * fitted) as f64;
    let mut weights = within(problem, &trimmed.unknowns, share(fitted));
    let unknowns = trimmed.unknowns.len() as f64;
    let mut found = trimmed;
    for _ in 0..REJECTIONS {
        let kept = problem.with_weights(&weights);
        found = descend_at_scale(&kept, found.unknowns, Loss::Squares, 1.0, found.steps, observe)?;
        let used = weights.iter().filter(|weight| **weight > 0.0).count();
        let next = within(problem, &found.unknowns, unknowns / (3 * used) as f64);
        let settled = next == weights;
        // In the end the weights must be those of the fit.
        found.weights = weights;
        if settled {
            break;
        }
        weights = next;
    }
    error::check_used(&found.weights, found.unknowns.len())?;
    let certificate = certify(problem, &found.unknowns, &found.weights)?;
    require_minimum(Method::LevenbergMarquardt, &found, &certificate)?;
    Ok((found, certificate))
}

/// One for points within the cut, zero for outliers. The scale is the median over all points, corrected for what a fit takes out of
/// their residuals: the share of the equations that unknowns use up.
pub(super) fn within(problem: &Problem, unknowns: &[f64], share: f64) -> Vec<f64> {
    let squares = problem.squares(unknowns);
    let scale = problem.scale(unknowns) / (1.0 - share).max(LEAST_FREEDOM).sqrt();
    let limit = (CUT * scale.max(f64::MIN_POSITIVE)).powi(2);
    squares.iter().map(|s| if *s <= limit { 1.0 } else { 0.0 }).collect()
}
