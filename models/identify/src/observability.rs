//! Can this plan see every error? If not, which combinations are hidden?
//!
//! Place in the flow: after the first pass, before anything is fitted in earnest; [`crate::proposal`] finds the lines
//! that would help. Each error function is looked at through its first shapes (straight line and parabola), which
//! every sensible plan must determine; a rich spline would hide a hole in the plan behind its penalty. The problem
//! is equilibrated (unit diagonal), so the decision does not depend on units, noise or the number of readings.

use crate::design::{Estimate, Setup};
use crate::error::{IdentifyError, Unobservable};
use crate::normal::NormalEquations;
use crate::proposal;
use crate::spectrum::{Shape, Spectrum};
use abbe_geometry::ErrorId;
use abbe_geometry::error_function::{Basis, Closure};
use abbe_measurement::campaign::Campaign;
use faer::Mat;
use std::collections::BTreeSet;

/// Share of the strongest part from which an error is named as taking part.
const NAMED_SHARE: f64 = 0.25;
/// Length of a null vector's row below which nothing of the unknown is left in the null space.
const NOTHING_LEFT: f64 = 1e-6;

/// Length from which an unknown clearly takes part in the null space.
const CLEAR: f64 = 0.1;

/// Rank and condition of an accepted plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Observability {
    pub(crate) rank: usize,
    pub(crate) unknowns: usize,
    pub(crate) condition: f64,
}

/// Refuses a plan that cannot see all low-order unknowns.
pub(crate) fn check(
    estimate: &Estimate,
    campaign: &Campaign,
    normal: &NormalEquations,
    absolute: bool,
) -> Result<Observability, IdentifyError> {
    let shapes = shapes(&estimate.setup, &campaign.stations, absolute);
    let reduced = reduce(normal, &shapes);
    let spectrum = Spectrum::new(&reduced).ok_or(IdentifyError::Singular)?;
    let unknowns = shapes.len();
    let rank = unknowns - spectrum.unseen();
    if rank == unknowns {
        return Ok(Observability { rank, unknowns, condition: spectrum.condition() });
    }
    Err(IdentifyError::RankDeficient {
        groups: groups(&shapes, spectrum.null_space()),
        enough: enough(&shapes, spectrum.null_space()).unwrap_or_default(),
        lines: proposal::lines(estimate, campaign, &shapes, &reduced),
        rank,
        unknowns,
    })
}

/// Rank and condition of a normal matrix whose unknowns have these names, and the combinations that are not seen;
/// `None` if it cannot be decomposed.
pub(crate) fn named_rank(matrix: &Mat<f64>, names: &[String]) -> Option<(Observability, Vec<Unobservable>)> {
    let spectrum = Spectrum::new(matrix)?;
    let shape = |(k, name): (usize, &String)| Shape { name: name.clone(), of_station: None, entries: vec![(k, 1.0)] };
    let shapes: Vec<Shape> = names.iter().enumerate().map(shape).collect();
    let seen =
        Observability { rank: names.len() - spectrum.unseen(), unknowns: names.len(), condition: spectrum.condition() };
    Some((seen, groups(&shapes, spectrum.null_space())))
}

/// Line and parabola of each error, squareness angles, stations.
fn shapes(setup: &Setup, stations: &[String], absolute: bool) -> Vec<Shape> {
    let mut shapes = Vec::new();
    for id in ErrorId::all() {
        let Some(basis) = setup.layout.basis(id) else { continue };
        for power in powers(basis) {
            let entries = setup.layout.range(id).zip(basis.coefficients_of_power(power)).collect();
            shapes.push(Shape { name: id.name(), of_station: None, entries });
        }
    }
    for (entry, index) in setup.machine.squareness.iter().zip(setup.layout.squareness()) {
        shapes.push(Shape { name: entry.name.clone(), of_station: None, entries: vec![(index, 1.0)] });
    }
    for (k, station) in stations.iter().enumerate() {
        let count = if absolute { 3 } else { 4 };
        for (d, what) in ["x", "y", "z", "dead path"].into_iter().enumerate().take(count) {
            let index = setup.machine_parameters() + 4 * k + d;
            let name = format!("station {station} {what}");
            shapes.push(Shape { name, of_station: Some(what), entries: vec![(index, 1.0)] });
        }
    }
    shapes
}

