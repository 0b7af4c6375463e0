//! Positions on plates: what a plane supports is fitted, the rest is named and held at zero.
//!
//! Place in the flow: beside [`super::fit_points`] for points that fill no volume. Each pose of a plate has a frame of its own,
//! whose six numbers are fitted; where heights were not measured, three. Errors are taken in one after another, squareness and
//! positioning first: what moves the points only as those before it and the frames do is held at zero, with its name. The
//! plate is taken as it was calibrated.

use super::fit::{fit_problem, of_degree};
use super::outcome::NotSeen;
use super::poses::Plates;
use super::problem::{FRAME, Problem};
use super::{FittedPoints, Loss, MeasuredPoint, Method, PointOptions, PointProgress, PointsError, error};
use crate::linear::{Factor, symmetric_eigen};
use crate::normal::NormalEquations;
use abbe_geometry::layout::{Layout, centre_of};
use abbe_geometry::machine::Machine;
use abbe_geometry::{Axis, ErrorId};
use faer::Mat;
use std::ops::{Range, RangeInclusive};

/// Share of a direction's information that errors taken before must leave of it.
const LEFT: f64 = 1e-7;
/// Fits what the plates support of the machine's error functions, as its file names them.
///
/// # Errors
/// Points that are no measurement of this machine, or show nothing of it; a loss or a method that is not for plates.
pub fn fit_plates(
    machine: &Machine,
    points: &[MeasuredPoint],
    plates: &Plates,
    options: &PointOptions,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<FittedPoints, PointsError> {
    if options.method != Method::LevenbergMarquardt || options.loss == Loss::Trimmed {
        let what = "plates are fitted by Levenberg-Marquardt with the loss huber or squares; leave the others out";
        return Err(PointsError::Choice(what));
    }
    error::check(machine, points)?;
    for pose in 0..plates.poses() {
        let own: Vec<MeasuredPoint> = plates.members(pose).map(|k| points[k]).collect();
        error::check_positions(&own)?;
    }
    let centre_m = centre_of(points.iter().map(|point| point.offset_m));
    let whole = Layout::new(machine, centre_m)?;
    let Seen { kept, not_seen, held } = seen(&Problem::of_plates(machine, &whole, points, plates)?)?;
    let layout = Layout::new(&kept, centre_m)?;
    let problem = Problem::of_plates(&kept, &layout, points, plates)?;
    let held: Vec<usize> = held.into_iter().map(|k| layout.squareness().start + k).collect();
    let problem = problem.holding(held);
    let equations = problem.dimensions() * points.len();
    if equations <= problem.free() {
        return Err(PointsError::TooFew { points: points.len(), equations, unknowns: problem.free() });
    }
    let fitted = fit_problem(&problem, options, observe)?;
    Ok(FittedPoints { not_seen, ..fitted })
}

/// The same with polynomials of the degree that the data choose (BIC) among those offered.
///
/// # Errors
/// Those of [`fit_plates`], where not even the lowest degree can be fitted.
pub fn fit_plates_of_best_degree(
    machine: &Machine,
    points: &[MeasuredPoint],
    plates: &Plates,
    degrees: RangeInclusive<usize>,
    options: &PointOptions,
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> Result<FittedPoints, PointsError> {
    let mut best: Option<FittedPoints> = None;
    let lowest = *degrees.start();
    for degree in degrees {
        match fit_plates(&of_degree(machine, degree), points, plates, options, observe) {
            Ok(fit) if best.as_ref().is_none_or(|best| fit.evidence.bic < best.evidence.bic) => best = Some(fit),
            Ok(_) => {}
            // A higher degree needs more points than a lower one: where one cannot be fitted, the next cannot either.
            Err(
                PointsError::TooFew { .. }
                | PointsError::RankDeficient { .. }
                | PointsError::NotConverged { .. }
                | PointsError::Singular,
            ) if degree > lowest => {
                break;
            }
            Err(problem) => return Err(problem),
        }
    }
    best.ok_or(PointsError::Choice("no degree was offered"))
}

/// The machine with what plates do not show held at zero, the names of that, and the squareness angles among it.
pub(super) fn seen_of(
    machine: &Machine,
    points: &[MeasuredPoint],
    plates: &Plates,
) -> Result<(Machine, Vec<NotSeen>, Vec<usize>), PointsError> {
    let layout = Layout::new(machine, centre_of(points.iter().map(|point| point.offset_m)))?;
    let Seen { kept, not_seen, held } = seen(&Problem::of_plates(machine, &layout, points, plates)?)?;
    Ok((kept, not_seen, held))
}

/// What the points see of a machine.
struct Seen {
    /// The machine with what they do not see held at zero.
    kept: Machine,
    not_seen: Vec<NotSeen>,
    /// Squareness angles that are held, by their number.
    held: Vec<usize>,
}

/// Takes in one error after another.
fn seen(problem: &Problem) -> Result<Seen, PointsError> {
    let normal = problem.normal_of_points(&vec![0.0; problem.unknowns()], &vec![1.0; problem.points.len()]);
    let layout = problem.layout;
    let mut taken: Vec<usize> = (layout.len()..layout.len() + FRAME * problem.alignments.len())
        .filter(|k| !problem.held().contains(k))
        .collect();
    let mut kept = problem.machine.clone();
    let (mut not_seen, mut held) = (Vec::new(), Vec::new());
    for block in blocks(problem) {
        let own: Vec<usize> = block.range.clone().collect();
        if own.is_empty() {
            continue;
        }
        let moves = own.iter().any(|k| normal.entry(*k, *k) > 0.0);
        if moves && is_left(&normal, &taken, &own)? {
            taken.extend(own);
            continue;
        }
        let because = match moves {
            false => "it moves none of these points",
            true => "it moves these points only as their poses and what was taken in before it do",
        };
        not_seen.push(NotSeen { name: block.name, because: because.to_owned() });
        match block.of {
            Of::Error(id) => kept.kinds[id.index()] = None,
            Of::Squareness(k) => held.push(k),
        }
    }
    if taken.len() == FRAME * problem.alignments.len() - problem.held().len() {
        return Err(PointsError::Choice(
            "the points show no error of the machine; measure points of a plate in a plane along two axes",
        ));
    }
    Ok(Seen { kept, not_seen, held })
}

/// Whether enough is left of all directions of a block beside what was taken.
fn is_left(normal: &NormalEquations, taken: &[usize], own: &[usize]) -> Result<bool, PointsError> {
    let scale = |k: usize| {
        let square = normal.entry(k, k);
        if square > 0.0 { square.sqrt().recip() } else { 0.0 }
    };
    if own.iter().any(|k| scale(*k) == 0.0) {
        return Ok(false);
    }
    let equal = |rows: &[usize], columns: &[usize]| {
        let one = |i: usize, j: usize| normal.entry(rows[i], columns[j]) * scale(rows[i]) * scale(columns[j]);
        Mat::from_fn(rows.len(), columns.len(), one)
    };
    let factor = Factor::new(&equal(taken, taken)).map_err(|_| PointsError::Singular)?;
    let across = equal(taken, own);
    let solved: Vec<Vec<f64>> =
        (0..own.len()).map(|j| factor.solve(&(0..taken.len()).map(|i| across[(i, j)]).collect::<Vec<f64>>())).collect();
    let alone = equal(own, own);
    let left = Mat::from_fn(own.len(), own.len(), |i, j| {
        alone[(i, j)] - (0..taken.len()).map(|k| across[(k, i)] * solved[j][k]).sum::<f64>()
    });
    let left = Mat::from_fn(own.len(), own.len(), |i, j| 0.5 * (left[(i, j)] + left[(j, i)]));
    let (values, _) = symmetric_eigen(&left).ok_or(PointsError::Singular)?;
    let (whole, _) = symmetric_eigen(&alone).ok_or(PointsError::Singular)?;
    // A block that can hardly be told from itself (a high degree on a short way) is judged by its own weakest direction.
    let weakest = whole.first().copied().unwrap_or(0.0).max(0.0);
    Ok(values.first().is_some_and(|least| *least > LEFT * weakest.max(LEFT)))
}

/// An error function or a squareness angle.
struct Block {
    name: String,
    of: Of,
    range: Range<usize>,
}

#[derive(Debug, Clone, Copy)]
enum Of {
    Error(ErrorId),
    Squareness(usize),
}

/// All errors, those first that a plate is measured for: squareness, positioning, straightness, angles.
fn blocks(problem: &Problem) -> Vec<Block> {
    let layout = problem.layout;
    let first = layout.squareness().start;
    let angle = |(k, own): (usize, &abbe_geometry::machine::Squareness)| Block {
        name: own.name.clone(),
        of: Of::Squareness(k),
        range: first + k..first + k + 1,
    };
    let mut blocks: Vec<Block> = problem.machine.squareness.iter().enumerate().map(angle).collect();
    let linear = |a: Axis, b: Axis| ErrorId::linear(a, b);
    let positioning: Vec<ErrorId> = Axis::ALL.into_iter().map(|axis| linear(axis, axis)).collect();
    let is_angular = |id: &ErrorId| id.is_angular();
    let straightness = ErrorId::all().filter(|id| !is_angular(id) && !positioning.contains(id));
    let ids: Vec<ErrorId> =
        positioning.iter().copied().chain(straightness).chain(ErrorId::all().filter(is_angular)).collect();
    blocks.extend(ids.into_iter().map(|id| Block { name: id.name(), of: Of::Error(id), range: layout.range(id) }));
    blocks
}