/// Powers to look at: those that the closure leaves, as far as the basis has coefficients for them.
fn powers(basis: &Basis) -> Vec<i32> {
    let available: &[i32] = if basis.closure() == Closure::BothEnds { &[2] } else { &[1, 2] };
    available.iter().take(basis.len()).copied().collect()
}

/// Normal matrix of the shapes.
fn reduce(normal: &NormalEquations, shapes: &[Shape]) -> Mat<f64> {
    Mat::from_fn(shapes.len(), shapes.len(), |i, j| {
        let one =
            |(a, x): &(usize, f64)| shapes[j].entries.iter().map(|(b, y)| x * y * normal.entry(*a, *b)).sum::<f64>();
        shapes[i].entries.iter().map(one).sum()
    })
}

/// Errors that take part in each unseen combination.
///
/// The null space has no preferred basis, so each shape is ranked by how much of it lies in the null space, and
/// combinations are formed around the strongest shape that is left (a pivoted elimination).
fn groups(shapes: &[Shape], mut null: Mat<f64>) -> Vec<Unobservable> {
    let mut groups: Vec<Unobservable> = Vec::new();
    for _ in 0..null.ncols() {
        let lengths: Vec<f64> =
            (0..shapes.len()).map(|i| null.row(i).iter().map(|v| v * v).sum::<f64>().sqrt()).collect();
        let Some(pivot) = (0..shapes.len()).max_by(|a, b| lengths[*a].total_cmp(&lengths[*b])) else { break };
        if lengths[pivot] < NOTHING_LEFT {
            break;
        }
        let vector = take_out(&mut null, pivot, lengths[pivot]);
        let group = Unobservable { errors: named(shapes, &vector) };
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    groups
}

/// Errors that, held at zero, leave nothing of the null space; `None` where stations or squareness take part in what no error does. Angles go
/// first: of them, some are known to be small on most machines.
fn enough(shapes: &[Shape], mut null: Mat<f64>) -> Option<Vec<String>> {
    let error = |shape: &Shape| ErrorId::all().find(|id| id.name() == shape.name);
    let mut held = BTreeSet::new();
    loop {
        let length = |i: usize| null.row(i).iter().map(|v| v * v).sum::<f64>().sqrt();
        let left: Vec<(usize, f64)> = (0..shapes.len()).map(|i| (i, length(i))).filter(|of| of.1 > CLEAR).collect();
        if left.is_empty() {
            return Some(ErrorId::all().filter(|id| held.contains(id)).map(ErrorId::name).collect());
        }
        let longest = |is_wanted: &dyn Fn(ErrorId) -> bool| {
            let own = left.iter().filter(|(i, _)| error(&shapes[*i]).is_some_and(is_wanted));
            own.max_by(|a, b| a.1.total_cmp(&b.1)).copied()
        };
        let (pivot, length) = longest(&ErrorId::is_angular).or_else(|| longest(&|_| true))?;
        take_out(&mut null, pivot, length);
        held.extend(error(&shapes[pivot]));
    }
}

/// Removes from the null space the vector that holds all of the pivot, and returns it.
fn take_out(null: &mut Mat<f64>, pivot: usize, length: f64) -> Vec<f64> {
    let direction: Vec<f64> = null.row(pivot).iter().map(|v| v / length).collect();
    let along = |i: usize, null: &Mat<f64>| null.row(i).iter().zip(&direction).map(|(a, b)| a * b).sum::<f64>();
    let vector: Vec<f64> = (0..null.nrows()).map(|i| along(i, null)).collect();
    for (i, part) in vector.iter().enumerate() {
        for (j, d) in direction.iter().enumerate() {
            null[(i, j)] -= part * d;
        }
    }
    vector
}

/// Names of the parts that matter, strongest first, each once.
fn named(shapes: &[Shape], vector: &[f64]) -> Vec<String> {
    let strongest = vector.iter().fold(0.0_f64, |most, part| most.max(part.abs()));
    let mut parts: Vec<usize> = (0..shapes.len()).filter(|i| vector[*i].abs() > NAMED_SHARE * strongest).collect();
    parts.sort_by(|a, b| vector[*b].abs().total_cmp(&vector[*a].abs()));
    let mut names: Vec<String> = Vec::new();
    for &part in &parts {
        let name = match shapes[part].of_station {
            Some(what) if parts.iter().filter(|k| shapes[**k].of_station == Some(what)).count() > 1 => {
                format!("the stations' {what}")
            }
            _ => shapes[part].name.clone(),
        };
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}
